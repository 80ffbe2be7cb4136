"""What to mind about a pose from points: a second solution, large residuals, other points."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sldvexp.io.registration.table import RegistrationTable
from sldvexp.lazy import scipy
from sldvexp.pose.single_view import PoseSolution
from sldvexp.targets.base import Target

if TYPE_CHECKING:
    from sldvexp.pose.registration import FromPoints

#: A file's object point further than this from the target's (and than its errors) is noted, m.
ROUNDING = 5e-6
#: Residuals, DAC steps, beyond the largest mean of Table 4.3 and two of its standard deviations.
LARGE = 14.0


def point_notes(
    method: FromPoints,
    table: RegistrationTable,
    solution: PoseSolution,
    target: Target | None,
    judged: bool,
) -> Iterator[str]:
    """What a reader of one view's pose should mind.

    Parameters
    ----------
    method : FromPoints
    table : RegistrationTable
    solution : PoseSolution
    target : Target or None
        If there is one, object points of the same number are compared with it.
    judged : bool
        Whether the residuals have been judged already.
    """
    view = f"view {table.name}"
    if solution.dof <= 0:
        yield f"{view}: as many unknowns as angles, so that no bound can be given"
    elif solution.has_other and solution.cost > 0:
        ratio = float(solution.other_cost / solution.cost)
        if ratio < scipy.special.fdtri(solution.dof, solution.dof, method.confidence):
            x, y, z = solution.other_origin
            yield (
                f"{view}: a second pose at ({x:.3f}, {y:.3f}, {z:.3f}) m fits nearly as well "
                f"(squared residuals {ratio:.2f} times larger); more points or a second plane tell "
                "them apart"
            )
    if not judged:
        yield from _residual_notes(method, view, solution)
    z = table.object_point[:, 2]
    if np.ptp(z) == 0 and solution.origin[2] < z[0]:
        yield (
            f"{view}: the instrument is found behind the object (z = {solution.origin[2]:.3f} m); "
            "if the object's z axis points to the instrument, a mirror's angles are recorded the "
            "other way round: try pose.inverted=[up_down]"
        )
    if target is not None:
        yield from _target_notes(view, table, target)


def unlikely_residuals(view: str, probability: float) -> str:
    """Residuals larger than stated errors explain."""
    return (
        f"{view}: residuals this large have a probability of {probability:.1g} if the stated "
        "errors are right; the bounds, which rest on these, are too small"
    )


def _residual_notes(method: FromPoints, view: str, solution: PoseSolution) -> Iterator[str]:
    """Residuals larger than stated errors, or than any method's, explain."""
    if solution.noise_known and solution.dof > 0:
        probability = float(scipy.special.chdtrc(solution.dof, solution.cost))
        if probability < 1 - method.confidence:
            yield unlikely_residuals(view, probability)
    elif np.isfinite(solution.s) and solution.s > LARGE:
        yield (
            f"{view}: the residuals, {solution.s:.1f} DAC steps, are larger than any method of "
            "Table 4.3 leaves; are the points matched to their angles, units and mirrors right?"
        )


def _target_notes(view: str, table: RegistrationTable, target: Target) -> Iterator[str]:
    """Object points that disagree with the calibration object's of the same number."""
    points = target.points()
    common, mine, theirs = np.intersect1d(table.number, points.number, return_indices=True)
    gap = np.abs(table.object_point[mine] - points.position[theirs])
    far = (gap > ROUNDING + 3 * points.std[theirs]).any(axis=1)
    if far.any():
        names = ", ".join(map(str, common[far]))
        yield (
            f"{view}: object points {names} of {Path(table.source).name} are up to "
            f"{1e3 * gap[far].max():.3g} mm from those of the same number on the calibration object"
        )
