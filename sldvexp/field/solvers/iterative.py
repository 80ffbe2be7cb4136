"""`solver=iterative`: conjugate gradients on the Kronecker product that is near the matrix.

Preconditioned conjugate gradients for many right-hand sides at once, each with steps of its own.
The matrix differs from a Kronecker product of line and surface only where views end or information
changes with depth, so that few iterations do; where it is one, the preconditioner is the solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.field.equations.system import NormalEquations, Solve
from sldvexp.field.solvers.base import Solver
from sldvexp.field.solvers.kronecker import KroneckerInverse
from sldvexp.typing import Array


@register("solver", "iterative")
@dataclass
class Iterative(Solver):
    """Preconditioned conjugate gradients; a single step where the matrix is a Kronecker product.

    Parameters
    ----------
    tolerance : float
        Largest accepted residual of each right-hand side over its size, in the norm of the
        preconditioner.
    iterations : int
        After so many without reaching it the system counts as singular.
    """

    tolerance: float = 1e-12
    iterations: int = 2000

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(
            1e-15 <= self.tolerance < 1,
            "tolerance",
            f"must lie between 1e-15 (round-off) and 1, not {self.tolerance}",
        )
        checks.require(
            self.iterations >= 1, "iterations", f"must be 1 or more, not {self.iterations}"
        )
        checks.done()

    def prepare(self, system: NormalEquations) -> Solve:
        """Factorise the preconditioner: a problem over the surface and one over the layers."""
        inverse = KroneckerInverse.from_system(system)
        if system.exact:
            return inverse.times
        return lambda right: solve(
            system.times, inverse.times, right, self.tolerance, self.iterations
        )

    def roughly(self, system: NormalEquations, solve: Solve) -> Solve:
        """See `Solver.roughly`."""
        if system.exact or self.tolerance >= ROUGH:
            return solve
        return replace(self, tolerance=ROUGH).prepare(system)


Operator = Callable[[Array], Array]

#: Right-hand sides that are iterated together.
COLUMNS_AT_ONCE = 64
#: Iterations without half the residual after which round-off has been reached.
PATIENCE = 20
#: Residual of what is told with three digits, as condition numbers are.
ROUGH = 1e-4
#: A residual that round-off may leave.
ROUND_OFF = 1e-9


def solve(
    matrix: Operator, near_inverse: Operator, right: Array, tolerance: float, iterations: int
) -> Array:
    """Solve ``M x = b`` for symmetric positive definite M.

    Parameters
    ----------
    matrix, near_inverse : callable
        ``M x`` and ``P x``, P near the inverse of M, symmetric positive definite.
    right : ndarray, shape (..., column)
    tolerance : float
        Of ``sqrt(r^T P r)`` over ``sqrt(b^T P b)`` in every column.
    iterations : int
        Most of them.

    Returns
    -------
    ndarray, shape (..., column)

    Raises
    ------
    UserError
        If residuals stay larger than that.
    """
    solution = np.empty_like(right)
    for first in range(0, right.shape[-1], COLUMNS_AT_ONCE):
        part = slice(first, first + COLUMNS_AT_ONCE)
        columns = np.ascontiguousarray(right[..., part])
        solution[..., part] = _solve(matrix, near_inverse, columns, tolerance, iterations)
    return solution


def _solve(
    matrix: Operator, near_inverse: Operator, right: Array, tolerance: float, iterations: int
) -> Array:
    residual, solution = right.copy(), np.zeros_like(right)
    steep = near_inverse(residual)
    direction = steep.copy()
    size = _dot(residual, steep)
    start = np.where(size > 0, size, 1.0)
    best, since = np.inf, 0
    for _ in range(iterations):
        left = float(np.sqrt(np.max(size / start, initial=0.0)))
        since = 0 if left < best / 2 else since + 1
        best = min(best, left) if since == 0 else best
        if left <= tolerance or (since > PATIENCE and left <= ROUND_OFF):
            return solution
        along = matrix(direction)
        step = _ratio(size, _dot(direction, along))
        solution += step * direction
        residual -= step * along
        steep = near_inverse(residual)
        new = _dot(residual, steep)
        direction *= _ratio(new, size)
        direction += steep
        size = new
    raise UserError(
        f"the field's equations are not solved after {iterations} iterations, a relative residual "
        f"of {best:.2g} is left: use solver=direct, or more samples and views where there are few"
    )


def _dot(a: Array, b: Array) -> Array:
    """Multiply column by column and sum."""
    columns = a.shape[-1]
    return np.einsum("ij,ij->j", a.reshape(-1, columns), b.reshape(-1, columns))


def _ratio(a: Array, b: Array) -> Array:
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)
