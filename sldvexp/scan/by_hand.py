"""`scan=by_hand`: a person points the beam at fiducial marks whose places are known."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.geometry import KnownPose
from sldvexp.scan.base import PersonPart, check_rough_pose, check_view_names
from sldvexp.targets import FiducialPoint, FiducialPoints
from sldvexp.typing import IntArray
from sldvexp.units import LengthUnit


@dataclass
class Marks:
    """Marks that a person can point at in one view.

    Parameters
    ----------
    hidden : list of int
        Numbers of the marks that cannot be seen from there.
    pose : KnownPose, optional
        Where the instrument roughly stands: the beam begins where it predicts a mark, and marks
        that are found correct it.
    """

    hidden: list[int] = field(default_factory=list)
    pose: KnownPose | None = None


@register("scan", "by_hand")
@dataclass
class ByHand(PersonPart):
    """Registration of Section 4.2: known marks, and the DAC steps that a person finds for them.

    Parameters
    ----------
    views : dict of str to Marks
    fiducials : dict of int to FiducialPoint
        The marks. Without them, the points of the group ``target``.
    unit : LengthUnit
        Of the fiducials' coordinates.
    accuracy : float
        Bound +- within which every coordinate is known.
    """

    kind: ClassVar[str] = "marks"

    views: dict[str, Marks] = field(default_factory=dict)
    fiducials: dict[int, FiducialPoint] = field(default_factory=dict)
    unit: LengthUnit = LengthUnit.m
    accuracy: float = 0.0

    def __post_init__(self) -> None:
        checks = Checks()
        check_view_names(checks, self.views)
        for name, view in self.views.items():
            if view.pose is not None:
                check_rough_pose(checks, f"views.{name}.pose", view.pose)
        checks.done()
        self.own_marks()
        for name, view in self.views.items():
            for number in view.hidden if self.fiducials else ():
                numbers = ", ".join(map(str, self.fiducials))
                there = f"there is no mark {number}; there are {numbers}"
                checks.require(number in self.fiducials, f"views.{name}.hidden", there)
        checks.done()

    def own_marks(self) -> FiducialPoints | None:
        """Return the fiducials, if there are any."""
        return FiducialPoints(self.unit, self.accuracy, self.fiducials) if self.fiducials else None

    def inputs(self) -> list[str]:
        """See `Scan`."""
        return []

    def known_pixels(self, view: str) -> IntArray:
        """See `ScanPart`; a person finds them all."""
        return np.zeros((0, 2), np.int64)
