"""Bounds of a few nodes computed exactly, to know how far the others may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.field.bounds.mode_effect import column_variances
from sldvexp.field.bounds.near_inverse import NearRows
from sldvexp.field.bounds.pose_uncertainty import PoseEffect
from sldvexp.field.equations.regions import Part
from sldvexp.field.equations.system import Solve, System
from sldvexp.typing import Array, BoolArray, IndexArray

#: Surface nodes of a part that are verified, each in one layer.
NODES = 4


@dataclass(frozen=True, eq=False)
class Verification:
    """What is verified.

    Parameters
    ----------
    part : Part
    pose : PoseEffect, optional
    right : ndarray, optional
        Its right-hand sides.
    noise : ndarray, shape (layer, surface_node, parameter)
        Variances from the noise.
    kept : ndarray, shape (layer, surface_node, parameter, ...)
        Those from the poses, as `pose` gives them.
    determined : ndarray of bool, shape (layer, surface_node, parameter)
    """

    part: Part
    pose: PoseEffect | None
    right: Array | None
    noise: Array
    kept: Array
    determined: BoolArray

    def largest_error(self, rows: NearRows, system: System, solve: Solve) -> float:
        """Largest relative error of the standard errors of some of the part's nodes."""
        layer, own = self._chosen(rows)
        node, block = self.part.region.own[own], system.block
        unit = np.zeros((system.layers, system.graph.nodes, block, len(node), block))
        for i, (x, n) in enumerate(zip(layer, node, strict=True)):
            unit[x, n, :, i] = np.eye(block)
        columns = solve(unit.reshape(*unit.shape[:3], -1)).reshape(unit.shape)
        inverse = columns[:, self.part.patch.nodes]
        if block == 1:
            inverse = inverse * np.eye(self.noise.shape[2])[:, None]
        worst = 0.0
        for i, (x, n) in enumerate(zip(layer, node, strict=True)):
            exact = self._variance(inverse[:, :, :, i])
            known = self.determined[x, n] & np.all(exact > 0, axis=1)
            near = self.noise[x, n, known, None] + self._of_pose(self.kept[x, n, known])
            ratio = np.sqrt(near / exact[known])
            worst = max(worst, float(np.abs(ratio - 1).max(initial=0.0)))
        return worst

    def _variance(self, inverse: Array) -> Array:
        """Of a node, from its row of the inverse (layer, patch_node, parameter, parameter)."""
        row = inverse.reshape(-1, inverse.shape[-1]).T
        total = np.zeros((len(row), 1))
        for r, std in zip(self.part.influences, self.part.model.pixel_std, strict=True):
            total += ((r.T @ row.T) ** 2).T @ std[:, None] ** 2
        if self.pose is None or self.right is None:
            return total
        return total + self._of_pose(self.pose.variance(row @ self.right.reshape(len(row.T), -1)))

    def _of_pose(self, kept: Array) -> Array:
        """Variances of the data's columns, shape (..., column)."""
        return kept if self.pose is None else column_variances(self.pose, kept)

    def _chosen(self, rows: NearRows) -> tuple[IndexArray, IndexArray]:
        """Some nodes spread over the part, and one with the oddest information."""
        determined = self.determined[:, self.part.region.own]
        layers, count = determined.shape[:2]
        own = np.linspace(0, count - 1, min(NODES, count)).round().astype(np.intp)
        layer = np.arange(len(own)) * (layers - 1) // max(1, len(own) - 1)
        far = np.abs(rows.turn - np.eye(rows.turn.shape[-1])).max(axis=(2, 3))
        x, n = np.unravel_index(np.argmax(far * determined.all(axis=2)), far.shape)
        return np.append(layer, x), np.append(own, n)
