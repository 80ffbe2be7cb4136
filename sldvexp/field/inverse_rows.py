"""Rows of the inverse of a field's matrix, which bounds need: all of them, of a small system."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array

from sldvexp.field.parts import Part
from sldvexp.field.system import System

Array = NDArray[np.float64]

#: Unknowns up to which the inverse is computed as a whole.
SMALL = 2000


class InverseRows(ABC):
    """Rows of ``M^-1`` for a region's own nodes, over the nodes of its patch."""

    @abstractmethod
    def times(self, x: Array) -> Array:
        """``M^-1 x``, from (layer, patch_node, parameter, column) to (layer, own, ...)."""

    @abstractmethod
    def variances(self, influence: bsr_array, variance: Array) -> tuple[Array, Array]:
        """Diagonals of ``K S K^T`` and of ``K S R^T``, with ``K = M^-1 R``.

        Parameters
        ----------
        influence : bsr_array, shape (patch node * parameter, pixel)
            The matrix R of one view.
        variance : ndarray, shape (pixel,)
            The diagonal matrix S.

        Returns
        -------
        nodal : ndarray, shape (layer, own, parameter)
        fitted : ndarray, shape (parameter,)
            The second diagonal, summed over the own nodes.
        """


@dataclass(frozen=True, eq=False)
class WholeInverse(InverseRows):
    """All rows, of a small system whose patch has all nodes.

    Parameters
    ----------
    inverse : ndarray, shape (node * block, node * block)
    layers, parameters : int
    """

    inverse: Array
    layers: int
    parameters: int

    @classmethod
    def of(cls, system: System, parameters: int) -> WholeInverse:
        """That of a system."""
        return cls(np.linalg.inv(system.matrix().toarray()), system.layers, parameters)

    def of_part(self, part: Part) -> WholeInverse:
        """The same: a small field is one part."""
        return self

    def times(self, x: Array) -> Array:
        """See `InverseRows`."""
        return (self.inverse @ x.reshape(len(self.inverse), -1)).reshape(x.shape)

    def variances(self, influence: bsr_array, variance: Array) -> tuple[Array, Array]:
        """See `InverseRows`."""
        rows, p = influence.tocsr(), self.parameters
        apart = p if len(self.inverse) < rows.shape[0] else 1  # components that do not couple
        nodal, fitted = np.empty(rows.shape[0]), np.empty(rows.shape[0])
        for first in range(apart):
            r = rows[first::apart]
            across = self.inverse @ (r * variance @ r.T).toarray()
            nodal[first::apart] = np.einsum("ij,ij->i", across, self.inverse)
            fitted[first::apart] = np.diagonal(across)
        return nodal.reshape(self.layers, -1, p), fitted.reshape(-1, p).sum(axis=0)
