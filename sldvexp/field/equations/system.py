"""The normal equations of a field, ``M theta = b`` with ``M = sum_s B_s^T B_s (x) N_s``.

B_s holds the basis functions at a sample and N_s the sample's own information. A prism's basis
functions are products of those of its triangle, t, and of the line through it, l. In the layers i
and j of each gap M has the block ``S = sum_s l_i l_j t t^T (x) N_s`` over the surface. Where N_s
does not change with depth and samples are a tensor product, M is one Kronecker product of a matrix
of the line and one of the surface; elsewhere that of the means over depth is near it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sldvexp.field.equations.elements import Graph, Patch
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray
from sldvexp.volume import SampleRule

#: From real right-hand sides (layer, surface_node, block, column) to the solutions.
Solve = Callable[[Array], Array]

#: Pairs of layers of a gap: lower with itself, lower with upper, upper with itself.
PAIRS = ((0, 0), (0, 1), (1, 1))
#: How often each stands in the sum over all four blocks of a gap.
TIMES = (1, 2, 1)
#: Unknowns up to which a system's matrix and its inverse are looked at as a whole.
SMALL = 2000
#: How firmly a node with too few samples is held, over the mean information of a node.
HOLD = 1e-9


def gap_coefficients(rule: SampleRule) -> Array:
    """Multiply ``l_i l_j t_c t_d`` at a prism's samples, shape (3 pairs, corner, corner, point)."""
    t, lower = rule.parameter[:, :3], (1 - rule.parameter[:, 3]) / 2
    line = np.stack([lower, 1 - lower], axis=1)
    pairs = np.stack([line[:, i] * line[:, j] for i, j in PAIRS])
    return np.einsum("kp,pc,pd->kcdp", pairs, t, t)


def line_matrix(rule: SampleRule, layers: int) -> Array:
    """Average ``l l^T`` over a gap's samples, put together over the gaps, shape (layer, layer)."""
    lower = (1 - rule.parameter[:, 3]) / 2
    line = np.stack([lower, 1 - lower], axis=1)
    matrix = np.zeros((layers, layers))
    for gap in range(layers - 1):
        matrix[gap : gap + 2, gap : gap + 2] += line.T @ line / len(line)
    return matrix


class Assembly:
    """Collects M, patch by patch.

    Parameters
    ----------
    block : int
        Unknowns of a node that M couples.
    whole : bool
        Whether the blocks of each gap are wanted even of a large system, and not the mean of their
        sums alone; those of a small one always are.
    """

    def __init__(
        self, graph: Graph, rule: SampleRule, layers: int, block: int, *, whole: bool = True
    ) -> None:
        self.graph, self.rule, self.layers, self.block = graph, rule, layers, block
        self.whole = whole or is_small(layers * graph.nodes * block)
        each = (layers - 1, 3) if self.whole else (1, 1)
        self.pairs = np.zeros((*each, len(graph.indices), block, block))
        self.lumped = None if self.whole else np.zeros((layers, graph.nodes, block, block))
        self.uniform = rule.triangle is not None

    def add(self, patch: Patch, information: Array) -> None:
        """Add the samples of a patch.

        Parameters
        ----------
        information : ndarray, shape (sample, block, block)
            The matrices N_s.
        """
        gaps, triangles, points = patch.sample_shape
        square = self.block**2
        here = np.ascontiguousarray(information.T).reshape(square, gaps, triangles, points)
        same = self.rule.triangle is not None and self._same_at_all_depths(here)
        self.uniform = self.uniform and same
        coefficients = gap_coefficients(self.rule).reshape(3, 9, points)
        if self.lumped is not None:  # the mean of all gaps, and of all pairs of a gap's layers
            coefficients = np.tensordot(TIMES, coefficients, axes=1)[None]
            lumped = patch.to_nodes(information.reshape(-1, square))
            self.lumped[:, patch.nodes] += lumped.reshape(*lumped.shape[:2], *2 * [self.block])
            here = here.mean(axis=1, keepdims=True)
        elif same:
            here = here[:, :1]
        place, which = np.unique(self.graph.place[patch.triangles], return_inverse=True)
        corners = which.reshape(triangles, 9).T.ravel()  # (corner, corner, triangle)
        entries = np.ones(len(corners)), (corners, np.arange(len(corners)))
        at_entries = scipy.sparse.csr_array(entries, shape=(len(place), len(corners)))
        for gap in range(here.shape[1]):
            of_gap = slice(None) if same and self.lumped is None else gap
            for pair, some in enumerate(coefficients):
                blocks = some @ here[:, gap].reshape(-1, points).T
                blocks = blocks.reshape(9, square, triangles).swapaxes(1, 2)
                sums = at_entries @ np.ascontiguousarray(blocks).reshape(-1, square)
                self.pairs[of_gap, pair, place] += sums.reshape(-1, self.block, self.block)

    def _same_at_all_depths(self, information: Array) -> bool:
        """Tell whether information, (square, gap, triangle, point), does not change with depth."""
        assert self.rule.triangle is not None
        column = information.reshape(*information.shape[:3], -1, len(self.rule.triangle))
        return bool(np.all(column == column[:, :1, :, :1]))

    def system(self, ranked: BoolArray) -> NormalEquations:
        """Finish the matrix.

        A node around which too few samples determine anything is held at zero: by an equation of
        its own if it has no sample at all, otherwise by so little that neighbours do not notice.

        Parameters
        ----------
        ranked : ndarray of bool, shape (layer, surface_node)
            Nodes around which enough samples determine something.
        """
        lumped = _row_sums(self.graph, self.pairs) if self.lumped is None else self.lumped
        trace = np.trace(lumped, axis1=-2, axis2=-1)
        active = trace > 0
        size = trace[active].mean() / self.block if active.any() else 1.0
        for layer in range(self.layers):
            for some, part in ((~active[layer], 1.0), (active[layer] & ~ranked[layer], HOLD)):
                held = self.graph.diagonal[some]
                hold(self.pairs, self.layers, (layer, held), part * size * np.eye(self.block))
        line = line_matrix(self.rule, self.layers)
        exact, pairs = self.uniform and bool(ranked.all()), self.pairs
        if exact:  # one gap is like another, and is kept once
            pairs = np.broadcast_to(pairs[:1].copy(), pairs.shape)
        return NormalEquations(self.graph, pairs, line, lumped, active, exact)


