"""`check=surface_depth`: where in the volume the real surface is, without any geometry.

A view looks at another place of the structure where a sample lies off it by z. To first order that
adds a tangential velocity, ``z`` times the slope of the normal velocity; in the middle of a thin
shell there is none. So the depth of least tangential motion is that of the shell's middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.agreement import agreement, best_depth, jackknife
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.lazy import xarray as xr
from sldvexp.typing import ComplexArray


@register("check", "surface_depth")
@dataclass
class SurfaceDepth(Check):
    """Depth of the middle of a vibrating shell in the volume, from velocities alone.

    Away from it every view looks at another place of the structure. To first order that adds a
    tangential velocity, the distance times the slope of the normal velocity, and a thin shell that
    bends has the same by itself (Love): none in the middle of its thickness. So the tangential
    velocity is least there. To second order the views disagree, which needs no shell but says less;
    where they agree best is found besides if there are four views or more.

    Parameters
    ----------
    parts : int
        Into how many parts the surface is cut; how the depth changes when each is left out is its
        standard error, whatever the cause.
    of : str
        Which field: ``field``, or the name of one in ``compare``. One of splines on the surface has
        its middle where it was laid, which is no finding.
    """

    parts: int = 16
    of: str = "field"

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(self.parts >= 4, "parts", f"must be at least 4, not {self.parts}")
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``depth`` along the normals, ``agreement_depth``, ``misfit`` at sampled depths.

        Raises
        ------
        UserError
            If there is no field.
        """
        field = run.field_of(self.of)
        depth, std, inside = least_motion(field, run.groups["volume"], self.parts)
        notes = [] if inside else ["the surface lies outside of the volume; move volume.offset"]
        found = agreement(run, self.parts) if len(field["view"]) > 3 else None
        agreed, agreed_std = best_depth(found) if found else (None, None)
        group = dataset.group(
            "examined/surface_depth",
            {"sample_depth": found.depth if found else []},
            depth=depth,
            depth_std=std,
            agreement_depth=agreed,
            agreement_depth_std=agreed_std,
            misfit=found.misfit.sum(axis=0) / found.freedom.sum(axis=0) if found else None,
        )
        group.attrs["notes"] = "\n".join(notes)
        return group


def least_motion(field: xr.Dataset, volume: xr.Dataset, parts: int) -> tuple[float, float, bool]:
    """Find the depth of least tangential motion of all columns of nodes together.

    In each column the tangential velocity is ``a + b z``, to first order; the sum of all
    ``|a + b z|^2`` is least at ``z_0 = -Re(sum b* a) / sum |b|^2``.

    Parameters
    ----------
    field, volume : xarray.Dataset
        Groups of a run.
    parts : int
        Of the surface, for the standard error.

    Returns
    -------
    depth : float, m
        Along the normals.
    std : float, m
    inside : bool
        Whether it lies in the volume.
    """
    depth = volume["depth"].values
    tangential = _tangential(field, volume).reshape(len(depth), volume.sizes["surface_node"], -1)
    known = np.isfinite(tangential).all(axis=(0, 2))
    tangential = tangential[:, known]
    offset = depth - depth.mean()
    slope = np.einsum("l,lnc->nc", offset, tangential) / np.sum(offset**2)
    middle = tangential.mean(axis=0)
    each = np.array_split(np.arange(len(slope)), min(parts, len(slope)))
    along = np.array([np.sum(slope[n].conj() * middle[n]).real for n in each])
    square = np.array([np.sum(np.abs(slope[n]) ** 2) for n in each])
    found = depth.mean() - along.sum() / square.sum()
    without = depth.mean() - (along.sum() - along) / (square.sum() - square)
    return float(found), jackknife(without), bool(depth[0] <= found <= depth[-1])


def _tangential(field: xr.Dataset, volume: xr.Dataset) -> ComplexArray:
    """Take the tangential velocity of the nodes, (node, component, ...)."""
    velocity = field["velocity"].transpose("node", "component", ...).values
    if "n" in field["component"].values:
        return np.asarray(velocity[:, :2])
    normal = np.tile(volume["frame"].values[:, 2], (volume.sizes["layer"], 1))
    return np.asarray(velocity - np.einsum("ni,nj,nj...->ni...", normal, normal, velocity))
