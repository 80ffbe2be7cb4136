"""Outline of the volume's surface in its coordinates: the chart that fits it, and what lies inside.

A surface that is flat or bends along one direction has a chart in closed form; it is that of a
grid, or fitted to the nodes of a mesh. Of any other mesh it is the height over a plane. The outline
is that of the triangles, so that it may have any shape and holes; with a margin it is the rectangle
around them.

Around a closed shell of revolution the first coordinate comes back after its period, so that there
are limits along the meridian alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sldvexp.geometry import Bins, rotation_from_euler
from sldvexp.lazy import scipy
from sldvexp.shell.chart import Chart
from sldvexp.shell.cylinder_chart import CylinderChart
from sldvexp.shell.height_chart import HeightChart
from sldvexp.shell.revolution_chart import RevolutionChart
from sldvexp.typing import Array, BoolArray, IntArray
from sldvexp.volume import Prisms, Volume
from sldvexp.volume.grid import Grid
from sldvexp.volume.outlined import OutlinedSurface
from sldvexp.volume.revolution import Revolution

#: Volumes that know their plane or cylinder.
KNOWN = (Grid, OutlinedSurface)
#: Distance of a node from the fitted surface, over the surface's extent, that is still no bulge.
BULGE = 2e-4
#: How far, in barycentric coordinates, a place may miss a triangle and still lie in it.
RIM = 1e-9


@dataclass(frozen=True, eq=False)
class Outline:
    """Part of a chart that the structure covers.

    Attributes
    ----------
    chart : Chart
        Of the surface that the splines are those of.
    given : float, m
        Height of the volume's surface above it.
    corners : ndarray, shape (node, 2), m
        Coordinates of the volume's surface nodes.
    triangles : ndarray of int, shape (triangle, 3)
    low, high : ndarray, shape (2,), m
        Corners of the rectangle around all, with the margin.
    margin : float, m
    both_sides : bool
        Whether views see the structure from behind as well.
    steepest : float
        Cosine of the largest angle between a beam and the normal where it meets the surface.
    """

    chart: Chart
    given: float
    corners: Array
    triangles: IntArray
    low: Array
    high: Array
    margin: float
    both_sides: bool = False
    steepest: float = 0.0

    @classmethod
    def of(cls, volume: Volume, prisms: Prisms, given: float) -> Outline:
        """Lay coordinates over a volume's surface.

        Parameters
        ----------
        given : float, m
            Height of the volume's surface above the one that the splines are those of.

        Raises
        ------
        UserError
            If the surface folds over, or has edges.
        """
        nodes = prisms.surface
        margin = volume.unit.value * volume.margin
        chart: Chart
        if isinstance(volume, KNOWN):
            chart = chart_of_grid(volume)
        elif isinstance(volume, Revolution):
            chart = chart_of_revolution(volume, margin)
        else:
            chart = fitted_chart(prisms, margin)
        lowered = chart.lowered(given)
        coordinates, _ = lowered.place(nodes)
        low, high = coordinates.min(axis=0) - margin, coordinates.max(axis=0) + margin
        if lowered.period is not None:
            low[0], high[0] = -lowered.period / 2, lowered.period / 2
        both, steepest = volume.sight.both_sides, np.cos(np.radians(volume.sight.grazing))
        return cls(lowered, given, coordinates, prisms.triangles, low, high, margin, both, steepest)

    @property
    def closed(self) -> bool:
        """Whether the surface closes in itself along s."""
        return self.chart.period is not None

    def side_towards(self, origin: Array) -> int:
        """Tell the side that is looked at from a place: 1 the face, -1 the back.

        It is that which most nodes of the surface turn to it, where both sides may be seen.
        """
        if not self.both_sides:
            return 1
        toward = origin - self.chart.points(self.corners, 0.0)
        facing = np.einsum("pi,pi->p", toward, self.chart.frames(self.corners)[:, 2]) > 0
        return 1 if 2 * np.count_nonzero(facing) >= len(facing) else -1

    @cached_property
    def holes(self) -> list[tuple[Array, float]]:
        """Middles, shape (2,), m, and mean radii, m, of the holes; none with a margin.

        A hole whose middle belongs to the structure, as that of a curved slot may, is left out; a
        shell of revolution has none.
        """
        if self.margin > 0 or self.closed:
            return []
        found = [_middle_and_area(self.corners[loop]) for loop in rims(self.triangles)]
        inner = sorted(found, key=lambda hole: hole[1])[:-1]
        beside = [~self.holds(middle[None])[0] for middle, _ in inner]
        return [
            (middle, float(np.sqrt(area / np.pi)))
            for (middle, area), free in zip(inner, beside, strict=True)
            if free
        ]

    def holds(self, coordinates: Array) -> BoolArray:
        """Tell which places belong to the structure, shape (place,)."""
        if self.closed:
            t = coordinates[:, 1]
            return np.asarray((t >= self.low[1]) & (t <= self.high[1]))
        if self.margin > 0:
            inside = (coordinates >= self.low) & (coordinates <= self.high)
            return np.asarray(inside.all(axis=1))
        corners = self.corners[self.triangles]
        bins = Bins.from_boxes(corners.min(axis=1), corners.max(axis=1))
        place, triangle = bins.pairs(coordinates)
        a, b, c = np.moveaxis(corners[triangle], 1, 0)
        u, v, p = b - a, c - a, coordinates[place] - a
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (p[:, 0] * v[:, 1] - p[:, 1] * v[:, 0]) / area
            t = (u[:, 0] * p[:, 1] - u[:, 1] * p[:, 0]) / area
        found = np.zeros(len(coordinates), bool)
        found[place[(s >= -RIM) & (t >= -RIM) & (s + t <= 1 + RIM)]] = True
        return found


def rims(triangles: IntArray) -> list[IntArray]:
    """Follow the edges that only one triangle has, around each rim; nodes in their order.

    Examples
    --------
    >>> import numpy as np
    >>> [loop.tolist() for loop in rims(np.array([[0, 1, 2], [0, 2, 3]]))]
    [[0, 1, 2, 3]]
    """
    start, end = triangles.ravel().tolist(), np.roll(triangles, -1, axis=1).ravel().tolist()
    edges = set(zip(start, end, strict=True))
    following = {a: b for a, b in edges if (b, a) not in edges}
    loops = []
    for first in sorted(following):
        loop, node = [], first
        while node in following:
            loop.append(node)
            node = following.pop(node)
        if loop:
            loops.append(np.array(loop))
    return loops


def _middle_and_area(loop: Array) -> tuple[Array, float]:
    """Compute the centroid and the area of a polygon, shape (corner, 2)."""
    (x, y), (u, v) = loop.T, np.roll(loop, -1, axis=0).T
    cross = x * v - u * y
    area = float(cross.sum()) / 2
    if area == 0:
        return loop.mean(axis=0), 0.0
    return np.array([((x + u) * cross).sum(), ((y + v) * cross).sum()]) / (6 * area), abs(area)


def chart_of_grid(grid: Grid | OutlinedSurface) -> CylinderChart:
    """Take the coordinates of a surface whose own x is the arc."""
    unit = grid.unit.value
    axes = rotation_from_euler(grid.euler)
    curvature = 0.0 if grid.radius is None else 1 / (unit * grid.radius)
    return CylinderChart(unit * np.array(grid.center, float), axes, curvature)


def chart_of_revolution(volume: Revolution, margin: float) -> RevolutionChart:
    """Take the coordinates around the axis of a volume, and along its meridian."""
    origin, axes = volume.unit.value * np.array(volume.center), rotation_from_euler(volume.euler)
    return RevolutionChart(origin, axes, volume.meridian, margin)


def fitted_chart(prisms: Prisms, margin: float = 0.0) -> Chart:
    """Fit a plane to the nodes of the given surface, or a cylinder, or else a height over a plane.

    On a plane s runs along the volume's first tangent.

    Parameters
    ----------
    margin : float, m
        How far the structure goes on beyond the nodes.

    Raises
    ------
    UserError
        If it is none of them; see `HeightChart.fitted`.
    """
    nodes = prisms.surface
    middle = nodes.mean(axis=0)
    along = np.linalg.svd(nodes - middle, full_matrices=False)[2]
    normal = along[2] * np.sign(along[2] @ prisms.frame[:, 2].mean(axis=0) or 1.0)
    extent = float(np.linalg.norm(np.ptp((nodes - middle) @ along.T, axis=0)))
    bulge = np.abs((nodes - middle) @ normal).max()
    if bulge <= BULGE * extent:
        # Strains along the same directions as the volume's own components of velocity.
        first = prisms.frame[:, 0].mean(axis=0)
        first = first - (first @ normal) * normal
        first /= np.linalg.norm(first)
        return CylinderChart(middle, np.stack([first, np.cross(normal, first), normal]))
    best = min(
        (_cylinder(nodes, middle, normal, along[i]) for i in (0, 1)), key=lambda found: found[1]
    )
    return best[0] if best[1] <= BULGE * extent else HeightChart.fitted(prisms, margin)


def _cylinder(
    nodes: Array, middle: Array, normal: Array, across: Array
) -> tuple[CylinderChart, float]:
    """Fit a cylinder that bends along one direction first; the largest distance of a node."""
    axes = np.stack([across, np.cross(normal, across), normal])
    x, _, h = ((nodes - middle) @ axes.T).T
    curve = np.polyfit(x, h, 2)

    def chart(p: Array) -> CylinderChart:
        turned = scipy.spatial.transform.Rotation.from_rotvec(p[:3]).as_matrix() @ axes
        return CylinderChart(middle + p[3] * turned[2], turned, p[4])

    start = np.array([0.0, 0.0, 0.0, curve[2], -2 * curve[0]])
    found = scipy.optimize.least_squares(
        lambda p: chart(p).place(nodes)[1], start, x_scale=[0.1, 0.1, 0.1, 0.01, 1.0]
    )
    fitted = chart(found.x)
    return fitted, float(np.abs(fitted.place(nodes)[1]).max())