def is_small(unknowns: int) -> bool:
    """Tell whether a system of so many unknowns is looked at as a whole."""
    return unknowns <= SMALL


def hold(pairs: Array, layers: int, where: tuple[int, IndexArray | np.intp], blocks: Array) -> None:
    """Add to diagonal blocks of M, in a layer at places among the entries.

    Parameters
    ----------
    pairs : ndarray, shape (gap, 3, entry, block, block) or (1, 1, entry, block, block)
        As of `NormalEquations`; changed in place.
    """
    (layer, entry), gaps = where, layers - 1
    gap, k = (layer, 0) if layer < gaps else (layer - 1, 2)
    if pairs.shape[1] == 1:  # a mean over the gaps
        gap, k, blocks = 0, 0, blocks / gaps
    pairs[gap, k, entry] += blocks


def _row_sums(graph: Graph, pairs: Array) -> Array:
    """Sum M's blocks over its columns, shape (layer, surface_node, block, block)."""
    gaps, _, _, block, _ = pairs.shape
    sums = np.zeros((gaps + 1, graph.nodes, block, block))
    for gap, layer, _, k in _entries(gaps):
        sums[layer] += np.add.reduceat(pairs[gap, k], graph.indptr[:-1], axis=0)
    return sums


def _entries(gaps: int) -> list[tuple[int, int, int, int]]:
    """List (gap, layer, other layer, pair) of every block of M over the layers."""
    both = [(gap, gap + i, gap + j, k) for gap in range(gaps) for k, (i, j) in enumerate(PAIRS)]
    return both + [(gap, other, layer, k) for gap, layer, other, k in both if layer != other]


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Matrix M and its nearest Kronecker product.

    Unknowns have the shape (layer, surface_node, block, column).

    Attributes
    ----------
    pairs : ndarray, shape (gap, 3, entry, block, block) or (1, 1, entry, block, block)
        The surface matrices S of the pairs of layers, entries as in `graph`; where the nearest
        Kronecker product alone is wanted, the mean over the gaps of their sums.
    line : ndarray, shape (layer, layer)
    lumped : ndarray, shape (layer, surface_node, block, block)
        Information that the samples around a node have, ``sum_s phi N_s``.
    active : ndarray of bool, shape (layer, surface_node)
        Nodes with a sample.
    exact : bool
        Whether ``M = line (x) surface``.
    """

    graph: Graph
    pairs: Array
    line: Array
    lumped: Array
    active: BoolArray
    exact: bool

    @property
    def block(self) -> int:
        """Unknowns of a node that M couples."""
        return self.pairs.shape[-1]

    @property
    def layers(self) -> int:
        """Surfaces of the volume."""
        return len(self.line)

    @property
    def nodes(self) -> int:
        """Nodes of all layers."""
        return self.layers * self.graph.nodes

    @cached_property
    def surface_blocks(self) -> Array:
        """Mean over the gaps of ``sum_s t t^T (x) N_s``, shape (entry, block, block)."""
        if self.pairs.shape[1] == 1:
            return self.pairs[0, 0]
        return (self.pairs[:, 0] + 2 * self.pairs[:, 1] + self.pairs[:, 2]).mean(axis=0)

    @cached_property
    def surface_sums(self) -> Array:
        """Sums of `surface_blocks` over the columns, shape (surface_node, block, block)."""
        return np.add.reduceat(self.surface_blocks, self.graph.indptr[:-1], axis=0)

    @cached_property
    def sums(self) -> Array:
        """Sums of M's blocks over the columns: `lumped`, and what holds nodes."""
        return _row_sums(self.graph, self.pairs)

    @cached_property
    def surface(self) -> scipy.sparse.bsr_array:
        """`surface_blocks` as a matrix over the surface's unknowns."""
        return self._over_surface(self.surface_blocks)

    def part(self, keep: int) -> NormalEquations:
        """Keep the first `keep` unknowns of every node, the others being zero."""
        return NormalEquations(
            self.graph,
            np.ascontiguousarray(self.pairs[..., :keep, :keep]),
            self.line,
            self.lumped[..., :keep, :keep],
            self.active,
            self.exact,
        )

    def times(self, x: Array) -> Array:
        """Multiply ``M x``."""
        flat = x.reshape(self.layers, self.graph.nodes * self.block, -1)
        if self.exact:
            along = np.tensordot(self.line, flat, axes=1)
            return np.stack([self.surface @ layer for layer in along]).reshape(x.shape)
        y = np.zeros_like(flat)
        for layer, other, matrix in self._layer_matrices:
            y[layer] += matrix @ flat[other]
        return y.reshape(x.shape)

    @cached_property
    def _layer_matrices(self) -> list[tuple[int, int, scipy.sparse.bsr_array]]:
        """Blocks of M over the layers."""
        sums: dict[tuple[int, int], Array] = {}
        for gap, layer, other, k in _entries(self.layers - 1):
            if layer <= other:
                known = sums.get((layer, other))
                added = self.pairs[gap, k]
                sums[layer, other] = added if known is None else known + added
        upper = [(i, j, self._over_surface(blocks)) for (i, j), blocks in sums.items()]
        return upper + [(j, i, matrix) for i, j, matrix in upper if i != j]

    @property
    def is_small(self) -> bool:
        """Whether `dense` and `inverse` are cheap."""
        return is_small(self.nodes * self.block)

    @cached_property
    def dense(self) -> Array:
        """M itself, of a small system."""
        matrix: Array = self.matrix().toarray()
        return matrix

    @cached_property
    def eigenvalues(self) -> Array:
        """Eigenvalues of `dense`, ascending."""
        values: Array = np.linalg.eigvalsh(self.dense).astype(float)
        return values

    @property
    def is_singular(self) -> bool:
        """Whether `dense` is singular, or so near it that round-off decides its inverse."""
        return self._cholesky is None

    @cached_property
    def inverse(self) -> Array:
        """Inverse of `dense`, which must not be singular."""
        assert self._cholesky is not None
        inverse: Array = scipy.linalg.lapack.dpotri(self._cholesky, lower=True)[0]
        return np.tril(inverse) + np.tril(inverse, -1).T

    def solved(self, right: Array) -> Array:
        """Solve for right-hand sides by a factor of `dense`, which must not be singular."""
        assert self._cholesky is not None
        flat = np.asfortranarray(right.reshape(len(self.dense), -1))
        return np.reshape(
            scipy.linalg.lapack.dpotrs(self._cholesky, flat, lower=True)[0], right.shape
        )

    @cached_property
    def _cholesky(self) -> Array | None:
        """Lower Cholesky factor of `dense`; None if there is none but by round-off."""
        factor, failed = scipy.linalg.lapack.dpotrf(self.dense, lower=True)
        pivots, round_off = np.diagonal(factor) ** 2, len(factor) * np.finfo(float).eps
        return None if failed or not pivots.min() > round_off * pivots.max() else factor

    def matrix(self) -> scipy.sparse.csr_array:
        """Assemble M itself, unknowns node by node, layer by layer."""
        size = self.graph.nodes * self.block
        rows, columns, values = [], [], []
        for layer, other, matrix in self._layer_matrices:
            entries = matrix.tocoo()
            rows.append(entries.row + layer * size)
            columns.append(entries.col + other * size)
            values.append(entries.data)
        places = np.concatenate(rows), np.concatenate(columns)
        shape = (self.layers * size, self.layers * size)
        return scipy.sparse.csr_array((np.concatenate(values), places), shape=shape)

    def _over_surface(self, blocks: Array) -> scipy.sparse.bsr_array:
        size = self.graph.nodes * self.block
        return scipy.sparse.bsr_array(
            (blocks, self.graph.indices, self.graph.indptr), shape=(size, size)
        )


def solution(right: Array, system: NormalEquations, solve: Solve) -> Array:
    """Solve right-hand sides (layer, surface_node, parameter, column).

    Parameters that the system does not couple are right-hand sides of one matrix.
    """
    layers, nodes, _, _ = right.shape
    return solve(right.reshape(layers, nodes, system.block, -1)).reshape(right.shape)
