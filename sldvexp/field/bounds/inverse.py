"""Rows of the inverse of a field's matrix, which bounds need.

Of a small system all rows are computed. Of a large one they are those of the nearest Kronecker
product, cut off after some rings of neighbours and turned by ``N^-1 N_mean`` to each node's own
information N. Where that differs a lot from the product's, as where a view ends at another place in
each layer, rows are of the inverse of the matrix around the node instead.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from sldvexp.field.bounds.compiled import CompiledKernels, kernels_for
from sldvexp.field.bounds.sparse_inverse_rows import (
    RINGS_BETWEEN,
    block_rows,
    diagonal_blocks,
    rings_of,
    sums_of_squares,
    surface_rows,
    volume_rows,
    with_blocks,
)
from sldvexp.field.equations.elements import (
    influences_by_layers,
    numbers_at,
    with_layers_apart,
)
from sldvexp.field.equations.regions import RegionIterator, RegionSamples
from sldvexp.field.equations.sample_model import AXES
from sldvexp.field.equations.system import NormalEquations
from sldvexp.field.solvers.kronecker import inverse_line, undetermined_nodes
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray


class InverseRows(ABC):
    """Rows of ``M^-1`` for a region's own nodes, over the nodes of its patch."""

    @abstractmethod
    def times(self, x: Array) -> Array:
        """Multiply ``M^-1 x``, from (layer, patch_node, parameter, column) to (layer, own, ...)."""


#: Part of a variance up to which terms of either sign may cancel in round-off.
ACCURATE = 1e-6


@dataclass(frozen=True, eq=False)
class WholeInverse(InverseRows):
    """Rows of a small system, all of them, whose patch has all nodes.

    Parameters
    ----------
    inverse : ndarray, shape (node * block, node * block)
    known : dict
        Variances that some views' noise has been found to give, by the views.
    """

    inverse: Array
    layers: int
    parameters: int
    known: dict[tuple[int, ...], tuple[Array, Array]] = field(default_factory=dict, repr=False)

    @classmethod
    def from_system(cls, system: NormalEquations, parameters: int) -> WholeInverse:
        """Invert a small system, or recall its inverse."""
        if system not in _inverses:
            _inverses[system] = cls(system.inverse, system.layers, parameters)
        return _inverses[system]

    def of_part(self, part: RegionSamples) -> WholeInverse:
        """Return the same for every part: a small field is one part."""
        return self

    def times(self, x: Array) -> Array:
        """Multiply as `InverseRows` says."""
        return (self.inverse @ x.reshape(len(self.inverse), -1)).reshape(x.shape)

    def variances(
        self, influences: Sequence[scipy.sparse.bsr_array], variances: Sequence[Array]
    ) -> tuple[Array, Array]:
        """Compute diagonals of ``sum_k K_k S_k K_k^T`` and ``sum_k K_k S_k R_k^T``, ``K = M^-1 R``.

        Parameters
        ----------
        influences : sequence of bsr_array, shape (patch node * parameter, pixel)
            The matrix R_k of each view.
        variances : sequence of ndarray, shape (pixel,)
            The diagonal matrices S_k.

        Returns
        -------
        nodal : ndarray, shape (layer, own, parameter)
        fitted : ndarray, shape (parameter,)
            The second diagonal, summed over the own nodes.
        """
        rows, p = scipy.sparse.hstack(influences, format="csr"), self.parameters
        rows = (rows * np.sqrt(np.concatenate(variances))).tocsr()  # which older scipy has as COO
        apart = p if len(self.inverse) < rows.shape[0] else 1  # components that do not couple
        nodal, fitted = np.empty(rows.shape[0]), np.empty(rows.shape[0])
        size = np.einsum("ij,ij->i", self.inverse, self.inverse)
        for first in range(apart):
            r = rows[first::apart]
            both = (r @ r.T).toarray()
            across = self.inverse @ both
            found = np.einsum("ij,ij->i", across, self.inverse)
            # Next to nodes that are held large terms cancel; a sum of squares loses nothing.
            near = np.finfo(float).eps * np.linalg.norm(both, 1) * size > ACCURATE * found
            found[near] = np.square(r.T @ self.inverse[near].T).sum(axis=0)
            nodal[first::apart], fitted[first::apart] = found, np.diagonal(across)
        return nodal.reshape(self.layers, -1, p), fitted.reshape(-1, p).sum(axis=0)


