"""Settings of where to stand: how many places, what they should be best for, and the room."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Self

from sldvexp.errors import Checks
from sldvexp.units import LengthUnit, VelocityUnit, beyond_belief

#: Noise of a vibrometer that is one of another unit, m/s r.m.s.
LOUDEST = 1.0
#: Incidence below which radians are meant.
IN_RADIANS = 2.0
#: Fewer stands do not determine a vector; more are no matter of planning.
FEWEST_STANDS, MOST_STANDS = 3, 8
#: Room in which stands are looked for where nothing is said of it, m: an instrument on a tripod,
#: the zero of the world at the height of a table.
USUAL_DISTANCE = (1.2, 2.5)
USUAL_LOW, USUAL_HIGH = (None, -0.9, None), (None, 1.1, None)
#: Names of what bounds can be wanted of; a direction is three numbers.
WANTED_OF = ("all", "in_plane", "x", "y", "z", "t1", "t2", "n")


class PlanCriterion(Enum):
    """Bound that stands make small.

    Attributes
    ----------
    mean
        Root mean square over the surface's nodes and the components asked for.
    worst
        The largest of any node and any of these components.
    """

    mean = "mean"
    worst = "worst"


@dataclass
class ForbiddenBox:
    """Part of the room where the instrument cannot stand.

    Parameters
    ----------
    low, high : list of 3 float, m
        Opposite corners, in the world.
    beams : bool
        Whether beams may pass through it, as over a table; a pillar stops them.
    """

    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)
    beams: bool = False

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is no box."""
        for key in ("low", "high"):
            values = getattr(self, key)
            message = f"must be three numbers, not {len(values)}"
            checks.require(len(values) == 3, f"{name}.{key}", message)
            checks.finite(f"{name}.{key}", *values)
        if len(self.low) == len(self.high) == 3:
            message = f"must be above low, {self.low}, in x, y and z, not {self.high}"
            above = all(a < b for a, b in zip(self.low, self.high, strict=True))
            checks.require(above, f"{name}.high", message)


