"""Poses from matched object and image points: what all methods share that start from these.

Each view is solved for itself, without a starting guess (`sldvexp.pose.single_view`); with shared
intrinsics all views are then solved once more together (`sldvexp.pose.multi_view`). A method that
knows where its points' errors come from replaces the solutions' covariance by that of a
`CovarianceModel`. Notes say what a reader should mind: a second pose that fits nearly as well,
large residuals, points that disagree with the calibration object's.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import ClassVar

import numpy as np

from sldvexp.dataset import WITHOUT_POSE, Finding, Severity
from sldvexp.errors import Checks, UserError, nearest
from sldvexp.io.registration import RegistrationTable, to_dataset
from sldvexp.laser import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.pose.base import JointCovariance, PoseMethod, PoseResult
from sldvexp.pose.intrinsics import adjusted_notes
from sldvexp.pose.least_squares import INTRINSICS
from sldvexp.pose.multi_view import PointObservations, solve_points_together
from sldvexp.pose.outliers import MatchedPoints
from sldvexp.pose.solution import PoseSolution, solutions_to_dataset
from sldvexp.pose.wrong_points import LARGE, PointJudgement, judge_points
from sldvexp.targets import Target, TargetPoints
from sldvexp.typing import Array, BoolArray, IntArray

#: Gives solutions the covariance that they deserve where the points' errors are not independent:
#: solutions, joint covariance of all views, and what to mind, as notes or findings.
CovarianceModel = Callable[
    [Sequence[PoseSolution]],
    tuple[list[PoseSolution], JointCovariance, list[str] | list[Finding]],
]


class MirrorName(Enum):
    """Mirror of the scanner."""

    up_down = 0
    left_right = 1


@dataclass
class FromPoints(PoseMethod):
    """Pose methods that solve for the pose from matched object and image points.

    Parameters
    ----------
    adjust : dict of str to float
        Intrinsics to adjust with the pose, with the standard deviation of what is known of them
        beforehand, as in ``{mirror_offset: 0.005}`` (``.inf`` for nothing): mirror_offset (m),
        gain_up_down and gain_left_right (relative to the calibration), zero_up_down and
        zero_left_right (rad). All others are fixed.
    shared : dict of str to float
        The same for intrinsics that have one value in all views, which are then solved together.
    confidence : float
        Level of the intervals.
    max_iterations : int
        Most steps of the non-linear solution.

    Attributes
    ----------
    judges_points : bool
        Whether points err independently, so that wrong ones can be told and left out.
    """

    judges_points: ClassVar[bool] = False

    adjust: dict[str, float] = field(default_factory=dict)
    shared: dict[str, float] = field(default_factory=dict)
    confidence: float = 0.95
    max_iterations: int = 200

    def __post_init__(self) -> None:
        checks = Checks()
        self._check(checks)
        checks.done()

    def _check(self, checks: Checks) -> None:
        """Collect what is wrong with the fields; methods add to it."""
        checks.probability("confidence", self.confidence)
        least = f"must be at least 1, not {self.max_iterations}"
        checks.require(self.max_iterations >= 1, "max_iterations", least)
        for group in ("adjust", "shared"):
            for name, std in getattr(self, group).items():
                wrong = f"cannot be adjusted; {nearest(name, INTRINSICS)}"
                checks.require(name in INTRINSICS, f"{group}.{name}", wrong)
                wrong = f"must be a positive standard deviation, infinite for a free one, not {std}"
                checks.require(std > 0, f"{group}.{name}", wrong)
        for name in set(self.adjust) & set(self.shared):
            wrong = "is in adjust too: it is either one value a view or one for all views"
            checks.require(False, f"shared.{name}", wrong)

    def angle_std(
        self,
        number: IntArray,
        distance: Array,
        step: Array,
        points: TargetPoints | None,
    ) -> Array | None:
        """Give the standard deviation of each point's angles, if it is known beforehand.

        Parameters
        ----------
        number : ndarray, shape (N,)
            Of the points.
        distance : ndarray, shape (N,), m
            From the instrument.
        step : ndarray, shape (2,), rad
            Angle of one DAC step of each mirror.
        points : TargetPoints or None
            Of the calibration object.

        Returns
        -------
        ndarray, shape (N,), DAC steps, or None
            None estimates it from the residuals, alike for all points.
        """
        return None

    def covariance_model(
        self, tables: Sequence[RegistrationTable], laser: TwoMirror, target: Target | None
    ) -> CovarianceModel | None:
        """Make the model of errors that are not independent, if the method has one.

        `tables` are those of all views.
        """
        return None

    def solve(
        self,
        tables: Sequence[RegistrationTable],
        laser: TwoMirror | None,
        target: Target | None,
        inverted: Sequence[MirrorName] = (),
        model: CovarianceModel | None = None,
    ) -> PoseResult:
        """Solve every view of registration data.

        Parameters
        ----------
        tables : sequence of RegistrationTable
            One a view.
        target : Target or None
            If there is one, object points of the same number are compared with it.
        inverted : sequence of MirrorName
            Mirrors whose recorded angles grow the other way.
        model : CovarianceModel, optional
            Without it, the method's own, if it has one.

        Raises
        ------
        UserError
            If there is no laser, an angle or DAC step is beyond its range, or a view has too few
            points or its pose is not determined or not found.
        """
        laser = require_laser(laser)
        sign = np.ones(2)
        sign[[m.value for m in inverted]] = -1
        views, failed = _solve_views(self, tables, sign, laser, target)
        used, solutions = [v.used_table for v in views], [v.solution for v in views]
        joint: JointCovariance | None = None
        if self.shared:
            angles = [v.angle[v.used] for v in views]
            solutions, joint = _together(self, used, angles, solutions, laser, target)
        model = model or self.covariance_model(used, laser, target)
        told: list[str] | list[Finding] = []
        if model is not None:
            solutions, joint, told = model(solutions)
        views = [replace(v, solution=s) for v, s in zip(views, solutions, strict=True)]
        pose = solutions_to_dataset(
            solutions,
            [v.table.name for v in views],
            [t.number for t in used],
            self.confidence,
            joint,
            [v.left_out(laser) for v in views],
        )
        pose.attrs["mirror_offset"] = laser.mirror_offset
        pose.attrs["step"] = laser.step
        pose.attrs["adjust"] = json.dumps(self.adjust)
        pose.attrs["shared"] = json.dumps(self.shared)
        pose.attrs["source"] = ", ".join(dict.fromkeys(Path(t.source).name for t in tables))
        if failed:
            pose.attrs[WITHOUT_POSE] = json.dumps([*failed])
        notes = [t for t in told if isinstance(t, str)]
        notes += [n for v in views for n in point_notes(self, v.table, v.solution, target)]
        intrinsics = adjusted_notes(self.adjust, self.shared, pose)
        pose.attrs["notes"] = "\n".join([*notes, *intrinsics])
        registration = to_dataset(
            [_as_solved(v.table, v.angle, laser) for v in views], [v.used for v in views]
        )
        findings = [no_pose(*f) for f in failed.items()] + [f for v in views for f in v.findings]
        findings += _residual_findings(views, told if model else None)
        return PoseResult(pose, registration, findings)


@dataclass(frozen=True, eq=False)
class ViewSolution:
    """One view's points and the pose that rests on those of them that are used.

    Parameters
    ----------
    table : RegistrationTable
        As it was recorded.
    angle : ndarray, shape (N, 2), rad
        To solve from.
    used : ndarray of bool, shape (N,)
    solution : PoseSolution
    findings : list of Finding
        About its points.
    """

    table: RegistrationTable
    angle: Array
    used: BoolArray
    solution: PoseSolution
    findings: list[Finding]

    @property
    def used_table(self) -> RegistrationTable:
        """Registration data of the points that are used."""
        return self.table.part(self.used)

    def left_out(self, laser: TwoMirror) -> tuple[IntArray, Array]:
        """Give numbers and residuals, DAC steps, of the points that are not used."""
        matched = MatchedPoints(self.table.object_point, self.angle, laser.step)
        return self.table.number[~self.used], matched.residual(self.solution)[~self.used]


def no_pose(view: str, reason: str) -> Finding:
    """Say that a view has no pose."""
    told = f"view {view} has no pose, and its images are left out: {reason}"
    return Finding("no_pose", f"view {view}", told, Severity.void, views=(view,))


def require_laser(laser: TwoMirror | None) -> TwoMirror:
    """Refuse to go on without mirrors."""
    if laser is None:
        raise UserError("the pose needs the instrument's mirrors: choose one with laser=name")
    return laser


def _together(
    method: FromPoints,
    tables: Sequence[RegistrationTable],
    angles: Sequence[Array],
    alone: Sequence[PoseSolution],
    laser: TwoMirror,
    target: Target | None,
) -> tuple[list[PoseSolution], JointCovariance]:
    """Solve all views with the intrinsics that they share."""
    views = [
        PointObservations(
            t.name, t.object_point, angle, _angle_std(method, t, s.origin, laser, target)
        )
        for t, angle, s in zip(tables, angles, alone, strict=True)
    ]
    found = solve_points_together(
        views,
        step=laser.step,
        mirror_offset=laser.mirror_offset,
        adjust=method.adjust,
        shared=method.shared,
        max_iterations=method.max_iterations,
    )
    if not all(s.converged for s in found.solutions):
        raise UserError(
            f"views {', '.join(t.name for t in tables)}: no poses were found together in "
            f"{method.max_iterations} iterations; share fewer intrinsics or give them priors"
        )
    return found.solutions, found.joint


def _angle_std(
    method: FromPoints,
    table: RegistrationTable,
    origin: Array,
    laser: TwoMirror,
    target: Target | None,
) -> Array | None:
    """Give the standard deviation of each point's angles, DAC steps, if known beforehand."""
    distance = np.linalg.norm(table.object_point - origin, axis=1)
    points = None if target is None else target.points()
    return method.angle_std(table.number, distance, laser.step, points)


