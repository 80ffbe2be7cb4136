"""Base of all solvers of a field's normal equations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from sldvexp.field.equations.system import NormalEquations, Solve


@dataclass
class Solver(ABC):
    """A way to solve ``M theta = b``. A strategy implements the one hook `prepare`."""

    @abstractmethod
    def prepare(self, system: NormalEquations) -> Solve:
        """Do all that does not depend on right-hand sides, which are many.

        Returns
        -------
        callable
            From real right-hand sides of shape (layer, surface_node, block, column) to the
            solutions.

        Raises
        ------
        UserError
            If the system cannot be solved in this way.
        """

    def roughly(self, system: NormalEquations, solve: Solve) -> Solve:
        """Return a way to solve it to some digits, where those of `solve` cost and are not wanted.

        Parameters
        ----------
        solve : callable
            What `prepare` made of the system.
        """
        return solve
