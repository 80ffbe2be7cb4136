"""Settings that all reconstructions by splines on the surface share, and what makes one of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

from sldvexp.errors import Checks
from sldvexp.reconstruction.system import Robust


class GivenSurface(Enum):
    """Surface of the structure that the volume's surface is.

    Attributes
    ----------
    middle
        The middle surface, half a thickness below the measured face.
    face
        The measured face.
    """

    middle = "middle"
    face = "face"


class PoseTreatment(Enum):
    """Poses of the views, which are known with their covariance.

    Attributes
    ----------
    adjust
        They are found anew together with the field, with what was known of them as prior.
    propagate
        They stay, and their covariance goes into the bounds.
    """

    adjust = "adjust"
    propagate = "propagate"


@dataclass
class SurfaceReconstruction:
    """Smooth field on a surface, of splines, from the pixels of all views at once.

    Pixels whose beams meet the surface are one equation each, ``v = D . V(s, t)``; noise, poses and
    how smooth the field is are in the bounds. A strategy says how the motion of the face depends on
    the splines.

    Parameters
    ----------
    given : GivenSurface
        Surface of the structure that the volume is laid around.
    cells : int
        Cells of w's splines along the longer side.
    membrane_cells : int
        Those of the motion along the surface.
    poses : PoseTreatment
        Whether poses are found anew with the field, or stay.
    height_tolerance : float, m
        Standard uncertainty of the given surface's height along its normal.
    confidence : float
        Two-sided level of the bounds.
    robust : Robust
        Whether pixels that dropped out unnoticed are left out.
    """

    given: GivenSurface = GivenSurface.middle
    cells: int = 12
    membrane_cells: int = 6
    poses: PoseTreatment = PoseTreatment.adjust
    height_tolerance: float = 0.0
    confidence: float = 0.95
    robust: Robust = Robust.auto

    #: Whether the splines are those of the middle surface of a thin shell, and not of the face.
    of_middle: ClassVar[bool]

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(self.cells >= 2, "cells", f"must be 2 or more, not {self.cells}")
        message = f"must be 1 or more, not {self.membrane_cells}"
        checks.require(self.membrane_cells >= 1, "membrane_cells", message)
        checks.non_negative("height_tolerance", self.height_tolerance)
        checks.require(
            0 < self.confidence < 1,
            "confidence",
            f"must lie between 0 and 1 as in 0.95, not {self.confidence}",
        )
        self._check(checks)
        checks.done()

    def _check(self, checks: Checks) -> None:
        """Note what else is wrong with a strategy's settings."""