def _solve_views(
    method: FromPoints,
    tables: Sequence[RegistrationTable],
    sign: Array,
    laser: TwoMirror,
    target: Target | None,
) -> tuple[list[ViewSolution], dict[str, str]]:
    """Solve each view for itself; say of those without a pose why, by their names.

    Parameters
    ----------
    sign : ndarray, shape (2,)
        Of each mirror's angles.

    Raises
    ------
    UserError
        If no view has a pose, or one has none and the method cannot do without it.
    """
    views: list[ViewSolution] = []
    failed: dict[str, UserError] = {}
    for table in tables:
        try:
            views.append(_solve_view(method, table, sign * _angles(table, laser), laser, target))
        except UserError as error:
            if not method.judges_points:
                raise
            failed[table.name] = error
    if not views:
        raise next(iter(failed.values()))
    return views, {name: str(error) for name, error in failed.items()}


def _solve_view(
    method: FromPoints,
    table: RegistrationTable,
    angle: Array,
    laser: TwoMirror,
    target: Target | None,
) -> ViewSolution:
    """Solve one view, its problems told with its name.

    Known standard deviations depend on the distance, which a first solution without them gives.
    """
    where = f"{table.source or 'registration data'}, view {table.name}"
    matched = MatchedPoints(
        table.object_point,
        angle,
        laser.step,
        laser.mirror_offset,
        method.adjust,
        max_iterations=method.max_iterations,
    )

    def weighted(used: BoolArray) -> tuple[MatchedPoints, PoseSolution]:
        first = matched.solve(used)
        std = _angle_std(method, table, first.origin, laser, target)
        if std is None:
            return matched, first
        with_std = replace(matched, std=std)
        return with_std, with_std.solve(used)

    judged = PointJudgement(np.ones(len(matched), bool), [])
    try:
        points, solution = weighted(judged.used)
        if method.judges_points:
            # With the shared intrinsics free: their error must not be taken for points'.
            free = replace(points, adjust=method.adjust | method.shared)
            judged = judge_points(table, free, target)
        if not judged.used.all():
            solution = weighted(judged.used)[1]
    except UserError as error:
        raise UserError(f"{where}: {error}") from None
    if not solution.converged:
        told = [f"; {f.text}" for f in judged.findings if f.severity is Severity.void]
        raise UserError(
            f"{where}: no pose was found in {method.max_iterations} iterations; are the points "
            f"matched to their angles, and pose.max_iterations large enough?{''.join(told)}"
        )
    return ViewSolution(table, angle, judged.used, solution, judged.findings)


