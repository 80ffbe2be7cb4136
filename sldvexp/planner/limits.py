"""Limits of the room that hold the stands back, and stands that are one.

A limit is active if stands that may go beyond it do so and lower what was asked for. Each is
loosened alone, by a step that a bench may allow, and the planned stands are moved on from where
they are in all of these rooms together (`sldvexp.planner.search.move_in_rooms`), which is much
quicker than searches from the beginning and tells nearly the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from sldvexp.config.planning import PlanRoom
from sldvexp.planner.criterion import Goal, covariance_of
from sldvexp.planner.images import Stand
from sldvexp.planner.place import OBLIQUE, Place, StandExamination
from sldvexp.planner.search import move_in_rooms
from sldvexp.typing import Array

#: Steps by which a limit is loosened: of the room's sides, m; of distances, as a part; deg.
ASIDE, AWAY, TURNED = 0.4, 0.25, 6.0
#: Part by which what was asked for must fall for a limit to be told.
WORTH = 0.05
#: Limits that are told at most.
MOST_TOLD = 2
#: Distance of two stands, as a part of that from the object, within which they are one.
ONE = 0.05


@dataclass(frozen=True)
class ActiveLimit:
    """A limit of the room, and what it costs.

    Parameters
    ----------
    setting : str
        As it would be loosened: ``plan.room.incidence=66``.
    before : str
        What it is.
    gain : float
        Part by which the bound that was asked for falls, about.
    """

    setting: str
    before: str
    gain: float


def active_limits(
    goal: Goal,
    place: Place,
    stands: StandExamination,
    least: float,
    begun: Array,
    seed: int,
) -> list[ActiveLimit]:
    """Find the limits that hold planned stands back, the one that costs most first.

    Parameters
    ----------
    place : Place
        With the nodes that stands are compared on.
    stands : StandExamination
        Of the new stands there.
    least : float
        Part of the nodes that each must see.
    begun : ndarray, shape (stand, node, 3)
        Directions of stands that are there already.
    """

    def bound(found: StandExamination) -> float:
        return goal.of(covariance_of(np.concatenate([begun, found.looks])))

    now, (settings, before, rooms) = bound(stands), zip(*_loosened(place.room), strict=True)
    rngs = [np.random.default_rng(seed) for _ in rooms]
    each = move_in_rooms(goal, place, rooms, stands, least, begun, rngs)
    found = [
        ActiveLimit(f"plan.room.{setting}", was, 1 - bound(moved) / now)
        for setting, was, moved in zip(settings, before, each, strict=True)
    ]
    active = [limit for limit in found if limit.gain > WORTH]
    return sorted(active, key=lambda limit: -limit.gain)[:MOST_TOLD]


def told(limits: Sequence[ActiveLimit], asked: float) -> str:
    """Say which limits hold the stands back, and what the bound would be without each.

    Parameters
    ----------
    asked : float, m/s
        Bound that was asked for, as it is.

    Examples
    --------
    >>> told([ActiveLimit("plan.room.incidence=66", "60", 0.25)], 4e-4)
    'the room limits the stands: with plan.room.incidence=66 in place of 60 the bound asked for \
falls by about 25 %, to 0.3 mm/s'
    """
    if not limits:
        return ""
    first, *others = limits
    more = "".join(
        f", with {limit.setting} in place of {limit.before} by {100 * limit.gain:.0f} %"
        for limit in others
    )
    return (
        f"the room limits the stands: with {first.setting} in place of {first.before} the bound "
        f"asked for falls by about {100 * first.gain:.0f} %, to "
        f"{1e3 * asked * (1 - first.gain):.3g} mm/s{more}"
    )


def nearly_one(stands: Sequence[Stand], place: Place) -> Iterator[str]:
    """Yield a sentence for each two stands that stand so near that they see the same."""
    for one, other in combinations(stands, 2):
        apart = float(np.linalg.norm(one.origin - other.origin))
        away = float(np.linalg.norm((one.origin + other.origin) / 2 - place.middle))
        if apart < ONE * away:
            yield (
                f"stands {one.name} and {other.name} stand {1e3 * apart:.0f} mm apart: they are "
                "one stand measured twice, which lessens its noise and tells no other direction"
            )


def _loosened(room: PlanRoom) -> Iterator[tuple[str, str, PlanRoom]]:
    """Yield rooms with one limit looser: the setting, its value before, and the room."""
    for key, way in (("low", -1), ("high", 1)):
        sides = getattr(room, key)
        for axis, side in enumerate(sides):
            if side is not None:
                wide = [*sides[:axis], round(side + way * ASIDE, 3), *sides[axis + 1 :]]
                yield f"{key}={_listed(wide)}", _listed(sides), replace(room, **_one(key, wide))
    nearest, farthest = room.distance
    for wide in (
        [round(nearest * (1 - AWAY), 3), farthest],
        [nearest, round(farthest * (1 + AWAY), 3)],
    ):
        yield f"distance={_listed(wide)}", _listed(room.distance), replace(room, distance=wide)
    if room.incidence < OBLIQUE:
        angle = min(room.incidence + TURNED, OBLIQUE)
        yield f"incidence={angle:g}", f"{room.incidence:g}", replace(room, incidence=angle)
    if room.mirrors < 1:
        yield "mirrors=1", f"{room.mirrors:g}", replace(room, mirrors=1.0)


def _one(key: str, value: Any) -> dict[str, Any]:
    return {key: value}


def _listed(values: Sequence[float | None]) -> str:
    """Write a list as the command line takes it.

    Examples
    --------
    >>> _listed([None, 1.5, None])
    '[null,1.5,null]'
    """
    return "[" + ",".join("null" if v is None else f"{v:g}" for v in values) + "]"
