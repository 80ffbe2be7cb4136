"""Sentences on stands that the calibration object limits: circles too oblique, circles hidden.

Circles on two faces of a box are seen together from a few places only, each at an angle that a
plate alone would not ask for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sldvexp.planner.images import Stand
from sldvexp.planner.place import OBLIQUE, Place
from sldvexp.planner.search import drawn, examined
from sldvexp.typing import Array

#: Part of the places that see oblique circles: if fewer see them all less obliquely, that is said.
MANY = 0.5


def around(place: Place, rng: np.random.Generator) -> str:
    """Say that circles limit where stands can be, and what would change that; empty if not so.

    That is tried at places which are drawn all around the surface.
    """
    limit = place.room.incidence
    if place.marks.circles is None or limit >= OBLIQUE:
        return ""
    origins = drawn(place, rng)
    now = _feasible(place, origins)
    then = _feasible(replace(place, room=replace(place.room, incidence=OBLIQUE)), origins)
    if now >= MANY * then:
        return ""
    return (
        f"the circles of the calibration object limit the stands: of {len(origins)} places that "
        f"were tried {now} see all of them within plan.room.incidence={limit:g} deg, and {then} "
        f"within {OBLIQUE:g} deg, at which a spot that is small beside the circles still finds "
        "them (one of a waist of 2 mm needs coarse.lines=9 of the scan of circles, and may miss "
        "some all the same)"
    )


def _feasible(place: Place, origins: Array) -> int:
    """Count the places that see something of the surface, and the calibration object."""
    found = examined(place, origins)
    return int((found.share > 0).sum())


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
