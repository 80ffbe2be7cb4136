"""`target=points`: plain fiducial marks at measured positions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.targets.base import Target, TargetPoints, std_of_bound
from sldvexp.units import LengthUnit, beyond_belief

#: Points nearer to their common line than this fraction of its length count as collinear.
COLLINEAR = 1e-9


@dataclass
class FiducialPoint:
    """One fiducial mark in the target's unit."""

    x: float
    y: float
    z: float = 0.0


@register("target", "points")
@dataclass
class FiducialPoints(Target):
    """Numbered fiducial points.

    Parameters
    ----------
    unit : LengthUnit
        Unit of all lengths below.
    accuracy : float
        Bound +- within which every coordinate is known.
    fiducials : dict of int to FiducialPoint
        By point number.
    """

    unit: LengthUnit = LengthUnit.m
    accuracy: float = 0.0
    fiducials: dict[int, FiducialPoint] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.non_negative("accuracy", self.accuracy)
        for number, point in self.fiducials.items():
            checks.finite(f"fiducials.{number}", point.x, point.y, point.z)
            if told := beyond_belief(self.unit, point.x, point.y, point.z):
                checks.require(False, f"fiducials.{number}", told)
                break
        checks.require(
            len(self.fiducials) >= 3,
            "fiducials",
            f"a pose needs three points or more, not {len(self.fiducials)}",
        )
        checks.done()
        self._check_spread(checks)
        checks.done()

    def points(self) -> TargetPoints:
        """Give the fiducials in the order in which the configuration has them."""
        position = self.unit.value * np.array([[p.x, p.y, p.z] for p in self.fiducials.values()])
        std = np.full(position.shape, self.unit.value * std_of_bound(self.accuracy))
        number = np.array(list(self.fiducials), np.int64)
        return TargetPoints(number, position, std, tuple(f"fiducial {n}" for n in number))

    def _check_spread(self, checks: Checks) -> None:
        """Note points that coincide, or that all lie on one line: they leave a rotation open."""
        seen: dict[tuple[float, float, float], int] = {}
        for number, p in self.fiducials.items():
            other = seen.setdefault((p.x, p.y, p.z), number)
            checks.require(
                other == number, f"fiducials.{number}", f"stands where point {other} stands"
            )
        away = np.array(list(seen))
        away -= away[0]
        distance = np.linalg.norm(away, axis=1)
        # The cross product with the longest way is that length times the distance beside it.
        beside = np.linalg.norm(np.cross(away[distance.argmax()], away), axis=1)
        checks.require(
            beside.max() > COLLINEAR * distance.max() ** 2,
            "fiducials",
            f"all {len(self.fiducials)} points lie on one line; at least one must stand beside it",
        )
