"""What every calibration object gives: numbered points, and how well their places are known."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from sldvexp import dataset
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, IntArray


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

    number: IntArray
    position: Array
    std: Array
    label: tuple[str, ...]


class Target(ABC):
    """A calibration object. A strategy implements the one hook `points`."""

    @abstractmethod
    def points(self) -> TargetPoints:
        """The numbered points that a pose is computed from."""

    def group(self) -> xr.Dataset:
        """The points as the group ``target`` of a run."""
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
