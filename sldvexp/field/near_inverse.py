"""Rows of the inverse of a large field's matrix, region by region, nearly exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array

from sldvexp.field.block_rows import block_rows, diagonal_blocks, kronecker_identity
from sldvexp.field.inverse_rows import InverseRows
from sldvexp.field.local_rows import Neighbourhood, rings_of, surface_rows, volume_rows
from sldvexp.field.parts import Part
from sldvexp.field.system import System

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: A node is odd if its own information differs by this part from that of the Kronecker product, in
#: any direction.
ODD = 0.05


@dataclass(frozen=True, eq=False)
class NearInverse(InverseRows):
    """Rows of the inverse Kronecker product, turned to each node's own information.

    Where that differs a lot from the product's, as where a view ends at another place in each
    layer, rows are of the inverse of the whole matrix around the node instead.

    Parameters
    ----------
    line : ndarray, shape (layer, layer)
        The inverse of the line's matrix.
    surface : bsr_array, shape (own * parameter, patch_node * parameter)
        Rows of the inverse of the surface's matrix.
    own : ndarray of int
        Places of the own nodes in the patch.
    turn : ndarray, shape (layer, own, parameter, parameter)
        ``N^-1 N_mean`` of a node's information and that of the Kronecker product there.
    odd : ndarray of int
        Which of `own` are odd.
    volume : bsr_array, shape (layer * odd * parameter, layer * patch_node * parameter)
        Rows of the inverse of the whole matrix.
    """

    line: Array
    surface: bsr_array
    own: Indices
    turn: Array
    odd: Indices
    volume: bsr_array

    @classmethod
    def of(cls, system: System, part: Part, parameters: int) -> NearInverse:
        """That of a part's region."""
        around = Neighbourhood.of(system, part.patch, rings_of(part.looks.rule))
        own = np.searchsorted(part.patch.nodes, part.region.own)
        turn = _turn(system, part.region.own)
        odd = _odd(turn, around, own)
        return cls(
            np.linalg.inv(system.line).astype(float),
            _of_parameters(surface_rows(system, around, own), parameters),
            own,
            turn if system.block > 1 else turn * np.eye(parameters),
            odd,
            _of_parameters(volume_rows(system, around, own[odd]), parameters),
        )

    def times(self, x: Array) -> Array:
        """See `InverseRows`."""
        layers, _, parameters, columns = x.shape
        along = np.tensordot(self.line, x, axes=1).reshape(layers, -1, columns)
        rows = np.stack([self.surface @ layer for layer in along])
        found = self.turn @ rows.reshape(layers, len(self.own), parameters, columns)
        exact = self.volume @ x.reshape(-1, columns)
        found[:, self.odd] = exact.reshape(layers, len(self.odd), parameters, columns)
        return found

    def variances(self, influence: bsr_array, variance: Array) -> tuple[Array, Array]:
        """See `InverseRows`."""
        layers, p = len(self.line), influence.blocksize[0]
        nodes = influence.shape[0] // p // layers
        along = kronecker_identity(self.line, nodes, p) @ influence
        covariance, fitted = np.empty((layers, len(self.own), p, p)), np.zeros(p)
        for layer in range(layers):
            k = self.surface @ block_rows(along, layer * nodes + np.arange(nodes))
            covariance[layer] = diagonal_blocks(k, variance)
            own = block_rows(influence, layer * nodes + self.own)
            fitted += (k.multiply(own) @ variance).reshape(-1, p).sum(axis=0)
        covariance = self.turn @ covariance @ np.swapaxes(self.turn, 2, 3)
        exact = diagonal_blocks(self.volume @ influence, variance)
        covariance[:, self.odd] = exact.reshape(layers, len(self.odd), p, p)
        return np.diagonal(covariance, axis1=2, axis2=3), fitted


def _turn(system: System, own: Indices) -> Array:
    """Shape (layer, own, block, block)."""
    mean = system.line.sum(axis=1)[:, None, None, None] * system.surface_sums[own]
    return np.linalg.pinv(system.lumped[:, own], rcond=1e-10, hermitian=True) @ mean


def _odd(turn: Array, around: Neighbourhood, own: Indices) -> Indices:
    """Own nodes whose own turn, or that of a neighbour, is far from none."""
    far = np.abs(np.linalg.eigvals(turn) - 1).max(axis=(0, 2)) > ODD
    place = np.zeros(len(around.place), bool)
    place[own[far]] = True
    return np.flatnonzero(around.neighbours[own] @ place.astype(float) > 0)


def _of_parameters(matrix: bsr_array, parameters: int) -> bsr_array:
    """Scalar rows as rows of every parameter."""
    if matrix.blocksize[0] > 1:
        return matrix
    shape = matrix.shape[0] * parameters, matrix.shape[1] * parameters
    entries = matrix.data * np.eye(parameters), matrix.indices, matrix.indptr
    return bsr_array(entries, shape=shape)
