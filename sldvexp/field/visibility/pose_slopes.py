"""Derivatives of what a view sees by its pose, at many samples at once.

A small rotation w and a displacement t of the origin move a point in the laser frame by ``w x P - R
t``. Each mirror's angle grows along a unit vector e, by one over the distance from that mirror's
axis, and turns the beam's direction d along it:

    e = (0, cos ud, -sin ud), (cos lr, -sin lr sin ud, -sin lr cos ud),
    A = da/dP = e / (hypot(y, z), hypot(x, hypot(y, z) + offset)),  N = dd/da = e (cos lr, 1).

An angle then changes by ``w . (P x A) - t . R' A``, and ``D = -R' d`` by ``R' (w x d - N da)``.
Arrays have the sample last, so that a component of all samples is one operation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.field.visibility.projection import CYCLES, angle_slope, to_laser
from sldvexp.field.visibility.view import View
from sldvexp.laser import TwoMirror
from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True, eq=False)
class PoseSlopes:
    """Samples of a view, with all that its derivatives by the pose are made of.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
        The matrix R.
    point, direction : ndarray, shape (3, sample)
        P and d.
    by_point, by_angle : ndarray, shape (mirror, 3, sample)
        A and N.
    by_step : ndarray, shape (mirror, sample), rad/step
        Change of the angle with the DAC step.
    known : ndarray of bool, shape (sample,)
        Whether there is an image point.
    """

    rotation: Array
    point: Array
    direction: Array
    by_point: Array
    by_angle: Array
    by_step: Array
    known: BoolArray

    @classmethod
    def from_points(cls, view: View, laser: TwoMirror, points: Array, dac: Array) -> PoseSlopes:
        """Differentiate at points in the world, shape (sample, 3), m, and their image points.

        Parameters
        ----------
        dac : ndarray, shape (sample, 2), steps
            NaN where there is no image point; all derivatives are 0 there.
        """
        laser = view.laser(laser)
        known = np.isfinite(dac[:, 0]) & np.isfinite(dac[:, 1])
        by_step = angle_slope(laser, np.where(known[:, None], dac, 0.0)).T.copy()
        point = to_laser(view, points).T
        x, y, z = point
        radius = np.hypot(y, z)
        reach = radius + laser.mirror_offset
        distance = np.hypot(x, reach)
        sine_ud, cosine_ud = y / radius, z / radius
        sine_lr, cosine_lr = x / distance, reach / distance
        direction = np.stack([sine_lr, cosine_lr * sine_ud, cosine_lr * cosine_ud])
        e = np.stack(
            [
                [np.zeros_like(x), cosine_ud, -sine_ud],
                [cosine_lr, -sine_lr * sine_ud, -sine_lr * cosine_ud],
            ]
        )
        by_point = e / np.stack([radius, distance])[:, None]
        by_angle = e * np.stack([cosine_lr, np.ones_like(x)])[:, None]
        return cls(view.rotation, point, direction, by_point, by_angle, by_step, known)

    def angles(self) -> Array:
        """Differentiate both mirrors' angles by w and t, shape (mirror, 6, sample)."""
        p, a = self.point, self.by_point
        found = np.empty((2, 6, p.shape[1]))
        for i, j, k in CYCLES:
            found[:, i] = p[j] * a[:, k] - p[k] * a[:, j]
        found[:, 3:] = -self.rotation.T @ a
        return self._where_known(found)

    def dac(self) -> Array:
        """Differentiate image points, shape (mirror, 6, sample), steps/rad and steps/m."""
        return self.angles() / self.by_step[:, None]

    def directions(self) -> Array:
        """Differentiate directions D, shape (3, 6, sample), 1/rad and 1/m."""
        n, angles, d = self.by_angle, self.angles(), self._where_known(self.direction)
        turned = np.stack([n[0, i] * angles[0] + n[1, i] * angles[1] for i in range(3)])
        for i, j, k in CYCLES:
            turned[j, i] += d[k]
            turned[k, i] -= d[j]
        return -(self.rotation.T @ turned.reshape(3, -1)).reshape(turned.shape)

    def change(self, slope: Array, velocity: Array) -> Array:
        """Differentiate ``v - D . u``, without the derivatives of v and D apart.

        With ``c = R u``, ``f = dv/da + N . c`` and ``g = A' f`` this is
        ``w . (P x g - d x c) - t . R' g``.

        Parameters
        ----------
        slope : ndarray, shape (mirror, column, sample)
            Of the image's velocity v by the DAC steps.
        velocity : ndarray, shape (3, column, sample)
            u, in world axes.

        Returns
        -------
        ndarray, shape (6, column, sample)
        """
        p, d, a, n = self.point, self.direction, self.by_point, self.by_angle
        c = (self.rotation @ velocity.reshape(3, -1)).reshape(velocity.shape)
        f = [
            slope[i] / self.by_step[i] + sum(n[i, j] * c[j] for j in range(i == 0, 3))
            for i in range(2)
        ]
        g = np.stack([a[0, j] * f[0] + a[1, j] * f[1] for j in range(3)])
        found = np.empty((6, *slope.shape[1:]))
        for i, j, k in CYCLES:
            found[i] = p[j] * g[k] - p[k] * g[j] - d[j] * c[k] + d[k] * c[j]
        found[3:] = -(self.rotation.T @ g.reshape(3, -1)).reshape(g.shape)
        return self._where_known(found)

    def _where_known(self, found: Array) -> Array:
        """Put zeros where there is no image point; mostly there is one everywhere."""
        return found if self.known.all() else np.where(self.known, found, 0.0)
