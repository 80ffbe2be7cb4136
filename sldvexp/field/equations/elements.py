"""Prisms between nodal values and samples: basis functions, and nodes that share a prism.

A nodal field becomes values at samples by ``B f`` and sums over samples become nodal by ``B^T f``,
both without a matrix. Arrays over nodes have the shape (layer, surface_node, ...), over samples
(gap, triangle, point, ...); both are plain reshapes of the dataset's order. From pixels to right-
hand sides leads a sparse matrix a view, ``b = sum_k R_k v_k``, through which bounds know that
samples share pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
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

    @cached_property
    def keys(self) -> IndexArray:
        """Row and column of each entry of `indices` as one number, ascending."""
        return self.row * self.nodes + self.indices

    @cached_property
    def entries(self) -> scipy.sparse.csr_array:
        """Place of each block among `indices`, shape (node, node), int."""
        places = np.arange(len(self.indices))
        size = (self.nodes, self.nodes)
        return scipy.sparse.csr_array((places, self.indices, self.indptr), shape=size)

    def around(self, nodes: IndexArray, rings: int) -> IndexArray:
        """Take so many rings of neighbours to some ascending nodes; all of them, ascending."""
        for _ in range(rings):
            nodes = np.unique(self.neighbours[nodes].indices)
        return nodes


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

    def gap_at_samples(self, nodal: Array) -> Array:
        """Interpolate as `at_samples` does in a gap, samples last: (2, node, m) to (m, sample)."""
        corner = np.ascontiguousarray(nodal[:, self.corner].transpose(3, 1, 0, 2))
        values = corner.reshape(-1, self.shape.shape[1]) @ self.shape.T
        return values.reshape(len(corner), -1)

    def to_nodes(self, samples: Array) -> Array:
        """Sum over samples, ``B^T f``: from (sample, m) to (layer, patch_node, m)."""
        columns = samples.shape[-1]
        each = self.shape.T @ samples.reshape(*self.sample_shape, columns)
        triangles = len(self.triangles)
        sums = np.zeros((self.layers, triangles, 3, columns))
        sums[:-1] += each[:, :, :3]
        sums[1:] += each[:, :, 3:]
        flat = sums.reshape(self.layers, triangles * 3, columns)
        return np.stack([self.gather @ layer for layer in flat])

    def ones_to_nodes(self) -> Array:
        """Sum as `to_nodes` does where every sample has 1, shape (layer, patch_node, 1)."""
        found = np.zeros((self.layers, len(self.nodes), 1))
        of_prism = self.shape.sum(axis=0).reshape(2, 3)
        for layers, of_triangle in zip((found[:-1], found[1:]), of_prism, strict=True):
            layers += (self.gather @ np.tile(of_triangle, len(self.triangles)))[:, None]
        return found

    def gap_to_nodes(self, samples: Array) -> Array:
        """Sum as `to_nodes` does over a gap's samples, which are last: (m, sample) to (2, node, m).

        The gap's lower and upper layer get a part each. One product with the few basis functions
        serves all prisms, and what is in between stays in the cache.
        """
        triangles, points = self.sample_shape[1:]
        each = (samples.reshape(-1, points) @ self.shape).reshape(-1, triangles, 2, 3)
        corners = np.ascontiguousarray(each.transpose(2, 1, 3, 0))
        return np.stack([self.gather @ c for c in corners.reshape(2, triangles * 3, -1)])

    @cached_property
    def gather(self) -> scipy.sparse.csr_array:
        """Sums corners of triangles at their nodes."""
        corners = self.corner.size
        entries = (np.ones(corners), (self.corner.ravel(), np.arange(corners)))
        return scipy.sparse.csr_array(entries, shape=(len(self.nodes), corners))

    @property
    def along(self) -> Array:
        """Basis functions of the line through a prism at its samples, shape (2, point)."""
        return np.stack([self.shape[:, :3].sum(axis=1), self.shape[:, 3:].sum(axis=1)])

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


def influences_by_layers(
    patch: Patch, estimators: Sequence[Array], weights: scipy.sparse.csr_array
) -> list[scipy.sparse.bsr_array]:
    """Compute `influence` of several models with the layers of a node beside one another.

    These see nearly the same pixels. Gap by gap and for all models at once; where a sample's pixels
    are among those of its triangle's corners is found before, so that each gap is one product.

    Parameters
    ----------
    estimators : sequence of ndarray, shape (sample, parameter)
        Of each model.

    Returns
    -------
    list of bsr_array, shape (patch_node * parameter, pixel * layer)
        In blocks (parameter, layer).
    """
    gaps, layers, pixels = patch.sample_shape[0], patch.layers, weights.shape[1]
    samples, used = weights.shape[0] // gaps, [e for e in estimators if e.any()]
    shapes = [(len(patch.nodes) * e.shape[1], pixels * layers) for e in estimators]
    if not used:
        blocks = [(e.shape[1], layers) for e in estimators]
        pairs = zip(shapes, blocks, strict=True)
        return [scipy.sparse.bsr_array(shape, blocksize=block) for shape, block in pairs]
    count = sum(e.shape[1] for e in used)
    triangles = samples // len(patch.shape)
    across = np.tile(patch.shape[:, :3] + patch.shape[:, 3:], (triangles, 1))
    along = np.tile(patch.along, triangles).T
    seen, place, of_nodes = _pixels_of_nodes(patch, weights)
    indices, indptr = of_nodes.indices, of_nodes.indptr
    data = np.zeros((layers, len(indices), count))
    for gap in range(gaps):
        here = slice(gap * samples, (gap + 1) * samples)
        estimator = np.concatenate([e[here] for e in used], axis=1)
        both = (along[:, :, None] * estimator[:, None]).reshape(samples, 2 * count)
        start = weights.indptr[here.start : here.stop + 1]
        some = slice(start[0], start[-1])
        values = np.repeat(across, np.diff(start), axis=0) * weights.data[some, None]
        to = place.take(seen[some], axis=0)  # a column has a sample's pixels, at three corners each
        entries = values.ravel(), to.ravel(), 3 * (start - start[0])
        corners = scipy.sparse.csc_array(entries, shape=(len(indices), samples))
        sums = (corners @ both).reshape(-1, 2, count)
        data[gap] += sums[:, 0]
        data[gap + 1] += sums[:, 1]
    found, first = [], 0
    for e, shape in zip(estimators, shapes, strict=True):
        p = e.shape[1]
        if not e.any():  # the rows leave this view out
            found.append(scipy.sparse.bsr_array(shape, blocksize=(p, layers)))
            continue
        beside = np.ascontiguousarray(np.moveaxis(data[..., first : first + p], 0, 2))
        found.append(scipy.sparse.bsr_array((beside, indices, indptr), shape=shape))
        first += p
    return found


def _pixels_of_nodes(
    patch: Patch, weights: scipy.sparse.csr_array
) -> tuple[IndexArray, IndexArray, scipy.sparse.csr_array]:
    """List the pixels that bear on each node, through those of each triangle.

    Returns
    -------
    seen : ndarray of int, shape (entry,)
        Where each entry of the weights is among the triangles' pixels.
    place : ndarray of int, shape (pixel of a triangle, corner)
        Where these are among the pixels of the triangle's corners.
    of_nodes : csr_array of int, shape (patch_node, pixel)
        Those of the nodes, numbered.
    """
    gaps, triangles, points = patch.sample_shape
    samples = np.arange(weights.shape[0]).reshape(gaps, triangles, points)
    ends = np.arange(0, samples.size + 1, gaps * points)
    of_triangles = _ones(samples.swapaxes(0, 1).ravel(), ends, weights.shape[0])
    known = _ones(weights.indices, weights.indptr, weights.shape[1])
    near = numbered(of_triangles @ known)
    triangle = np.tile(np.repeat(np.arange(triangles), points), gaps)
    row = np.repeat(triangle, np.diff(weights.indptr))
    seen = numbers_at(near, row, weights.indices)
    at_corners = _ones(patch.corner.ravel(), 3 * np.arange(triangles + 1), len(patch.nodes))
    of_nodes = numbered(at_corners.T.tocsr() @ _ones(near.indices, near.indptr, near.shape[1]))
    node = np.repeat(patch.corner, np.diff(near.indptr), axis=0)
    place = numbers_at(of_nodes, node.ravel(), np.repeat(near.indices, 3))
    return seen, place.reshape(-1, 3), of_nodes


def _ones(indices: IndexArray, indptr: IndexArray, columns: int) -> scipy.sparse.csr_array:
    """Make a matrix of bool that is true at some places."""
    entries = np.ones(len(indices), bool), indices, indptr
    return scipy.sparse.csr_array(entries, shape=(len(indptr) - 1, columns))


def numbered(matrix: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
    """Give the places of a matrix numbers, row by row and sorted."""
    matrix.sort_indices()
    entries = np.arange(len(matrix.indices)), matrix.indices, matrix.indptr
    return scipy.sparse.csr_array(entries, shape=matrix.shape)


def numbers_at(matrix: scipy.sparse.csr_array, row: IndexArray, column: IndexArray) -> IndexArray:
    """Look up the numbers of a matrix of `numbered` at some places, which it has."""
    if not len(row):  # of which scipy makes a matrix
        return np.zeros(0, np.intp)
    found = matrix[row, column.copy()]  # scipy wants to write into what it is given
    return np.asarray(found, np.intp).ravel()


def with_layers_apart(beside: scipy.sparse.bsr_array) -> scipy.sparse.bsr_array:
    """Turn a matrix of `influences_by_layers` into that of `influence`, with zeros of its own."""
    parameters, layers = beside.blocksize
    nodes, blocks = len(beside.indptr) - 1, len(beside.indices)
    data = np.moveaxis(beside.data, 2, 0).reshape(layers * blocks, parameters, 1)
    start = beside.indptr[:-1] + blocks * np.arange(layers)[:, None]
    indptr = np.append(start.ravel(), layers * blocks)
    shape = layers * nodes * parameters, beside.shape[1] // layers
    return scipy.sparse.bsr_array((data, np.tile(beside.indices, layers), indptr), shape=shape)
