"""`target=circles`: circular features on one or several planes and their bitangent points.

Circles are measured in the axes of their plane. The four common tangents of two circles on a plane
touch each of them at four points, which a scanner sees well defined although the circles have no
marks (Section 4.4.1). Errors of the circles' numbers move these points to first order,
``C_point = J C_circle J'``; an error of the height above the plane moves them along its normal.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.config.registry import register
from sldvexp.errors import Checks, nearest
from sldvexp.geometry.circles import LINES, bitangent_jacobian, bitangent_points
from sldvexp.targets.base import Target, TargetPoints, std_of_bound
from sldvexp.typing import Array
from sldvexp.units import FARTHEST, LengthUnit, beyond_belief

#: The first lines of a pair are the external ones; they carry the points of Figure 4.1.
EXTERNAL = 2

PAIR = re.compile(r"\s*(\d+)\s*-\s*(\d+)\s*")
#: Sine of the angle between a normal and the object's x axis below which x has no projection.
PARALLEL = 1e-6
#: Diameter above which the unit of a circle's numbers is another one, m.
WIDEST = 10.0


@dataclass
class Circle:
    """One circular feature, in the target's unit and the axes of its plane."""

    x: float
    y: float
    diameter: float
    plane: str = "front"


@dataclass
class Plane:
    """A plane of features, by a point on it and its normal.

    The plane's own x axis is the projection of the object's x axis, its y axis completes the
    right-handed frame with the normal. A plane facing the viewer has its normal towards them.

    Parameters
    ----------
    origin : list of 3 float, the target's unit
        Where the plane's own coordinates are zero.
    normal : list of 3 float
        Of any length but zero.
    """

    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    normal: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what makes this no plane."""
        known = len(checks.problems)
        for part in ("origin", "normal"):
            values = getattr(self, part)
            checks.finite(f"{name}.{part}", *values)
            checks.require(
                len(values) == 3, f"{name}.{part}", f"must be three numbers, not {len(values)}"
            )
        if len(checks.problems) > known:
            return
        x, y, z = self.normal
        length = math.hypot(x, y, z)
        checks.require(length > 0, f"{name}.normal", "must not be zero")
        checks.require(
            length == 0 or math.hypot(y, z) > PARALLEL * length,
            f"{name}.normal",
            "must not be along the object's x axis, whose projection is the plane's own x axis",
        )

    def axes(self) -> Array:
        """Give the plane's own x, y and normal as unit rows in the object's axes, shape (3, 3)."""
        normal = np.array(self.normal, float)
        normal /= np.linalg.norm(normal)
        x = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(normal, x), normal])


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
        for one, other in self.all_pairs():
            self._check_apart(checks, one, other)
        self._check_pairs(checks)
        self._check_unit(checks)
        checks.done()
        checks.require(
            bool(self.selected_pairs()), "circles", "bitangents need two circles on one plane"
        )
        checks.done()

    def outlines(self, corners: int = 16) -> Array:
        """Give points around the edge of each circle, in the order of `circles`.

        Returns
        -------
        ndarray, shape (circle, corner, 3), m
            Evenly spaced; their mean is the circle's centre.
        """
        angle = 2 * np.pi * np.arange(corners) / corners
        around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        found = []
        for circle in self.circles.values():
            plane = self.planes[circle.plane]
            flat = [circle.x, circle.y] + circle.diameter / 2 * around
            found.append(plane.origin + flat @ plane.axes()[:2])
        return self.unit.value * np.array(found)

    def points(self) -> TargetPoints:
        """Give the external bitangent points of the selected pairs, numbered as in Figure 4.1.

        Every pair a-b adds four: a left, a right, b left, b right, on the left and the right of
        the way from a to b.
        """
        position, std, label = self._bitangents(self.selected_pairs())
        position, std = (v[:, :EXTERNAL].swapaxes(1, 2) for v in (position, std))
        return _numbered(position, std, label[:, :EXTERNAL].swapaxes(1, 2))

    def all_bitangents(self) -> TargetPoints:
        """Give all bitangent points of all pairs on a common plane: 48 for four circles.

        Numbered from 1 (Section 4.5.2); pairs by circle number, lines in the order of
        `sldvexp.geometry.circles.LINES`, on each line first the point on the first circle.
        """
        return _numbered(*self._bitangents(self.all_pairs()))

    def selected_pairs(self) -> list[tuple[int, int]]:
        """List the pairs whose points are used, in the order of the points' numbers."""
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

    def all_pairs(self) -> list[tuple[int, int]]:
        """List every pair on a common plane, in the order of `all_bitangents`."""
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

    def _check_unit(self, checks: Checks) -> None:
        """Note the first number that is of another unit; others are of that one too."""
        for number, circle in self.circles.items():
            for key, most in (("x", FARTHEST), ("y", FARTHEST), ("diameter", WIDEST)):
                if told := beyond_belief(self.unit, getattr(circle, key), most=most):
                    checks.require(False, f"circles.{number}.{key}", told)
                    return

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
        """Give positions, standard deviations and labels, shape (pair, line, circle[, 3]), m."""
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
    """Give points numbers from 1 in the order in which they stand."""
    return TargetPoints(
        number=np.arange(1, label.size + 1),
        position=position.reshape(-1, 3),
        std=std.reshape(-1, 3),
        label=tuple(label.ravel().tolist()),
    )


def bitangents_in_space(a: ArrayLike, b: ArrayLike, origin: ArrayLike, axes: ArrayLike) -> Array:
    """Place the bitangent points of pairs of circles, each pair on a plane of its own.

    Parameters
    ----------
    a, b : array_like, shape (pair, 3)
        x, y and radius of each circle on its plane, one unit.
    origin : array_like, shape (pair, 3), the same unit
        Zero of the plane's own axes.
    axes : array_like, shape (pair, 3, 3)
        The plane's own x, y and normal as unit rows.

    Returns
    -------
    ndarray, shape (pair, line, circle, 3), the same unit
        Lines in the order of `sldvexp.geometry.circles.LINES`.
    """
    flat = bitangent_points(a, b)
    in_plane = np.asarray(axes, float)[:, None, None, :2, :]
    return np.asarray(origin, float)[:, None, None] + np.einsum("...i,...ij->...j", flat, in_plane)


def bitangents_std(a: ArrayLike, b: ArrayLike, axes: ArrayLike, std: float) -> Array:
    """Give the standard deviations of `bitangents_in_space`, to first order.

    Parameters
    ----------
    a, b : array_like, shape (pair, 3)
        x, y and radius of each circle on its plane, one unit.
    axes : array_like, shape (pair, 3, 3)
        The plane's own x, y and normal as unit rows.
    std : float, the same unit
        Of every center coordinate and diameter, and of the height above the plane; independent.

    Returns
    -------
    ndarray, shape (pair, line, circle, 3), the same unit
        Along the object's axes.
    """
    jacobian = bitangent_jacobian(a, b)
    circle_variance = std**2 * np.array([1.0, 1.0, 0.25, 1.0, 1.0, 0.25])  # radius: diameter / 2
    covariance = np.zeros((*jacobian.shape[:-2], 3, 3))
    covariance[..., :2, :2] = np.einsum("...ik,k,...jk->...ij", jacobian, circle_variance, jacobian)
    covariance[..., 2, 2] = std**2
    turned = np.asarray(axes, float)[:, None, None]
    return np.sqrt(np.einsum("...ki,...kl,...li->...i", turned, covariance, turned))