def _angles(table: RegistrationTable, laser: TwoMirror) -> Array:
    """Give the recorded angles, or those of the recorded DAC steps."""
    try:
        return table.angle_through(laser)
    except UserError as error:
        raise UserError(f"{table.source}: {error}") from None


def _as_solved(table: RegistrationTable, angle: Array, laser: TwoMirror) -> RegistrationTable:
    """Give registration data the angles that the pose was solved from, and their DAC steps."""
    try:
        dac = laser.dac_from_angle(angle, table.labels) if table.dac is None else table.dac
    except UserError as error:
        raise UserError(f"{table.source}: {error}") from None
    return replace(table, angle=angle, dac=dac)


#: Probability that right statements about errors are doubted, for all views together.
UNLIKELY = 0.01
#: A file's object point further than this from the target's (and than its errors) is noted, m.
ROUNDING = 5e-6


def point_notes(
    method: FromPoints,
    table: RegistrationTable,
    solution: PoseSolution,
    target: Target | None,
) -> Iterator[str]:
    """Say what a reader of one view's pose should mind.

    Parameters
    ----------
    target : Target or None
        If there is one, object points of the same number are compared with it.
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
    if target is not None:
        yield from _target_notes(view, table, target)


def unlikely_residuals(views: Sequence[str], probability: float) -> Finding:
    """Say that residuals of some views are larger than stated errors explain."""
    which = f"view{'s' * (len(views) > 1)} {', '.join(views)}"
    return Finding(
        "residuals",
        which,
        f"{which}: residuals this large have a probability of {probability:.1g} if the stated "
        "errors are right; the bounds, which rest on these, are too small",
        p_value=probability,
        views=tuple(views),
    )


def _residual_findings(
    views: Sequence[ViewSolution], told: Sequence[str | Finding] | None
) -> list[Finding]:
    """Find residuals that are too large, once a view.

    Parameters
    ----------
    told : sequence of str or Finding, optional
        By a model of the errors, if there is one.
    """
    void = [v for v in views if any(f.severity is Severity.void for f in v.findings)]
    large = [f for v in views if v not in void for f in _large_residuals(v)]
    known = {*(f.subject for f in large), *(f"view {v.table.name}" for v in void)}
    if told is None:
        refuted = [f for v in views for f in _refuted_errors(v, len(views))]
    else:
        refuted = [t for t in told if isinstance(t, Finding)]
    return large + [f for f in refuted if f.kind != "residuals" or f.subject not in known]


def _large_residuals(view: ViewSolution) -> Iterator[Finding]:
    """Find residuals larger than any method's: the points are not those of the angles."""
    solution, where = view.solution, f"view {view.table.name}"
    if solution.dof <= 0:
        return
    scale = float(np.sqrt(np.sum(solution.residual**2) / solution.dof))
    if scale > LARGE:
        yield Finding(
            "residuals",
            where,
            f"{where}: the residuals, {scale:.1f} DAC steps, are larger than any method of "
            "Table 4.3 leaves; are the points matched to their angles, units and mirrors right?",
            Severity.void,
            size=scale,
            views=(view.table.name,),
        )


def _refuted_errors(view: ViewSolution, views: int) -> Iterator[Finding]:
    """Find residuals larger than stated errors explain."""
    solution = view.solution
    if solution.noise_known and solution.dof > 0:
        probability = float(scipy.special.chdtrc(solution.dof, solution.cost))
        if probability < UNLIKELY / views:
            yield unlikely_residuals([view.table.name], probability)


def _target_notes(view: str, table: RegistrationTable, target: Target) -> Iterator[str]:
    """Find object points that disagree with the calibration object's of the same number."""
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
