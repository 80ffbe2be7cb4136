"""`volume=outline`: a surface of any outline, with holes, given by corners and circles.

The outline is followed by nodes no farther than `spacing` from one another, the inside filled with
nodes of a grid of equilateral triangles that keep away from it; Delaunay's triangulation of all
then has every side of the outline as an edge, and triangles outside are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IntArray
from sldvexp.volume.base import Volume, vector
from sldvexp.volume.grid import cylinder
from sldvexp.volume.surface import TriangulatedSurface

#: Distance of inner nodes from the outline, over the spacing: a side's own circle, half of it,
#: holds no other node then.
AWAY = 0.7
#: Nodes at least around a circle.
ROUND = 32
#: Nodes beyond which a spacing is taken for a mistake.
MANY = 50_000


@dataclass
class Contour:
    """A closed line: a polygon, or a circle.

    Parameters
    ----------
    corners : list of list of 2 float, the volume's unit
        Of a polygon, around it in either sense; the last is joined to the first.
    center : list of 2 float, the volume's unit
        Of a circle.
    radius : float, optional
        Of a circle, instead of corners.
    """

    corners: list[list[float]] = field(default_factory=list)
    center: list[float] = field(default_factory=lambda: [0.0, 0.0])
    radius: float | None = None

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no closed line can be."""
        if self.radius is not None:
            checks.positive(f"{name}.radius", self.radius)
            vector(checks, f"{name}.center", self.center, 2)
            checks.require(not self.corners, name, "has corners and a radius: give one of them")
            return
        message = f"needs 3 corners or more, or the radius of a circle, not {len(self.corners)}"
        checks.require(len(self.corners) >= 3, name, message)
        for i, corner in enumerate(self.corners):
            vector(checks, f"{name}.corners[{i}]", corner, 2)

    def nodes(self, spacing: float) -> Array:
        """Place nodes along it, no farther apart than so, shape (node, 2), in its unit.

        Examples
        --------
        >>> Contour([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]).nodes(0.5).tolist()[:3]
        [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]
        """
        if self.radius is not None:
            count = max(ROUND, math.ceil(2 * math.pi * self.radius / spacing))
            angle = 2 * np.pi * np.arange(count) / count
            circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            return np.asarray(self.center + self.radius * circle)
        corner = np.array(self.corners, float)
        sides = []
        for a, b in zip(corner, np.roll(corner, -1, axis=0), strict=True):
            count = max(math.ceil(np.linalg.norm(b - a) / spacing * (1 - 1e-9)), 1)
            sides.append(a + (b - a) * (np.arange(count) / count)[:, None])
        return np.concatenate(sides)


