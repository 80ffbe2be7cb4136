"""Findings about the points of one view: wrong, exchanged, of a mirrored object or a wrong unit.

A pose rests on the points that agree (`sldvexp.pose.outliers`); what does not agree is named here
with the file and number that a person can look up. All points may be right, but the object mirrored
or in another unit of length: such an `Alternative` is believed if its deviance is much smaller than
that of the object as it is given. Units also show where the object points contradict the
calibration object, or the instrument would stand nearer or farther than one can; if the mirrors'
axes meet, nothing else tells a scaled object, and nothing a mirrored one that is planar.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.errors import UserError
from sldvexp.io.registration import RegistrationTable
from sldvexp.pose.few_points import contradiction_of, joined
from sldvexp.pose.outliers import MatchedPoints, RobustPose, exchanged, robust_pose
from sldvexp.pose.rough_pose import rough_poses
from sldvexp.targets import Target, TargetPoints
from sldvexp.typing import Array, BoolArray
from sldvexp.units import LengthUnit

#: Scale of residuals, DAC steps, beyond the largest mean of Table 4.3 and two of its std.
LARGE = 14.0
#: Distances of an instrument from its object, m, that are possible.
POSSIBLE = (0.1, 100.0)
#: Points from which one or two wrong ones are found so surely that the rest can be trusted.
SURE, SURE_SHARE = 8, 4
#: Relative deviation of an object's size from another's that is no matter of tolerances.
SCALED, ALIKE = 0.1, 0.01


#: Difference of deviances from which an alternative is believed: odds of a million.
BELIEVED = 2 * math.log(1e6)
#: Cost, in that of the given object, from which an alternative is not looked at closer.
FAR_WORSE = 10.0
#: Planar objects have no extent across, as a part of their extent along, and no mirror image.
PLANAR = 1e-3


@dataclass(frozen=True)
class PointJudgement:
    """Which points of a view its pose may rest on, and what is said about the others.

    Parameters
    ----------
    used : ndarray of bool, shape (N,)
    findings : list of Finding
    """

    used: BoolArray
    findings: list[Finding]


def judge_points(
    table: RegistrationTable, matched: MatchedPoints, target: Target | None
) -> PointJudgement:
    """Find the points of one view that are wrong, or the object that all of them are of.

    Parameters
    ----------
    table : RegistrationTable
        For names, numbers and units.
    matched : MatchedPoints
        The same points with the angles to solve from.
    target : Target or None
        The calibration object, if there is one.
    """
    everything = np.ones(len(matched), bool)
    findings = [] if target is None else list(_other_size(table, target.points()))
    if len(matched) <= matched.least:
        return PointJudgement(everything, [*findings, *_few(table, matched)])
    found: RobustPose | None = None
    try:
        found = robust_pose(matched)
    except UserError as error:  # points that agree lie on a line, say
        untested = _untested(table, f"no wrong point could be looked for, since {error}")
    other = _alternative(table, matched, found)
    if other is not None:
        return PointJudgement(everything, [*findings, _of_alternative(table, other, found)])
    if found is None:
        return PointJudgement(everything, [*findings, untested])
    if not findings:
        findings += _impossible(table, matched, found)
    if any(f.severity is Severity.void for f in findings):
        # Nothing can be said of single points before the object is right.
        return PointJudgement(everything, findings)
    return PointJudgement(found.used, [*findings, *_wrong(table, matched, found)])


def _untested(table: RegistrationTable, why: str) -> Finding:
    """Say that wrong points could not be seen."""
    view = f"view {table.name}"
    return Finding("untested", view, f"{view}: {why}", Severity.note, views=(table.name,))


def _few(table: RegistrationTable, matched: MatchedPoints) -> Iterator[Finding]:
    """Say what a few points cannot tell, and where they contradict one another.

    Without known errors only what no method of Table 4.3 would leave is a contradiction.
    """
    view, count = f"view {table.name}", len(matched)
    told = f"{count} points are too few to leave a wrong one out; they can only contradict"
    yield _untested(table, f"{told} one another")
    if matched.adjust:
        return  # which explains residuals, too
    known = matched if matched.std is not None else replace(matched, std=np.full(count, LARGE))
    if count == 3 and len(poses := rough_poses(known)) > 1:
        places = " or ".join("({:.2f}, {:.2f}, {:.2f})".format(*pose.origin) for pose in poses)
        told = (
            f"{view}: its three points fit {len(poses)} poses, at {places} m; another point tells"
        )
        yield Finding("untested", view, told, Severity.doubtful, views=(table.name,))
    found = contradiction_of(known)
    if found is not None:
        names = [f"point {number}" for number in table.number]
        told = f"{view}: {found.sentence(names)}; the pose rests on all of them"
        severity = Severity.doubtful if found.kind == "mirrored" else Severity.void
        subject = f"{view}, {joined([names[k] for k in found.points])}"
        remedy = f"take more points than {count}, and the wrong ones again"
        yield Finding(
            found.kind,
            subject,
            told,
            severity,
            p_value=found.p_value,
            size=found.size,
            remedy=remedy,
            views=(table.name,),
        )


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another object than the one that is given, whose points would fit.

    Parameters
    ----------
    scale : float
        By which the object's points are to be multiplied; -1 for a mirrored object.
    found : RobustPose
    """

    scale: float
    found: RobustPose


