"""From registration data to the groups of a run: one solution a view, and what to mind about it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sldvexp.errors import UserError
from sldvexp.pose.base import pose_group
from sldvexp.pose.solver import PoseSolution, solve_pose
from sldvexp.pose.statistics import half_width, standard_error
from sldvexp.registration.netcdf import to_dataset
from sldvexp.statistics.student import student_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.pose.registration import FromPoints, MirrorName
    from sldvexp.registration.table import RegistrationTable
    from sldvexp.target.base import Target

    Array = NDArray[np.float64]

#: A file's object point further than this from the target's (and than its errors) is noted, m.
ROUNDING = 5e-6
#: Residuals, DAC steps, beyond the largest mean of Table 4.3 and two of its standard deviations.
LARGE = 14.0


def estimate(
    method: FromPoints,
    tables: Sequence[RegistrationTable],
    laser: TwoMirror | None,
    target: Target | None,
    inverted: Sequence[MirrorName] = (),
    judge: Callable[[int, PoseSolution], PoseSolution] | None = None,
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
    judge : callable, optional
        Gives the solution of the i-th view the covariance that it deserves, where the points'
        errors are not independent.

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
    if judge is not None:
        solutions = [judge(i, s) for i, s in enumerate(solutions)]
    registration = to_dataset(
        [_as_solved(table, angle, laser) for table, angle in zip(tables, angles, strict=True)]
    )
    pose = _pose_group(method, tables, solutions, laser)
    notes = [
        n
        for t, s in zip(tables, solutions, strict=True)
        for n in _notes(method, t, s, target, judged=judge is not None)
    ]
    pose.attrs["notes"] = "\n".join(notes)
    return {"registration": registration, "pose": pose}


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
        distance = np.linalg.norm(table.object_point - solution.origin, axis=1)
        points = None if target is None else target.points()
        std = method.angle_std(table.number, distance, laser.step, points)
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
) -> xr.Dataset:
    """The group ``pose`` of all views."""

    def each(name: str) -> Array:
        return np.array([getattr(s, name) for s in solutions])

    number = np.unique(np.concatenate([t.number for t in tables]))
    residual = np.full((len(tables), len(number), 2), np.nan)
    for i, (table, s) in enumerate(zip(tables, solutions, strict=True)):
        residual[i, np.searchsorted(number, table.number)] = s.residual
    covariance, dof, sse = each("covariance"), each("dof"), each("sse_deg2")
    coords: dict[str, Any] = {"point": number}
    more: dict[str, Any] = {}
    adjusted = solutions[0].parameters[6:]
    if adjusted:
        std = standard_error(covariance)[:, 6:]
        coords["adjusted"] = list(adjusted)
        more = {
            "intrinsic": np.array([[s.intrinsics[a] for a in adjusted] for s in solutions]),
            "intrinsic_std": std,
            "intrinsic_confidence": half_width(std, each("covariance_dof"), method.confidence),
        }
    with np.errstate(divide="ignore", invalid="ignore"):
        s_deg = np.sqrt(sse / dof)
    group = pose_group(
        [t.name for t in tables],
        each("rotation"),
        each("origin"),
        covariance,
        each("covariance_dof"),
        method.confidence,
        parameters=solutions[0].parameters,
        coords=coords,
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
        **more,
    )
    group.attrs["mirror_offset"] = laser.mirror_offset
    group.attrs["step"] = laser.step
    group.attrs["adjust"] = json.dumps({name: method.adjust[name] for name in adjusted})
    group.attrs["source"] = ", ".join(dict.fromkeys(Path(t.source).name for t in tables))
    return group


def _noise(solution: PoseSolution) -> float:
    """Standard deviation of a mirror reading, DAC steps, whatever the weights."""
    if not solution.noise_known or solution.dof <= 0:
        return float(solution.s)
    return float(np.sqrt(np.sum(solution.residual**2) / solution.dof))


def _notes(
    method: FromPoints,
    table: RegistrationTable,
    solution: PoseSolution,
    target: Target | None,
    judged: bool,
) -> Iterator[str]:
    """What a reader of this view's pose should mind; residuals may have been judged already."""
    from scipy.special import fdtri

    view = f"view {table.name}"
    if solution.dof <= 0:
        yield f"{view}: as many unknowns as angles, so that no bound can be given"
    elif solution.has_other and solution.cost > 0:
        ratio = float(solution.other_cost / solution.cost)
        if ratio < fdtri(solution.dof, solution.dof, method.confidence):
            x, y, z = solution.other_origin
            yield (
                f"{view}: a second pose at ({x:.3f}, {y:.3f}, {z:.3f}) m fits nearly as well "
                f"(squared residuals {ratio:.2f} times larger); more points or a second plane tell "
                "them apart"
            )
    if not judged:
        yield from _residual_notes(method, view, solution)
    yield from _intrinsic_notes(method, view, solution)
    z = table.object_point[:, 2]
    if np.ptp(z) == 0 and solution.origin[2] < z[0]:
        yield (
            f"{view}: the instrument is found behind the object (z = {solution.origin[2]:.3f} m); "
            "if the object's z axis points to the instrument, a mirror's angles are recorded the "
            "other way round: try pose.inverted=[up_down]"
        )
    if target is not None:
        yield from _target_notes(view, table, target)


def _residual_notes(method: FromPoints, view: str, solution: PoseSolution) -> Iterator[str]:
    """Residuals larger than stated errors, or than any method's, explain."""
    from scipy.special import chdtrc

    if solution.noise_known and solution.dof > 0:
        probability = float(chdtrc(solution.dof, solution.cost))
        if probability < 1 - method.confidence:
            yield (
                f"{view}: residuals this large have a probability of {probability:.1g} if the "
                "stated errors are right; the bounds, which rest on these, are too small"
            )
    elif np.isfinite(solution.s) and solution.s > LARGE:
        yield (
            f"{view}: the residuals, {solution.s:.1f} DAC steps, are larger than any method of "
            "Table 4.3 leaves; are the points matched to their angles, units and mirrors right?"
        )


def _intrinsic_notes(method: FromPoints, view: str, solution: PoseSolution) -> Iterator[str]:
    """Adjusted intrinsics that the data cannot tell from their nominal values."""
    factor = float(student_factor(method.confidence, solution.covariance_dof))
    for i, name in enumerate(solution.parameters[6:], 6):
        value = float(solution.intrinsics[name])
        std = float(np.sqrt(solution.covariance[i, i]))
        nominal = 1.0 if name.startswith("gain") else 0.0
        if not abs(value - nominal) > factor * std:
            yield (
                f"{view}: this data barely determines {name}: {value:.4f} with a standard error of "
                f"{std:.4f}, so that {nominal:g} is as good"
            )
        elif method.adjust[name] < np.inf and std > 0.9 * method.adjust[name]:
            yield f"{view}: {name} is what was assumed of it beforehand; this data adds nothing"


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
