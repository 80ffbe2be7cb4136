"""`solver=iterative`: conjugate gradients on the Kronecker product that is near the matrix."""

from __future__ import annotations

from dataclasses import dataclass

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.field.equations.system import Solve, System
from sldvexp.field.solvers.base import Solver
from sldvexp.field.solvers.conjugate_gradients import solve
from sldvexp.field.solvers.kronecker import KroneckerInverse


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

    def prepare(self, system: System) -> Solve:
        """Factors of the preconditioner: a problem over the surface and one over the layers."""
        inverse = KroneckerInverse.of(system)
        if system.exact:
            return inverse.times
        return lambda right: solve(
            system.times, inverse.times, right, self.tolerance, self.iterations
        )
