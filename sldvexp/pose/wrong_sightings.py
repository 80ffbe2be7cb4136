"""Wrong marks among sightings of unknown points, found because the errors are known.

Right sightings have a cost that is chi-square of ``2 M + D - (6 V + 3 P - 6)``. If theirs is
refuted, one after the other is left out, everything adjusted anew, and those without which the
others agree are told. The best is left out for good while none does, up to `MOST`. A point that
only two views see has no redundancy of its own beyond one of its four angles, so that several
sightings may explain a contradiction as well: then all are named, and the poses void.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sldvexp.pose.bundle_start import configurations
from sldvexp.pose.free_points import AdjustedPoints, Configuration, Sightings, adjust_points
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
    left_out: list[int] = []
    best = found[0]
    for _ in range(MOST):
        tried = {
            k: a
            for k in _dispensable(sightings, left_out)
            if (a := _without(sightings, [*left_out, k], best))
        }
        if not tried:
            break
        p = {
            k: _probability(sightings.without(np.array([*left_out, k])), a)
            for k, a in tried.items()
        }
        ranked = sorted(tried, key=lambda k: (-p[k], tried[k].cost))
        left_out.append(ranked[0])
        best = tried[ranked[0]]
        if p[ranked[0]] >= AGREE:
            rest = sightings.without(np.array(left_out))
            others = [k for k in ranked[1:] if p[k] * BETTER >= p[ranked[0]] and p[k] >= REFUTED]
            size = [_beside(sightings, k, best.at) for k in left_out]
            again = _again(rest, best)
            return JudgedSightings(rest, again, left_out, size, others, whole, True)
    return JudgedSightings(sightings, found, [], [], [], whole, False)


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