def _better_alternative(
    matched: MatchedPoints, given: RobustPose | None, scales: Iterable[float]
) -> Alternative | None:
    """Find the alternative that explains the angles much better than the object that is given.

    Parameters
    ----------
    given : RobustPose or None
        With the object as it is; None if there is no such pose.
    scales : iterable of float
        To try; -1 tries the mirror image, which a planar object does not have.
    """
    centred = matched.points - matched.points.mean(axis=0)
    extent = np.linalg.svd(centred, compute_uv=False)
    found = []
    for scale in scales:
        if scale < 0 and extent[2] < PLANAR * extent[0]:
            continue
        # A point reflection is a mirror image turned half round.
        other = replace(matched, points=scale * matched.points)
        try:
            # Points that agree about the given object do not all miss a better one: saves time.
            if given is None or other.solve(given.used).cost < FAR_WORSE * given.pose.cost:
                found.append(Alternative(scale, robust_pose(other)))
        except UserError:
            continue
    limit = np.inf if given is None else given.deviance - BELIEVED
    best = min(
        (a for a in found if a.found.pose.converged), key=lambda a: a.found.deviance, default=None
    )
    return best if best is not None and best.found.deviance < limit else None


def _alternative(
    table: RegistrationTable, matched: MatchedPoints, found: RobustPose | None
) -> Alternative | None:
    """Look for a mirrored object and, if something is amiss, for one in another unit."""
    mirrored = _better_alternative(matched, found, [-1.0])
    if mirrored is not None or matched.mirror_offset == 0:
        return mirrored
    amiss = (
        found is None
        or not found.pose.converged
        or found.scale > LARGE
        or 4 * np.sum(~found.used) > len(matched)
        or not _possible(matched.points, found)
    )
    scales = [u.value / table.unit.value for u in LengthUnit if u != table.unit] if amiss else []
    other = _better_alternative(matched, found, scales)
    return other if other and _possible(matched.points * other.scale, other.found) else None


def _distance(points: Array, found: RobustPose) -> float:
    """Give the distance of the instrument from the middle of the object, m."""
    return float(np.linalg.norm(found.pose.origin - points.mean(axis=0)))


def _possible(points: Array, found: RobustPose) -> bool:
    """Tell whether an instrument can stand there."""
    return POSSIBLE[0] < _distance(points, found) < POSSIBLE[1]


def _of_alternative(
    table: RegistrationTable, other: Alternative, given: RobustPose | None
) -> Finding:
    """Say which object the points are of."""
    view, file = f"view {table.name}", _file(table)
    rms = float(other.found.pose.residual_rms)
    instead = (
        "where there is no pose otherwise"
        if given is None
        else f"instead of {float(given.pose.residual_rms):.2g}"
    )
    if other.scale > 0:
        unit = LengthUnit(other.scale * table.unit.value)
        return Finding(
            "unit",
            view,
            f"{view}: the angles fit object points in {unit.name}, to {rms:.2g} DAC "
            f"steps {instead}, but {file} is read in {table.unit.name}",
            Severity.void,
            size=other.scale,
            remedy=f"state {unit.name} as the unit of {file}",
            views=(table.name,),
        )
    return Finding(
        "mirrored",
        view,
        f"{view}: the angles fit the mirror image of the object points of {file}, to "
        f"{rms:.2g} DAC steps {instead}: an axis of these, or the angles of one "
        "mirror, have the wrong sign",
        Severity.void,
        size=rms,
        remedy="pose.inverted=[up_down], pose.inverted=[left_right] or a right-handed object",
        views=(table.name,),
    )


