"""Base of calibration objects: numbered points, and how well their places are known."""

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
        Each point's description, for people.
    """

    number: IntArray
    position: Array
    std: Array
    label: tuple[str, ...]


class Target(ABC):
    """A calibration object.

    A plugin implements the one hook `points`; pose methods and reports take all else from it.
    """

    @abstractmethod
    def points(self) -> TargetPoints:
        """Give the numbered points that a pose is computed from."""

    def to_dataset(self) -> xr.Dataset:
        """Make the group ``target`` of a run."""
        points = self.points()
        return dataset.group(
            "target",
            {"point": points.number},
            position=points.position,
            position_std=points.std,
        )


def std_of_bound(accuracy: float) -> float:
    """Give the standard deviation of a number known within +-`accuracy`, all values as likely.

    Examples
    --------
    >>> round(std_of_bound(0.0003), 6)
    0.000173
    """
    return accuracy / math.sqrt(3.0)
