"""Wrong marks among sightings of unknown points, found because the errors are known.

Right sightings have a cost that is chi-square of ``2 M + D - (6 V + 3 P - 6)``. If theirs is
refuted, a view without which all others agree is looked for, since one gross error may lead the
whole astray, and two of its sightings with each other's numbers. Else one sighting after the other
is left out, everything adjusted anew, and those without which the others agree are told. The best
is left out for good while none does, up to `MOST`. A point that only two views see has little
redundancy, so that several sightings may explain a contradiction as well: then all are named, and
the poses void.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sldvexp.errors import UserError
from sldvexp.pose.bundle_start import configurations
from sldvexp.pose.free_points import AdjustedPoints, Configuration, Sightings, adjust_points
from sldvexp.pose.outliers import MatchedPoints, robust_pose
from sldvexp.pose.single_view import solve_points
from sldvexp.statistics import chi_square_p_value

#: Probability of right sightings that are doubted, and from which they agree.
REFUTED, AGREE = 0.001, 0.01
#: Sightings that are left out at most.
MOST = 3
#: Ratio of probabilities by which one explanation is better than another.
BETTER = 1e3
#: Sightings of a point, and of a view, below which it is not determined.
LEAST_OF_POINT, LEAST_OF_VIEW = 2, 3


@dataclass(frozen=True, eq=False)
class JudgedSightings:
    """Sightings that agree, and what was left out.

    Parameters
    ----------
    sightings : Sightings
        That agree, or all if nothing explains a contradiction.
    found : list of AdjustedPoints
        The best configuration first.
    left_out : list of int
        Positions among all sightings.
    size : list of float, DAC steps
        How far these lie beside where the others put them.
    or_else : list of int
        Further sightings, of which each explains the contradiction as well as the last left out.
    p_value : float
        Of all sightings' residuals.
    agree : bool
    """

    sightings: Sightings
    found: list[AdjustedPoints]
    left_out: list[int]
    size: list[float]
    or_else: list[int]
    p_value: float
    agree: bool


def freedom(sightings: Sightings, at: Configuration) -> int:
    """Count observations less unknowns, those of the world's axes not counted.

    Examples
    --------
    >>> none = np.zeros((0, 2), int)
    >>> see = np.divmod(np.arange(24), 6)
    >>> sightings = Sightings(*see, np.zeros((24, 2)), np.ones(2), 1.0, 0.0, none, [], [])
    >>> freedom(sightings, Configuration(np.zeros((4, 3, 3)), np.zeros((4, 3)), np.zeros((6, 3))))
    12
    """
    return 2 * len(sightings) + len(sightings.length) - 6 * len(at.origin) - 3 * len(at.points) + 6


def judge_sightings(sightings: Sightings, found: list[AdjustedPoints]) -> JudgedSightings:
    """Leave out the sightings that contradict the others.

    Parameters
    ----------
    found : list of AdjustedPoints
        Configurations of all sightings, the best first.
    """
    whole = _probability(sightings, found[0])
    if not whole < REFUTED:
        return JudgedSightings(sightings, found, [], [], [], whole, True)
    best, blamed = _without_a_view(sightings, found[0])
    if blamed is not None and (exchanged := _exchanged_in(sightings, best.at, blamed)):
        pair, near = exchanged
        adjusted = _without(sightings, pair, near)
        rest = sightings.without(np.array(pair))
        if adjusted is not None and _probability(rest, adjusted) >= AGREE:
            return _agreeing(sightings, pair, [], adjusted, whole)
    left_out: list[int] = []
    for _ in range(MOST):
        tried = {
            k: adjusted
            for k in _dispensable(sightings, left_out)
            if (adjusted := _without(sightings, [*left_out, k], best))
        }
        if not tried:
            break
        p = {
            k: _probability(sightings.without(np.array([*left_out, k])), adjusted)
            for k, adjusted in tried.items()
        }
        ranked = sorted(tried, key=lambda k: (-p[k], tried[k].cost))
        left_out.append(ranked[0])
        best = tried[ranked[0]]
        if p[ranked[0]] >= AGREE:
            others = [k for k in ranked[1:] if p[k] * BETTER >= p[ranked[0]] and p[k] >= REFUTED]
            left_out, best = _put_back(sightings, left_out, best)
            return _agreeing(sightings, left_out, others, best, whole)
    return JudgedSightings(sightings, found, [], [], [], whole, False)


def _agreeing(
    sightings: Sightings,
    left_out: list[int],
    or_else: list[int],
    best: AdjustedPoints,
    p_value: float,
) -> JudgedSightings:
    """Gather what is left once the wrong sightings are out."""
    rest = sightings.without(np.array(left_out))
    size = [_beside(sightings, k, best.at) for k in left_out]
    found = _again(rest, best)
    return JudgedSightings(rest, found, left_out, size, or_else, p_value, True)


def _put_back(
    sightings: Sightings, left_out: list[int], best: AdjustedPoints
) -> tuple[list[int], AdjustedPoints]:
    """Put back what was left out first, but agrees now that a worse one is out."""
    for k in left_out[:-1]:
        fewer = [other for other in left_out if other != k]
        adjusted = _without(sightings, fewer, best)
        rest = sightings.without(np.array(fewer))
        if adjusted is not None and _probability(rest, adjusted) >= AGREE:
            left_out, best = fewer, adjusted
    return left_out, best


def _exchanged_in(
    sightings: Sightings, at: Configuration, view: int
) -> tuple[list[int], AdjustedPoints] | None:
    """Find two of a view's sightings with whose angles exchanged all agree, and what fits then."""
    own = np.flatnonzero(sightings.view == view)
    points, angles = at.points[sightings.point[own]], sightings.angle[own]
    pairs = list(combinations(range(len(own)), 2))
    swapped = np.repeat(angles[None], len(pairs), axis=0)
    for k, (one, other) in enumerate(pairs):
        swapped[k, [one, other]] = angles[[other, one]]
    found = solve_points(
        np.broadcast_to(points, (len(pairs), *points.shape)),
        swapped,
        step=sightings.step,
        mirror_offset=sightings.mirror_offset,
    )
    best = int(np.argmin(found.cost))
    with_pair = sightings.angle.copy()
    with_pair[own] = swapped[best]
    whole = Configuration(at.rotation.copy(), at.origin.copy(), at.points)
    whole.rotation[view], whole.origin[view] = found.rotation[best], found.origin[best]
    adjusted = adjust_points(sightings.with_angles(with_pair), whole)
    if adjusted is None or not _probability(sightings, adjusted) >= AGREE:
        return None
    return [int(own[k]) for k in pairs[best]], adjusted


