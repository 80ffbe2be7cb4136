"""Search for stands: candidates, the greedy choice, exchanges, and moves of each stand in space.

Places are drawn around the object and those kept that the room, the mirrors and the object allow.
The first layout takes the best candidate after the other. Then each stand in turn is exchanged for
the candidate that is best with the others (Fedorov), until none helps. At last every stand moves by
steps in space that help, which become smaller when none does. Every comparison is the closed form
of `sldvexp.planner.criterion`.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.config.planning import PlanRoom
from sldvexp.errors import UserError
from sldvexp.planner.criterion import Goal, covariance_of
from sldvexp.planner.place import OBLIQUE, SETTING_OF, Place, StandExamination, Unseen
from sldvexp.planner.stand_limits import StandLimits
from sldvexp.planner.turning import turned_towards
from sldvexp.typing import Array

#: Places that are drawn together, and how many at most for each candidate wanted.
AT_ONCE, MOST_TRIED = 1000, 40
#: Length of a surface's mean normal from which places are drawn on its side alone.
ONE_SIDED = 0.5
#: Part of the nodes from which a limit that costs them counts as forbidding a place.
HALF = 0.5
#: Places that are enough to say that a limit allows some.
SOME = 10
#: Relative improvement that counts.
BETTER = 1e-6
#: Steps of the moves in space: the first and the last, m.
FIRST_STEP, LAST_STEP = 0.16, 0.01
#: Places are whole millimetres, as they are written: what was examined is what is said.
DECIMALS = 3
#: Directions of moves besides those along the axes.
OTHER_MOVES = 10


@dataclass(frozen=True, eq=False)
class FeasiblePlaces:
    """Feasible places.

    Attributes
    ----------
    examined : StandExamination
    least : float
        Part of the nodes that each sees at least.
    """

    examined: StandExamination
    least: float


def candidates(place: Place, count: int, rng: np.random.Generator) -> FeasiblePlaces:
    """Draw places that are feasible.

    Raises
    ------
    UserError
        If there is none; it says which limit forbids most.
    """
    found: StandExamination | None = None
    for _ in range(-(-MOST_TRIED * count // AT_ONCE)):
        origins = drawn(place, rng)
        # What refuses a stand however it is turned comes first: few see circles on two faces.
        some = examined(place, origins[place.allowed(origins) & ~place.too_oblique(origins)])
        some = some.take(some.share > 0)
        found = some if found is None else found.and_also(some)
        least = _least(place, found)
        good = np.flatnonzero(found.share >= least)
        if len(good) >= count:
            break
    assert found is not None
    if not len(good):
        raise UserError(_none_of(place, drawn(place, rng)))
    return FeasiblePlaces(found.take(good[:count]), least)


def _least(place: Place, found: StandExamination) -> float:
    """Say which part of the nodes a stand must see."""
    if place.room.seen is not None:
        return place.room.seen
    best = float(found.share.max(initial=0.0))
    return 1.0 if best == 1.0 or best == 0.0 else best / 2


def drawn(place: Place, rng: np.random.Generator) -> Array:
    """Draw places around the middle of the surface, on its side if it has one."""
    normal = place.frame[:, 2].mean(axis=0)
    sided = np.linalg.norm(normal) > ONE_SIDED and not place.both_sides
    cosine = rng.uniform(0.0 if sided else -1.0, 1.0, AT_ONCE)
    turn, sine = rng.uniform(0, 2 * np.pi, AT_ONCE), np.sqrt(1 - cosine**2)
    pole = normal / np.linalg.norm(normal) if sided else np.array([0.0, 0.0, 1.0])
    first = np.cross(pole, np.eye(3)[np.argmin(np.abs(pole))])
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(pole, first), pole])
    ball = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)
    nearest, farthest = place.room.for_new_stands().distance
    radius = rng.uniform(nearest, farthest, AT_ONCE)
    return np.asarray((place.middle + radius[:, None] * ball @ axes).round(DECIMALS))


def examined(place: Place, origins: Array, limits: StandLimits | None = None) -> StandExamination:
    """Turn upright instruments towards the object and examine what they see."""
    _, rotations = turned_towards(origins, place.to_be_seen, place.laser)
    return place.examine(origins, rotations, limits)


def _none_of(place: Place, origins: Array) -> str:
    """Say which limit forbids most of some places, and what would allow some."""
    _, rotations = turned_towards(origins, place.to_be_seen, place.laser)
    losses = place.losses(origins, rotations)
    forbids = {reason: lost.mean(axis=1) > HALF for reason, lost in losses.items()}
    forbids |= place.refusals(origins, rotations)
    counts = sorted(((int(out.sum()), reason) for reason, out in forbids.items()), reverse=True)
    (most, first), *others = counts
    more = ", ".join(f"{SETTING_OF[reason]} {times}" for times, reason in others[:2] if times)
    right = list(filter(None, (_behind_structure(place, origins), _wider(place, origins))))
    return (
        f"plan: no stand is feasible: {SETTING_OF[first]} forbids {most} of {len(origins)} places "
        f"({first.told}){f', {more}' if more else ''}; "
        f"{'; '.join(right) or 'widen that limit, or move the object'}"
    )


def _behind_structure(place: Place, origins: Array) -> str:
    """Say which circles the structure hides from the places that nothing else forbids, if any."""
    found = examined(place, origins)
    away = origins[found.refused == Unseen.target_behind_structure]
    if not len(away):
        return ""
    hidden = place.marks.hidden_by(place.structure, away).any(axis=0)
    circles = place.marks.circles
    names = "too many marks"
    if circles is not None:
        numbers = np.array(sorted(circles.circles))[hidden]
        names = " or ".join(f"circle {number}" for number in numbers)
    return (
        f"from {len(away)} more the structure hides {names} of the calibration object: move this "
        "towards the instrument, or away from the structure"
    )


def _wider(place: Place, origins: Array) -> str:
    """Say the least incidence that would allow some of the places, if any does."""

    def feasible(incidence: int) -> int:
        room = replace(place.room, incidence=float(incidence))
        found = examined(replace(place, room=room), origins)
        return int(((found.share > 0) & (found.share >= _least(place, found))).sum())

    low, high = int(place.room.incidence), int(OBLIQUE)
    if low >= high or not (most := feasible(high)):
        return ""
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if feasible(middle) >= min(SOME, most) else (middle, high)
    return (
        f"with plan.room.incidence={high} {feasible(high)} of them are feasible (circles are found "
        f"up to {OBLIQUE:g} deg)"
    )


def greedy(goal: Goal, looks: Array, count: int, begun: Array) -> list[int]:
    """Choose one candidate after the other, each the best with those before.

    Parameters
    ----------
    looks : ndarray, shape (candidate, node, 3)
    begun : ndarray, shape (stand, node, 3)
        Of stands that are there already.
    """
    chosen: list[int] = []
    for _ in range(count):
        covariance = covariance_of(np.concatenate([begun, looks[chosen]]))
        chosen.append(int(np.argmin(goal.with_one_more(covariance, looks))))
    return chosen


def exchange(goal: Goal, looks: Array, chosen: list[int], begun: Array) -> list[int]:
    """Exchange each stand for the best candidate with the others, while that helps (Fedorov)."""
    chosen = list(chosen)
    best, moved = goal.of(covariance_of(np.concatenate([begun, looks[chosen]]))), True
    while moved:
        moved = False
        for j in range(len(chosen)):
            others = chosen[:j] + chosen[j + 1 :]
            covariance = covariance_of(np.concatenate([begun, looks[others]]))
            values = goal.with_one_more(covariance, looks)
            k = int(np.argmin(values))
            if values[k] < best * (1 - BETTER):
                best, chosen[j], moved = float(values[k]), k, True
    return chosen


def move(
    goal: Goal,
    place: Place,
    stands: StandExamination,
    least: float,
    begun: Array,
    rng: np.random.Generator,
) -> StandExamination:
    """Move every stand in space while that helps and is feasible, by ever smaller steps."""
    (moved,) = move_in_rooms(goal, place, [place.room], stands, least, begun, [rng])
    return moved


def move_in_rooms(
    goal: Goal,
    place: Place,
    rooms: Sequence[PlanRoom],
    stands: StandExamination,
    least: float,
    begun: Array,
    rngs: Sequence[np.random.Generator],
) -> list[StandExamination]:
    """Move the same stands in each of several rooms, as `move` does.

    The searches know nothing of one another; what all of them try is examined together.
    """
    searches = [_moves(goal, stands, least, begun, rng) for rng in rngs]
    found: dict[int, StandExamination | None] = dict.fromkeys(range(len(rooms)))
    ended: dict[int, StandExamination] = {}
    while found:
        tried: dict[int, Array] = {}
        for k, examination in found.items():
            try:
                tried[k] = searches[k].send(examination)
            except StopIteration as end:
                ended[k] = end.value
        found = {**_examined_in_rooms(place, rooms, tried)} if tried else {}
    return [ended[k] for k in range(len(rooms))]


def _examined_in_rooms(
    place: Place, rooms: Sequence[PlanRoom], tried: Mapping[int, Array]
) -> dict[int, StandExamination]:
    """Examine those of the places tried in each room that it allows and circles are seen from."""
    of, counts = [rooms[k] for k in tried], [len(origins) for origins in tried.values()]
    every, limits = np.concatenate([*tried.values()]), StandLimits.from_rooms(of, counts)
    kept = place.allowed(every, limits) & ~place.too_oblique(every, limits)
    ends = np.cumsum(counts)
    counts = [int(part.sum()) for part in np.split(kept, ends[:-1])]
    found = examined(place, every[kept], StandLimits.from_rooms(of, counts))
    first = np.cumsum([0, *counts])
    return {k: found.take(np.arange(*first[i : i + 2])) for i, k in enumerate(tried)}


def _moves(
    goal: Goal, stands: StandExamination, least: float, begun: Array, rng: np.random.Generator
) -> Generator[Array, StandExamination | None, StandExamination]:
    """Yield places to try, take the examination of those that are allowed, return the stands."""
    best = goal.of(covariance_of(np.concatenate([begun, stands.looks])))
    step, count = FIRST_STEP, len(stands.origins)
    while step >= LAST_STEP:
        moved = False
        for j in range(count):
            others = np.arange(count) != j
            covariance = covariance_of(np.concatenate([begun, stands.looks[others]]))
            free = rng.standard_normal((OTHER_MOVES, 3)) / 2
            ways = step * np.concatenate([np.eye(3), -np.eye(3), free])
            found = yield (stands.origins[j] + ways).round(DECIMALS)
            assert found is not None
            values = goal.with_one_more(covariance, found.looks)
            values[found.share < least] = np.inf
            if len(values) and values.min() < best * (1 - BETTER):
                best, moved = float(values.min()), True
                one = found.take([int(values.argmin())])
                order = np.insert(np.arange(count - 1), j, count - 1)
                stands = stands.take(others).and_also(one).take(order)
        if not moved:
            step /= 2
    return stands


def layout(
    goal: Goal,
    place: Place,
    found: FeasiblePlaces,
    count: int,
    begun: Array,
    rng: np.random.Generator,
) -> StandExamination:
    """Find so many stands: greedy choice, exchanges, moves."""
    looks = found.examined.looks
    chosen = exchange(goal, looks, greedy(goal, looks, count, begun), begun)
    return move(goal, place, found.examined.take(chosen), found.least, begun, rng)
