"""`check=pose_equivalence`: whether two estimates of a pose are the same (Table 4.2).

Welch's test takes two means with standard errors and degrees of freedom of their own; neither their
variances nor their numbers of observations need be equal (Eqs 4.25 to 4.30).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.geometry import KnownPose
from sldvexp.lazy import xarray as xr
from sldvexp.pose import Given
from sldvexp.statistics import student_factor, welch


@register("check", "pose_equivalence")
@dataclass
class PoseEquivalence(Check):
    """Welch's test of each Euler angle and coordinate against another pose (Eqs 4.25 to 4.30).

    Parameters
    ----------
    path : str
        The other pose: a run's ``run.nc`` or a text of Figure 4.29's kind.
    views : dict of str to KnownPose
        The other pose as numbers, instead of a path.
    confidence : float
        One minus the size of the test.
    """

    path: str = ""
    views: dict[str, KnownPose] = field(default_factory=dict)
    confidence: float = 0.99

    def __post_init__(self) -> None:
        checks = Checks()
        checks.probability("confidence", self.confidence)
        checks.done()
        self._other()

    def _other(self) -> Given:
        """Make the other pose, checked as `pose=given` checks it."""
        return Given(path=self.path, views=self.views)

    def inputs(self) -> list[str]:
        """Name the other pose's file."""
        return self._other().inputs()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find t', its degrees of freedom and critical value, for every view and parameter."""
        if "pose" not in run.groups:
            raise UserError("check=pose_equivalence needs a pose to compare: choose pose=...")
        pose, other = run.groups["pose"], self._other().read().pose
        names = [str(v) for v in pose["view"].values]
        others = [str(v) for v in other["view"].values]
        if names != others and len(names) == len(others) == 1:
            other = other.assign_coords(view=names)
        elif set(names) - set(others):
            raise UserError(
                f"check.pose_equivalence: the other pose has the views {', '.join(others)}, "
                f"the run has {', '.join(names)}"
            )
        other = other.sel(view=names)
        (mean1, error1, dof1), (mean2, error2, dof2) = map(_estimate, (pose, other))
        test = welch(mean1, error1, dof1, mean2, error2, dof2, self.confidence)
        return dataset.group(
            "examined/pose_equivalence",
            {"view": names, "quantity": ["phi1", "phi2", "phi3", "x", "y", "z"]},
            difference=mean1 - mean2,
            t=test.statistic,
            dof=test.dof,
            t_critical=test.critical,
            t_critical_whole_dof=student_factor(self.confidence, np.floor(test.dof)),
            reject=test.reject,
        )


def _estimate(pose: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Take Euler angles and origin, standard errors and degrees of freedom, (view, 6) each."""
    mean = np.hstack([pose["euler"].values, pose["origin"].values])
    error = np.hstack([pose["euler_std"].values, pose["origin_std"].values])
    if not (np.isfinite(error) & (error > 0)).all():
        raise UserError(
            "check.pose_equivalence: a pose has no standard errors that are positive and finite; "
            "the test needs them"
        )
    return mean, error, pose["dof"].values[:, None]
