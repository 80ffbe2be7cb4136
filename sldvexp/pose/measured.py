"""Object points as a session measured them, in the place of a calibration object's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp.io.registration.table import RegistrationTable
from sldvexp.targets.base import Target, TargetPoints


class MeasuredPoints(Target):
    """The points of some views' registration data, each under its number.

    Parameters
    ----------
    tables : sequence of RegistrationTable
        With the standard deviations of their object points.
    """

    def __init__(self, tables: Sequence[RegistrationTable]) -> None:
        number = np.concatenate([t.number for t in tables])
        self._number, first = np.unique(number, return_index=True)
        self._position = np.concatenate([t.object_point for t in tables])[first]
        stds = [t.object_std for t in tables if t.object_std is not None]
        self._std = np.concatenate(stds)[first]

    def points(self) -> TargetPoints:
        """See `Target`."""
        label = tuple(f"point {n}" for n in self._number)
        return TargetPoints(self._number, self._position, self._std, label)


def measured_points(tables: Sequence[RegistrationTable]) -> MeasuredPoints | None:
    """The points of some views, None unless the uncertainty of all is known."""
    if any(table.object_std is None for table in tables):
        return None
    return MeasuredPoints(tables)