def _impossible(
    table: RegistrationTable, matched: MatchedPoints, found: RobustPose
) -> Iterator[Finding]:
    """Find an instrument at a distance where none can stand, or behind a planar object."""
    view, distance = f"view {table.name}", _distance(matched.points, found)
    if not _possible(matched.points, found):
        metres = {u.name: distance * u.value / table.unit.value for u in LengthUnit}
        likely = [
            f"{m:.3g} m if the unit is {name}"
            for name, m in metres.items()
            if POSSIBLE[0] < m < POSSIBLE[1]
        ]
        yield Finding(
            "unit",
            view,
            f"{view}: with the object points of {_file(table)} in {table.unit.name} the instrument "
            f"stands {distance:.3g} m from the object; it would be {' or '.join(likely)}",
            Severity.void,
            size=distance,
            remedy=f"state the right unit of {_file(table)}",
            views=(table.name,),
        )
    height = table.object_point[found.used, 2]
    if np.ptp(height) == 0 and found.pose.origin[2] < height[0]:
        yield Finding(
            "mirrored",
            view,
            f"{view}: the instrument is found behind the object (z = {found.pose.origin[2]:.3f} "
            "m); if the object's z axis points to the instrument, a mirror's angles are recorded "
            "the other way round",
            Severity.doubtful,
            remedy="pose.inverted=[up_down]",
            views=(table.name,),
        )


def _other_size(table: RegistrationTable, target: TargetPoints) -> Iterator[Finding]:
    """Find object points whose distances are those of the target times another unit."""
    _, mine, theirs = np.intersect1d(table.number, target.number, return_indices=True)
    if len(mine) < 3:
        return
    pairs = np.triu_indices(len(mine), 1)
    own, true = (
        np.linalg.norm(p[pairs[0]] - p[pairs[1]], axis=1)
        for p in (table.object_point[mine], target.position[theirs])
    )
    ratio = own[true > 0] / true[true > 0]
    scale = float(np.median(ratio))
    alike = np.median(np.abs(ratio - scale)) < ALIKE * scale
    if not alike or abs(scale - 1) < SCALED:
        return
    right = [u for u in LengthUnit if math.isclose(u.value * scale, table.unit.value, rel_tol=0.02)]
    file = _file(table)
    yield Finding(
        "unit",
        f"view {table.name}",
        f"view {table.name}: the object points of {file} lie {scale:.4g} times as far from each "
        f"other as the calibration object's, and so does the instrument from them",
        Severity.void,
        size=scale,
        remedy=f"state {right[0].name} as the unit of {file}"
        if right
        else f"divide the object points of {file} by {scale:.4g}",
        views=(table.name,),
    )


def _wrong(
    table: RegistrationTable, matched: MatchedPoints, found: RobustPose
) -> Iterator[Finding]:
    """Name the points that the pose does not rest on."""
    view, file, out = f"view {table.name}", _file(table), np.flatnonzero(~found.used)
    sure = len(matched) >= SURE and SURE_SHARE * len(out) <= len(matched)
    severity = Severity.note if sure else Severity.doubtful
    beside = np.linalg.norm(matched.residual(found.pose), axis=1)
    swapped: list[int] = []
    for own in exchanged(matched, found):
        swapped += own
        numbers = joined([str(table.number[k]) for k in own])
        yield Finding(
            "exchanged_points",
            f"{view}, points {numbers}",
            f"{view}: points {numbers} of {file} have each other's angles, up to "
            f"{beside[own].max():.3g} DAC steps beside their own, and are left out",
            severity,
            statistic=float(found.statistic[own].max()),
            p_value=float(found.p_value[own].min()),
            size=float(beside[own].max()),
            remedy=f"exchange points {numbers} in {file}",
            views=(table.name,),
        )
    for k in sorted(set(out.tolist()) - set(swapped)):
        number = table.number[k]
        yield Finding(
            "wrong_point",
            f"{view}, point {number}",
            f"{view}: point {number} of {file} lies {beside[k]:.3g} DAC steps beside where the "
            f"other {found.used.sum()} put it (p = {found.p_value[k]:.1g}), and is left out",
            severity,
            statistic=float(found.statistic[k]),
            p_value=float(found.p_value[k]),
            size=float(beside[k]),
            remedy=f"correct or remove point {number} in {file}",
            views=(table.name,),
        )


def _file(table: RegistrationTable) -> str:
    """Give the name of the file that the points are from."""
    return Path(table.source).name or "the registration"
