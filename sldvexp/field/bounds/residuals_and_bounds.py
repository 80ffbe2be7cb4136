"""Second way through the samples, with the solution: residuals and bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.field.bounds.inverse import WholeInverse
from sldvexp.field.bounds.mode_effect import kept_columns
from sldvexp.field.bounds.near_inverse import NearInverse, NearRows
from sldvexp.field.bounds.node_variance import Bounds
from sldvexp.field.bounds.pose_uncertainty import PoseEffect
from sldvexp.field.bounds.residuals import Residuals
from sldvexp.field.bounds.sparse_inverse_rows import rings_of
from sldvexp.field.bounds.verification import Verification
from sldvexp.field.equations.regions import Parts
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.equations.system import Solve, System
from sldvexp.field.streaming.frequency_modes import FrequencyModes
from sldvexp.field.visibility.view import View
from sldvexp.typing import Array, BoolArray

#: Parts in which bounds of some nodes are verified.
VERIFIED_PARTS = 2


@dataclass(frozen=True, eq=False)
class Second:
    """What the second way finds.

    Attributes
    ----------
    residuals : Residuals
    noise : ndarray, shape (layer, surface_node, parameter, frequency), optional
        Variance from the pixels' noise, of a real part.
    pose : ndarray, shape (layer, surface_node, parameter, column), optional
        Variance from the poses.
    expected : ndarray, shape (equation, frequency), optional
        Sum of squares that the noise lets expect.
    error : float
        Largest relative error of a standard error found where it was computed exactly.
    efficiency : ndarray, shape (layer, surface_node, component), optional
        Gauss-Markov bound over variance.
    """

    residuals: Residuals
    noise: Array | None
    pose: Array | None
    expected: Array | None
    error: float
    efficiency: Array | None


def residuals_only(parts: Parts, theta: Array, data: list[Array]) -> Second:
    """Go through the samples without computing bounds."""
    left = Residuals.empty(parts.model, len(data), theta.shape[-1])
    for part in parts.disjoint():
        left.add(part, theta, data)
    return Second(left, None, None, None, np.nan, None)


def with_bounds(
    parts: Parts,
    system: System,
    solve: Solve,
    theta: Array,
    data: list[Array],
    determined: BoolArray,
    factor: Array,
    pose: PoseEffect | None,
) -> Second:
    """Go through the samples and compute bounds as well.

    Parameters
    ----------
    parts : Parts
    system : System
    solve : Solve
    theta : ndarray, shape (layer, surface_node, parameter, column)
    data : list of ndarray, shape (pixel, column)
    determined : ndarray of bool, shape (layer, surface_node, parameter)
    factor : ndarray, shape (view, frequency)
        Each frequency's variance over the mean of all.
    pose : PoseEffect, optional
        None if the poses have no covariance.
    """
    looks, model = parts.looks, parts.model
    left = Residuals.empty(model, len(data), theta.shape[-1])
    factors, group = np.unique(factor, axis=0, return_inverse=True)
    found = Bounds.empty(looks, model, group.ravel(), kept_columns(pose))
    small = system.small
    rings = rings_of(looks.rule)
    whole = WholeInverse.of(system, model.parameters) if small else NearInverse.of(system, rings)
    errors: list[float] = [0.0] if small else []
    for part in parts.overlapping(rings, whole=small):
        left.add(part, theta, data)
        rows = whole.of_part(part)
        found.add_noise(part, rows)
        found.add_efficiency(part)
        right = None if pose is None else pose.right_sides(part)
        if pose is not None and right is not None:
            found.pose[:, part.region.own] = pose.variance(rows.times(right))
        if isinstance(rows, NearRows) and len(errors) < VERIFIED_PARTS:
            noise = found.noise.sum(axis=3)
            check = Verification(part, pose, right, noise, found.pose, determined)
            errors.append(check.largest_error(rows, system, solve))
    variance = None if pose is None else found.pose
    expected = 2 * found.expected @ factors
    return Second(left, found.noise @ factors, variance, expected, max(errors), found.efficiency)


def variance_factors(views: Sequence[View], pixel_std: tuple[Array, ...]) -> Array:
    """Each frequency's variance over the mean of all, shape (view, frequency).

    White noise has the same variance at all frequencies, or differs by a factor that all pixels of
    a view have in common; this factor is taken from the pixels' mean.
    """
    factors = []
    for view, std in zip(views, pixel_std, strict=True):
        frequencies = view.velocity.shape[1]
        if view.std.ndim == 1 or frequencies == 1:
            factors.append(np.ones(frequencies))
            continue
        mean = np.mean(view.std[view.usable] ** 2, axis=0)
        total = np.mean(std[view.usable] ** 2)
        factors.append(mean / total if total > 0 else np.ones(frequencies))
    return np.array(factors)


def pose_effect(
    model: FieldModel,
    theta: Array,
    data: list[Array],
    factor: Array,
    covariance: Array | None,
) -> PoseEffect | None:
    """What the poses' covariance does to the velocities; None if it is not known."""
    if covariance is None:
        return None
    total = np.array([np.sum(std**2) for std in model.pixel_std])
    modes = FrequencyModes.of(data, np.repeat(total @ factor, 2))
    return PoseEffect.of(covariance, modes, theta, data)
