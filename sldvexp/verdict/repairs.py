"""Repairs of views that the verdict proposes, and how one changes the groups of a run.

A repair has a name, ``view_<view>.<kind>``, and is done only if the configuration names it. The
groups that it changes say so in their attribute ``repaired``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import cross_covariance
from sldvexp.typing import Array
from sldvexp.verdict.refinement import moved_poses

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
    covariance : ndarray, shape (6, 6), optional
        Of the repaired pose.
    """

    kind: str
    view: str
    other: str = ""
    factor: complex = 1.0
    pose: tuple[float, ...] = ()
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
        if self.kind == "pose":
            pose = moved_pose(groups["pose"], self.view, np.array(self.pose), self.covariance)
            return {"pose": _marked(pose, groups["pose"], self.name)}
        if self.kind == "exchanged":
            other = f"image/{self.other}"
            return {
                image: _marked(groups[other], groups[image], self.name),
                other: _marked(groups[image], groups[other], self.name),
            }
        if self.kind == "left_out":
            told = groups[image].assign_attrs(left_out=1)
            return {image: _marked(told, groups[image], self.name)}
        velocity = groups[image]["velocity"]
        values = np.conj(velocity.values) if self.kind in CONJUGATES else velocity.values
        repaired = groups[image].assign(velocity=velocity.copy(data=values / self.factor))
        return {image: _marked(repaired, groups[image], self.name)}


def _marked(repaired: xr.Dataset, before: xr.Dataset, name: str) -> xr.Dataset:
    """Say in a group what was done to it."""
    done = [*filter(None, [str(before.attrs.get("repaired", ""))]), name]
    return repaired.assign_attrs(repaired=", ".join(done))


def moved_pose(
    pose: xr.Dataset, view: str, move: Array, covariance: Array | None = None
) -> xr.Dataset:
    """Move one view of a group ``pose``.

    Parameters
    ----------
    move : ndarray, shape (6,)
        Rotation vector of the laser frame (rad) and displacement of the origin (m).
    covariance : ndarray, shape (6, 6), optional
        Of the new pose; the old one's without it.
    """
    names = [str(v) for v in pose["view"].values]
    moves = np.zeros((len(names), 6))
    moves[names.index(view)] = move
    whole = None
    if covariance is not None:
        whole = cross_covariance(pose, names)
        k = names.index(view)
        whole[k], whole[:, :, k] = 0.0, 0.0
        whole[k, :, k] = covariance
        whole = whole.reshape(6 * len(names), 6 * len(names))
    return moved_poses(pose, moves, whole)
