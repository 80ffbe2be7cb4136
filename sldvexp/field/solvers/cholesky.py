"""`solver=cholesky`: sparse Cholesky factors, by the optional package cholespy."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.field.equations.system import Solve, System
from sldvexp.field.solvers.base import Solver
from sldvexp.field.solvers.cholmod import solve_with
from sldvexp.field.solvers.kronecker import KroneckerInverse


@register("solver", "cholesky")
@dataclass
class Cholesky(Solver):
    """CHOLMOD's factors: half the numbers that `direct` keeps.

    Needs the extra: ``pip install 'sldvexp[cholesky]'``.
    """

    def __post_init__(self) -> None:
        checks = Checks()  # now, and not after the scan
        needed = "needs the package cholespy: pip install 'sldvexp[cholesky]', or solver=iterative"
        checks.require(find_spec("cholespy") is not None, "", needed)
        checks.done()

    def prepare(self, system: System) -> Solve:
        """Factors of the matrix."""
        import cholespy

        inverse = KroneckerInverse.of(system)  # which says what is singular
        if system.exact:
            return inverse.times
        matrix = system.matrix().tocoo()
        factor = cholespy.CholeskySolverD(
            matrix.shape[0], matrix.row, matrix.col, matrix.data, cholespy.MatrixType.COO
        )
        return solve_with(factor)
