"""Rows of the inverse of a field's matrix, which bounds need: all of them, of a small system."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.field.equations.regions import Part
from sldvexp.field.equations.system import System
from sldvexp.lazy import scipy
from sldvexp.typing import Array


class InverseRows(ABC):
    """Rows of ``M^-1`` for a region's own nodes, over the nodes of its patch."""

    @abstractmethod
    def times(self, x: Array) -> Array:
        """``M^-1 x``, from (layer, patch_node, parameter, column) to (layer, own, ...)."""

    @abstractmethod
    def variances(
        self, influences: Sequence[scipy.sparse.bsr_array], variances: Sequence[Array]
    ) -> tuple[Array, Array]:
        """Diagonals of ``sum_k K_k S_k K_k^T`` and ``sum_k K_k S_k R_k^T``, with ``K = M^-1 R``.

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
        return cls(system.inverse, system.layers, parameters)

    def of_part(self, part: Part) -> WholeInverse:
        """The same: a small field is one part."""
        return self

    def times(self, x: Array) -> Array:
        """See `InverseRows`."""
        return (self.inverse @ x.reshape(len(self.inverse), -1)).reshape(x.shape)

    def variances(
        self, influences: Sequence[scipy.sparse.bsr_array], variances: Sequence[Array]
    ) -> tuple[Array, Array]:
        """See `InverseRows`."""
        rows, p = scipy.sparse.hstack(influences, format="csr"), self.parameters
        rows = rows * np.sqrt(np.concatenate(variances))
        apart = p if len(self.inverse) < rows.shape[0] else 1  # components that do not couple
        nodal, fitted = np.empty(rows.shape[0]), np.empty(rows.shape[0])
        for first in range(apart):
            r = rows[first::apart]
            across = self.inverse @ (r @ r.T).toarray()
            nodal[first::apart] = np.einsum("ij,ij->i", across, self.inverse)
            fitted[first::apart] = np.diagonal(across)
        return nodal.reshape(self.layers, -1, p), fitted.reshape(-1, p).sum(axis=0)