def _without_a_view(
    sightings: Sightings, near: AdjustedPoints
) -> tuple[AdjustedPoints, int | None]:
    """Find a configuration that a wrong view does not lead astray, and that view.

    The others agree without it, and it stands where most of their points are seen. The given
    configuration and None if no view is to blame.
    """
    views, points = len(near.at.origin), len(near.at.points)
    for view in range(views):
        own = sightings.view == view
        others = sightings.only(np.flatnonzero(~own))
        others = others.with_views(others.view - (others.view > view))
        if views < 3 or np.bincount(others.point, minlength=points).min() < LEAST_OF_POINT:
            continue
        found = configurations(others, views - 1, points, 2.0 * len(others))
        if not found or not _probability(others, found[0]) >= AGREE:
            continue
        at = found[0].at
        matched = MatchedPoints(
            at.points[sightings.point[own]],
            sightings.angle[own],
            sightings.step,
            sightings.mirror_offset,
        )
        try:
            pose = robust_pose(matched).pose
        except UserError:
            continue
        whole = Configuration(
            np.insert(at.rotation, view, pose.rotation, axis=0),
            np.insert(at.origin, view, pose.origin, axis=0),
            at.points,
        )
        residual = sightings.residual(whole)
        return AdjustedPoints(whole, residual, float(residual @ residual)), view
    return near, None


def exchanged_sightings(sightings: Sightings, judged: JudgedSightings) -> Iterator[tuple[int, int]]:
    """Find pairs of one view's sightings that all agree with if their angles are exchanged."""
    for one, other in combinations(judged.left_out or range(len(sightings)), 2):
        if sightings.view[one] != sightings.view[other]:
            continue
        order = np.arange(len(sightings))
        order[[one, other]] = other, one
        swapped = sightings.with_angles(sightings.angle[order])
        adjusted = adjust_points(swapped, judged.found[0].at)
        if adjusted is not None and _probability(swapped, adjusted) >= AGREE:
            yield one, other


def wrong_distances(sightings: Sightings, near: AdjustedPoints) -> list[int]:
    """Find known distances without one of which everything else agrees."""
    found = []
    for k in range(len(sightings.length)):
        kept = np.arange(len(sightings.length)) != k
        rest = sightings.with_distances(kept)
        adjusted = adjust_points(rest, near.at) if kept.any() else None
        if adjusted is not None and _probability(rest, adjusted) >= AGREE:
            found.append(k)
    return found


def _dispensable(sightings: Sightings, left_out: Sequence[int]) -> Iterator[int]:
    """Give sightings without which view and point are still determined."""
    kept = np.setdiff1d(np.arange(len(sightings)), left_out)
    for k in kept:
        of_point = np.sum(sightings.point[kept] == sightings.point[k])
        of_view = np.sum(sightings.view[kept] == sightings.view[k])
        if of_point > LEAST_OF_POINT and of_view > LEAST_OF_VIEW:
            yield int(k)


def _without(
    sightings: Sightings, left_out: Sequence[int], near: AdjustedPoints
) -> AdjustedPoints | None:
    """Adjust without some sightings; None without degrees of freedom that could refute it."""
    rest = sightings.without(np.array(left_out))
    if freedom(rest, near.at) < 1:
        return None
    return adjust_points(rest, near.at)


def _again(sightings: Sightings, near: AdjustedPoints) -> list[AdjustedPoints]:
    """Search anew without the wrong sightings, which may have led astray."""
    views, points = len(near.at.origin), len(near.at.points)
    found = configurations(sightings, views, points, near.cost * 1.001)
    return sorted([near, *(f for f in found if f.cost > near.cost * 1.001)], key=lambda f: f.cost)


def _probability(sightings: Sightings, adjusted: AdjustedPoints) -> float:
    return float(chi_square_p_value(adjusted.cost, max(freedom(sightings, adjusted.at), 1)))


def _beside(sightings: Sightings, k: int, at: Configuration) -> float:
    """Give the distance, DAC steps, of a sighting from where the others put it."""
    residual = sightings.only(np.array([k])).residual(at)[:2]
    return float(np.linalg.norm(residual) * sightings.std)
