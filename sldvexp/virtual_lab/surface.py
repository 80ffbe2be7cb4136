"""Measured face of the virtual lab's plates: where it is, how it is turned, where beams meet it.

Its coordinates (s, t) are those of the middle surface below it, from one corner of the rectangle
around the plate; the face lies half a thickness above.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True, eq=False)
class PlateSurface(ABC):
    """Upper surface of a plate in the plate's own axes, by coordinates of its middle surface.

    Parameters
    ----------
    size : ndarray, shape (2,), m
        Coordinates (s, t) run from 0 to these.
    height : float, m
        Of the upper surface above the middle one, along the normal.
    holes : ndarray, shape (hole, 2, 2), m
        Lowest and highest coordinates of each.
    """

    size: Array
    height: float
    holes: Array

    @property
    @abstractmethod
    def curvature(self) -> float:
        """Of the middle surface along s, 1/m; positive if the normal points away from the axis."""

    @abstractmethod
    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Find where each beam first meets the upper surface.

        Parameters
        ----------
        origin, direction : ndarray, shape (beam, 3)

        Returns
        -------
        distance : ndarray, shape (beam,), m
            Infinite where the beam misses.
        coordinates : ndarray, shape (beam, 2), m
            0 where the beam misses.
        """

    @abstractmethod
    def coordinates(self, points: Array) -> Array:
        """Find the nearest places, shape (..., 2), m; beyond `size` for points beside."""

    @abstractmethod
    def frame(self, coordinates: Array) -> Array:
        """Compute unit rows along s, along t and along the normal, shape (..., 3, 3)."""

    @abstractmethod
    def position(self, coordinates: Array) -> Array:
        """Compute places on the upper surface, shape (..., 3), m."""

    @property
    def back(self) -> Self:
        """The lower surface, which beams from behind meet."""
        return replace(self, height=-self.height)

    def inside(self, coordinates: Array) -> BoolArray:
        """Tell whether coordinates are on the plate, shape (...)."""
        on_it = np.all((coordinates >= 0) & (coordinates <= self.size), axis=-1)
        for low, high in self.holes:
            on_it &= ~np.all((coordinates > low) & (coordinates < high), axis=-1)
        return on_it


class FlatSurface(PlateSurface):
    """A plane at z = height in the plate's axes."""

    @property
    def curvature(self) -> float:
        """None."""
        return 0.0

    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """See `PlateSurface`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (self.height - origin[:, 2]) / direction[:, 2]
            coordinates = self.coordinates(origin + distance[:, None] * direction)
            hits = self.inside(coordinates) & (distance > 0)
        return np.where(hits, distance, np.inf), np.where(hits[:, None], coordinates, 0.0)

    def coordinates(self, points: Array) -> Array:
        """See `PlateSurface`."""
        return points[..., :2] + self.size / 2

    def frame(self, coordinates: Array) -> Array:
        """See `PlateSurface`."""
        return np.broadcast_to(np.eye(3), (*coordinates.shape[:-1], 3, 3))

    def position(self, coordinates: Array) -> Array:
        """See `PlateSurface`."""
        xy = coordinates - self.size / 2
        return np.concatenate([xy, np.full_like(xy[..., :1], self.height)], axis=-1)


#: How far beside a plate the light of a spot may still fall on it, m.
MARGIN = 0.005


class LitSurface(FlatSurface):
    """A plane whose edges a spot passes bit by bit, being wider than nothing."""

    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Find where each beam meets the plane, and the nearest place of the plate."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (self.height - origin[:, 2]) / direction[:, 2]
            coordinates = self.coordinates(origin + distance[:, None] * direction)
        nearest = np.clip(coordinates, 0.0, self.size)
        hits = (np.abs(coordinates - nearest) < MARGIN).all(axis=1) & (distance > 0)
        return np.where(hits, distance, np.inf), np.where(hits[:, None], nearest, 0.0)

    def light(self, points: Array, direction: Array, radius: Array) -> Array:
        """Give the part of each spot's light that falls on the plate.

        The light of a Gaussian beam of radius w along d has the variance
        ``w^2/4 (1 + (a.d)^2 / (n.d)^2)`` along the axis a of the plane with normal n; that of both
        axes is taken as independent, which matters in corners alone.

        Parameters
        ----------
        points : ndarray, shape (beam, 3), m
            Where the beams' axes meet the plane.
        direction : ndarray, shape (beam, 3)
        radius : ndarray, shape (beam,), m
            Of the beams (1/e^2 of the intensity).
        """
        place = self.coordinates(points)
        slant = direction[:, :2] / direction[:, 2:]
        sigma = np.maximum(radius[:, None] / 2 * np.hypot(1.0, slant), np.finfo(float).tiny)

        def between(low: Array, high: Array) -> Array:
            below, above = (scipy.special.ndtr((x - place) / sigma) for x in (low, high))
            return np.asarray((above - below).prod(axis=1))

        whole = between(np.zeros(2), self.size)
        return np.asarray(whole - sum(between(low, high) for low, high in self.holes))


@dataclass(frozen=True, eq=False)
class CylinderSurface(PlateSurface):
    """A cylinder about the line x = 0, z = -radius; s is the middle surface's arc.

    Parameters
    ----------
    radius : float, m
        Of the middle surface; negative where the normal points towards the axis.
    """

    radius: float

    @property
    def curvature(self) -> float:
        """1 / radius."""
        return 1.0 / self.radius

    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Find where each beam first meets the upper surface."""
        ox, oz = origin[:, 0], origin[:, 2] + self.radius
        dx, dz = direction[:, 0], direction[:, 2]
        a, b = dx**2 + dz**2, ox * dx + oz * dz
        c = ox**2 + oz**2 - (self.radius + self.height) ** 2
        distance = np.full(len(origin), np.inf)
        coordinates = np.zeros((len(origin), 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(b**2 - a * c)
            for crossing in ((-b + root) / a, (-b - root) / a):  # the nearer one last: it stays
                place = self.coordinates(origin + crossing[:, None] * direction)
                hits = self.inside(place) & (crossing > 0)
                distance = np.where(hits, crossing, distance)
                coordinates = np.where(hits[:, None], place, coordinates)
        return distance, coordinates

    def coordinates(self, points: Array) -> Array:
        """See `PlateSurface`."""
        reach = self.radius + self.height
        angle = np.arctan2(points[..., 0] / reach, (points[..., 2] + self.radius) / reach)
        return np.stack([self.radius * angle, points[..., 1]], axis=-1) + self.size / 2

    def frame(self, coordinates: Array) -> Array:
        """See `PlateSurface`."""
        sine, cosine = self._turn(coordinates)
        zero, one = np.zeros_like(sine), np.ones_like(sine)
        rows = [[cosine, zero, -sine], [zero, one, zero], [sine, zero, cosine]]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def position(self, coordinates: Array) -> Array:
        """See `PlateSurface`."""
        sine, cosine = self._turn(coordinates)
        reach = self.radius + self.height
        y = coordinates[..., 1] - self.size[1] / 2
        return np.stack([reach * sine, y, reach * cosine - self.radius], axis=-1)

    def _turn(self, coordinates: Array) -> tuple[Array, Array]:
        """Compute sine and cosine of the angle from the panel's center."""
        angle = (coordinates[..., 0] - self.size[0] / 2) / self.radius
        return np.sin(angle), np.cos(angle)
