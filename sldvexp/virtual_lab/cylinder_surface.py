"""The panel of a cylinder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array
from sldvexp.virtual_lab.surface import Surface


@dataclass(frozen=True, eq=False)
class CylinderSurface(Surface):
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
        """The nearer of the two crossings that lies on the panel; see `Surface`."""
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
        """See `Surface`."""
        reach = self.radius + self.height
        angle = np.arctan2(points[..., 0] / reach, (points[..., 2] + self.radius) / reach)
        return np.stack([self.radius * angle, points[..., 1]], axis=-1) + self.size / 2

    def frame(self, coordinates: Array) -> Array:
        """See `Surface`."""
        sine, cosine = self._turn(coordinates)
        zero, one = np.zeros_like(sine), np.ones_like(sine)
        rows = [[cosine, zero, -sine], [zero, one, zero], [sine, zero, cosine]]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def position(self, coordinates: Array) -> Array:
        """See `Surface`."""
        sine, cosine = self._turn(coordinates)
        reach = self.radius + self.height
        y = coordinates[..., 1] - self.size[1] / 2
        return np.stack([reach * sine, y, reach * cosine - self.radius], axis=-1)

    def _turn(self, coordinates: Array) -> tuple[Array, Array]:
        """Sine and cosine of the angle from the panel's center."""
        angle = (coordinates[..., 0] - self.size[0] / 2) / self.radius
        return np.sin(angle), np.cos(angle)
