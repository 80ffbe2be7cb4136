"""Inverse of a Kronecker product of a line's matrix and a surface's.

``(L (x) S)^-1 = L^-1 (x) S^-1``: a small dense matrix over the layers and sparse LU factors over
one surface stand for the inverse over the volume. Pivots stay on the diagonal, which is safe for
symmetric positive definite matrices and keeps their ordering.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.equations.system import NormalEquations
from sldvexp.lazy import scipy
from sldvexp.typing import Array

#: Right-hand sides that are solved together: more do not stay in the cache.
COLUMNS_AT_ONCE = 32
#: Smallest pivot over the largest of a matrix that is not singular.
SINGULAR = 1e-14
#: How many nodes of a singular system are named.
NAMED = 5


def factorised(matrix: scipy.sparse.csc_array) -> scipy.sparse.linalg.SuperLU:
    """Factorise a symmetric positive definite matrix into LU, with an ordering for those.

    Raises
    ------
    RuntimeError
        If it is singular.
    """
    options = {"SymmetricMode": True}
    factor = scipy.sparse.linalg.splu(
        matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
    )
    pivots = np.abs(factor.U.diagonal())
    for copied in (factor.L, factor.U):  # else it keeps copies, which take as much as itself
        copied.data, copied.indices = np.empty(0), np.empty(0, np.int32)
    if not pivots.min() > SINGULAR * pivots.max():
        raise RuntimeError("the matrix is singular")
    return factor


def solved(factor: scipy.sparse.linalg.SuperLU, right: Array) -> Array:
    """Solve real right-hand sides, shape (unknown, column)."""
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
    surface: scipy.sparse.linalg.SuperLU

    @classmethod
    def from_system(cls, system: NormalEquations) -> KroneckerInverse:
        """Invert a system's means over depth, or recall the inverse.

        Raises
        ------
        UserError
            If samples do not determine all layers, or all nodes of a layer.
        """
        if system in _inverses:
            return _inverses[system]
        line = inverse_line(system)
        try:
            surface = factorised(scipy.sparse.csc_array(system.surface))
        except RuntimeError:
            raise undetermined_nodes(system) from None
        return _inverses.setdefault(system, cls(line, surface))

    def times(self, x: Array) -> Array:
        """Multiply ``(line (x) surface)^-1 x``; x as in `NormalEquations`."""
        layers, columns = len(self.line), x.shape[-1]
        flat = np.tensordot(self.line, x.reshape(layers, -1, columns), axes=1)
        rows = flat.shape[1]
        beside = flat.transpose(1, 0, 2).reshape(rows, layers * columns)
        done = solved(self.surface, beside).reshape(rows, layers, columns)
        return done.transpose(1, 0, 2).reshape(x.shape)


#: Inverses of systems that are still there: a solver needs one, and once more for what is wanted
#: roughly, and so do condition numbers.
_inverses: WeakKeyDictionary[NormalEquations, KroneckerInverse] = WeakKeyDictionary()


def inverse_line(system: NormalEquations) -> Array:
    """Invert the line's matrix, shape (layer, layer).

    Raises
    ------
    UserError
        If samples do not determine all layers.
    """
    pivots = np.linalg.eigvalsh(system.line)
    if not pivots[0] > SINGULAR * pivots[-1]:
        raise UserError(
            "field: samples through the thickness of each prism do not determine the layers "
            "above and below them one by one; use samples.line=2 or more"
        )
    return np.linalg.inv(system.line).astype(float)


def undetermined_nodes(system: NormalEquations) -> UserError:
    """Say that samples do not determine all nodes of a surface, and which not."""
    return UserError(
        f"field: the samples are too few to determine the surface nodes {_undetermined(system)} "
        "one by one; use more points in each triangle, as with samples.triangle=3"
    )


def _undetermined(system: NormalEquations) -> str:
    """Name nodes where the matrix's weakest vector is, by inverse iteration with a shift."""
    matrix = scipy.sparse.csc_array(system.surface)
    shift = 1e-8 * matrix.diagonal().mean()
    factor = scipy.sparse.linalg.splu(
        scipy.sparse.csc_array(matrix + shift * scipy.sparse.eye_array(matrix.shape[0])),
        "MMD_AT_PLUS_A",
    )
    vector = np.random.default_rng(len(system.surface_blocks)).normal(size=matrix.shape[0])
    for _ in range(5):
        vector = factor.solve(vector)
        vector /= np.abs(vector).max()
    size = np.abs(vector).reshape(system.graph.nodes, -1).max(axis=1)
    nodes = np.flatnonzero(size > 0.1)
    named = ", ".join(map(str, nodes[:NAMED]))
    return f"{named} and {len(nodes) - NAMED} others" if len(nodes) > NAMED else named
