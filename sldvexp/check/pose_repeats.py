"""`check=pose_repeats`: do the pose's bounds hold? Simulated repeats of the same registration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sldvexp.check.base import Check
from sldvexp.errors import Checks, UserError
from sldvexp.registry import register

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr


@register("check", "pose_repeats")
@dataclass
class PoseRepeats(Check):
    """Repeats every view's registration with new noise, solved from no starting guess.

    Parameters
    ----------
    repeats : int
        How many.
    """

    repeats: int = 1000

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(self.repeats >= 10, "repeats", f"must be at least 10, not {self.repeats}")
        checks.done()

    def examine(self, tree: Mapping[str, xr.Dataset], rng: np.random.Generator) -> xr.Dataset:
        """``std_ratio`` and ``coverage`` of each parameter; a note where bounds do not hold."""
        import numpy as np

        from sldvexp import dataset

        if "pose" not in tree or "registration" not in tree:
            raise UserError("check=pose_repeats needs a pose from points: choose pose=registration")
        pose, registration = tree["pose"], tree["registration"]
        views = pose["view"].values
        found = [self._view(pose.sel(view=v), registration.sel(view=v), rng) for v in views]
        ratio, coverage = (np.array(values) for values in zip(*found, strict=True))
        coords = {"view": views, "parameter": pose["parameter"].values}
        group = dataset.group("examined/pose_repeats", coords, std_ratio=ratio, coverage=coverage)
        group.attrs |= {"repeats": self.repeats, "notes": "\n".join(self._notes(group))}
        return group

    def _view(self, pose: xr.Dataset, registration: xr.Dataset, rng: np.random.Generator) -> Any:
        """Ratio of standard deviations and coverage for one view."""
        import numpy as np

        from sldvexp.geometry.rotation import vector_from_rotation
        from sldvexp.laser.model import project
        from sldvexp.pose.solver import solve_pose
        from sldvexp.statistics.student import student_factor

        step, offset = np.asarray(pose.attrs["step"]), pose.attrs["mirror_offset"]
        if "adjusted" in pose.dims:
            raise UserError(
                "check.pose_repeats: leave pose.adjust empty; it repeats the pose alone"
            )
        if not np.isfinite(pose["s"]):
            raise UserError("check.pose_repeats: more points are needed; the noise is not known")
        used = registration["used"].values.astype(bool)
        points = registration["object_point"].values[used]
        rotation, origin = pose["rotation"].values, pose["origin"].values
        true = project((points - origin) @ rotation.T, offset)
        noise = float(pose["s"]) * step * rng.standard_normal((self.repeats, *true.shape))
        repeats = solve_pose(points, true + noise, step=step, mirror_offset=offset)
        turned = vector_from_rotation(repeats.rotation @ rotation.T)
        error = np.hstack([turned, repeats.origin - origin])
        std = np.sqrt(np.diagonal(repeats.covariance, axis1=1, axis2=2))
        reported = np.sqrt(np.diagonal(pose["covariance"].values))
        factor = student_factor(pose.attrs["confidence_level"], repeats.covariance_dof)
        return error.std(axis=0) / reported, (np.abs(error) <= factor[:, None] * std).mean(axis=0)

    def _notes(self, group: xr.Dataset) -> list[str]:
        """Views whose simulated spread is further from the reported one than chance allows."""
        import numpy as np

        limit = 4 / np.sqrt(2 * self.repeats)
        bad = (np.abs(group["std_ratio"] - 1) > limit).any("parameter")
        return [
            f"view {view}: simulated repeats spread by {float(ratio.min()):.2f} to "
            f"{float(ratio.max()):.2f} of the reported standard errors; they are not to be trusted"
            for view, ratio, wrong in zip(
                group["view"].values, group["std_ratio"], bad.values, strict=True
            )
            if wrong
        ]
