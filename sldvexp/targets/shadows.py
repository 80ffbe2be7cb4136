"""Shadows of a calibration object's own circles: what stands at one depth hides what is behind.

A circle is a disc of its hole and of what rests around it. The beam from O to P meets the plane of
a disc around C with normal n at

    S = O + t (P - O),   t = n . (C - O) / n . (P - O),

and is stopped before it reaches P if 0 < t < 1 and S is within the disc. Lines that are scanned
across a circle go on beyond its edge; the hole of a circle at another depth that looks so near is
taken for it. The offset of the mirrors moves O by a few millimetres and is neglected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.targets.circles import Circles
from sldvexp.typing import Array, BoolArray

#: Width of what rests around each circle, m; blocks and boards are as wide at least.
REST = 0.01
#: Half of a line that is scanned across a circle, over the circle's half width.
SPAN = 1.5
#: Distance of t from 1 from which a plane is another one than the point's own.
APART = 1e-6


@dataclass(frozen=True, eq=False)
class Discs:
    """Circles as discs in space, in the order of the target's circles.

    Parameters
    ----------
    edges : ndarray, shape (circle, corner, 3), m
    centre : ndarray, shape (circle, 3), m
    normal : ndarray, shape (circle, 3)
    radius : ndarray, shape (circle,), m
    """

    edges: Array
    centre: Array
    normal: Array
    radius: Array

    @classmethod
    def from_circles(cls, target: Circles) -> Discs:
        """Lay the circles of a target out."""
        edges, circles = target.outlines(), target.circles.values()
        radius = np.array([c.diameter / 2 for c in circles]) * target.unit.value
        normal = {name: plane.axes()[2] for name, plane in target.planes.items()}
        return cls(edges, edges.mean(axis=1), np.array([normal[c.plane] for c in circles]), radius)


def hidden_behind_circles(origins: Array, points: Array, discs: Discs) -> BoolArray:
    """Tell which circles stand in the way from places of the instrument to points.

    Parameters
    ----------
    origins : ndarray, shape (stand, 3), m
    points : ndarray, shape (point, 3), m

    Returns
    -------
    ndarray of bool, shape (stand, point, circle)
    """
    t, beside = _met(origins, points, discs)
    return np.asarray((beside <= discs.radius + REST) & (t > 0) & (t < 1 - APART))


def circles_met(begin: Array, way: Array, target: Circles) -> Array:
    """Find how far along each beam it meets a circle from the front, m; infinite if it meets none.

    Parameters
    ----------
    begin : ndarray, shape (beam, 3), m
    way : ndarray, shape (beam, 3)
        Of length 1.

    Examples
    --------
    >>> from sldvexp.targets import Circle
    >>> one = Circles(circles={k: Circle(0.1 * k, 0, 0.04) for k in (1, 2, 3)})
    >>> begin = np.array([[0.1, 0.01, 1.0], [0.1, 0.03, 1.0]])
    >>> circles_met(begin, np.array([[0, 0, -1.0], [0, 0, -1.0]]), one)
    array([ 1., inf])
    """
    unit, found = target.unit.value, np.full(len(begin), np.inf)
    for circle in target.circles.values():
        plane = target.planes[circle.plane]
        axes = plane.axes()
        centre = unit * (np.array(plane.origin) + np.array([circle.x, circle.y]) @ axes[:2])
        towards = way @ axes[2]
        far = np.divide(
            (centre - begin) @ axes[2], towards, out=np.full(len(begin), np.inf), where=towards < 0
        )
        known = np.isfinite(far) & (far > 0)
        beside = np.linalg.norm(begin[known] + far[known, None] * way[known] - centre, axis=1)
        met = np.flatnonzero(known)[beside <= unit * circle.diameter / 2]
        found[met] = np.minimum(found[met], far[met])
    return found


def shaded(origins: Array, discs: Discs) -> BoolArray:
    """Tell which circles cannot be scanned from places, because of which others.

    Returns
    -------
    ndarray of bool, shape (stand, circle, other circle)
        The other hides a part of the circle, or looks as near to it as lines across it reach.
    """
    edges = discs.edges
    count, corners, _ = edges.shape
    middle = edges.mean(axis=1, keepdims=True)
    ends = middle + SPAN * (edges - middle)
    shape = (len(origins), count, corners, count)
    hidden = hidden_behind_circles(origins, edges.reshape(-1, 3), discs).reshape(shape)
    t, beside = _met(origins, ends.reshape(-1, 3), discs)
    own_rest = (SPAN - 1) * discs.radius <= REST  # a line that ends on it sees nothing behind
    seen = (t > 0) & (t < 1 - APART) | (t > 1 + APART) & ~np.repeat(own_rest, corners)[:, None]
    near = ((beside <= discs.radius) & seen).reshape(shape)
    return np.asarray((hidden | near).any(axis=2))


def shaded_circles(origin: Array, target: Circles) -> dict[int, list[int]]:
    """Find the circles that cannot be scanned from a place, because of which others.

    Returns
    -------
    dict of int to list of int
        Numbers of the circles in the way, by the number of the circle.

    Examples
    --------
    >>> from sldvexp.targets import Circle, Plane
    >>> planes = {"front": Plane(), "raised": Plane(origin=[0, 0, 0.1])}
    >>> circles = {n: Circle(x, 0, 0.04) for n, x in ((1, 0.0), (2, 0.3))}
    >>> step = Circles(circles=circles | {3: Circle(0.1, 0, 0.04, "raised")}, planes=planes)
    >>> shaded_circles(np.array([1.0, 0, 1.0]), step), shaded_circles(np.array([0.0, 0, 2]), step)
    ({1: [3]}, {})
    """
    numbers = np.array(list(target.circles))
    found = zip(numbers.tolist(), shaded(origin[None], Discs.from_circles(target))[0], strict=True)
    return {number: numbers[row].tolist() for number, row in found if row.any()}


def shade_told(number: int, others: list[int]) -> str:
    """Say that others are in the way of a circle."""
    return f"circle {number} is {_shade(others)}"


def _shade(others: list[int]) -> str:
    names = [f"circle {other}" for other in others]
    return f"hidden in part by {' and '.join(names)}, or looks too near to it, at another depth"


def turned_away(origin: Array, target: Circles) -> dict[int, str]:
    """Find the circles whose plane shows its back to a place: the planes by the circles' numbers.

    A circle is seen from the side that the normal of its plane points to.
    """
    found = {}
    for number, circle in target.circles.items():
        plane = target.planes[circle.plane]
        height = (origin - target.unit.value * np.array(plane.origin)) @ plane.axes()[2]
        if height <= 0:
            found[number] = circle.plane
    return found


def unseen_circles(origin: Array, target: Circles) -> dict[int, str]:
    """Say of the circles that are not seen from a place that, and why, by their numbers.

    Examples
    --------
    >>> from sldvexp.targets import Circle, Plane
    >>> planes = {"front": Plane(), "top": Plane(normal=[0, 1, 0])}
    >>> circles = {1: Circle(0, 0, 0.04), 2: Circle(0.1, 0, 0.04)}
    >>> box = Circles(circles=circles | {3: Circle(0.3, 0, 0.04, "top")}, planes=planes)
    >>> unseen_circles(np.array([0.0, 1.0, 1.0]), box)
    {}
    >>> unseen_circles(np.array([0.0, -1.0, 1.0]), box)
    {3: 'not seen from here: its plane top is turned away'}
    """
    shades = {
        number: f"not seen from here: {_shade(others)}"
        for number, others in shaded_circles(origin, target).items()
    }
    return shades | {
        number: f"not seen from here: its plane {plane} is turned away"
        for number, plane in turned_away(origin, target).items()
    }


def _met(origins: Array, points: Array, discs: Discs) -> tuple[Array, Array]:
    """Find where beams to points meet the planes of circles.

    Returns
    -------
    t, beside : ndarray, shape (stand, point, circle)
        Part of the way, and distance from the circle's middle, m.
    """
    centre, normal = discs.centre, discs.normal
    way = points[None] - origins[:, None]
    height = np.einsum("kj,skj->sk", normal, centre[None] - origins[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = height[:, None] / np.einsum("spj,kj->spk", way, normal)
        off = (origins[:, None, None] - centre) + t[..., None] * way[:, :, None]
    return t, np.linalg.norm(off, axis=-1)
