"""Coordinates on a surface: where beams meet it, its local axes, and how it bends.

Points at coordinates (s, t) and the height z above the surface are ``P(s, t) + z n(s, t)``. The
local axes t1, t2 and the normal n turn from place to place. Per unit of length along t_i

    the coordinates change by J_i1, J_i2,      n changes by kappa_ij t_j,
    t1 changes by g_i t2 - kappa_i1 n,         t2 by -g_i t1 - kappa_i2 n,

with the curvature tensor kappa, which is positive where normals spread, and the turn g of the axes
about the normal. Motion and strain of a shell need no more of a surface than these.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array, BoolArray

#: Steps towards where a beam meets a surface, and the change of coordinates that ends them, m.
STEPS, SETTLED = 30, 1e-12
#: Distance from the surface, m, within which a beam has met it.
MET = 1e-9


@dataclass(frozen=True, eq=False)
class LocalForms:
    """How coordinates and local axes change along the surface, per unit of length.

    Attributes
    ----------
    rate : ndarray, shape (point, 2, 2)
        J: of the coordinates (last), along t1 and t2.
    curvature : ndarray, shape (point, 2, 2), 1/m
        kappa: of the normal towards t1 and t2 (last), along t1 and t2; symmetric.
    turn : ndarray, shape (point, 2), 1/m
        g: of t1 towards t2, along t1 and t2.
    """

    rate: Array
    curvature: Array
    turn: Array

    def stretch(self, height: float) -> Array:
        """Compute ``delta + z kappa``, lengths at a height over those on the surface, (p, 2, 2)."""
        return np.asarray(np.eye(2) + height * self.curvature)

    def shrink(self, height: float) -> Array:
        """Compute lengths on the surface over those at a height, (point, 2, 2)."""
        return np.asarray(np.linalg.inv(self.stretch(height)), float)

    def along(self, height: float, step: Array) -> Array:
        """Reduce steps at a height to lengths on the surface, along t1 and t2, (point, 2, ...)."""
        return by_place(self.shrink(height), step)

    def at(self, height: float) -> LocalForms:
        """Find those of the surface at a height, whose local axes are the same."""
        shrink = self.shrink(height)
        turn = np.einsum("pij,pj->pi", shrink, self.turn)
        return LocalForms(shrink @ self.rate, shrink @ self.curvature, turn)


class Chart(ABC):
    """Coordinates (s, t) of a surface.

    Attributes
    ----------
    center : ndarray, shape (3,), m
        A point near the surface's middle, in the world.
    """

    center: Array

    @property
    def period(self) -> float | None:
        """Length after which s comes back to the same place, m; none of a surface that ends."""
        return None

    @abstractmethod
    def place(self, points: Array) -> tuple[Array, Array]:
        """Find the coordinates of points near the surface, and their heights above it.

        Parameters
        ----------
        points : ndarray, shape (point, 3), m

        Returns
        -------
        coordinates : ndarray, shape (point, 2), m
        height : ndarray, shape (point,), m
        """

    @abstractmethod
    def points(self, coordinates: Array, height: float) -> Array:
        """Find the points at coordinates and a height, shape (point, 3), m, in the world."""

    @abstractmethod
    def frames(self, coordinates: Array) -> Array:
        """Compute the local axes, shape (point, 3, 3): rows t1, t2, n in the world."""

    @abstractmethod
    def forms(self, coordinates: Array) -> LocalForms:
        """Compute how the surface and its axes change along it."""

    def lowered(self, height: float) -> Chart:
        """Make the chart of the surface that lies so far below this one, along the normals."""
        return ParallelChart(self, -height) if height else self

    def start(self, begin: Array, way: Array, height: float, side: int) -> Array:
        """Find coordinates near those where beams meet the surface; see `met`."""
        nearest = np.einsum("bi,bi->b", self.center - begin, way)
        return self.place(begin + nearest[:, None] * way)[0]

    def met(
        self,
        begin: Array,
        way: Array,
        height: float,
        start: Array | None = None,
        side: int = 1,
    ) -> tuple[Array, Array, BoolArray]:
        """Find where beams meet the surface at a height, from one of its sides.

        Steps lead along the tangent plane at the height to where the beam passes through it.

        Parameters
        ----------
        begin, way : ndarray, shape (beam, 3)
            Starts, m, and unit vectors of the beams, in the world.
        height : float, m
        start : ndarray, shape (beam, 2), m, optional
            Coordinates near those that are looked for.
        side : int
            1 from the side of the normals, -1 from behind.

        Returns
        -------
        coordinates : ndarray, shape (beam, 2), m
        cosine : ndarray, shape (beam, 3)
            Direction cosines towards the instrument, along t1, t2 and n.
        meets : ndarray of bool, shape (beam,)
        """
        coordinates = self.start(begin, way, height, side) if start is None else start
        for _ in range(STEPS):
            forms, point = self.forms(coordinates), self.points(coordinates, height)
            step = forms.along(height, slide(self.frames(coordinates), begin - point, way))
            change = np.einsum("pi,pia->pa", step, forms.rate)
            coordinates = coordinates + change
            if np.nan_to_num(np.abs(change)).max(initial=0.0) < SETTLED:
                break
        frames = self.frames(coordinates)
        point = self.points(coordinates, height)
        cosine = -np.einsum("bij,bj->bi", frames, way)
        far = np.einsum("bi,bi->b", point - begin, way)
        miss = np.linalg.norm(begin + far[:, None] * way - point, axis=1)
        return coordinates, cosine, (miss < MET) & (far > 0) & (side * cosine[:, 2] > 0)


def by_place(matrix: Array, vectors: Array) -> Array:
    """Multiply vectors at places by matrices, (place, i, j) times (place, j, ...)."""
    if vectors.ndim == 2:
        return np.asarray((matrix @ vectors[:, :, None])[..., 0])
    return np.asarray(matrix @ vectors)


def slide(frames: Array, move: Array, way: Array) -> Array:
    """Compute how the points where beams meet a surface move along it if the beams do.

    Parameters
    ----------
    frames : ndarray, shape (point, 3, 3)
        Local axes at the points.
    move : ndarray, shape (point, 3, ...), m
        Of the beams.
    way : ndarray, shape (point, 3)
        Unit vectors of the beams.

    Returns
    -------
    ndarray, shape (point, 2, ...), m
        Along t1 and t2.
    """
    local = by_place(frames, move)
    toward = np.einsum("pij,pj->pi", frames, way)
    slope = (toward[:, :2] / toward[:, 2:]).reshape(*toward[:, :2].shape, *(1,) * (move.ndim - 2))
    return np.asarray(local[:, :2] - slope * local[:, 2:])


@dataclass(frozen=True, eq=False)
class ParallelChart(Chart):
    """Coordinates of another chart for the surface at a height above its own.

    Parameters
    ----------
    chart : Chart
    height : float, m
    """

    chart: Chart
    height: float

    @property
    def center(self) -> Array:  # type: ignore[override]
        """A point near the middle."""
        return self.chart.center

    @property
    def period(self) -> float | None:
        """That of the other chart."""
        return self.chart.period

    def start(self, begin: Array, way: Array, height: float, side: int) -> Array:
        """Find coordinates near those where beams meet the surface; see `Chart`."""
        return self.chart.start(begin, way, height + self.height, side)

    def place(self, points: Array) -> tuple[Array, Array]:
        """Find coordinates and heights of points; see `Chart`."""
        coordinates, height = self.chart.place(points)
        return coordinates, height - self.height

    def points(self, coordinates: Array, height: float) -> Array:
        """Find the points at coordinates and a height; see `Chart`."""
        return self.chart.points(coordinates, height + self.height)

    def frames(self, coordinates: Array) -> Array:
        """Compute the local axes; see `Chart`."""
        return self.chart.frames(coordinates)

    def forms(self, coordinates: Array) -> LocalForms:
        """Compute how the surface and its axes change along it; see `Chart`."""
        return self.chart.forms(coordinates).at(self.height)
