"""The inverse of a Kronecker product of a line's matrix and a surface's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from sldvexp.field.system import System

Array = NDArray[np.float64]

#: Right-hand sides that are solved together: more do not stay in the cache.
COLUMNS_AT_ONCE = 32


def factorised(matrix: csc_array) -> SuperLU:
    """LU factors of a symmetric positive definite matrix, with an ordering for those."""
    options = {"SymmetricMode": True}
    return splu(csc_array(matrix), "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)


def solved(factor: SuperLU, right: Array) -> Array:
    """Solutions of real right-hand sides, shape (unknown, column)."""
    solution = np.empty_like(right)
    for first in range(0, right.shape[1], COLUMNS_AT_ONCE):
        part = slice(first, first + COLUMNS_AT_ONCE)
        solution[:, part] = factor.solve(np.asfortranarray(right[:, part]))
    return solution


@dataclass(frozen=True, eq=False)
class KroneckerInverse:
    """``(line (x) surface)^-1``, near the inverse of a system's matrix or exactly that.

    Parameters
    ----------
    line : ndarray, shape (layer, layer)
        The inverse of the line's matrix.
    surface : SuperLU
        Factors of the surface's.
    """

    line: Array
    surface: SuperLU

    @classmethod
    def of(cls, system: System) -> KroneckerInverse:
        """That of a system's means over depth."""
        return cls(np.linalg.inv(system.line), factorised(system.surface))

    def times(self, x: Array) -> Array:
        """``(line (x) surface)^-1 x``; x as in `System`."""
        layers, columns = len(self.line), x.shape[-1]
        flat = np.tensordot(self.line, x.reshape(layers, -1, columns), axes=1)
        rows = flat.shape[1]
        beside = flat.transpose(1, 0, 2).reshape(rows, layers * columns)
        done = solved(self.surface, beside).reshape(rows, layers, columns)
        return done.transpose(1, 0, 2).reshape(x.shape)
