"""The flat plate."""

from __future__ import annotations

import numpy as np

from sldvexp.typing import Array
from sldvexp.virtual_lab.surface import Surface


class FlatSurface(Surface):
    """A plane at z = height in the plate's axes."""

    @property
    def curvature(self) -> float:
        """None."""
        return 0.0

    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """See `Surface`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (self.height - origin[:, 2]) / direction[:, 2]
            coordinates = self.coordinates(origin + distance[:, None] * direction)
            hits = self.inside(coordinates) & (distance > 0)
        return np.where(hits, distance, np.inf), np.where(hits[:, None], coordinates, 0.0)

    def coordinates(self, points: Array) -> Array:
        """See `Surface`."""
        return points[..., :2] + self.size / 2

    def frame(self, coordinates: Array) -> Array:
        """See `Surface`."""
        return np.broadcast_to(np.eye(3), (*coordinates.shape[:-1], 3, 3))

    def position(self, coordinates: Array) -> Array:
        """See `Surface`."""
        xy = coordinates - self.size / 2
        return np.concatenate([xy, np.full_like(xy[..., :1], self.height)], axis=-1)
