"""Rows of the inverse of a field's matrix, which bounds need: all of them, of a small system."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array

from sldvexp.field.system import System

Array = NDArray[np.float64]

#: Unknowns up to which the inverse is computed as a whole.
SMALL = 3000
#: Numbers of dense arrays that are worked on at once.
NUMBERS_AT_ONCE = 20_000_000


class InverseRows(ABC):
    """Rows of ``M^-1`` for a region's own nodes, over the nodes of its patch."""

    @abstractmethod
    def times(self, x: Array) -> Array:
        """``M^-1 x``, from (layer, patch_node, parameter, column) to (layer, own, ...)."""

    @abstractmethod
    def covariance(self, influence: bsr_array, variance: Array) -> tuple[Array, Array]:
        """Blocks on the diagonal of ``K S K^T``, ``K = M^-1 R``, and the sum of that of ``K S R^T``.

        Parameters
        ----------
        influence : bsr_array, shape (patch node * parameter, pixel)
            The matrix R of one view.
        variance : ndarray, shape (pixel,)
            The diagonal matrix S.

        Returns
        -------
        covariance : ndarray, shape (layer, own, parameter, parameter)
        fitted : ndarray, shape (parameter,)
            Over the own nodes, parameter by parameter.
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

    def times(self, x: Array) -> Array:
        """See `InverseRows`."""
        return (self.inverse @ x.reshape(len(self.inverse), -1)).reshape(x.shape)

    def covariance(self, influence: bsr_array, variance: Array) -> tuple[Array, Array]:
        """See `InverseRows`."""
        rows = influence.tocsr()
        used = np.unique(rows.indices)
        rows, variance = rows[:, used], variance[used]
        nodes, p = rows.shape[0] // self.parameters, self.parameters
        covariance, fitted = np.zeros((nodes, p, p)), np.zeros(p)
        step = max(1, NUMBERS_AT_ONCE // rows.shape[0])
        for first in range(0, len(used), step):
            part = slice(first, first + step)
            some = rows[:, part].toarray()
            k = (self.inverse @ some.reshape(len(self.inverse), -1)).reshape(nodes, p, -1)
            scaled = k * variance[part]
            covariance += scaled @ np.swapaxes(k, 1, 2)
            fitted += np.einsum("npx,npx->p", scaled, some.reshape(nodes, p, -1))
        return covariance.reshape(self.layers, -1, p, p), fitted
