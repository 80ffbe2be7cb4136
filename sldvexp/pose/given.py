"""`pose=given`: poses known from numbers, from a text of Figure 4.29's kind, or from a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.geometry.rotation import KnownPose, euler_jacobian, rotation_from_euler
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import PoseMethod, pose_to_dataset
from sldvexp.targets.base import Target


@register("pose", "given")
@dataclass
class Given(PoseMethod):
    """Known poses: nothing is estimated, the numbers and their bounds are taken over.

    Parameters
    ----------
    path : str
        A run's ``run.nc``, or a text as the program writes it (``pose.txt``, Figure 4.29).
    views : dict of str to KnownPose
        Poses as numbers, instead of a path.
    confidence : float
        Level of the intervals.
    """

    path: str = ""
    views: dict[str, KnownPose] = field(default_factory=dict)
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(
            bool(self.path) != bool(self.views),
            "path",
            "give either a path or views, not both or none",
        )
        checks.probability("confidence", self.confidence)
        for name, view in self.views.items():
            for key in ("euler", "origin", "euler_std", "origin_std"):
                values = getattr(view, key)
                sizes = (0, 3) if key.endswith("std") else (3,)
                checks.require(
                    len(values) in sizes,
                    f"views.{name}.{key}",
                    f"must be three numbers, not {len(values)}",
                )
                checks.finite(f"views.{name}.{key}", *values)
                if key.endswith("std"):
                    for value in values:
                        checks.non_negative(f"views.{name}.{key}", value)
            both = bool(view.euler_std) == bool(view.origin_std)
            message = "give euler_std and origin_std together"
            checks.require(both, f"views.{name}.euler_std", message)
            few = "must be 0 (errors known) or at least 2"
            checks.require(view.samples == 0 or view.samples > 1, f"views.{name}.samples", few)
        checks.done()

    def inputs(self) -> list[str]:
        """The file, if poses come from one."""
        return [self.path] if self.path else []

    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """The known poses as the group ``pose``."""
        return {"pose": self.group()}

    def group(self) -> xr.Dataset:
        """The known poses, whatever they come from."""
        from sldvexp.pose.files import read_poses

        if self.path:
            return read_poses(locate(self.path), self.confidence)
        return known_poses(self.views, self.confidence)


def known_poses(views: dict[str, KnownPose], confidence: float) -> xr.Dataset:
    """The group ``pose`` of poses given as Euler angles and origins with standard deviations."""
    poses = list(views.values())
    rotation = rotation_from_euler([p.euler for p in poses])
    covariance = np.full((len(poses), 6, 6), np.nan)
    for matrix, r, p in zip(covariance, rotation, poses, strict=True):
        if not p.euler_std:
            continue
        n = p.samples or 1
        by_euler = np.linalg.inv(euler_jacobian(r))
        matrix[:] = 0.0
        matrix[:3, :3] = by_euler @ np.diag(np.square(p.euler_std) / n) @ by_euler.T
        matrix[3:, 3:] = np.diag(np.square(p.origin_std) * p.unit.value**2 / n)
    return pose_to_dataset(
        list(views),
        rotation,
        np.array([p.origin for p in poses]) * [[p.unit.value] for p in poses],
        covariance,
        [p.samples - 1 if p.samples else np.inf for p in poses],
        confidence,
    )
