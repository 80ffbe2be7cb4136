"""`check=pose_repeats`: whether the pose's bounds hold, by simulated repeats of its registration.

Each repeat adds noise of the estimated size to true readings and solves anew from no starting
guess; the spread over the reported standard error should be 1, and coverage the level.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.geometry import vector_from_rotation
from sldvexp.laser import project
from sldvexp.lazy import xarray as xr
from sldvexp.pose import half_width, solve_points, standard_error


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

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``std_ratio`` and ``coverage`` of each parameter; note where bounds do not hold."""
        if "pose" not in run.groups or "registration" not in run.groups:
            raise UserError(
                "check=pose_repeats needs a pose from points: choose pose=registration, or leave "
                "the check out with '~check.pose_repeats'"
            )
        pose, registration = run.groups["pose"], run.groups["registration"]
        if json.loads(pose.attrs.get("shared", "{}")):
            raise UserError(
                "check=pose_repeats repeats every view for itself, but pose.shared solved them "
                "together: adjust for each view with pose.adjust, or leave the check out with "
                "'~check.pose_repeats'"
            )
        views = pose["view"].values
        found = [self._view(pose.sel(view=v), registration.sel(view=v), run.rng) for v in views]
        ratio, coverage = (np.array(values) for values in zip(*found, strict=True))
        coords = {"view": views, "parameter": pose["parameter"].values}
        group = dataset.group("examined/pose_repeats", coords, std_ratio=ratio, coverage=coverage)
        group.attrs |= {"repeats": self.repeats, "notes": "\n".join(self._notes(group))}
        return group

    def _view(self, pose: xr.Dataset, registration: xr.Dataset, rng: np.random.Generator) -> Any:
        """Repeat one view: ratio of standard deviations, and coverage."""
        step, offset = np.asarray(pose.attrs["step"]), pose.attrs["mirror_offset"]
        if not np.isfinite(pose["s"]):  # as many unknowns as angles: there is no noise to repeat
            return [np.full(pose.sizes["parameter"], np.nan)] * 2
        used = registration["used"].values.astype(bool)
        points = registration["object_point"].values[used]
        rotation, origin = pose["rotation"].values, pose["origin"].values
        adjust = json.loads(pose.attrs["adjust"])
        truth = self._intrinsics(pose, adjust, rng)
        in_laser = np.broadcast_to((points - origin) @ rotation.T, (self.repeats, *points.shape))
        true = project(in_laser, truth["mirror_offset"])
        true = (true - _by_mirror(truth, "zero")) / _by_mirror(truth, "gain")
        noise = float(pose["s"]) * step * rng.standard_normal((self.repeats, len(points), 2))
        repeats = solve_points(points, true + noise, step=step, mirror_offset=offset, adjust=adjust)
        intrinsics = [repeats.intrinsics[name] - truth[name][:, 0] for name in adjust]
        turned = vector_from_rotation(repeats.rotation @ rotation.T)
        error = np.column_stack([turned, repeats.origin - origin, *intrinsics])
        level = pose.attrs["confidence_level"]
        width = half_width(standard_error(repeats.covariance), repeats.covariance_dof, level)
        reported = standard_error(pose["covariance"].values)
        return error.std(axis=0) / reported, (np.abs(error) <= width).mean(axis=0)

    def _intrinsics(
        self, pose: xr.Dataset, adjust: dict[str, float], rng: np.random.Generator
    ) -> dict[str, Any]:
        """Choose true intrinsics of each repeat, (repeat, 1): a free one's estimate, else a draw.

        What is known of a parameter beforehand is its nominal value and standard deviation; it is
        right on average if the truth is drawn from them.
        """
        truth = {"mirror_offset": np.full((self.repeats, 1), pose.attrs["mirror_offset"])}
        for mirror in ("up_down", "left_right"):
            truth |= {f"gain_{mirror}": np.ones((self.repeats, 1))}
            truth |= {f"zero_{mirror}": np.zeros((self.repeats, 1))}
        for name, std in adjust.items():
            if np.isinf(std):
                truth[name] = np.full_like(truth[name], pose["intrinsic"].sel(adjusted=name))
            else:
                truth[name] = truth[name] + std * rng.standard_normal(truth[name].shape)
        return truth

    def _notes(self, group: xr.Dataset) -> list[str]:
        """List views whose simulated spread is further from the reported one than chance allows."""
        limit = 4 / np.sqrt(2 * self.repeats)
        bad = (np.abs(group["std_ratio"] - 1) > limit).any("parameter")
        unknown = group["view"].values[group["std_ratio"].isnull().all("parameter").values]
        return [
            f"view {view}: too few points to know their noise, so that nothing could be repeated"
            for view in unknown
        ] + [
            f"view {view}: simulated repeats spread by {float(ratio.min()):.2f} to "
            f"{float(ratio.max()):.2f} of the reported standard errors; they are not to be trusted"
            for view, ratio, wrong in zip(
                group["view"].values, group["std_ratio"], bad.values, strict=True
            )
            if wrong
        ]


def _by_mirror(truth: dict[str, Any], what: str) -> np.ndarray:
    """Stack gain or zero of both mirrors, shape (repeat, 1, 2)."""
    return np.stack([truth[f"{what}_up_down"], truth[f"{what}_left_right"]], axis=-1)
