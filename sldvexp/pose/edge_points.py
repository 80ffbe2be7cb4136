"""Edge points of one view as its pose's adjustment takes them: beams, circles and their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.laser import TwoMirror
from sldvexp.targets import Circles
from sldvexp.typing import Array, IndexArray


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Edge points of one view with the circle each belongs to.

    Parameters
    ----------
    angle : ndarray, shape (n, 2), rad
        By the nominal calibration.
    along : ndarray, shape (n, 2), rad
        Change of the angles along the scan line for one standard error of the edge.
    center : ndarray, shape (n, 3), m
        Of the point's circle, in the world.
    normal : ndarray, shape (n, 3)
        Unit normal of the circle's plane, in the world.
    radius : ndarray, shape (n,), m
    in_plane : ndarray, shape (n, 2, 3)
        Unit vectors of the circle's plane, in the world.
    circle : ndarray of int, shape (n,)
        Index of the circle, from 0, the same in all views.
    std : ndarray, shape (n,), DAC steps
        Standard error of each edge along its scan line, with the mirrors' pointing noise.
    step : ndarray, shape (2,), rad
        Angle of one DAC step of each mirror.
    growth : ndarray, shape (n, 2)
        How far independent errors of a circle's uneven motion move all its edges together along
        their scan lines, in standard errors of each edge (`sldvexp.image.uneven_motion`).
    """

    angle: Array
    along: Array
    center: Array
    normal: Array
    radius: Array
    in_plane: Array
    circle: IndexArray
    std: Array
    step: Array
    growth: Array

    @classmethod
    def from_dac(
        cls,
        target: Circles,
        laser: TwoMirror,
        number: ArrayLike,
        dac: ArrayLike,
        direction: ArrayLike,
        std: ArrayLike,
        growth_std: ArrayLike = 0.0,
    ) -> EdgePoints:
        """Take edges in DAC steps, each of a circle of the calibration object.

        Parameters
        ----------
        number : array_like of int, shape (n,)
            Circle of each edge, as the target numbers it.
        dac : array_like, shape (n, 2), DAC steps
            Edge points (up_down, left_right).
        direction : array_like, shape (n, 2)
            Unit vectors of the scan lines, along which the edges err.
        std : array_like, shape (n,), DAC steps
            Standard error along the scan line.
        growth_std : array_like, broadcastable to (n, 2), DAC steps
            As in `sldvexp.image.ScanLineEdges`.
        """
        numbers, unit = sorted(target.circles), target.unit.value
        dac, direction, std = (np.asarray(a, float) for a in (dac, direction, std))
        circle = np.searchsorted(numbers, np.asarray(number))
        features = [target.circles[n] for n in numbers]
        planes = [target.planes[c.plane] for c in features]
        axes = np.array([p.axes() for p in planes])
        center = [
            unit * (np.array(p.origin) + c.x * own[0] + c.y * own[1])
            for p, c, own in zip(planes, features, axes, strict=True)
        ]
        radius = np.array([unit * c.diameter / 2 for c in features])
        angle, along = angles_along(laser, dac, direction, std)
        return cls(
            angle=angle,
            along=along,
            center=np.array(center)[circle],
            normal=axes[circle, 2],
            radius=radius[circle],
            in_plane=axes[circle, :2],
            circle=circle,
            std=std,
            step=laser.step,
            growth=np.broadcast_to(growth_std, (len(std), 2)) / std[:, None],
        )

    @property
    def axes(self) -> Array:
        """Axes of the circle's plane, its normal last, in the world, shape (n, 3, 3)."""
        return np.concatenate([self.in_plane, self.normal[:, None]], axis=1)

    def decorrelated(self, values: Array, outwards: Array) -> Array:
        """Take out of residuals over their standard errors what the edges of a circle share.

        With ``V = growth`` their covariance is ``1 + V V'``, and with ``V = P S R'`` its inverse
        square root ``1 + P (1 / sqrt(1 + S^2) - 1) P'``, of unit covariance.

        Parameters
        ----------
        values : ndarray, shape (n, k)
            Residuals, or their derivatives.
        outwards : ndarray, shape (n,)
            1 where the scan line leaves the circle, -1 where it enters, 0 where it is not known.
        """
        if not self.growth.any():
            return values
        free = values.copy()
        for number in np.unique(self.circle):
            own = self.circle == number
            base, size, _ = np.linalg.svd(outwards[own, None] * self.growth[own], False)
            less = 1.0 / np.hypot(1.0, size) - 1.0
            free[own] += base @ (less[:, None] * (base.T @ values[own]))
        return free


def angles_along(laser: TwoMirror, dac: Array, direction: Array, std: Array) -> tuple[Array, Array]:
    """Give the angles of edge points, and their change for a standard error along the scan line."""
    step = direction * std[:, None]
    angle = laser.angle_from_dac(dac)
    return angle, laser.angle_from_dac(dac + step / 2) - laser.angle_from_dac(dac - step / 2)
