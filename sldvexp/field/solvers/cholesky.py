"""`solver=cholesky`: sparse Cholesky factors, by the optional package cholespy."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.field.equations.system import NormalEquations, Solve
from sldvexp.field.solvers.base import Solver
from sldvexp.field.solvers.kronecker import KroneckerInverse
from sldvexp.typing import Array


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

    def prepare(self, system: NormalEquations) -> Solve:
        """Factorise the matrix."""
        import cholespy

        inverse = KroneckerInverse.from_system(system)  # which says what is singular
        if system.exact:
            return inverse.times
        matrix = system.matrix().tocoo()
        factor = cholespy.CholeskySolverD(
            matrix.shape[0], matrix.row, matrix.col, matrix.data, cholespy.MatrixType.COO
        )
        return solve_with(factor)


#: Right-hand sides that cholespy takes at once.
COLUMNS_AT_ONCE = 128


def solve_with(factor: Any) -> Solve:
    """Solve with factors of a system's matrix; for shapes see `Solve`."""

    def solve(right: Array) -> Array:
        # Both arrays that cholespy gets must be contiguous: it fills the second in place.
        flat = right.reshape(-1, right.shape[-1])
        solution = np.empty_like(flat)
        for first in range(0, flat.shape[1], COLUMNS_AT_ONCE):
            part = slice(first, first + COLUMNS_AT_ONCE)
            columns = np.ascontiguousarray(flat[:, part])
            found = np.zeros_like(columns)
            factor.solve(columns, found)
            solution[:, part] = found
        return solution.reshape(right.shape)

    return solve
