"""Coordinates on a plane or on a cylinder: where beams meet it, and its local axes.

The surface at the height z above the given one consists of the points

    P(s, t, z) = center + (x, y, h)' axes,   x = (r + z) sin(s/r), y = t, h = (r + z) cos(s/r) - r,

with the arc s along the first axis, t along the second and the radius r; a plane is r -> infinity.
The local axes t1, t2, n at (s, t) point along s, along t and along the normal. The curvature of the
given surface is k = 1/r along s and none along t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.shell.chart import Chart, LocalForms
from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True, eq=False)
class CylinderChart(Chart):
    """Coordinates (s, t) of a surface that bends along s alone, or not at all.

    Parameters
    ----------
    center : ndarray, shape (3,), m
        Where s = t = 0, in the world.
    axes : ndarray, shape (3, 3)
        Rows: s, t and the normal there, in the world.
    curvature : float, 1/m
        Along s; positive where the normals spread.
    """

    center: Array
    axes: Array
    curvature: float = 0.0

    def place(self, points: Array) -> tuple[Array, Array]:
        """Find coordinates and heights of points, in closed form; see `Chart`.

        Examples
        --------
        >>> import numpy as np
        >>> from sldvexp.shell import CylinderChart
        >>> chart = CylinderChart(np.zeros(3), np.eye(3), 2.0)
        >>> coordinates, height = chart.place(np.array([[0.6, 0, -0.5]]))
        >>> coordinates.round(4).tolist(), height.round(4).tolist()
        ([[0.7854, 0.0]], [0.1])
        """
        (x, t, h), k = ((points - self.center) @ self.axes.T).T, self.curvature
        arc = np.arctan2(k * x, 1 + k * h) / k if k else x
        # hypot(x, h + r) - r, without the digits that a nearly flat surface would lose
        height = (k * (x**2 + h**2) + 2 * h) / (1 + np.hypot(k * x, 1 + k * h))
        return np.column_stack([arc, t]), height

    def points(self, coordinates: Array, height: float) -> Array:
        """Find the points at coordinates and a height; see `Chart`."""
        (s, t), k = coordinates.T, self.curvature
        # (cos(k s) - 1) / k and sin(k s) / k, also for k = 0
        sagitta = -k * s**2 * np.sinc(k * s / (2 * np.pi)) ** 2 / 2
        across = s * np.sinc(k * s / np.pi)
        angle = k * s
        local = [across + height * np.sin(angle), t, sagitta + height * np.cos(angle)]
        return np.asarray(self.center + np.stack(local, axis=-1) @ self.axes)

    def frames(self, coordinates: Array) -> Array:
        """Compute the local axes; see `Chart`."""
        angle = coordinates[:, 0] * self.curvature
        cosine, sine, zero = np.cos(angle), np.sin(angle), np.zeros(len(angle))
        local = np.stack(
            [
                np.stack([cosine, zero, -sine], axis=-1),
                np.broadcast_to([0.0, 1.0, 0.0], (len(angle), 3)),
                np.stack([sine, zero, cosine], axis=-1),
            ],
            axis=1,
        )
        return local @ self.axes

    def forms(self, coordinates: Array) -> LocalForms:
        """Give the same everywhere: lengths are coordinates, and the surface bends along s."""
        count = len(coordinates)
        bent = np.broadcast_to(np.diag([self.curvature, 0.0]), (count, 2, 2))
        return LocalForms(np.broadcast_to(np.eye(2), (count, 2, 2)), bent, np.zeros((count, 2)))

    def lowered(self, height: float) -> CylinderChart:
        """Make the chart of the surface below, whose own arc is s; see `Chart`."""
        center = self.center - height * self.axes[2]
        return CylinderChart(center, self.axes, self.curvature / (1 - self.curvature * height))

    def met(
        self,
        begin: Array,
        way: Array,
        height: float,
        start: Array | None = None,
        side: int = 1,
    ) -> tuple[Array, Array, BoolArray]:
        """Find where beams meet the surface from one side, in closed form; see `Chart`."""
        own, along = (begin - self.center) @ self.axes.T, way @ self.axes.T
        (x, _, h), (dx, _, dh), k = own.T, along.T, self.curvature
        # a far^2 + 2 b far + c = 0, all times the curvature, so that a plane is no exception
        a = k * (dx**2 + dh**2)
        b = k * (x * dx + h * dh) + dh
        c = k * (x**2 + h**2 - height**2) + 2 * (h - height)
        with np.errstate(divide="ignore", invalid="ignore"):
            far = c / (side * np.sqrt(b * b - a * c) - b)
        meets = np.isfinite(far) & (far > 0)
        point = begin + np.where(meets, far, 0.0)[:, None] * way
        coordinates, _ = self.place(point)
        cosine = -np.einsum("bij,bj->bi", self.frames(coordinates), way)
        return coordinates, cosine, meets & (side * cosine[:, 2] > 0)