@register("volume", "outline")
@dataclass
class OutlinedSurface(Volume):
    """A plane or a cylinder's panel within an outline, without holes; zero stands at `center`.

    Parameters
    ----------
    outline : Contour
        Along the surface's own x (the arc, if it is curved) and y.
    holes : dict of str to Contour
        Parts inside of the outline that the structure does not have.
    spacing : float
        Between neighbouring nodes.
    radius : float, optional
        Of a cylinder about the line x = 0, z = -radius; negative where the normals point towards
        that axis. Without it the surface is flat.
    """

    outline: Contour = field(default_factory=Contour)
    holes: dict[str, Contour] = field(default_factory=dict)
    spacing: float = 0.008
    radius: float | None = None

    def check(self, checks: Checks) -> None:
        """Note what no outline can be."""
        known = len(checks.problems)
        checks.positive("spacing", self.spacing)
        self.outline.check(checks, "outline")
        for name, hole in self.holes.items():
            hole.check(checks, f"holes.{name}")
        if len(checks.problems) > known:
            return
        self._check_size(checks)
        if len(checks.problems) == known:
            self._check_lines(checks)

    def surface(self) -> TriangulatedSurface:
        """Triangulate the inside of the outline.

        Raises
        ------
        UserError
            If nodes are too far apart for the outline's corners.
        """
        loops = self._loops()
        rim = np.concatenate(loops)
        grid = _triangular_grid(loops[0].min(axis=0), loops[0].max(axis=0), self.spacing)
        inner = grid[_inside(grid, loops) & (_distance(grid, loops) > AWAY * self.spacing)]
        flat = np.concatenate([rim, inner])
        triangles = scipy.spatial.Delaunay(flat).simplices.astype(np.int64)
        triangles = triangles[_inside(flat[triangles].mean(axis=1), loops)]
        self._check_sides(loops, triangles)
        a, b, c = np.moveaxis(flat[triangles], 1, 0)
        clockwise = _cross(b - a, c - a) < 0
        triangles[clockwise] = triangles[clockwise][:, ::-1]
        unit = self.unit.value
        position = unit * np.column_stack([flat, np.zeros(len(flat))])
        normal = np.broadcast_to([0.0, 0.0, 1.0], position.shape)
        plane = TriangulatedSurface(position, triangles, normal)
        return plane if self.radius is None else cylinder(plane, unit * self.radius)

    def _loops(self) -> list[Array]:
        """Place nodes along the outline and along each hole, in the volume's unit."""
        return [line.nodes(self.spacing) for line in (self.outline, *self.holes.values())]

    def _check_size(self, checks: Checks) -> None:
        corners = self.outline.nodes(np.inf)
        width, height = np.ptp(corners, axis=0)
        most = math.sqrt(max(width, 1e-300) * max(height, 1e-300) / MANY)
        message = (
            f"must be {most:.2g} {self.unit.name} or more, or there are more than {MANY} nodes, "
            f"and below half the outline's width, not {self.spacing}"
        )
        checks.require(most <= self.spacing <= min(width, height) / 2, "spacing", message)
        if self.radius is not None:
            reach = float(np.abs(corners[:, 0]).max()) / math.pi
            message = (
                f"must be finite and beyond +-{reach:.6g} {self.unit.name}, where the panel closes "
                f"to a tube, not {self.radius}; null is flat"
            )
            fits = math.isfinite(self.radius) and abs(self.radius) > reach
            checks.require(fits, "radius", message)

    def _check_lines(self, checks: Checks) -> None:
        """Refuse lines that cross themselves or one another, and holes outside."""
        loops, names = self._loops(), ["outline", *(f"holes.{name}" for name in self.holes)]
        for i, (name, loop) in enumerate(zip(names, loops, strict=True)):
            if (crossing := _first_crossing(loop, loop)) is not None:
                x, y = crossing
                message = f"crosses itself at [{x:.4g}, {y:.4g}] {self.unit.name}"
                checks.require(False, name, f"{message}; give its corners in order around it")
            for other, before in zip(names[:i], loops[:i], strict=True):
                meets = _first_crossing(loop, before) is not None
                checks.require(not meets, name, f"crosses {other}")
            if i and not _inside(loop[:1], [loops[0]])[0]:
                checks.require(False, name, "lies outside of the outline")

    def _check_sides(self, loops: list[Array], triangles: IntArray) -> None:
        """Refuse a triangulation that cuts across the outline."""
        rim = np.concatenate(loops)
        start = np.cumsum([0, *(len(loop) for loop in loops[:-1])])
        number = np.arange(len(rim))
        runs = zip(start, loops, strict=True)
        following = np.concatenate([low + np.roll(np.arange(len(loop)), -1) for low, loop in runs])
        edges = {
            frozenset(pair)
            for pair in zip(
                triangles.ravel().tolist(),
                np.roll(triangles, -1, axis=1).ravel().tolist(),
                strict=True,
            )
        }
        for i, j in zip(number.tolist(), following.tolist(), strict=True):
            if frozenset((i, j)) not in edges:
                x, y = rim[i]
                raise UserError(
                    f"volume.spacing: nodes {self.spacing:g} {self.unit.name} apart cannot follow "
                    f"the outline at [{x:.4g}, {y:.4g}]; choose a smaller spacing"
                )


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _triangular_grid(low: Array, high: Array, spacing: float) -> Array:
    """Fill a rectangle with the corners of equilateral triangles, shape (node, 2)."""
    rows = np.arange(low[1], high[1] + spacing, spacing * math.sqrt(3) / 2)
    along = np.arange(low[0] - spacing, high[0] + spacing, spacing)
    x, y = np.meshgrid(along, rows)
    x[::2] += spacing / 2
    return np.column_stack([x.ravel(), y.ravel()])


def _inside(points: Array, loops: list[Array]) -> BoolArray:
    """Tell which points a ray to the right leaves across an odd number of lines, shape (point,)."""
    odd = np.zeros(len(points), bool)
    x, y = points.T
    for loop in loops:
        for (ax, ay), (bx, by) in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            if ay == by:
                continue
            across = (ay > y) != (by > y)
            odd ^= across & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    return odd


def _distance(points: Array, loops: list[Array]) -> Array:
    """Compute the distance of points from the nearest line, shape (point,)."""
    least = np.full(len(points), np.inf)
    for loop in loops:
        for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            side = b - a
            along = np.clip((points - a) @ side / max(float(side @ side), 1e-300), 0, 1)
            away = np.linalg.norm(points - a - along[:, None] * side, axis=1)
            least = np.minimum(least, away)
    return least


def _first_crossing(one: Array, other: Array) -> Array | None:
    """Find where sides of two closed lines cross; sides that share a corner do not."""
    a, p = one[:, None], other[None]
    d, e = np.roll(one, -1, axis=0)[:, None] - a, np.roll(other, -1, axis=0)[None] - p
    with np.errstate(divide="ignore", invalid="ignore"):
        span = _cross(d, e)
        u, v = _cross(p - a, e) / span, _cross(p - a, d) / span
        cross = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    if one is other:
        i = np.arange(len(one))
        for step in (-1, 0, 1):
            cross[i, (i + step) % len(one)] = False
    if not cross.any():
        return None
    i, j = np.argwhere(cross)[0]
    return np.asarray(one[i] + u[i, j] * d[i, 0])
