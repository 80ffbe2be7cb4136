"""Smooth field around a closed surface, as a tube, which views of it are tested with.

Splines run around the axis of the ring that the nodes make, where they are periodic, and along it;
the field does not change away from the axis. In space the slope by the way around, ``s = R phi``,

    grad N = N,s (R / r) e_phi + N,y e_y,

is told along three fixed directions, as `sldvexp.verdict.smooth_field` tells it of other surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array
from sldvexp.verdict.smooth_field import DEGREE, SmoothField, product, splines_on

#: Smallest over largest distance from the axis of a surface that runs around it.
HOLLOW = 0.3
#: Widest gap around the axis, rad, of a surface that is closed.
GAP = np.pi / 2


@dataclass(frozen=True, eq=False)
class FieldAround(SmoothField):
    """Basis functions of a smooth vector field near a surface that runs around its third axis."""

    @classmethod
    def on(cls, surface: Array, intervals: int) -> SmoothField:
        """Lay knots over a surface that is closed around an axis, and along axes over any other."""
        straight = SmoothField.on(surface, intervals)
        if any(k is None for k in straight.knots):
            return straight
        along = (surface - straight.middle) @ straight.axes.T
        distance = [np.linalg.norm(np.delete(along, i, axis=1), axis=1) for i in range(3)]
        about = max(range(3), key=lambda i: distance[i].min() / distance[i].max())
        order = [*np.delete(np.arange(3), about), about]
        x, z, _ = along[:, order].T
        r, angle = distance[about], np.sort(np.arctan2(x, z))
        gap = np.diff(np.r_[angle, angle[0] + 2 * np.pi]).max()
        if r.min() < HOLLOW * r.max() or gap > GAP:
            return straight
        width = np.ptp(along, axis=0).max() / intervals
        cells = max(int(np.ceil(2 * np.pi * r.mean() / width)), 2 * DEGREE)
        # exactly -pi and pi at both ends, which are angles too
        around = np.pi * (2 * np.arange(-DEGREE, cells + DEGREE + 1) / cells - 1)
        knots = (around, straight.knots[about])
        return cls(straight.middle, straight.axes[order], knots)

    @property
    def count(self) -> int:
        """Number of functions."""
        around, along = (len(k) - DEGREE - 1 for k in self.knots if k is not None)
        return (around - DEGREE) * along

    def evaluate(self, points: Array) -> tuple[Array, list[tuple[Array, Array]]]:
        """Evaluate the basis functions and their slopes; see `SmoothField`."""
        x, z, y = ((points - self.middle) @ self.axes.T).T
        around, along = (k for k in self.knots if k is not None)
        count = len(around) - DEGREE - 1
        same = np.arange(count) % (count - DEGREE) == np.arange(count - DEGREE)[:, None]
        value, turn = splines_on(np.arctan2(x, z), around) @ same.T
        of_y, by_y = splines_on(y, along)
        # e_phi / r = (z, -x) / r^2 along the first two axes
        by_angle, squared = product([turn, of_y]), (x**2 + z**2)[:, None]
        slopes = [
            (self.axes[0], z[:, None] / squared * by_angle),
            (self.axes[1], -x[:, None] / squared * by_angle),
            (self.axes[2], product([value, by_y])),
        ]
        return product([value, of_y]), slopes

    def values(self, points: Array) -> Array:
        """Evaluate the basis functions alone; see `SmoothField`."""
        return self.evaluate(points)[0]
