"""What every calibration object gives: numbered points, and how well their places are known."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class TargetPoints:
    """Points of a calibration object in the object's axes.

    Parameters
    ----------
    number : ndarray of int, shape (N,)
    position : ndarray, shape (N, 3), m
    std : ndarray, shape (N, 3), m
        Standard deviation of each coordinate.
    label : tuple of str, length N
        What each point is, for people.
    """

    number: NDArray[np.int64]
    position: NDArray[np.float64]
    std: NDArray[np.float64]
    label: tuple[str, ...]


class Target(ABC):
    """A calibration object. A strategy implements the one hook `points`."""

    @abstractmethod
    def points(self) -> TargetPoints:
        """The numbered points that a pose is computed from."""

    def group(self) -> xr.Dataset:
        """The points as the group ``target`` of a run."""
        from sldvexp import dataset

        points = self.points()
        return dataset.group(
            "target",
            {"point": points.number},
            position=points.position,
            position_std=points.std,
        )


def std_of_bound(accuracy: float) -> float:
    """Standard deviation of a number known within +-`accuracy`, no value in between preferred."""
    return accuracy / math.sqrt(3.0)
