"""Rows of inverses from what is near a node: the inverse of the matrix of a few rings around it.

The inverse of a mass matrix decays by a factor of about 0.27 from one ring of neighbours to the
next, so that the rest of the row is small. What lies beyond the last ring is taken to have the
values of that ring: then rows are exact for a field that is the same everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csr_array

from sldvexp.field.elements import Patch
from sldvexp.field.system import PAIRS, System
from sldvexp.volume.samples import SampleRule

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Rings around a node that its row reaches: of samples that are a tensor product, and of others,
#: whose matrices are worse conditioned and decay more slowly.
RINGS, MORE_RINGS = 3, 4
#: Numbers of small matrices that are solved at once.
NUMBERS_AT_ONCE = 20_000_000


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """A patch's part of the graph.

    Parameters
    ----------
    nodes : ndarray of int, shape (patch_node,)
    place : ndarray of int, shape (patch_node, patch_node)
        Where the block of two nodes is in the system's graph; -1 for none.
    neighbours : csr_array of bool, shape (patch_node, patch_node)
    rings : int
        How far rows reach.
    """

    nodes: Indices
    place: NDArray[np.int32]
    neighbours: csr_array
    rings: int

    @classmethod
    def of(cls, system: System, patch: Patch, rings: int) -> Neighbourhood:
        """That of a patch."""
        graph, nodes = system.graph, patch.nodes
        local = np.full(graph.nodes, -1)
        local[nodes] = np.arange(len(nodes))
        length = np.diff(graph.indptr)[nodes]
        before = np.concatenate([[0], np.cumsum(length)[:-1]])
        entry = np.arange(length.sum()) + np.repeat(graph.indptr[nodes] - before, length)
        row, column = np.repeat(np.arange(len(nodes)), length), local[graph.indices[entry]]
        inside = column >= 0
        place = np.full((len(nodes), len(nodes)), -1, np.int32)
        place[row[inside], column[inside]] = entry[inside]
        ones = np.ones(np.count_nonzero(inside), bool)
        entries = (ones, (row[inside], column[inside]))
        return cls(nodes, place, csr_array(entries, shape=place.shape), rings)

    def reach(self, nodes: Indices) -> csr_array:
        """Nodes within so many rings of some, shape (node, patch_node)."""
        found = self.neighbours[nodes]
        for _ in range(self.rings - 1):
            found = (found @ self.neighbours).astype(bool)
        found.sort_indices()
        return found


def rings_of(rule: SampleRule) -> int:
    """How far rows reach."""
    return MORE_RINGS if rule.triangle is None else RINGS


def surface_rows(system: System, around: Neighbourhood, nodes: Indices) -> bsr_array:
    """Rows of the inverse of the surface's matrix.

    Parameters
    ----------
    system : System
    around : Neighbourhood
    nodes : ndarray of int, shape (own,)
        Places in the patch.

    Returns
    -------
    bsr_array, shape (own * block, patch_node * block)
    """
    block, reach = system.block, around.reach(nodes)
    length = np.diff(reach.indptr)
    data = np.empty((reach.nnz, block, block))
    blocks = _with_zero(system.surface_blocks)
    sums = system.surface_sums[around.nodes]
    for size in np.unique(length):
        rows = np.flatnonzero(length == size)
        step = max(1, NUMBERS_AT_ONCE // (size * block) ** 2)
        for first in range(0, len(rows), step):
            some = rows[first : first + step]
            entry = reach.indptr[some, None] + np.arange(size)
            near = reach.indices[entry]
            dense = blocks[around.place[near[:, :, None], near[:, None]]]
            dense[:, np.arange(size), np.arange(size)] += sums[near] - dense.sum(axis=2)
            data[entry] = _center_rows(dense, near == nodes[some, None])
    shape = (len(nodes) * block, len(around.place) * block)
    return bsr_array((data, reach.indices, reach.indptr), shape=shape)


def volume_rows(system: System, around: Neighbourhood, nodes: Indices) -> bsr_array:
    """Rows of the inverse of the whole matrix, of the nodes in all layers.

    Returns
    -------
    bsr_array, shape (layer * own * block, layer * patch_node * block)
    """
    layers, block, count = system.layers, system.block, len(around.place)
    reach = around.reach(nodes)
    pairs = _with_zero(np.moveaxis(system.pairs, 2, 0))
    data, indices = [], []
    for node, first, last in zip(nodes, reach.indptr[:-1], reach.indptr[1:], strict=True):
        near = reach.indices[first:last]
        here, number = pairs[around.place[near[:, None], near]], len(near)
        dense = np.zeros((layers, layers, number, number, block, block))
        for gap in range(layers - 1):
            for k, (i, j) in enumerate(PAIRS):
                dense[gap + i, gap + j] += here[:, :, gap, k]
                if i != j:
                    dense[gap + j, gap + i] += here[:, :, gap, k]
        rest = system.lumped[:, around.nodes[near]] - dense.sum(axis=(1, 3))
        for layer in range(layers):
            dense[layer, layer, np.arange(number), np.arange(number)] += rest[layer]
        size = layers * number * block
        right = np.zeros((layers, number, block, layers * block))
        right[:, np.flatnonzero(near == node)[0]] = np.eye(layers * block).reshape(
            layers, block, -1
        )
        matrix = dense.transpose(0, 2, 4, 1, 3, 5).reshape(size, size)
        columns = np.linalg.solve(matrix, right.reshape(size, -1)).astype(float)
        data.append(columns.reshape(-1, block, layers, block).transpose(2, 0, 3, 1))
        indices.append((near + count * np.arange(layers)[:, None]).ravel())
    return _assembled(data, indices, layers, (len(nodes), count), block)


def _assembled(
    data: list[Array], indices: list[Indices], layers: int, shape: tuple[int, int], block: int
) -> bsr_array:
    """Rows node by node, put layer by layer."""
    length = np.array([len(i) for i in indices], int)
    indptr = np.concatenate([[0], np.cumsum(np.tile(length, layers))])
    by_layer = [rows[layer] for layer in range(layers) for rows in data]
    size = layers * shape[0] * block, layers * shape[1] * block
    if not by_layer:
        return bsr_array(size, blocksize=(block, block))
    entries = np.concatenate(by_layer), np.tile(np.concatenate(indices), layers), indptr
    return bsr_array(entries, shape=size)


def _center_rows(dense: Array, center: NDArray[np.bool_]) -> Array:
    """Rows of the inverses of small matrices that belong to the center nodes.

    Parameters
    ----------
    dense : ndarray, shape (matrix, near, near, block, block)
    center : ndarray of bool, shape (matrix, near)
    """
    count, near, _, block, _ = dense.shape
    matrices = dense.transpose(0, 1, 3, 2, 4).reshape(count, near * block, near * block)
    right = center[..., None, None] * np.eye(block)
    columns = np.linalg.solve(matrices, right.reshape(count, near * block, block))
    return np.swapaxes(columns.reshape(count, near, block, block), 2, 3)


def _with_zero(blocks: Array) -> Array:
    """The same with zeros at the end, where -1 points to."""
    return np.concatenate([blocks, np.zeros_like(blocks[:1])])
