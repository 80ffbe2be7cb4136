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

from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True, eq=False)
class Chart:
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
        """Find the coordinates of points near the surface, and their heights above it.

        Parameters
        ----------
        points : ndarray, shape (point, 3), m

        Returns
        -------
        coordinates : ndarray, shape (point, 2), m
        height : ndarray, shape (point,), m

        Examples
        --------
        >>> import numpy as np
        >>> from sldvexp.shell import Chart
        >>> chart = Chart(np.zeros(3), np.eye(3), 2.0)
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
        """Find the points at coordinates and a height, shape (point, 3), m, in the world."""
        (s, t), k = coordinates.T, self.curvature
        # (cos(k s) - 1) / k and sin(k s) / k, also for k = 0
        sagitta = -k * s**2 * np.sinc(k * s / (2 * np.pi)) ** 2 / 2
        across = s * np.sinc(k * s / np.pi)
        angle = k * s
        local = [across + height * np.sin(angle), t, sagitta + height * np.cos(angle)]
        return np.asarray(self.center + np.stack(local, axis=-1) @ self.axes)

    def frames(self, coordinates: Array) -> Array:
        """Compute the local axes, shape (point, 3, 3): rows t1, t2, n in the world."""
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

    def met(self, begin: Array, way: Array, height: float) -> tuple[Array, Array, BoolArray]:
        """Find where beams first meet the surface at a height, from the side of its normals.

        Parameters
        ----------
        begin, way : ndarray, shape (beam, 3)
            Starts, m, and unit vectors of the beams, in the world.
        height : float, m

        Returns
        -------
        coordinates : ndarray, shape (beam, 2), m
        cosine : ndarray, shape (beam, 3)
            Direction cosines towards the instrument, along t1, t2 and n.
        meets : ndarray of bool, shape (beam,)
        """
        start, along = (begin - self.center) @ self.axes.T, way @ self.axes.T
        (x, _, h), (dx, _, dh), k = start.T, along.T, self.curvature
        # a far^2 + 2 b far + c = 0, all times the curvature, so that a plane is no exception
        a = k * (dx**2 + dh**2)
        b = k * (x * dx + h * dh) + dh
        c = k * (x**2 + h**2 - height**2) + 2 * (h - height)
        with np.errstate(divide="ignore", invalid="ignore"):
            far = c / (np.sqrt(b * b - a * c) - b)
        meets = np.isfinite(far) & (far > 0)
        point = begin + np.where(meets, far, 0.0)[:, None] * way
        coordinates, _ = self.place(point)
        cosine = -np.einsum("bij,bj->bi", self.frames(coordinates), way)
        return coordinates, cosine, meets & (cosine[:, 2] > 0)
