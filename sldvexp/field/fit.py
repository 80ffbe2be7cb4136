"""A field that is solved, before its residuals and bounds are known."""

from __future__ import annotations

from dataclasses import dataclass

from sldvexp.errors import UserError
from sldvexp.field.bounds.pose_uncertainty import PoseEffect
from sldvexp.field.bounds.residuals_and_bounds import Second, with_bounds
from sldvexp.field.equations.assembly import Equations, normal_equations
from sldvexp.field.equations.held import prepared
from sldvexp.field.equations.regions import Parts
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.equations.system import Solve, solution
from sldvexp.field.equations.undetermined import Flags, described, flags
from sldvexp.field.result import LOCAL, WORLD
from sldvexp.field.solvers.base import Solver
from sldvexp.field.visibility.coverage import flagged
from sldvexp.field.visibility.looks import Looks
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.typing import Array


@dataclass(frozen=True, eq=False)
class Fit:
    """The least-squares fit of a field to columns of velocities.

    Attributes
    ----------
    parts : Parts
    data : list of ndarray, shape (pixel, column), m/s
        Of each view.
    equations : Equations
    flags : Flags
    solve : callable
    theta : ndarray, shape (layer, surface_node, parameter, column)
    """

    parts: Parts
    data: list[Array]
    equations: Equations
    flags: Flags
    solve: Solve
    theta: Array

    @classmethod
    def of(
        cls, looks: Looks, method: Reconstruction, solver: Solver, local: bool, data: list[Array]
    ) -> Fit:
        """Set up the equations and solve them.

        Raises
        ------
        UserError
            See `sldvexp.field.estimate.estimate_field`.
        """
        parts = Parts(looks, FieldModel.of(method, looks, local))
        equations = normal_equations(parts, data)
        found = flags(equations)
        if not found.observable.any():
            raise UserError(
                f"field: nothing is determined anywhere by the rows {parts.model.rows}; "
                + "; ".join(_messages(parts, equations, found))
            )
        equations, solve = prepared(solver, equations, found)
        theta = solution(equations.right, equations.system, solve)
        return cls(parts, data, equations, found, solve, theta)

    @property
    def messages(self) -> list[str]:
        """About nodes where not all is determined."""
        return _messages(self.parts, self.equations, self.flags)

    def with_bounds(self, factor: Array, pose: PoseEffect | None) -> Second:
        """Residuals and bounds; see `sldvexp.field.bounds.residuals_and_bounds.with_bounds`."""
        system = self.equations.system
        determined = self.flags.determined.reshape(*system.active.shape, -1)
        return with_bounds(
            self.parts, system, self.solve, self.theta, self.data, determined, factor, pose
        )


def _messages(parts: Parts, equations: Equations, found: Flags) -> list[str]:
    axes = LOCAL if parts.model.local else WORLD
    told = described(found, parts.looks.prisms.position, axes)
    lost = flagged(equations.coverage)
    return [*told, lost] if told and lost else told
