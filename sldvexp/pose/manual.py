"""`pose=manual`: an operator points the beam at fiducials by eye (Section 4.2).

Where the errors of marks come from: the operator's eye in each view, and the tape measure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.io.registration import RegistrationTable
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.pose.correlated_errors import Errors, with_errors
from sldvexp.pose.from_points import CovarianceModel, unlikely_residuals
from sldvexp.pose.registration import Registration
from sldvexp.pose.single_view import PoseSolution
from sldvexp.targets.base import Target, TargetPoints
from sldvexp.typing import Array, IntArray


@register("pose", "manual")
@dataclass
class Manual(Registration):
    """A registration whose errors are known beforehand: the operator's eye and the tape measure.

    Every point is weighted by both, and the bounds rest on them instead of on the residuals, which
    a handful of points leaves few of. Residuals much larger than that are noted.

    Parameters
    ----------
    pointing : float, DAC steps
        Standard deviation of the operator's pointing, of each mirror.
    """

    pointing: float = 1.0

    def _check(self, checks: Checks) -> None:
        super()._check(checks)
        checks.positive("pointing", self.pointing)

    def angle_std(
        self,
        number: IntArray,
        distance: Array,
        step: Array,
        points: TargetPoints | None,
    ) -> Array:
        """Pointing and, for points that the target has, the uncertainty of their position."""
        position_std = np.zeros(len(number))
        if points is not None:
            _, mine, theirs = np.intersect1d(number, points.number, return_indices=True)
            position_std[mine] = points.std[theirs].mean(axis=1)
        return np.hypot(self.pointing, position_std / distance / step.mean())

    def judge(
        self, tables: Sequence[RegistrationTable], laser: TwoMirror, target: Target | None
    ) -> CovarianceModel | None:
        """The marks' errors are the same in every view."""
        if target is None:
            return None

        return mark_judge(self, tables, laser, target.points())


def mark_judge(
    method: Manual, tables: Sequence[RegistrationTable], laser: TwoMirror, points: TargetPoints
) -> CovarianceModel:
    """Bounds from both errors; a mark that stands elsewhere than measured does so in every view.

    Parameters
    ----------
    method : Manual
    tables : sequence of RegistrationTable
        Of all views.
    laser : TwoMirror
    points : TargetPoints
        The marks.
    """

    def judge(
        solutions: Sequence[PoseSolution],
    ) -> tuple[list[PoseSolution], Array, list[str]]:
        errors = [
            _errors(method, table, solution, laser, points)
            for table, solution in zip(tables, solutions, strict=True)
        ]
        judged, joint, probability = with_errors(
            solutions, errors, laser, method.adjust, method.shared
        )
        notes = [
            unlikely_residuals(f"view {e.view}", p)
            for e, p in zip(errors, probability, strict=True)
            if p < 1 - method.confidence
        ]
        return judged, joint, notes

    return judge


def _errors(
    method: Manual,
    table: RegistrationTable,
    solution: PoseSolution,
    laser: TwoMirror,
    points: TargetPoints,
) -> Errors:
    """Of one view's marks."""
    count = len(table.number)
    _, mine, theirs = np.intersect1d(table.number, points.number, return_indices=True)
    of_object = np.zeros((count, 3, len(points.number), 3))
    for axis in range(3):
        of_object[mine, axis, theirs, axis] = points.std[theirs, axis]
    distance = np.linalg.norm(table.object_point - solution.origin, axis=1)
    return Errors(
        view=table.name,
        points=table.object_point,
        of_image=method.pointing**2 * np.eye(2 * count),
        of_object=of_object.reshape(count, 3, -1),
        std=method.angle_std(table.number, distance, laser.step, points),
    )
