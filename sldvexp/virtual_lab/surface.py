"""What every surface of a plate must tell: where it is, how it is turned, where a beam meets it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True, eq=False)
class Surface(ABC):
    """The upper surface of a plate in the plate's own axes, by coordinates of its middle surface.

    Parameters
    ----------
    size : ndarray, shape (2,), m
        Coordinates (s, t) run from 0 to these.
    height : float, m
        Of the upper surface above the middle one, along the normal.
    """

    size: Array
    height: float

    @property
    @abstractmethod
    def curvature(self) -> float:
        """Of the middle surface along s, 1/m; positive if the normal points away from the axis."""

    @abstractmethod
    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Where each beam first meets the upper surface.

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
        """Coordinates of the nearest places, shape (..., 2), m; beyond `size` for points beside."""

    @abstractmethod
    def frame(self, coordinates: Array) -> Array:
        """Unit rows along s, along t and along the normal, shape (..., 3, 3)."""

    @abstractmethod
    def position(self, coordinates: Array) -> Array:
        """Places on the upper surface, shape (..., 3), m."""

    def inside(self, coordinates: Array) -> BoolArray:
        """Whether coordinates are on the plate, shape (...)."""
        return np.all((coordinates >= 0) & (coordinates <= self.size), axis=-1)
