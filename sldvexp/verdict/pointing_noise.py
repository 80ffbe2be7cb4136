"""Pointing noise of the mirrors, told from other noise by where the misfit of the views is large.

A pixel whose mirrors come to rest a random angle s beside their step has the velocity of a place
beside it. In whitened numbers its variance is ``1 + s^2 (g_1^2 + g_2^2)``, g the derivatives of its
velocity by turns of the laser about both mirrors' axes: large where the image is steep, and only in
phase with the motion. Noise that is stated too small is larger everywhere, ``1 + c``. The
likelihood of the residuals decides between both.
"""

from __future__ import annotations

import numpy as np

from sldvexp.field.visibility.projection import angle_slope
from sldvexp.laser import TwoMirror
from sldvexp.typing import Array
from sldvexp.verdict.explanation import LARGE_MISFIT
from sldvexp.verdict.joint_fit import JointFit
from sldvexp.verdict.pixel_data import PixelData

#: Angles that are tried, rad.
ANGLES = np.geomspace(1e-7, 1e-2, 201)
#: Twice the logarithm of the likelihoods' ratio from which pointing is named.
SURE = 20.0


def pointing_noise(fit: JointFit, laser: TwoMirror) -> float | None:
    """Estimate the pointing noise that explains a misfit, DAC steps; None if other noise does it.

    Parameters
    ----------
    laser : TwoMirror
        As configured; see `View.laser`.
    """
    square, slope, step = [], [], []
    for k in fit.views:
        data, design = fit.data[k], fit.designs[k]
        square.append(np.square(fit.residual[k]).ravel())
        turns = design.pose_columns(fit.m)[:, :2]
        slope.append(np.square(turns).sum(axis=1).ravel())
        step.append(mean_angle(data, laser))
    r2, g2 = np.concatenate(square), np.concatenate(slope)
    left = fit.dof / len(r2)
    even = _surprise(r2, left * max(1.0, r2.mean() / left) * np.ones_like(r2))
    tried = np.array([_surprise(r2, left * (1 + s**2 * g2)) for s in ANGLES])
    best = int(tried.argmin())
    remains = float(np.mean(r2 / (1 + ANGLES[best] ** 2 * g2)) / left)
    if even - tried[best] < SURE or best in (0, len(ANGLES) - 1) or remains > LARGE_MISFIT:
        return None
    return float(ANGLES[best] / np.mean(step))


def mean_angle(data: PixelData, laser: TwoMirror) -> float:
    """Average the angle of a DAC step over the pixels of a view, rad."""
    slope = angle_slope(data.view.laser(laser), data.view.dac[data.pixel])
    return float(np.abs(slope).mean())


def _surprise(square: Array, variance: Array) -> float:
    """Compute minus twice the logarithm of the likelihood, but for a constant."""
    return float(np.sum(np.log(variance) + square / variance))
