"""Repairs of views that the verdict proposes, and how one changes the groups of a run.

A repair has a name, ``view_<view>.<kind>``, and is done only if the configuration names it. The
groups that it changes say so in their attribute ``repaired``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp import pose as poses
from sldvexp import verdict
from sldvexp.dataset import Finding, Severity
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array
from sldvexp.verdict.explanation import POSE

#: Kinds whose repair multiplies the view's velocities.
FACTORS = ("sign", "rms", "inverse_rms", "gain", "phase", "factor")
CONJUGATES = ("conjugate", "conjugate_sign")


@dataclass(frozen=True)
class Repair:
    """One change that would make a view agree with the others.

    Parameters
    ----------
    kind : str
    view : str
    other : str
        The view that it is exchanged with, if it is.
    factor : complex
        That its velocities have stood to what they should be.
    pose : tuple of float
        Rotation vector (rad) and displacement (m) from the stated pose to the true one.
    free : tuple of int
        Numbers of the pose that were found without their prior.
    covariance : ndarray, shape (6, 6), optional
        Of the repaired pose.
    """

    kind: str
    view: str
    other: str = ""
    factor: complex = 1.0
    pose: tuple[float, ...] = ()
    free: tuple[int, ...] = ()
    covariance: Array | None = None

    @property
    def name(self) -> str:
        """Name of the repair in `use_repair`."""
        return f"view_{self.view}.{self.kind}" + (f"_{self.other}" if self.other else "")

    @property
    def setting(self) -> str:
        """What is typed to take it."""
        return f"use_repair=[{self.name}]"

    def apply(self, groups: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
        """Change the groups of a run: those that come out otherwise."""
        image = f"image/{self.view}"
        if "line_of_sight" in groups:
            return {"line_of_sight": self._of_points(groups["line_of_sight"])}
        if self.kind == "pose":
            pose = groups["pose"]
            return {"pose": _marked(self._of_pose(pose), pose, self.name)}
        if self.kind == "exchanged":
            other = f"image/{self.other}"
            return {
                image: _marked(groups[other], groups[image], self.name),
                other: _marked(groups[image], groups[other], self.name),
            }
        if self.kind == "left_out":
            told = groups[image].assign_attrs(left_out=1)
            return {image: _marked(told, groups[image], self.name)}
        velocity, std = groups[image]["velocity"], groups[image]["velocity_std"]
        # Perhaps in a file, where they stay; noise was scaled with the velocities.
        values = np.conj(velocity.data) if self.kind in CONJUGATES else velocity.data
        repaired = groups[image].assign(
            velocity=velocity.copy(data=values / self.factor),
            velocity_std=std.copy(data=std.data / abs(self.factor)),
        )
        return {image: _marked(repaired, groups[image], self.name)}

    def _of_points(self, points: xr.Dataset) -> xr.Dataset:
        """Change one view of single points."""
        if self.kind == "left_out":
            return _marked(points.drop_sel(view=self.view), points, self.name)
        names = [str(v) for v in points["view"].values]
        repaired = points.copy(deep=True)
        for name in ("velocity", "velocity_std"):  # noise was scaled and exchanged with velocities
            if name not in repaired:
                continue
            values = np.moveaxis(repaired[name].values, repaired[name].get_axis_num("view"), 0)
            k = names.index(self.view)
            if self.kind == "exchanged":
                other = names.index(self.other)
                values[[k, other]] = values[[other, k]]
                continue
            own = np.conj(values[k]) if self.kind in CONJUGATES else values[k]
            values[k] = own / (self.factor if name == "velocity" else abs(self.factor))
        return _marked(repaired, points, self.name)

    def _of_pose(self, pose: xr.Dataset) -> xr.Dataset:
        """Move one view of a group ``pose``; its error has no longer to do with the others'."""
        names = [str(v) for v in pose["view"].values]
        k, moves = names.index(self.view), np.zeros((len(names), POSE))
        whole = poses.cross_covariance(pose, names)
        moves[k] = self.pose
        whole[k], whole[:, :, k] = 0.0, 0.0
        whole[k, :, k] = self.covariance
        return verdict.refinement.moved_poses(pose, moves, whole.reshape(moves.size, moves.size))


def examined_repairs(
    groups: dict[str, xr.Dataset],
    use_repair: Sequence[str],
    examine: Callable[[dict[str, xr.Dataset]], tuple[list[Finding], list[Repair]]],
) -> tuple[dict[str, xr.Dataset], list[Finding], list[Repair]]:
    """Examine groups, and again after every repair that is asked for.

    Returns
    -------
    dict of str to Dataset
        The repaired groups.
    list of Finding
    list of Repair
        Those that were done.

    Raises
    ------
    UserError
        If a repair is named that nothing proposes.
    """
    wanted = list(use_repair)
    taken: list[Repair] = []
    proposed: list[str] = []
    while True:
        findings, repairs = examine(groups)
        proposed += [repair.name for repair in repairs]
        repair = next((r for r in repairs if r.name in wanted), None)
        if repair is None:
            break
        wanted.remove(repair.name)
        groups = groups | repair.apply(groups)
        taken.append(repair)
    if wanted:
        known = f"; {nearest(wanted[0], proposed)}" if proposed else ""
        raise UserError(
            f"use_repair: nothing that was found proposes {wanted[0]}{known}; run without it and "
            "read the verdict"
        )
    told = [
        Finding(
            "repaired",
            f"view {r.view}",
            f"repaired as asked: {r.name}",
            Severity.note,
            views=(r.view,),
        )
        for r in taken
    ]
    return groups, [*told, *findings], taken


def _marked(repaired: xr.Dataset, before: xr.Dataset, name: str) -> xr.Dataset:
    """Say in a group what was done to it."""
    done = [*filter(None, [str(before.attrs.get("repaired", ""))]), name]
    return repaired.assign_attrs(repaired=", ".join(done))