#: Inverses of systems that are still there, since fits by several solvers have one in common.
_inverses: WeakKeyDictionary[NormalEquations, WholeInverse] = WeakKeyDictionary()

#: A node is odd if its own information differs by this part from that of the Kronecker product, in
#: any direction.
ODD = 0.05


@dataclass(frozen=True, eq=False)
class NearInverse:
    """Rows of the inverse Kronecker product, turned to each node's own information.

    Where that differs a lot from the product's, as where a view ends at another place in each
    layer, rows are of the inverse of the whole matrix around the node instead.

    Parameters
    ----------
    line : ndarray, shape (layer, layer)
        The inverse of the line's matrix.
    turn : ndarray, shape (layer, surface_node, block, block)
        ``N^-1 N_mean`` of a node's information and that of the Kronecker product there.
    odd : ndarray of bool, shape (surface_node,)
    rings, between : int
        How far rows reach, and how far those that are solved together are apart, see `NearNodes`.
    """

    system: NormalEquations
    line: Array
    turn: Array
    odd: BoolArray
    rings: int
    between: int = RINGS_BETWEEN

    @classmethod
    def from_system(cls, system: NormalEquations, parts: RegionIterator) -> NearInverse:
        """Prepare the rows of a system's inverse.

        Raises
        ------
        UserError
            If samples do not determine all layers.
        """
        rings = rings_of(parts.visibility.rule)
        line = inverse_line(system)
        mean = system.line.sum(axis=1)[:, None, None, None] * system.surface_sums
        # Layer by layer, as what is in between takes several times as much as the result.
        turn, far = np.empty_like(mean), np.zeros(system.graph.nodes, bool)
        for layer, own in enumerate(system.lumped):
            turn[layer] = _pseudo_inverse(own) @ mean[layer]
            far |= _differ(turn[layer])
        odd = system.graph.neighbours @ far.astype(float) > 0
        return cls(system, line, turn, odd, rings)

    def of_part(self, part: RegionSamples) -> CoupledRows | ScalarRows:
        """Compute the rows of a part's own nodes.

        Raises
        ------
        UserError
            If samples do not determine all of them.
        """
        nodes, own = part.patch.nodes, part.region.own
        place = np.full(self.system.graph.nodes, -1)
        place[nodes] = np.arange(len(nodes))
        try:
            surface = surface_rows(self.system, own, place, self.rings, self.between)
        except RuntimeError:
            raise undetermined_nodes(self.system) from None
        odd = np.flatnonzero(self.odd[own])
        volume = volume_rows(self.system, own[odd], place, self.rings)
        kind = ScalarRows if self.system.block == 1 else CoupledRows
        return kind(self.line, surface, place[own], self.turn[:, own], odd, volume)


def _pseudo_inverse(matrices: Array) -> Array:
    """Invert symmetric matrices, shape (..., block, block); of singular ones as far as they are."""
    if matrices.shape[-1] > 1:
        return np.asarray(np.linalg.pinv(matrices, rcond=1e-10, hermitian=True), float)
    return np.divide(1.0, matrices, out=np.zeros_like(matrices), where=matrices != 0)


def _differ(turn: Array) -> BoolArray:
    """Tell which matrices (..., block, block) differ from the identity by more than `ODD`.

    In any direction: an eigenvalue of the difference, none of which is larger than its norm.
    """
    off = turn - np.eye(turn.shape[-1])
    found = np.linalg.norm(off, axis=(-2, -1)) > ODD
    if turn.shape[-1] > 1:
        found[found] = np.abs(np.linalg.eigvals(off[found])).max(axis=-1) > ODD
    return np.asarray(found)


