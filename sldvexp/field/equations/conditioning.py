"""Condition numbers of a field's normal equations, as Table 5.7 states them.

Extreme eigenvalues are Lanczos', of the matrix and of its inverse, and the 1-norm of an inverse is
Hager's estimate: neither needs the inverse itself, only its products with vectors. A Kronecker
product has the products of its factors' numbers.
"""

from __future__ import annotations

import numpy as np

from sldvexp.field.equations.system import NormalEquations, Solve
from sldvexp.field.solvers.kronecker import KroneckerInverse
from sldvexp.lazy import scipy
from sldvexp.typing import Array

#: Relative accuracy of the extreme eigenvalues of larger ones.
ACCURACY = 1e-3
#: Vectors that Lanczos keeps, from a start that random numbers alone are, and from a better one.
#: Each costs the inverse a solution; with the better start 8 need less than half the solutions.
VECTORS, FEW_VECTORS = 20, 8
#: Relative accuracy of an eigenvector to start from.
NEARLY = 1e-2
#: Steps of Hager's estimate of a norm; it rarely needs more than three.
STEPS = 6


def condition_numbers(system: NormalEquations, solve: Solve) -> tuple[float, float]:
    """Compute largest over smallest eigenvalue of M, and ``1 / (|M| |M^-1|)`` in the 1-norm.

    For large systems the latter's ``|M^-1|`` is Hager's estimate, a lower bound, mostly exact.
    Both numbers of a Kronecker product are the products of its factors'.
    """
    shape = (system.layers, system.graph.nodes, system.block, -1)
    size = system.nodes * system.block
    if system.is_small:
        return _of_dense(system.eigenvalues, system.dense, system.inverse)
    if system.exact:
        inverse = KroneckerInverse.from_system(system)
        line = _of_dense(np.linalg.eigvalsh(system.line).astype(float), system.line, inverse.line)
        surface = _of_operators(
            lambda x: system.surface @ x, inverse.surface.solve, system.surface.shape[0]
        )
        return line[0] * surface[0], line[1] * surface[1]

    def times(x: Array) -> Array:
        return system.times(x.reshape(shape)).reshape(x.shape)

    def inverse_times(x: Array) -> Array:
        return solve(np.ascontiguousarray(x.reshape(shape))).reshape(x.shape)

    return _of_operators(times, inverse_times, size, _lowest_vector(system))


def _lowest_vector(system: NormalEquations) -> Array:
    """Find about where M is smallest, as its nearest Kronecker product has it, shape (unknown,)."""
    surface = KroneckerInverse.from_system(system).surface.solve
    _, across = _largest(surface, system.surface.shape[0], tolerance=NEARLY)
    _, along = np.linalg.eigh(system.line)
    return np.kron(along[:, 0], across)


def _of_dense(value: Array, matrix: Array, inverse: Array) -> tuple[float, float]:
    norms = np.linalg.norm(matrix, 1) * np.linalg.norm(inverse, 1)
    ratio = value[-1] / value[0] if value[0] > 0 else np.inf  # negative by round-off
    return float(ratio), float(1 / norms)


def _of_operators(
    times: Solve, inverse: Solve, size: int, lowest: Array | None = None
) -> tuple[float, float]:
    """Compute the numbers of a matrix from its products and those of its inverse.

    Parameters
    ----------
    lowest : ndarray, shape (unknown,), optional
        Unit vector near that of the smallest eigenvalue.
    """
    (largest, _), (smallest, _) = _largest(times, size), _largest(inverse, size, lowest)
    return largest * smallest, 1 / (_one_norm(times, size) * _one_norm(inverse, size))


def _largest(
    times: Solve, size: int, near: Array | None = None, tolerance: float = ACCURACY
) -> tuple[float, Array]:
    """Find the largest eigenvalue and its vector.

    Random numbers are half of every start, as what is near may have nothing of the vector.
    """
    operator = scipy.sparse.linalg.LinearOperator((size, size), matvec=times, dtype=float)
    start = np.random.default_rng(size).normal(size=size)
    if near is not None:
        start = start / np.linalg.norm(start) + near
    value, vector = scipy.sparse.linalg.eigsh(
        operator,
        1,
        which="LA",
        v0=start,
        ncv=min(VECTORS if near is None else FEW_VECTORS, size),
        tol=tolerance,
    )
    return float(value[0]), vector[:, 0]


def _one_norm(times: Solve, size: int) -> float:
    """Estimate the largest column sum of a symmetric matrix as Hager does."""
    x, norm = np.full(size, 1 / size), 0.0
    for _ in range(STEPS):
        y = times(x)
        sums = np.abs(y).sum()
        if sums <= norm:
            break
        norm = sums
        slope = times(np.where(y < 0, -1.0, 1.0))
        x = np.zeros(size)
        x[np.argmax(np.abs(slope))] = 1.0
    return float(norm)
