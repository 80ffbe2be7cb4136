"""Rows of inverses, as far as they reach.

The inverse of a mass matrix decays by a factor of about 0.27 from one ring of neighbours to the
next, so that rows end after a few rings. What lies beyond is taken to have the values of the last
ring: then rows are exact for a field that is the same everywhere. Nodes get colours so that those
of one colour are too far apart to matter to one another, and all of a colour are solved as one
right-hand side.
Matrices are sparse, of small blocks; some operations on these that scipy lacks are at the end.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from sldvexp.field.equations.elements import Graph
from sldvexp.field.equations.system import HOLD, PAIRS, NormalEquations
from sldvexp.field.solvers.kronecker import factorised, solved
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray
from sldvexp.volume import SampleRule

#: Rings around a node that its row reaches: of samples that are a tensor product, and of others,
#: whose matrices are worse conditioned and decay more slowly.
RINGS, MORE_RINGS = 3, 4
#: Rings beyond those, with whose matrix rows are solved for: what lies further away changes them by
#: 0.27 to the power of 13, at most by a millionth of their last ring.
RINGS_BEYOND = 5
#: Rings between rows of one colour, each of which errs by what the other still has there. Without
#: any, the poses' standard errors of 36 thousand nodes err by 0.83 % (root mean square) and by 18 %
#: and more at worst, with two by 0.24 % and 7 %, as rows do that are solved one by one.
RINGS_BETWEEN = 2
#: Colours whose columns are solved together.
COLOURS_AT_ONCE = 32


def rings_of(rule: SampleRule) -> int:
    """Say how far rows reach."""
    return MORE_RINGS if rule.triangle is None else RINGS


@dataclass(frozen=True, eq=False)
class NearNodes:
    """Some own nodes of a surface, and those that rows of the inverse for these depend on.

    Attributes
    ----------
    nodes : ndarray of int, shape (near,)
        All of them, ascending.
    own : ndarray of int
        Places of the own ones in `nodes`.
    entries : csr_array of int, shape (near, near)
        Places of their blocks among the graph's.
    rings, between : int
        How many rings of neighbours rows of the own ones reach, and how many are between these.
    """

    nodes: IndexArray
    own: IndexArray
    entries: scipy.sparse.csr_array
    rings: int
    between: int

    @classmethod
    def of_own(
        cls, graph: Graph, own: IndexArray, rings: int, between: int = RINGS_BETWEEN
    ) -> NearNodes:
        """Find what is around some ascending nodes whose rows reach so many rings of neighbours.

        Fits by several methods have one graph, so that the latest that reach so far are kept.
        """
        of_graph = _latest.setdefault(graph, {})
        latest = of_graph.get((rings, between))
        if latest is not None and np.array_equal(latest.nodes[latest.own], own):
            return latest
        nodes = graph.around(own, rings + RINGS_BEYOND)
        entries = graph.entries[nodes][:, nodes]
        entries.sort_indices()
        found = cls(nodes, np.searchsorted(nodes, own), entries, rings, between)
        of_graph[rings, between] = found
        return found

    @cached_property
    def neighbours(self) -> scipy.sparse.csr_array:
        """Nodes that share a triangle, also with themselves, shape (near, near), bool."""
        ones = np.ones(len(self.entries.indices), bool)
        places = ones, self.entries.indices, self.entries.indptr
        return scipy.sparse.csr_array(places, shape=self.entries.shape)

    @cached_property
    def _inner(self) -> scipy.sparse.csr_array:
        """`reach` without its last ring."""
        return within(self.neighbours, self.own, self.rings - 1)

    @cached_property
    def reach(self) -> scipy.sparse.csr_array:
        """How far rows of the own ones reach, shape (own, near), bool."""
        return within_both(self._inner, self.neighbours)

    @cached_property
    def last(self) -> BoolArray:
        """Entries of `reach` that are in its last ring."""
        return _last_ring(self.reach, self._inner)

    @cached_property
    def colour(self) -> IndexArray:
        """Colours of the own ones, shape (own,)."""
        beyond = self.reach
        for _ in range(self.between):
            beyond = beyond @ self.neighbours
        return colours(self.reach, beyond)

    def factor(self, system: NormalEquations) -> scipy.sparse.linalg.SuperLU:
        """Factorise what a system's surface has between these nodes.

        Raises
        ------
        RuntimeError
            If that is singular.
        """
        size, entries = len(self.nodes) * system.block, self.entries
        blocks = system.surface_blocks[entries.data], entries.indices, entries.indptr
        matrix = scipy.sparse.bsr_array(blocks, shape=(size, size))
        return factorised(scipy.sparse.csc_array(matrix))


#: Latest nodes of graphs that are still there, by their rings.
_latest: WeakKeyDictionary[Graph, dict[tuple[int, int], NearNodes]] = WeakKeyDictionary()


def surface_rows(
    system: NormalEquations,
    own: IndexArray,
    place: IndexArray,
    rings: int,
    between: int = RINGS_BETWEEN,
) -> scipy.sparse.bsr_array:
    """Compute rows of the inverse of the surface's matrix, of some nodes.

    They are solved for with the matrix of what is near, all nodes of one colour as one right-hand
    side, so that neither memory nor time of a node grows with the surface.

    Parameters
    ----------
    own : ndarray of int, shape (own,)
        Ascending.
    place : ndarray of int, shape (surface_node,)
        Where columns of the result stand.
    rings, between : int
        As in `NearNodes`.

    Returns
    -------
    bsr_array, shape (own * block, place * block)

    Raises
    ------
    RuntimeError
        If the matrix of what is near is singular.
    """
    around, block = NearNodes.of_own(system.graph, own, rings, between), system.block
    factor, reach, colour = around.factor(system), around.reach, around.colour
    row, count = np.repeat(np.arange(len(own)), np.diff(reach.indptr)), len(around.nodes)
    data = np.empty((reach.nnz, block, block))
    for first in range(0, int(colour.max()) + 1, COLOURS_AT_ONCE):
        now = (colour >= first) & (colour < first + COLOURS_AT_ONCE)
        some = np.flatnonzero(now)
        unit = np.zeros((count, block, int(colour[some].max()) + 1 - first, block))
        unit[around.own[some], :, colour[some] - first] = np.eye(block)
        columns = solved(factor, unit.reshape(count * block, -1)).reshape(unit.shape)
        entry = np.flatnonzero(now[row])
        found = columns[reach.indices[entry], :, colour[row[entry]] - first]
        data[entry] = np.swapaxes(found, 1, 2)
    near = scipy.sparse.bsr_array(
        (data, reach.indices, reach.indptr), shape=(len(own) * block, count * block)
    )
    _close(near, row, around.last, system.surface_sums[around.nodes])
    column = place[np.asarray(around.nodes[near.indices], np.intp)]
    shape = len(own) * block, (int(place.max()) + 1) * block
    return scipy.sparse.bsr_array((near.data, column, near.indptr), shape=shape)


def _last_ring(reach: scipy.sparse.csr_array, inner: scipy.sparse.csr_array) -> BoolArray:
    """Mark entries of `reach` that are not of `inner`; all of a row without others."""
    rows, columns = reach.shape
    row = np.repeat(np.arange(rows), np.diff(reach.indptr))
    inner_row = np.repeat(np.arange(rows), np.diff(inner.indptr))
    key, inner_key = row * columns + reach.indices, inner_row * columns + inner.indices  # sorted
    at = np.minimum(np.searchsorted(inner_key, key), len(inner_key) - 1)
    last = inner_key[at] != key
    alone = np.bincount(row, last, rows) == 0
    return last | alone[row]


def _close(rows: scipy.sparse.bsr_array, row: IndexArray, last: BoolArray, sums: Array) -> None:
    """Give the last ring what rows lack to be exact for a constant, ``sum_m Z_nm s_m = 1``.

    Parameters
    ----------
    rows : bsr_array
        The matrix Z; changed in place.
    row : ndarray of int, shape (entry,)
    last : ndarray of bool, shape (entry,)
    sums : ndarray, shape (node, block, block)
        Sums s of the matrix's blocks over its columns.
    """
    nodes, block, _ = sums.shape
    lacking = np.eye(block) - (rows @ sums.reshape(-1, block)).reshape(-1, block, block)
    entries = last.astype(float), rows.indices, rows.indptr
    ring = scipy.sparse.csr_array(entries, shape=(len(lacking), nodes))
    whole = (ring @ sums.reshape(nodes, -1)).reshape(lacking.shape)
    share = lacking @ np.linalg.pinv(whole, rcond=1e-10, hermitian=True)
    rows.data[last] += share[row[last]]


def volume_rows(
    system: NormalEquations, nodes: IndexArray, place: IndexArray, rings: int
) -> scipy.sparse.bsr_array:
    """Compute rows of the inverse of the whole matrix, of some nodes in all layers.

    Each is that of the matrix of what is near.

    Parameters
    ----------
    nodes : ndarray of int, shape (some,)
    place : ndarray of int, shape (surface_node,)
        Where columns of the result stand.

    Returns
    -------
    bsr_array, shape (layer * some * block, layer * place * block)
    """
    layers, block, graph = system.layers, system.block, system.graph
    reach = within(graph.neighbours, nodes, rings)
    data, indices, count = [], [], int(place.max()) + 1
    for node, first, last in zip(nodes, reach.indptr[:-1], reach.indptr[1:], strict=True):
        near = np.asarray(reach.indices[first:last], np.intp)
        here, number = _blocks_of(system, near), len(near)
        dense = np.zeros((layers, layers, number, number, block, block))
        for gap in range(layers - 1):
            for k, (i, j) in enumerate(PAIRS):
                dense[gap + i, gap + j] += here[gap, k]
                if i != j:
                    dense[gap + j, gap + i] += here[gap, k]
        rest = system.sums[:, near] - dense.sum(axis=(1, 3))
        for layer in range(layers):
            dense[layer, layer, np.arange(number), np.arange(number)] += rest[layer]
        size = layers * number * block
        right = np.zeros((layers, number, block, layers * block))
        right[:, np.flatnonzero(near == node)[0]] = np.eye(layers * block).reshape(
            layers, block, -1
        )
        matrix = dense.transpose(0, 2, 4, 1, 3, 5).reshape(size, size)
        factor = _firmly_factorised(scipy.sparse.csc_array(matrix))
        columns = solved(factor, right.reshape(size, -1))
        data.append(columns.reshape(-1, block, layers, block).transpose(2, 0, 3, 1))
        indices.append((place[near] + count * np.arange(layers)[:, None]).ravel())
    return _assembled(data, indices, layers, (len(nodes), count), block)


def _firmly_factorised(matrix: scipy.sparse.csc_array) -> scipy.sparse.linalg.SuperLU:
    """Factorise what is near; what nothing determines there is held, as in the whole matrix."""
    try:
        return factorised(matrix)
    except RuntimeError:
        held = HOLD * matrix.diagonal().mean() * scipy.sparse.eye_array(matrix.shape[0])
        return factorised(scipy.sparse.csc_array(matrix + held))


def _blocks_of(system: NormalEquations, near: IndexArray) -> Array:
    """Take the blocks of some nodes, shape (gap, 3, near, near, block, block)."""
    graph = system.graph
    key = near[:, None] * graph.nodes + near
    entry = np.minimum(np.searchsorted(graph.keys, key), len(graph.keys) - 1)
    there = graph.keys[entry] == key
    return system.pairs[:, :, entry] * there[..., None, None]


def _assembled(
    data: list[Array], indices: list[IndexArray], layers: int, shape: tuple[int, int], block: int
) -> scipy.sparse.bsr_array:
    """Order rows that are given node by node layer by layer."""
    length = np.array([len(i) for i in indices], int)
    indptr = np.concatenate([[0], np.cumsum(np.tile(length, layers))])
    by_layer = [rows[layer] for layer in range(layers) for rows in data]
    size = layers * shape[0] * block, layers * shape[1] * block
    if not by_layer:
        return scipy.sparse.bsr_array(size, blocksize=(block, block))
    entries = np.concatenate(by_layer), np.tile(np.concatenate(indices), layers), indptr
    return scipy.sparse.bsr_array(entries, shape=size)


def within(
    neighbours: scipy.sparse.csr_array, nodes: IndexArray, rings: int
) -> scipy.sparse.csr_array:
    """Find the nodes within so many rings of some, these among them, sorted.

    Parameters
    ----------
    neighbours : csr_array of bool, shape (node, node)
        With every node its own neighbour.
    nodes : ndarray of int, shape (some,)

    Returns
    -------
    csr_array of bool, shape (some, node)
    """
    reached = neighbours[nodes]
    for _ in range(rings - 1):
        reached = (reached @ neighbours).astype(bool)
    reached.sort_indices()
    return reached


def within_both(a: scipy.sparse.csr_array, b: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
    """Find the nodes that two ways lead to one after the other, sorted."""
    reached = (a @ b).astype(bool)
    reached.sort_indices()
    return reached


def colours(reach: scipy.sparse.csr_array, beyond: scipy.sparse.csr_array) -> IndexArray:
    """Colour nodes one by one, each with the first colour that nothing beyond its reach has yet.

    Parameters
    ----------
    reach, beyond : csr_array of bool, shape (node, other)
        What rows of a node reach, and where no other row of its colour may.
    """
    found = np.empty(reach.shape[0], np.intp)
    taken = [0] * reach.shape[1]  # a bit for every colour that reaches there
    all_reached, all_beyond = reach.indices.tolist(), beyond.indices.tolist()
    first_reached, first_beyond = reach.indptr.tolist(), beyond.indptr.tolist()
    for node in range(len(found)):
        colour = 0
        for other in all_beyond[first_beyond[node] : first_beyond[node + 1]]:
            colour |= taken[other]
        colour = ~colour & (colour + 1)
        for other in all_reached[first_reached[node] : first_reached[node + 1]]:
            taken[other] |= colour
        found[node] = colour.bit_length() - 1
    return found


def block_rows(matrix: scipy.sparse.bsr_array, rows: IndexArray) -> scipy.sparse.bsr_array:
    """Take some block rows of a matrix."""
    length = np.diff(matrix.indptr)[rows]
    start = np.concatenate([[0], np.cumsum(length)])
    entry = np.arange(start[-1]) + np.repeat(matrix.indptr[rows] - start[:-1], length)
    shape = (len(rows) * matrix.blocksize[0], matrix.shape[1])
    return scipy.sparse.bsr_array((matrix.data[entry], matrix.indices[entry], start), shape=shape)


def diagonal_blocks(matrix: scipy.sparse.bsr_array, weight: Array) -> Array:
    """Compute the blocks on the diagonals of ``A_l W A_l^T``, shape (l, row, p, p).

    Parameters
    ----------
    matrix : bsr_array
        In blocks (p, l): column l of each is of the matrix A_l.
    weight : ndarray, shape (column,)
        The diagonal matrix W.
    """
    _, p, count = matrix.data.shape
    sums = _weighted_sums(matrix, weight)
    found = np.empty((count, sums.shape[0], p, p))
    for i in range(p):
        for j in range(i + 1):
            of_both = sums @ (matrix.data[:, i] * matrix.data[:, j])
            found[:, :, i, j] = found[:, :, j, i] = of_both.T
    return found


def sums_of_squares(matrix: scipy.sparse.bsr_array, weight: Array) -> Array:
    """Compute ``sum_j w_j a_ij^2``, shape (row, p), of a matrix of (1, p) blocks a.

    Parameters
    ----------
    matrix : bsr_array, shape (row, column * p)
    weight : ndarray, shape (column,)
    """
    squares: Array = _weighted_sums(matrix, weight) @ np.square(matrix.data[:, 0])
    return squares


def _weighted_sums(matrix: scipy.sparse.bsr_array, weight: Array) -> scipy.sparse.csr_array:
    """Make the matrix that sums over a row's blocks, weighted as their columns are."""
    blocks = len(matrix.indices)
    entries = weight[matrix.indices], np.arange(blocks), matrix.indptr
    return scipy.sparse.csr_array(entries, shape=(len(matrix.indptr) - 1, blocks))


def with_blocks(matrix: scipy.sparse.bsr_array, blocks: Array) -> scipy.sparse.bsr_array:
    """Put other blocks into the places of a matrix."""
    rows, columns = len(matrix.indptr) - 1, matrix.shape[1] // matrix.blocksize[1]
    shape = rows * blocks.shape[1], columns * blocks.shape[2]
    return scipy.sparse.bsr_array((blocks, matrix.indices, matrix.indptr), shape=shape)