@dataclass(frozen=True, eq=False)
class ViewInfluence:
    """Matrix R of one view's pixels over the nodes of a patch.

    Parameters
    ----------
    beside : bsr_array, shape (patch_node * parameter, pixel * layer), blocks (parameter, layer)
    kernels : CompiledKernels, optional
        What computes with it.
    """

    beside: scipy.sparse.bsr_array
    kernels: CompiledKernels | None = None

    @cached_property
    def apart(self) -> scipy.sparse.bsr_array:
        """The same, shape (layer * patch_node * parameter, pixel), in blocks (parameter, 1)."""
        return with_layers_apart(self.beside)

    def transposed_times(self, rows: Array) -> Array:
        """Multiply ``R^T x`` by few vectors, shape (vector, layer * patch_node * parameter).

        Returns
        -------
        ndarray, shape (pixel, vector)
        """
        r, (parameters, layers) = self.beside, self.beside.blocksize
        nodes, pixels = len(r.indptr) - 1, r.shape[1] // layers
        x = np.moveaxis(rows.reshape(len(rows), layers, nodes, parameters), 0, -1)
        found = np.zeros((pixels, len(rows)))
        for i in range(parameters):
            some = np.flatnonzero(x[:, :, i].any(axis=(0, 1)))  # one that couples none has few
            for layer in range(layers):
                # Rows of R read as columns are those of its transpose.
                entries = r.data[:, i, layer], r.indices, r.indptr
                of_layer = scipy.sparse.csc_array(entries, shape=(pixels, nodes))
                found[:, some] += of_layer @ x[layer, :, i, some].T
        return found


def view_influences(parts: Sequence[RegionSamples], k: int) -> list[ViewInfluence]:
    """Compute a view's influences in several models of the same samples, all at once."""
    weights = parts[0].samples.by_view[k].weights
    estimators = [part.at.estimator[:, :, k] for part in parts]
    kernels = kernels_for(parts[0].visibility)
    by_layers = influences_by_layers if kernels is None else kernels.influences_by_layers
    each = by_layers(parts[0].patch, estimators, weights)
    return [ViewInfluence(beside, kernels) for beside in each]


@dataclass(frozen=True, eq=False)
class NearRows(InverseRows):
    """Rows of a part's own nodes.

    Parameters
    ----------
    line, turn
        As in `NearInverse`, the latter of the own nodes.
    surface : bsr_array, shape (own * block, patch_node * block)
    own : ndarray of int
        Places of the own nodes in the patch.
    odd : ndarray of int
        Which of `own` are odd.
    volume : bsr_array, shape (layer * odd * block, layer * patch_node * block)
        Their rows of the inverse of the whole matrix.
    """

    line: Array
    surface: scipy.sparse.bsr_array
    own: IndexArray
    turn: Array
    odd: IndexArray
    volume: scipy.sparse.bsr_array

    def _along(self, beside: scipy.sparse.bsr_array) -> Array:
        """Put the line's inverse before blocks (parameter, layer), all in one product."""
        product = beside.data.reshape(-1, beside.blocksize[1]) @ self.line.T
        return np.asarray(product.reshape(beside.data.shape))

    @abstractmethod
    def of_view(
        self, influence: ViewInfluence, variance: Array, *, fitted: bool = True
    ) -> tuple[Array, Array]:
        """Compute diagonals of one view, as `WholeInverse.variances` does.

        Parameters
        ----------
        variance : ndarray, shape (pixel,)
        fitted : bool
            Whether the second one is wanted; zeros otherwise.
        """


class CoupledRows(NearRows):
    """Rows of an inverse that couples the parameters of a node, in blocks of them."""

    def times(self, x: Array) -> Array:
        """Multiply as `InverseRows` says."""
        layers, _, parameters, columns = x.shape
        along = np.tensordot(self.line, x, axes=1).reshape(layers, -1, columns)
        surface = self.surface.tocsr()  # without blocks all columns are added at once
        found = np.empty((layers, len(self.own), parameters, columns))
        for turn, of_layer, to in zip(self.turn, along, found, strict=True):
            np.matmul(turn, (surface @ of_layer).reshape(to.shape), out=to)
        exact = self.volume @ x.reshape(-1, columns)
        found[:, self.odd] = exact.reshape(layers, len(self.odd), parameters, columns)
        return found

    def of_view(
        self, influence: ViewInfluence, variance: Array, *, fitted: bool = True
    ) -> tuple[Array, Array]:
        """Compute diagonals as `NearRows` says."""
        beside, kernels = influence.beside, influence.kernels
        p, layers = beside.blocksize
        along = self._along(beside)
        if kernels is None or p != AXES:
            covariance, of_both = self._products(beside, along, variance, fitted)
        else:
            both = beside, along
            covariance, of_both = kernels.coupled(self.surface, self.own, both, variance, fitted)
        nodal = np.einsum("lnij,lnij->lni", self.turn @ covariance, self.turn)
        if len(self.odd):
            exact = diagonal_blocks(self.volume @ influence.apart, variance)[0]
            diagonals = np.diagonal(exact, axis1=1, axis2=2)
            nodal[:, self.odd] = diagonals.reshape(layers, len(self.odd), p)
        return nodal, of_both

    def _products(
        self, beside: scipy.sparse.bsr_array, along: Array, variance: Array, fitted: bool
    ) -> tuple[Array, Array]:
        """Compute what `CompiledKernels.coupled` does."""
        p, layers = beside.blocksize
        r = with_blocks(beside, along)
        covariance, of_both = np.empty((layers, len(self.own), p, p)), np.zeros(p)
        for some in _parts(len(self.own)):
            k = block_rows(self.surface, some) @ r
            covariance[:, some] = diagonal_blocks(k, variance)
            if fitted:
                of_both += _of_both(k, block_rows(beside, self.own[some]), variance).sum(axis=1)
        return covariance, of_both


