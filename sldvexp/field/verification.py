"""Bounds of a few nodes computed exactly, to know how far the others may be off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.near_inverse import NearInverse
from sldvexp.field.parts import Part
from sldvexp.field.system import Solve, System

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Surface nodes of a part that are verified, each in one layer.
NODES = 4


def largest_error(
    part: Part,
    rows: NearInverse,
    noise: Array,
    determined: NDArray[np.bool_],
    system: System,
    solve: Solve,
) -> float:
    """Largest relative error of the standard errors of some of a part's nodes.

    Parameters
    ----------
    part : Part
    rows : NearInverse
    noise : ndarray, shape (layer, surface_node, parameter, view)
        Variances that are to be verified.
    determined : ndarray of bool, shape (layer, surface_node, parameter)
    system : System
    solve : Solve
    """
    parameters, worst = noise.shape[2], 0.0
    layer, own = _chosen(rows, determined[:, part.region.own])
    node = part.region.own[own]
    unit = np.zeros((system.layers, system.graph.nodes, system.block, len(node), system.block))
    for i, (x, n) in enumerate(zip(layer, node, strict=True)):
        unit[x, n, :, i] = np.eye(system.block)
    inverse = solve(unit.reshape(*unit.shape[:3], -1)).reshape(unit.shape)[:, part.patch.nodes]
    if system.block == 1:
        inverse = inverse * np.eye(parameters)[:, None]
    for i, (x, n) in enumerate(zip(layer, node, strict=True)):
        columns = inverse[:, :, :, i].reshape(-1, parameters)
        exact = sum(
            ((r.T @ columns) ** 2).T @ std**2
            for r, std in zip(part.influences, part.model.pixel_std, strict=True)
        )
        known = determined[x, n] & (exact > 0)
        ratio = noise[x, n, known].sum(axis=-1) / exact[known]
        worst = max(worst, float(np.abs(np.sqrt(ratio) - 1).max(initial=0.0)))
    return worst


def _chosen(rows: NearInverse, determined: NDArray[np.bool_]) -> tuple[Indices, Indices]:
    """Some nodes spread over the part, and the one whose information differs most from the mean."""
    layers, count = determined.shape[:2]
    own = np.linspace(0, count - 1, min(NODES, count)).round().astype(np.intp)
    layer = np.arange(len(own)) * (layers - 1) // max(1, len(own) - 1)
    size = rows.turn.shape[-1]
    odd = np.abs(rows.turn - np.eye(size)).max(axis=(2, 3)) * determined.all(axis=2)
    x, n = np.unravel_index(np.argmax(odd), odd.shape)
    return np.append(layer, x), np.append(own, n)
