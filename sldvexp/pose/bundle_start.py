"""Configurations of unknown points and views to start from, out of angles alone.

Two views that see many points in common give relative poses (`sldvexp.pose.relative_pose`), rays
that meet give places of the points, points that have places give the poses of further views
(`sldvexp.pose.single_view`), and these the places of further points. Beams are taken to start in
one place and the baseline is one long until the known distances tell how long it is. Of every pair
all relative poses are followed; the adjustment with the true mirrors decides between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from sldvexp.errors import UserError
from sldvexp.laser import rays
from sldvexp.pose.free_points import (
    AdjustedPoints,
    Configuration,
    Sightings,
    adjust_points,
)
from sldvexp.pose.relative_pose import RelativePose, relative_poses
from sldvexp.pose.single_view import solve_points
from sldvexp.typing import Array, IndexArray

#: Points that two views must have in common, and that a further view must see of those placed.
LEAST_COMMON, LEAST_PLACED = 5, 4
#: Pairs of views that are tried at most, the best first.
PAIRS = 6
#: Configurations nearer than this part of their extent are one.
ALIKE = 1e-4


def configurations(
    sightings: Sightings, views: int, points: int, good: float
) -> list[AdjustedPoints]:
    """Find the adjusted configurations that fit, the best first.

    Parameters
    ----------
    views, points : int
        How many there are.
    good : float
        Cost of a configuration after which no further pair of views is tried.

    Returns
    -------
    list of AdjustedPoints
        Distinct ones; none if no pair of views leads to any.
    """
    found: list[AdjustedPoints] = []
    for first, second in _pairs(sightings, views)[:PAIRS]:
        for start in _starts(sightings, first, second, views, points):
            adjusted = adjust_points(sightings, start)
            if adjusted is not None and _is_new(adjusted, found, sightings):
                found.append(adjusted)
        if found and min(f.cost for f in found) <= good:
            break
    return sorted(found, key=lambda f: f.cost)


def _pairs(sightings: Sightings, views: int) -> list[tuple[int, int]]:
    """Order pairs of views by the points that they have in common, then by the parallax."""

    def worth(pair: tuple[int, int]) -> tuple[int, float]:
        one, other = (_rays(sightings, view) for view in pair)
        common, mine, theirs = np.intersect1d(one[0], other[0], return_indices=True)
        if len(common) < LEAST_COMMON:
            return len(common), 0.0
        # Rays that a rotation brings onto one another have no parallax.
        cross = other[1][theirs].T @ one[1][mine]
        return len(common), -float(np.linalg.svd(cross, compute_uv=False)[:2].sum())

    pairs = {pair: worth(pair) for pair in combinations(range(views), 2)}
    enough = [pair for pair, (count, _) in pairs.items() if count >= LEAST_COMMON]
    return sorted(enough, key=lambda pair: pairs[pair], reverse=True)


def _rays(sightings: Sightings, view: int) -> tuple[IndexArray, Array]:
    """Give the points that a view sees and the unit vectors towards them in its laser frame."""
    own = sightings.view == view
    return sightings.point[own], rays(sightings.angle[own])[1]


def _starts(
    sightings: Sightings, first: int, second: int, views: int, points: int
) -> Iterator[Configuration]:
    """Make configurations from the relative poses of two views."""
    (mine, one), (theirs, other) = (_rays(sightings, view) for view in (first, second))
    _, a, b = np.intersect1d(mine, theirs, return_indices=True)
    for pose in relative_poses(one[a], other[b]):
        grown = _grown(sightings, first, second, pose, views, points)
        if grown is not None:
            yield grown


def _grown(
    sightings: Sightings, first: int, second: int, pose: RelativePose, views: int, points: int
) -> Configuration | None:
    """Add points and views to two views until all are there; None if that cannot be."""
    at = Configuration(
        np.tile(np.eye(3), (views, 1, 1)), np.zeros((views, 3)), np.full((points, 3), np.nan)
    )
    at.rotation[second], at.origin[second] = pose.rotation, -pose.rotation.T @ pose.shift
    posed = np.isin(np.arange(views), (first, second))
    while True:
        _place_points(sightings, at, np.flatnonzero(posed))
        placed = np.isfinite(at.points[:, 0])
        if posed.all():
            break
        seen = [
            np.sum(placed[sightings.point[sightings.view == v]]) if not posed[v] else 0
            for v in range(views)
        ]
        view = int(np.argmax(seen))
        if seen[view] < LEAST_PLACED or not _pose_view(sightings, at, view):
            return None
        posed[view] = True
    if not placed.all():
        return None
    scale = np.sum(sightings.length**2) / np.sum(sightings.length * sightings.distances(at))
    return at.scaled(float(scale))


def _place_points(sightings: Sightings, at: Configuration, posed: IndexArray) -> None:
    """Place each point that two views with poses see where it is nearest to their rays."""
    own = np.isin(sightings.view, posed)
    view, point = sightings.view[own], sightings.point[own]
    along = np.einsum("mji,mj->mi", at.rotation[view], rays(sightings.angle[own])[1])
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    for k in np.unique(point):
        rows = point == k
        if rows.sum() < 2:
            continue
        normal = across[rows].sum(axis=0)
        right = np.einsum("mij,mj->i", across[rows], at.origin[view[rows]])
        at.points[k] = np.linalg.lstsq(normal, right, rcond=None)[0]


def _pose_view(sightings: Sightings, at: Configuration, view: int) -> bool:
    """Find a further view's pose from the points that have places; tell whether there is one."""
    own = (sightings.view == view) & np.isfinite(at.points[sightings.point, 0])
    try:
        found = solve_points(
            at.points[sightings.point[own]], sightings.angle[own], step=sightings.step
        )
    except UserError:
        return False
    at.rotation[view], at.origin[view] = found.rotation, found.origin
    return bool(np.isfinite(found.cost))


def _is_new(found: AdjustedPoints, others: list[AdjustedPoints], sightings: Sightings) -> bool:
    """Tell whether a configuration is none of those found, by the distances within it."""

    def shape(at: Configuration) -> Array:
        places = np.concatenate([at.origin, at.points])
        return np.linalg.norm(places[:, None] - places, axis=-1)

    own = shape(found.at)
    return all(np.abs(own - shape(o.at)).max() > ALIKE * own.max() for o in others)
