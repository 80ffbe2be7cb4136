"""Prisms between nodal values and samples: basis functions, and nodes that share a prism.

A nodal field becomes values at samples by ``B f`` and sums over samples become nodal by ``B^T f``,
both without a matrix. Arrays over nodes have the shape (layer, surface_node, ...), over samples
(gap, triangle, point, ...); both are plain reshapes of the dataset's order. From pixels to right-
hand sides leads a sparse matrix a view, ``b = sum_k R_k v_k``, through which bounds know that
samples share pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, IndexArray
from sldvexp.volume import Prisms, SampleRule


@dataclass(frozen=True, eq=False)
class Graph:
    """Graph of surface nodes that share a triangle: blocks of matrices over the surface.

    Parameters
    ----------
    indptr, indices : ndarray of int
        As of a sorted CSR matrix; every node is a neighbour of itself.
    place : ndarray of int, shape (triangle, 3, 3)
        Where the block of two corners of a triangle is among `indices`.
    """

    indptr: IndexArray
    indices: IndexArray
    place: IndexArray

    @classmethod
    def from_prisms(cls, prisms: Prisms) -> Graph:
        """Connect the surface nodes of a volume."""
        count = prisms.surface_nodes
        row = np.repeat(prisms.triangles, 3, axis=1).astype(np.intp)
        key = row * count + np.tile(prisms.triangles, (1, 3))
        keys, place = np.unique(key, return_inverse=True)
        indptr = np.searchsorted(keys, count * np.arange(count + 1))
        return cls(indptr, keys % count, place.reshape(-1, 3, 3))

    @property
    def nodes(self) -> int:
        """Nodes of the surface."""
        return len(self.indptr) - 1

    @cached_property
    def row(self) -> IndexArray:
        """Row of each entry of `indices`."""
        return np.repeat(np.arange(self.nodes), np.diff(self.indptr))

    @cached_property
    def neighbours(self) -> scipy.sparse.csr_array:
        """Nodes that share a triangle, also with themselves, shape (node, node), bool."""
        ones = np.ones(len(self.indices), bool)
        return scipy.sparse.csr_array(
            (ones, self.indices, self.indptr), shape=(self.nodes, self.nodes)
        )

    @cached_property
    def diagonal(self) -> IndexArray:
        """Places of the blocks of a node with itself, shape (surface_node,)."""
        return np.flatnonzero(self.indices == self.row)


@dataclass(frozen=True, eq=False)
class Patch:
    """Prisms over some triangles, with the nodes of these numbered anew.

    Parameters
    ----------
    triangles : ndarray of int, shape (triangle,)
    nodes : ndarray of int, shape (patch_node,)
        Surface nodes of the patch, ascending.
    corner : ndarray of int, shape (triangle, 3)
        Corners of the triangles as places in `nodes`.
    shape : ndarray, shape (point, 6)
        Basis functions of a prism (Eq 5.20) at its samples.
    """

    triangles: IndexArray
    nodes: IndexArray
    corner: IndexArray
    layers: int
    shape: Array

    @classmethod
    def over(cls, prisms: Prisms, rule: SampleRule, triangles: IndexArray) -> Patch:
        """Take the patch over these triangles of a volume."""
        nodes, corner = np.unique(prisms.triangles[triangles], return_inverse=True)
        return cls(triangles, nodes, corner.reshape(-1, 3), prisms.layers, rule.shape())

    @property
    def count(self) -> int:
        """Nodes in all layers."""
        return self.layers * len(self.nodes)

    @property
    def sample_shape(self) -> tuple[int, int, int]:
        """(gap, triangle, point)."""
        return self.layers - 1, len(self.triangles), len(self.shape)

    def at_samples(self, nodal: Array) -> Array:
        """Interpolate, ``B f``: nodal values (layer, patch_node, m) to samples (sample, m)."""
        corner = nodal[:, self.corner]
        values = self.shape[:, :3] @ corner[:-1]
        values += self.shape[:, 3:] @ corner[1:]
        return values.reshape(-1, nodal.shape[-1])

    def to_nodes(self, samples: Array) -> Array:
        """Sum over samples, ``B^T f``: from (sample, m) to (layer, patch_node, m)."""
        columns = samples.shape[-1]
        each = self.shape.T @ samples.reshape(*self.sample_shape, columns)
        triangles = len(self.triangles)
        sums = np.zeros((self.layers, triangles, 3, columns))
        sums[:-1] += each[:, :, :3]
        sums[1:] += each[:, :, 3:]
        flat = sums.reshape(self.layers, triangles * 3, columns)
        return np.stack([self._gather @ layer for layer in flat])

    @cached_property
    def _gather(self) -> scipy.sparse.csr_array:
        """Sums corners of triangles at their nodes."""
        corners = self.corner.size
        entries = (np.ones(corners), (self.corner.ravel(), np.arange(corners)))
        return scipy.sparse.csr_array(entries, shape=(len(self.nodes), corners))

    @cached_property
    def transposed(self) -> scipy.sparse.csr_array:
        """``B^T``, shape (node, sample)."""
        gaps, triangles, points = self.sample_shape
        step = len(self.nodes) * np.arange(gaps)[:, None, None]
        element = step + np.concatenate([self.corner, self.corner + len(self.nodes)], axis=1)
        samples = gaps * triangles * points
        columns = np.repeat(element.reshape(-1, 6), points, axis=0).ravel().astype(np.int32)
        values = np.tile(self.shape.ravel(), gaps * triangles)
        rows = np.arange(0, 6 * samples + 1, 6, dtype=np.int32)
        matrix = scipy.sparse.csr_array((values, columns, rows), shape=(samples, self.count))
        return matrix.T.tocsr()


def influence(
    patch: Patch, estimator: Array, weights: scipy.sparse.csr_array
) -> scipy.sparse.bsr_array:
    """Compute ``R = sum_s B_s^T (x) T_s W_s`` of one view over a patch.

    Parameters
    ----------
    estimator : ndarray, shape (sample, parameter)
        The view's column of T_s.
    weights : csr_array, shape (sample, pixel)
        Of the pixels' velocities.

    Returns
    -------
    bsr_array, shape (node * parameter, pixel), blocks (parameter, 1)
    """
    parameters, pixels = estimator.shape[1], weights.shape[1]
    shape = patch.count * parameters, pixels
    if not estimator.any():  # the rows leave this view out
        return scipy.sparse.bsr_array(shape, blocksize=(parameters, 1))
    of_entries = np.repeat(estimator, np.diff(weights.indptr), axis=0) * weights.data[:, None]
    entries = of_entries[:, None], weights.indices, weights.indptr
    weighted = scipy.sparse.bsr_array(entries, shape=(len(estimator), pixels * parameters))
    sums = scipy.sparse.bsr_array(patch.transposed, blocksize=(1, 1)) @ weighted
    blocks = sums.data.reshape(-1, parameters, 1)
    return scipy.sparse.bsr_array((blocks, sums.indices, sums.indptr), shape=shape)
