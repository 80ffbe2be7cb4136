"""From registration data to the groups of a run: one solution a view, and what to mind about it.

What to mind about a pose from points: a second solution, large residuals, other points.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sldvexp.errors import UserError
from sldvexp.io.registration import RegistrationTable, to_dataset
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import JointCovariance, pose_to_dataset
from sldvexp.pose.intrinsics import adjusted_notes
from sldvexp.pose.multi_view import PointObservations, solve_together
from sldvexp.pose.single_view import PoseSolution, solve_pose
from sldvexp.targets.base import Target
from sldvexp.typing import Array

if TYPE_CHECKING:
    from sldvexp.pose.registration import FromPoints, MirrorName

#: Gives solutions the covariance that they deserve where the points' errors are not independent:
#: solutions, joint covariance of all views, notes.
CovarianceModel = Callable[[Sequence[PoseSolution]], tuple[list[PoseSolution], Array, list[str]]]


def estimate(
    method: FromPoints,
    tables: Sequence[RegistrationTable],
    laser: TwoMirror | None,
    target: Target | None,
    inverted: Sequence[MirrorName] = (),
    judge: CovarianceModel | None = None,
) -> dict[str, xr.Dataset]:
    """Solve every view and make the groups ``registration`` and ``pose``.

    Parameters
    ----------
    method : FromPoints
    tables : sequence of RegistrationTable
    laser : TwoMirror or None
    target : Target or None
        If there is one, object points of the same number are compared with it.
    inverted : sequence of MirrorName
        Mirrors whose recorded angles grow the other way.
    judge : CovarianceModel, optional
        Without it, the method's own, if it has one.

    Returns
    -------
    dict of str to xarray.Dataset

    Raises
    ------
    UserError
        If there is no laser, an angle or DAC step is beyond its range, or a view has too few points
        or its pose is not determined or not found.
    """
    if laser is None:
        raise UserError("the pose needs the instrument's mirrors: choose one with laser=name")
    sign = np.ones(2)
    sign[[m.value for m in inverted]] = -1
    angles = [sign * _angles(table, laser) for table in tables]
    solutions = [
        _solve(method, table, angle, laser, target)
        for table, angle in zip(tables, angles, strict=True)
    ]
    matrix: Array | None = None
    if method.shared:
        solutions, matrix = _together(method, tables, angles, solutions, laser, target)
    judge = judge or method.judge(tables, laser, target)
    judged: list[str] = []
    if judge is not None:
        solutions, matrix, judged = judge(solutions)
    registration = to_dataset(
        [_as_solved(table, angle, laser) for table, angle in zip(tables, angles, strict=True)]
    )
    pose = _pose_group(method, tables, solutions, laser, matrix)
    notes = [
        n
        for t, s in zip(tables, solutions, strict=True)
        for n in point_notes(method, t, s, target, judged=judge is not None)
    ]
    intrinsics = adjusted_notes(method.adjust, method.shared, pose)
    pose.attrs["notes"] = "\n".join([*judged, *notes, *intrinsics])
    return {"registration": registration, "pose": pose}


def _together(
    method: FromPoints,
    tables: Sequence[RegistrationTable],
    angles: Sequence[Array],
    alone: Sequence[PoseSolution],
    laser: TwoMirror,
    target: Target | None,
) -> tuple[list[PoseSolution], Array]:
    """All views with the intrinsics that they share, and the joint covariance."""
    sights = [
        PointObservations(
            t.name, t.object_point, angle, _angle_std(method, t, s.origin, laser, target)
        )
        for t, angle, s in zip(tables, angles, alone, strict=True)
    ]
    solutions, matrix = solve_together(
        sights,
        step=laser.step,
        mirror_offset=laser.mirror_offset,
        adjusted=method.adjust,
        shared=method.shared,
        max_iterations=method.max_iterations,
    )
    if not all(s.converged for s in solutions):
        raise UserError(
            f"views {', '.join(t.name for t in tables)}: no poses were found together in "
            f"{method.max_iterations} iterations; share fewer intrinsics or give them priors"
        )
    return solutions, matrix


def _angle_std(
    method: FromPoints,
    table: RegistrationTable,
    origin: Array,
    laser: TwoMirror,
    target: Target | None,
) -> Array | None:
    """Standard deviation of each point's angles, DAC steps, if known beforehand."""
    distance = np.linalg.norm(table.object_point - origin, axis=1)
    points = None if target is None else target.points()
    return method.angle_std(table.number, distance, laser.step, points)