@dataclass
class PlanRoom:
    """Room around the object, and the instrument's limits.

    Parameters
    ----------
    distance : list of 2 float, m, optional
        Nearest and farthest that any node of the surface may be from the instrument. Without it
        stands are looked for from 1.2 to 2.5 m, and those that are given may be anywhere.
    low, high : list of 3 float or null, m, optional
        Opposite corners, in the world, of where the instrument can stand; null is no limit. The
        world's y is up. Without them stands are looked for from 0.9 m below to 1.1 m above the
        world's zero, and those that are given may be anywhere.
    forbidden : dict of str to ForbiddenBox
    incidence : float, deg
        Largest angle between a beam and the normal of the surface, or of a plane of circles.
    mirrors : float
        Part of the range of the mirrors that beams to the surface and to the calibration object
        may use; 0.96 is 24 of 25 deg.
    seen : float, optional
        Part of the surface's nodes that every stand must see. Without it all of them, or, if no
        stand sees the whole object, half of what the best one sees.
    """

    distance: list[float] = field(default_factory=list)
    low: list[float | None] = field(default_factory=list)
    high: list[float | None] = field(default_factory=list)
    forbidden: dict[str, ForbiddenBox] = field(default_factory=dict)
    incidence: float = 60.0
    mirrors: float = 0.96
    seen: float | None = None

    def for_new_stands(self) -> Self:
        """Give the usual limits where nothing is said, for stands that are looked for."""
        return replace(
            self,
            distance=self.distance or list(USUAL_DISTANCE),
            low=self.low or list(USUAL_LOW),
            high=self.high or list(USUAL_HIGH),
        )

    @property
    def unsaid(self) -> list[str]:
        """Limits that are not said."""
        return [key for key in ("low", "high", "distance") if not getattr(self, key)]

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no room can be."""
        for key in ("distance", "low", "high"):
            told = beyond_belief(LengthUnit.m, *(v for v in getattr(self, key) if v is not None))
            checks.require(not told, f"{name}.{key}", f"{told} (plan.room is in m)")
        pair = len(self.distance) == 2 and 0 < self.distance[0] < self.distance[1] < math.inf
        message = f"must be a nearest and a larger farthest distance, m, not {self.distance}"
        checks.require(pair or not self.distance, f"{name}.distance", message)
        for key in ("low", "high"):
            values = getattr(self, key)
            message = f"must be three numbers or null, not {len(values)}"
            checks.require(len(values) in (0, 3), f"{name}.{key}", message)
            checks.finite(f"{name}.{key}", *(v for v in values if v is not None))
        if len(self.low) == len(self.high) == 3:
            for axis, a, b in zip("xyz", self.low, self.high, strict=True):
                message = f"must be above low, {a} m, along {axis}, not {b}"
                checks.require(a is None or b is None or a < b, f"{name}.high", message)
        for key, box in self.forbidden.items():
            box.check(checks, f"{name}.forbidden.{key}")
        message = f"must lie between 0 and 90 deg, not {self.incidence}"
        checks.require(0 < self.incidence < 90, f"{name}.incidence", message)
        degrees = math.degrees(self.incidence)
        message = (
            f"is in deg, and {self.incidence:g} deg leaves no stand: {degrees:.3g} if rad are meant"
        )
        checks.require(not 0 < self.incidence < IN_RADIANS, f"{name}.incidence", message)
        message = f"must be above 0 and at most 1, not {self.mirrors}"
        checks.require(0 < self.mirrors <= 1, f"{name}.mirrors", message)
        message = f"must be above 0 and at most 1, not {self.seen}"
        checks.require(self.seen is None or 0 < self.seen <= 1, f"{name}.seen", message)


@dataclass
class PlanSettings:
    """What ``sldvexp plan`` looks for. A run does not use them.

    Parameters
    ----------
    stands : int
        From 3 to 8.
    criterion : PlanCriterion
    of : str or list of 3 float
        What the bounds are of: all components, ``in_plane`` (along the surface), ``x``, ``y`` or
        ``z`` of the world, ``t1``, ``t2`` or ``n`` of the surface, or a direction in the world.
    gage : list of 2 lists of 3 float, m
        Instead of `of`: ends of a strain gage on the surface, in the world. The bounds are then of
        the velocities at its ends along it, and of the strain between them.
    unit : VelocityUnit
        Of `wanted` and `noise`.
    wanted : float, optional
        Bound that is to be reached, in `unit`, at the level of the reconstruction; then as many
        stands are planned as it needs, whatever `stands` says.
    noise : float, optional
        Root mean square of the vibrometer's noise before a sine is fitted, in `unit`. Without it
        that of the images of the run that is gone on with, of the virtual lab, or 0.5 % of 0.1 m/s.
    drop_out : float, optional
        Part of the pixels that speckle will cost. Without it that of the virtual lab, or 0.002.
    pixels : list of 2 int
        Rows and columns of each image; without them those of ``scan``, or 41 by 41.
    candidates : int
        Places that are compared before the best are moved.
    room : PlanRoom
    """

    stands: int = 5
    criterion: PlanCriterion = PlanCriterion.mean
    of: Any = "all"
    gage: list[Any] = field(default_factory=list)
    unit: VelocityUnit = VelocityUnit.m_per_s
    wanted: float | None = None
    noise: float | None = None
    drop_out: float | None = None
    pixels: list[int] = field(default_factory=list)
    candidates: int = 1500
    room: PlanRoom = field(default_factory=PlanRoom)

    def __post_init__(self) -> None:
        checks = Checks()
        message = f"must be from {FEWEST_STANDS} to {MOST_STANDS}, not {self.stands}"
        few = ": fewer views do not determine a velocity vector"
        message += few if self.stands < FEWEST_STANDS else ""
        checks.require(FEWEST_STANDS <= self.stands <= MOST_STANDS, "stands", message)
        self._check_of(checks)
        message = f"must be two ends, [[x, y, z], [x, y, z]], not {self.gage}"
        ends = all(isinstance(end, list) and _is_vector(end) for end in self.gage)
        checks.require(len(self.gage) in (0, 2) and ends, "gage", message)
        for key in ("wanted", "noise"):
            value = getattr(self, key)
            if value is not None:
                checks.positive(key, value)
        noise = self.in_si("noise") or 0.0
        message = f"is {noise:g} m/s, more than vibrometers measure at all: is plan.unit right?"
        checks.require(not noise >= LOUDEST, "noise", message)
        lost = self.drop_out or 0.0
        checks.require(0 <= lost < 1, "drop_out", f"must be from 0 to below 1, not {lost}")
        message = f"must be rows and columns, each 2 or more, not {self.pixels}"
        good = len(self.pixels) in (0, 2) and all(n >= 2 for n in self.pixels)
        checks.require(good, "pixels", message)
        message = f"must be from 50 to 20000, not {self.candidates}"
        checks.require(50 <= self.candidates <= 20000, "candidates", message)
        self.room.check(checks, "room")
        checks.done()

    def in_si(self, key: str) -> float | None:
        """Give ``wanted`` or ``noise`` in m/s, None if it is not said."""
        value = getattr(self, key)
        return None if value is None else float(value * self.unit.value)

    def _check_of(self, checks: Checks) -> None:
        """Refuse what is neither a name nor a direction."""
        named = isinstance(self.of, str) and self.of in WANTED_OF
        vector = isinstance(self.of, list) and _is_vector(self.of) and any(self.of)
        message = f"must be one of {', '.join(WANTED_OF)}, or a direction [x, y, z], not {self.of}"
        checks.require(named or vector, "of", message)


def _is_vector(values: list[Any]) -> bool:
    """Tell whether these are three finite numbers."""
    numbers = all(isinstance(v, int | float) and math.isfinite(v) for v in values)
    return numbers and len(values) == 3
