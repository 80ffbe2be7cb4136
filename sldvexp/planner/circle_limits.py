"""Sentences on stands that the calibration object limits: circles too oblique, circles hidden.

Circles on two faces of a box are seen together from a few places only, each at an angle that a
plate alone would not ask for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sldvexp.planner.images import Stand
from sldvexp.planner.place import OBLIQUE, Place, Unseen
from sldvexp.planner.search import drawn
from sldvexp.planner.turning import turned_towards
from sldvexp.typing import Array, BoolArray

#: Part of the places of otherwise good stands that circles cost, from which that is said.
MANY = 0.5


def around(place: Place, rng: np.random.Generator) -> str:
    """Say `oblique_told` of places that are drawn all around the surface."""
    return oblique_told(place, drawn(place, rng))


def oblique_told(place: Place, origins: Array) -> str:
    """Say that circles limit where stands can be, and what would change that; empty if not so.

    Parameters
    ----------
    origins : ndarray, shape (stand, 3), m
        Places all around the surface.
    """
    limit = place.room.incidence
    if place.marks.circles is None or limit >= OBLIQUE or not len(origins):
        return ""
    wider = replace(place, room=replace(place.room, incidence=OBLIQUE))
    without = _good(wider, origins, but=Unseen.target_incidence)
    now, then = _good(place, origins) & without, _good(wider, origins)
    if now.sum() >= (1 - MANY) * then.sum() or not then.any():
        return ""
    return (
        f"the circles of the calibration object limit the stands: of {len(origins)} places that "
        f"were tried {now.sum()} see all of them within plan.room.incidence={limit:g} deg, and "
        f"{then.sum()} within {OBLIQUE:g} deg, at which a spot that is small beside the circles "
        "still finds them (one of a waist of 2 mm needs coarse.lines=9 of the scan of circles, and "
        f"may miss some all the same): try plan.room.incidence={OBLIQUE:g}"
    )


def _good(place: Place, origins: Array, but: Unseen = Unseen.seen) -> BoolArray:
    """Tell which places see the surface and the calibration object, one reason left out."""
    _, rotations = turned_towards(origins, place.to_be_seen, place.laser)
    refusals = place.refusals(origins, rotations)
    out = np.any([refused for reason, refused in refusals.items() if reason != but], axis=0)
    lost = np.any(list(place.losses(origins, rotations).values()), axis=0).all(axis=1)
    return np.asarray(~out & ~lost)


def hidden_told(stands: Sequence[Stand], place: Place) -> Iterator[str]:
    """Yield a sentence for each stand from which the structure itself hides circles."""
    circles = place.marks.circles
    if circles is None or not stands:
        return
    origins = np.array([stand.origin for stand in stands])
    numbers = np.array(sorted(circles.circles))
    for stand, row in zip(stands, place.marks.hidden_by(place.structure, origins), strict=True):
        if row.any():
            names = " and ".join(f"circle {number}" for number in numbers[row])
            yield (
                f"stand {stand.name}: the structure hides {names} of the calibration object, or a "
                "part of what rests around it; move the object forward, or keep that place out by "
                "plan.room.low, plan.room.high or plan.room.forbidden"
            )