def _solve(
    method: FromPoints,
    table: RegistrationTable,
    angle: Array,
    laser: TwoMirror,
    target: Target | None,
) -> PoseSolution:
    """One view's solution, its problems told with its name."""
    where = f"{table.source or 'registration data'}, view {table.name}"

    def solve(std: Array | None) -> PoseSolution:
        return solve_pose(
            table.object_point,
            angle,
            step=laser.step,
            mirror_offset=laser.mirror_offset,
            adjust=method.adjust,
            std=std,
            max_iterations=method.max_iterations,
        )

    try:
        solution = solve(None)
        std = _angle_std(method, table, solution.origin, laser, target)
        if std is not None:
            solution = solve(std)
    except UserError as error:
        raise UserError(f"{where}: {error}") from None
    if not solution.converged:
        raise UserError(
            f"{where}: no pose was found in {method.max_iterations} iterations; are the points "
            "matched to their angles, and pose.max_iterations large enough?"
        )
    return solution


def _angles(table: RegistrationTable, laser: TwoMirror) -> Array:
    """The recorded angles, or those of the recorded DAC steps."""
    try:
        return table.angle_through(laser)
    except UserError as error:
        raise UserError(f"{table.source}: {error}") from None


def _as_solved(table: RegistrationTable, angle: Array, laser: TwoMirror) -> RegistrationTable:
    """Registration data with the angles that the pose was solved from, and their DAC steps."""
    try:
        dac = laser.dac_from_angle(angle, table.labels) if table.dac is None else table.dac
    except UserError as error:
        raise UserError(f"{table.source}: {error}") from None
    return replace(table, angle=angle, dac=dac)


def _pose_group(
    method: FromPoints,
    tables: Sequence[RegistrationTable],
    solutions: Sequence[PoseSolution],
    laser: TwoMirror,
    matrix: Array | None,
) -> xr.Dataset:
    """The group ``pose`` of all views."""

    def each(name: str) -> Array:
        return np.array([getattr(s, name) for s in solutions])

    number = np.unique(np.concatenate([t.number for t in tables]))
    residual = np.full((len(tables), len(number), 2), np.nan)
    for i, (table, s) in enumerate(zip(tables, solutions, strict=True)):
        residual[i, np.searchsorted(number, table.number)] = s.residual
    covariance, dof, sse = each("covariance"), each("dof"), each("sse_deg2")
    adjusted = solutions[0].parameters[6:]
    views = [t.name for t in tables]
    joint = None
    if matrix is not None:
        joint = JointCovariance(views, [*method.adjust], [*method.shared], matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        s_deg = np.sqrt(sse / dof)
    group = pose_to_dataset(
        views,
        each("rotation"),
        each("origin"),
        covariance,
        each("covariance_dof"),
        method.confidence,
        adjusted=adjusted,
        intrinsic=np.array([[s.intrinsics[a] for a in adjusted] for s in solutions]),
        joint=joint,
        coords={"point": number},
        residual=residual,
        residual_rms=np.sqrt(np.nanmean(residual**2, axis=(1, 2))),
        s=np.array([_noise(s) for s in solutions]),
        s_deg=s_deg,
        sse=sse,
        cost=each("cost"),
        other_found=each("has_other"),
        other_origin=each("other_origin"),
        other_rotation=each("other_rotation"),
        other_cost=each("other_cost"),
    )
    group.attrs["mirror_offset"] = laser.mirror_offset
    group.attrs["step"] = laser.step
    group.attrs["adjust"] = json.dumps(method.adjust)
    group.attrs["shared"] = json.dumps(method.shared)
    group.attrs["source"] = ", ".join(dict.fromkeys(Path(t.source).name for t in tables))
    return group


def _noise(solution: PoseSolution) -> float:
    """Standard deviation of a mirror reading, DAC steps, whatever the weights."""
    if not solution.noise_known or solution.dof <= 0:
        return float(solution.s)
    return float(np.sqrt(np.sum(solution.residual**2) / solution.dof))


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
