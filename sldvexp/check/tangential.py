"""Where through the thickness of a volume the tangential velocity is least."""

from __future__ import annotations

import numpy as np

from sldvexp.check.agreement import jackknife
from sldvexp.lazy import xarray as xr
from sldvexp.typing import ComplexArray


def least_motion(field: xr.Dataset, volume: xr.Dataset, parts: int) -> tuple[float, float, bool]:
    """Depth of the least tangential motion of all columns of nodes together.

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
    """Tangential velocity of the nodes, (node, component, ...)."""
    velocity = field["velocity"].transpose("node", "component", ...).values
    if "n" in field["component"].values:
        return np.asarray(velocity[:, :2])
    normal = np.tile(volume["frame"].values[:, 2], (volume.sizes["layer"], 1))
    return np.asarray(velocity - np.einsum("ni,nj,nj...->ni...", normal, normal, velocity))
