"""`target=circles`: circular features on one or several planes and their bitangent points."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sldvexp.config.registry import register
from sldvexp.errors import Checks, nearest
from sldvexp.geometry.circles import LINES
from sldvexp.targets.base import Target, TargetPoints, std_of_bound
from sldvexp.targets.bitangents import bitangents_in_space, bitangents_std
from sldvexp.targets.plane import Plane
from sldvexp.typing import Array
from sldvexp.units import LengthUnit

#: The first lines of a pair are the external ones; they carry the points of Figure 4.1.
EXTERNAL = 2

PAIR = re.compile(r"\s*(\d+)\s*-\s*(\d+)\s*")


@dataclass
class Circle:
    """One circular feature, in the target's unit and the axes of its plane."""

    x: float
    y: float
    diameter: float
    plane: str = "front"


@register("target", "circles")
@dataclass
class Circles(Target):
    """Circles measured with a coordinate measuring machine (Section 4.4.1).

    Parameters
    ----------
    unit : LengthUnit
        Unit of all lengths below.
    accuracy : float
        Bound +- within which the machine knows every coordinate and diameter.
    circles : dict of int to Circle
        By the circle's number.
    planes : dict of str to Plane
        Where the planes of the circles stand; ``front`` is z = 0.
    pairs : list of str
        Ordered pairs such as ``1-2`` whose external bitangent points are used, numbered in this
        order. Without it: on each plane every circle with the next by number, and where there
        are more than two also the last with the first, as in Figure 4.1.
    """

    unit: LengthUnit = LengthUnit.m
    accuracy: float = 0.0
    circles: dict[int, Circle] = field(default_factory=dict)
    planes: dict[str, Plane] = field(default_factory=lambda: {"front": Plane()})
    pairs: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.non_negative("accuracy", self.accuracy)
        for name, plane in self.planes.items():
            plane.check(checks, f"planes.{name}")
        for number, circle in self.circles.items():
            self._check_circle(checks, number, circle)
        for one, other in self._same_plane():
            self._check_apart(checks, one, other)
        self._check_pairs(checks)
        checks.done()
        checks.require(
            bool(self.selected_pairs()), "circles", "bitangents need two circles on one plane"
        )
        checks.done()

    def points(self) -> TargetPoints:
        """External bitangent points of the selected pairs, numbered as in Figure 4.1.

        Every pair a-b adds four: a left, a right, b left, b right, on the left and the right of
        the way from a to b.
        """
        position, std, label = self._bitangents(self.selected_pairs())
        position, std = (v[:, :EXTERNAL].swapaxes(1, 2) for v in (position, std))
        return _numbered(position, std, label[:, :EXTERNAL].swapaxes(1, 2))

    def all_bitangents(self) -> TargetPoints:
        """All bitangent points of all pairs on a common plane: 48 for four circles (Section 4.5.2).

        Numbered from 1; pairs by circle number, lines in the order of
        `sldvexp.geometry.circles.LINES`, on each line first the point on the first circle.
        """
        return _numbered(*self._bitangents(self._same_plane()))

    def selected_pairs(self) -> list[tuple[int, int]]:
        """The pairs whose points are used, in the order of the points' numbers."""
        if self.pairs:
            return [(int(m[1]), int(m[2])) for p in self.pairs if (m := PAIR.fullmatch(p))]
        rings: list[tuple[int, int]] = []
        for members in self._by_plane().values():
            rings += itertools.pairwise(members)
            rings += [(members[-1], members[0])] if len(members) > 2 else []
        return rings

    def _by_plane(self) -> dict[str, list[int]]:
        members: dict[str, list[int]] = {}
        for number in sorted(self.circles):
            members.setdefault(self.circles[number].plane, []).append(number)
        return members

    def _same_plane(self) -> list[tuple[int, int]]:
        planes = self._by_plane().values()
        return [pair for members in planes for pair in itertools.combinations(members, 2)]

    def _check_circle(self, checks: Checks, number: int, circle: Circle) -> None:
        name = f"circles.{number}"
        checks.finite(f"{name}.x", circle.x)
        checks.finite(f"{name}.y", circle.y)
        checks.positive(f"{name}.diameter", circle.diameter)
        checks.require(
            circle.plane in self.planes,
            f"{name}.plane",
            f"there is no plane {circle.plane}; {nearest(circle.plane, self.planes)}",
        )

    def _check_apart(self, checks: Checks, one: int, other: int) -> None:
        a, b = self.circles[one], self.circles[other]
        distance = math.dist((a.x, a.y), (b.x, b.y))
        if distance > (a.diameter + b.diameter) / 2 or not math.isfinite(distance):
            return
        nested = distance <= abs(a.diameter - b.diameter) / 2
        how = "lie one inside the other" if nested else "overlap"
        checks.require(
            False,
            "circles",
            f"circles {one} and {other} {how}: their centers are {distance:.6g} "
            f"{self.unit.name} apart, which must be more than the sum of their radii",
        )

    def _check_pairs(self, checks: Checks) -> None:
        seen: set[frozenset[int]] = set()
        for i, pair in enumerate(self.pairs):
            match = PAIR.fullmatch(pair)
            numbers = [int(n) for n in match.groups()] if match else []
            unknown = [n for n in numbers if n not in self.circles]
            planes = {self.circles[n].plane for n in numbers if n in self.circles}
            message = ""
            if not match:
                message = f"must be two circle numbers such as 1-2, not {pair!r}"
            elif unknown:
                valid = ", ".join(str(n) for n in sorted(self.circles))
                message = f"{pair} names circle {unknown[0]}; there are {valid or 'none'}"
            elif numbers[0] == numbers[1]:
                message = f"{pair} pairs a circle with itself"
            elif len(planes) > 1:
                message = f"{pair} pairs circles of different planes, which have no bitangents"
            elif frozenset(numbers) in seen:
                message = f"{pair} is listed twice; its points would be counted twice"
            checks.require(not message, f"pairs[{i}]", message)
            seen.add(frozenset(numbers))

    def _bitangents(self, pairs: list[tuple[int, int]]) -> tuple[Array, Array, NDArray[np.str_]]:
        """Positions, standard deviations and labels, each of shape (pair, line, circle[, 3]), m."""
        a, b = (np.array([self._numbers(pair[side]) for pair in pairs]) for side in (0, 1))
        planes = [self.planes[self.circles[one].plane] for one, _ in pairs]
        origin = np.array([plane.origin for plane in planes])
        axes = np.stack([plane.axes() for plane in planes])
        position = bitangents_in_space(a, b, origin, axes)
        std = bitangents_std(a, b, axes, std_of_bound(self.accuracy))
        label = [
            [[f"circle {n} of pair {one}-{other}, {line}" for n in (one, other)] for line in LINES]
            for one, other in pairs
        ]
        return self.unit.value * position, self.unit.value * std, np.array(label)

    def _numbers(self, number: int) -> list[float]:
        circle = self.circles[number]
        return [circle.x, circle.y, circle.diameter / 2]


def _numbered(position: Array, std: Array, label: NDArray[np.str_]) -> TargetPoints:
    """Number points from 1 in the order in which they stand."""
    return TargetPoints(
        number=np.arange(1, label.size + 1),
        position=position.reshape(-1, 3),
        std=std.reshape(-1, 3),
        label=tuple(label.ravel().tolist()),
    )
