"""Errors of the mirrors' calibration, as what they do to the beams of all views.

Each independent error of one standard deviation is one column beside the poses (see
`sldvexp.shell.nuisances`): with poses that stay it widens the bounds, with poses that are adjusted
it is adjusted as well. Which there are is told by `sldvexp.field.bounds.calibration`: errors of
intrinsics that were adjusted with the poses, which have the poses go along, and those that are
stated of the laser.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sldvexp.field import View
from sldvexp.field.bounds.calibration import stated_lasers
from sldvexp.field.bounds.pose_uncertainty import PoseErrors
from sldvexp.laser import TwoMirror
from sldvexp.shell.pixels import beams
from sldvexp.typing import Array, IndexArray


@dataclass(frozen=True, eq=False)
class CalibrationError:
    """One independent error: views and laser on both sides of those that are taken.

    Attributes
    ----------
    more, less : tuple of list of View and TwoMirror
    part : float
        Of the distance between both that is one standard deviation.
    """

    more: tuple[Sequence[View], TwoMirror]
    less: tuple[Sequence[View], TwoMirror]
    part: float

    def of_beams(self, k: int, pixel: IndexArray) -> tuple[Array, Array]:
        """Compute how starts, m, and directions of a view's beams change, (pixel, 3) each."""
        (views, laser), (others, other) = self.more, self.less
        (begin, way), (start, along) = beams(views[k], laser, pixel), beams(others[k], other, pixel)
        return (begin - start) * self.part, (way - along) * self.part


def calibration_errors(
    views: Sequence[View], laser: TwoMirror, errors: PoseErrors | None
) -> list[CalibrationError]:
    """List the errors that are known of.

    Parameters
    ----------
    errors : PoseErrors, optional
        With the intrinsics that were adjusted with the poses.
    """
    found = []
    if errors is not None and len(errors.pose):
        for more, less in errors.moved(views):
            found.append(CalibrationError((more, laser), (less, laser), 0.5))
    adjusted = any(view.intrinsics is not None for view in views)
    for high, low, part in stated_lasers(laser, adjusted):
        found.append(CalibrationError((views, high), (views, low), part))
    return found
