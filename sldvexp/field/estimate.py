"""The velocity field over a volume of prisms (Section 5.3), from views to values with bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.field.conditioning import condition_numbers
from sldvexp.field.equations import normal_equations, pixel_data
from sldvexp.field.flags import described, flags
from sldvexp.field.looks import Looks
from sldvexp.field.model import FieldModel
from sldvexp.field.outcome import Outcome
from sldvexp.field.parts import Parts
from sldvexp.field.pose_effect import pose_covariance
from sldvexp.field.result import LOCAL, WORLD, FieldResult
from sldvexp.field.second_way import residuals_only, with_bounds
from sldvexp.field.solvers.base import Solver
from sldvexp.field.system import solution
from sldvexp.reconstruction.base import Reconstruction

Array = NDArray[np.float64]


def estimate_field(
    looks: Looks,
    method: Reconstruction,
    solver: Solver,
    *,
    local: bool = False,
    bounds: bool = True,
    covariance: Array | None = None,
) -> FieldResult:
    """Reconstruct the velocity field (Section 5.3.6).

    The field is ``V(P) = sum_i V_i N_i(P)`` (Eq 5.21); every method is a least-squares fit of it to
    the velocities that the views have at the samples.

    Parameters
    ----------
    looks : Looks
        The volume, its samples and the views.
    method : Reconstruction
        absolute, relative, combined or contravariant; its rows, model, weights and confidence.
    solver : Solver
    local : bool
        Components along each node's tangents and normal instead of the world's axes. The basis
        functions interpolate the components, and the frame turns with the surface.
    bounds : bool
        Compute standard errors and condition numbers, which takes a while longer.
    covariance : ndarray, shape (6 views, 6 views), optional
        Of all poses together; without it those of the views, each by itself.

    Returns
    -------
    FieldResult

    Raises
    ------
    UserError
        If there are too few views or rows for the method, a view sees nothing, or nothing is
        determined anywhere.
    """
    _check_views(looks)
    poses = pose_covariance(looks.views, covariance)
    model = FieldModel.of(method, looks, local)
    parts, data = Parts(looks, model), pixel_data(looks.views)
    equations = normal_equations(parts, data)
    system = equations.system
    found = flags(equations)
    messages = described(found, looks.prisms.position, LOCAL if local else WORLD)
    if not found.observable.any():
        raise UserError(
            f"field: nothing is determined anywhere by the rows {model.rows}; "
            + "; ".join(messages)
        )
    solve = solver.prepare(system)
    theta = solution(equations.right, system, solve)
    if not bounds:
        second = residuals_only(parts, theta, data)
        return Outcome(looks, model, equations, found, theta, second, solver).result(messages)
    determined = found.determined.reshape(*system.active.shape, -1)
    second = with_bounds(parts, system, solve, theta, data, determined, poses)
    if poses is None:
        messages.append("the poses have no covariance: bounds are those of the velocities' noise")
    outcome = Outcome(looks, model, equations, found, theta, second, solver)
    return outcome.result(messages, condition_numbers(system, solve))


def _check_views(looks: Looks) -> None:
    if not looks.views:
        raise UserError("field: there are no views")
    for i, a in enumerate(looks.views):
        for b in looks.views[:i]:
            if np.array_equal(a.origin, b.origin) and np.array_equal(a.rotation, b.rotation):
                raise UserError(
                    f"views {b.name} and {a.name} have the same pose: they see the same component "
                    "of the velocity; leave one out, or move the instrument"
                )
