"""`solver=direct`: LU factors of the matrix, or of its two factors where it is a product."""

from __future__ import annotations

from dataclasses import dataclass

from sldvexp.config.registry import register
from sldvexp.field.equations.system import NormalEquations, Solve
from sldvexp.field.solvers.base import Solver
from sldvexp.field.solvers.kronecker import (
    KroneckerInverse,
    factorised,
    solved,
    undetermined_nodes,
)


@register("solver", "direct")
@dataclass
class Direct(Solver):
    """Sparse LU factors: no iteration, but memory for a field's volume instead of its surface."""

    def prepare(self, system: NormalEquations) -> Solve:
        """Factorise the matrix.

        Raises
        ------
        UserError
            If samples do not determine all of a field.
        """
        inverse = KroneckerInverse.from_system(system)  # which says what is singular
        if system.exact:
            return inverse.times
        try:
            factor = factorised(system.matrix().tocsc())
        except RuntimeError:  # though its means over depth are not singular
            raise undetermined_nodes(system) from None
        return lambda right: solved(factor, right.reshape(-1, right.shape[-1])).reshape(right.shape)
