"""`check=pose_methods`: the error estimates of several pose methods side by side (Table 4.3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError, nearest
from sldvexp.geometry import KnownPose, vector_from_rotation
from sldvexp.lazy import xarray as xr


@register("check", "pose_methods")
@dataclass
class PoseMethods(Check):
    """Mean and standard deviation over views of each method's error estimate s.

    A method's s is what its own observations scatter by, a mark's, a bitangent point's or an
    edge's; where the true pose is known, its distance compares the methods themselves.

    Parameters
    ----------
    methods : dict of str to str
        Group of poses by the method's name, ``{edge: compare_pose/edge}``.
    truth : dict of str to KnownPose
        The true pose of every view, if it is known.
    """

    methods: dict[str, str] = field(default_factory=dict)
    truth: dict[str, KnownPose] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(bool(self.methods), "methods", "needs a group of poses, as in {edge: pose}")
        for name, pose in self.truth.items():
            pose.check(checks, f"truth.{name}")
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``s_mean``, ``s_std`` and, with the truth, ``origin_error``, ``rotation_error``."""
        poses = {name: self._pose(name, group, run.groups) for name, group in self.methods.items()}
        s = [pose["s"].values for pose in poses.values()]
        errors: dict[str, np.ndarray] = {}
        if self.truth:
            both = np.array([self._errors(name, pose) for name, pose in poses.items()])
            errors = {"origin_error": both[:, 0], "rotation_error": both[:, 1]}
        return dataset.group(
            "examined/pose_methods",
            {"pose_method": list(poses)},
            views=[len(values) for values in s],
            s_mean=[values.mean() for values in s],
            s_std=[values.std(ddof=1) if len(values) > 1 else np.nan for values in s],
            **errors,
        )

    def _pose(self, name: str, group: str, tree: Mapping[str, xr.Dataset]) -> xr.Dataset:
        """Find the poses of a method."""
        where = f"check.pose_methods: methods.{name}"
        if group not in tree:
            known = [g for g in tree if "s" in tree[g] and "rotation" in tree[g]]
            raise UserError(f"{where}: the run has no poses {group}; {nearest(group, known)}")
        if "s" not in tree[group]:
            raise UserError(f"{where}: the poses {group} have no error estimate s")
        return tree[group]

    def _errors(self, name: str, pose: xr.Dataset) -> tuple[float, float]:
        """Compute r.m.s. distance from the true origins, m, and angle to the true axes, rad."""
        views = [str(view) for view in pose["view"].values]
        if missing := [view for view in views if view not in self.truth]:
            raise UserError(
                f"check.pose_methods: truth lacks the view {missing[0]}, of which {name} has a "
                f"pose; {nearest(missing[0], self.truth)}"
            )
        true = [self.truth[view] for view in views]
        origin = np.array([t.place for t in true])
        rotation = np.array([t.rotation for t in true])
        turned = vector_from_rotation(pose["rotation"].values @ rotation.swapaxes(1, 2))
        return tuple(  # type: ignore[return-value]
            float(np.sqrt((deviation**2).sum(axis=1).mean()))
            for deviation in (pose["origin"].values - origin, turned)
        )
