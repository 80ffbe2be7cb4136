"""`pose=manual`: an operator points the beam at fiducials by eye (Section 4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.pose.registration import Registration

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sldvexp.io.registration.table import RegistrationTable
    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.pose.from_points import Judge
    from sldvexp.targets.base import Target, TargetPoints


@register("pose", "manual")
@dataclass
class Manual(Registration):
    """A registration whose errors are known beforehand: the operator's eye and the tape measure.

    Every point is weighted by both, and the bounds rest on them instead of on the residuals, which
    a handful of points leaves few of. Residuals much larger than that are noted.

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
        number: NDArray[np.int64],
        distance: NDArray[np.float64],
        step: NDArray[np.float64],
        points: TargetPoints | None,
    ) -> NDArray[np.float64]:
        """Pointing and, for points that the target has, the uncertainty of their position."""
        import numpy as np

        position_std = np.zeros(len(number))
        if points is not None:
            _, mine, theirs = np.intersect1d(number, points.number, return_indices=True)
            position_std[mine] = points.std[theirs].mean(axis=1)
        return np.hypot(self.pointing, position_std / distance / step.mean())

    def judge(
        self, tables: Sequence[RegistrationTable], laser: TwoMirror, target: Target | None
    ) -> Judge | None:
        """The marks' errors are the same in every view."""
        if target is None:
            return None
        from sldvexp.pose.mark_errors import mark_judge

        return mark_judge(self, tables, laser, target.points())