class ScalarRows(NearRows):
    """Rows of an inverse that is the same for every parameter, and couples none."""

    def times(self, x: Array) -> Array:
        """Multiply as `InverseRows` says."""
        layers, _, parameters, columns = x.shape
        along = np.tensordot(self.line, x, axes=1).reshape(layers, -1, parameters * columns)
        surface, volume = (scipy.sparse.csr_array(rows) for rows in (self.surface, self.volume))
        found = np.empty((layers, len(self.own), parameters, columns))
        for turn, of_layer, to in zip(self.turn, along, found, strict=True):
            np.multiply(turn, (surface @ of_layer).reshape(to.shape), out=to)
        exact = volume @ x.reshape(-1, parameters * columns)
        found[:, self.odd] = exact.reshape(layers, len(self.odd), parameters, columns)
        return found

    def of_view(
        self, influence: ViewInfluence, variance: Array, *, fitted: bool = True
    ) -> tuple[Array, Array]:
        """Compute diagonals as `NearRows` says."""
        beside, kernels = influence.beside, influence.kernels
        p, layers = beside.blocksize
        along = self._along(beside)
        if kernels is None:
            nodal, of_both = self._products(beside, along, variance, fitted)
        else:
            both = beside, along
            nodal, of_both = kernels.scalar(self.surface, self.own, both, variance, fitted)
        nodal = nodal * self.turn[..., 0] ** 2
        if len(self.odd):
            apart = influence.apart
            flat = with_blocks(apart, apart.data.reshape(-1, 1, p))
            exact = sums_of_squares(self.volume @ flat, variance)
            nodal[:, self.odd] = exact.reshape(layers, len(self.odd), p)
        return nodal, of_both

    def _products(
        self, beside: scipy.sparse.bsr_array, along: Array, variance: Array, fitted: bool
    ) -> tuple[Array, Array]:
        """Compute what `CompiledKernels.scalar` does; a node's influences are (1, p) blocks."""
        p, layers = beside.blocksize
        r = with_blocks(beside, along.reshape(-1, 1, p * layers))
        beside = with_blocks(beside, beside.data.reshape(-1, 1, p * layers))
        nodal, of_both = np.empty((layers, len(self.own), p)), np.zeros(p)
        for some in _parts(len(self.own)):
            k = block_rows(self.surface, some) @ r
            squares = sums_of_squares(k, variance).reshape(-1, p, layers)
            nodal[:, some] = np.moveaxis(squares, 2, 0)
            if fitted:
                both = _of_both(k, block_rows(beside, self.own[some]), variance)
                of_both += both.reshape(p, layers).sum(axis=1)
        return nodal, of_both


#: Nodes whose rows of K are in memory at once, so that they stay in the cache.
NODES_AT_ONCE = 256


def _parts(count: int) -> Iterator[IndexArray]:
    """Go through this many nodes, some at a time."""
    for first in range(0, count, NODES_AT_ONCE):
        yield np.arange(first, min(first + NODES_AT_ONCE, count))


def _of_both(k: scipy.sparse.bsr_array, r: scipy.sparse.bsr_array, weight: Array) -> Array:
    """Sum ``w_j k_ij r_ij`` over rows and columns, in the shape of a block.

    Where r has a block k has one as well, as a node's row of the inverse has the node itself.
    """
    size = len(k.indptr) - 1, len(weight)
    order = scipy.sparse.csr_array((np.arange(len(k.indices)), k.indices, k.indptr), shape=size)
    row = np.repeat(np.arange(size[0]), np.diff(r.indptr))
    same = k.data[numbers_at(order, row, r.indices)]
    total: Array = np.einsum("b,bij,bij->ij", weight[r.indices], same, r.data)
    return total
