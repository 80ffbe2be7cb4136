"""`pose=manual`: an operator points the beam at fiducials by eye (Section 4.2).

A mark's image errs by the operator's eye, anew in each view, and by the tape measure: a mark that
stands elsewhere than measured does so in every view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.config.registry import register
from sldvexp.dataset import Finding
from sldvexp.errors import Checks
from sldvexp.io.registration import RegistrationTable
from sldvexp.laser import TwoMirror
from sldvexp.pose.base import JointCovariance
from sldvexp.pose.correlated_errors import Errors, with_errors
from sldvexp.pose.from_points import UNLIKELY, CovarianceModel, unlikely_residuals
from sldvexp.pose.registration import Registration
from sldvexp.pose.solution import PoseSolution
from sldvexp.targets import Target, TargetPoints
from sldvexp.typing import Array, IntArray


@register("pose", "manual")
@dataclass
class Manual(Registration):
    """A registration whose errors are known beforehand: the operator's eye and the tape measure.

    Every point is weighted by both, and the bounds rest on them instead of on the residuals, which
    a handful of points leaves few of. Residuals much larger than that are doubted.

    Parameters
    ----------
    pointing : float, DAC steps
        Standard deviation of the operator's pointing, of each mirror (Table 4.3).
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
        """Join pointing and, for points that the target has, the uncertainty of their position."""
        position_std = np.zeros(len(number))
        if points is not None:
            _, mine, theirs = np.intersect1d(number, points.number, return_indices=True)
            position_std[mine] = points.std[theirs].mean(axis=1)
        return np.hypot(self.pointing, position_std / distance / step.mean())

    def covariance_model(
        self, tables: Sequence[RegistrationTable], laser: TwoMirror, target: Target | None
    ) -> CovarianceModel | None:
        """Make bounds from both errors, those of the marks being the same in every view."""
        if target is None:
            return None
        points = target.points()

        def covariance_model(
            solutions: Sequence[PoseSolution],
        ) -> tuple[list[PoseSolution], JointCovariance, list[Finding]]:
            errors = [
                _errors(self, table, solution, laser, points)
                for table, solution in zip(tables, solutions, strict=True)
            ]
            known, joint, probability = with_errors(
                solutions, errors, laser, self.adjust, self.shared
            )
            findings = [
                unlikely_residuals([e.view], p)
                for e, p in zip(errors, probability, strict=True)
                if p < UNLIKELY / len(errors)
            ]
            return known, joint, findings

        return covariance_model


def _errors(
    method: Manual,
    table: RegistrationTable,
    solution: PoseSolution,
    laser: TwoMirror,
    points: TargetPoints,
) -> Errors:
    """Say where the images of one view's marks err."""
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
