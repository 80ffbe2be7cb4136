"""`volume=points`: points that were digitised on the structure, connected to triangles.

Delaunay's triangulation, seen along the normal of the best-fit plane, fills the convex hull; flat
triangles along a dented rim are peeled off again, since no surface is there.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.io import read_points
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IntArray
from sldvexp.volume.base import Volume, vector
from sldvexp.volume.surface import TriangulatedSurface


@register("volume", "points")
@dataclass
class PointSurface(Volume):
    """The Delaunay triangulation of digitised points in their best-fit plane (Section 5.3.3).

    Parameters
    ----------
    path : str
        ``.csv`` with the columns ``x_m,y_m,z_m`` (or another unit), one line a point, in any
        order; other columns are left alone.
    towards : list of 3 float
        The side of the points to which the normals point, in the points' own axes.
    slivers : float
        Triangles along the rim whose height is below this part of their longest side are left
        out: they fill the dents of a rim that was digitised by hand. 0 keeps all.
    """

    path: str = MISSING
    towards: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    slivers: float = 0.1

    def check(self, checks: Checks) -> None:
        """Note what cannot be."""
        vector(checks, "towards", self.towards)
        checks.require(any(self.towards), "towards", "must be a direction, not zero")
        message = f"must be from 0 to 0.5, not {self.slivers}"
        checks.require(0 <= self.slivers <= 0.5, "slivers", message)

    def inputs(self) -> list[str]:
        """Name the file of the digitised points."""
        return [self.path]

    def surface(self) -> TriangulatedSurface:
        """Triangulate the points."""
        position, line = read_points(path := locate(self.path))
        return triangulated(position, line, str(path), self.towards, self.slivers)


#: Points whose second extent is below this fraction of the first lie on one line.
COLLINEAR = 1e-6

#: Cosine of the angle between the best-fit plane and a direction that chooses no side of it.
ALONG = 1e-3


def triangulated(
    position: Array, line: IntArray, source: str, towards: Sequence[float], slivers: float
) -> TriangulatedSurface:
    """Triangulate points in their best-fit plane.

    Parameters
    ----------
    position : ndarray, shape (point, 3), m
    line : ndarray of int, shape (point,)
        Where in the file each point stands.
    source : str
        The file.
    towards : sequence of 3 float
        The side to which the normals point.
    slivers : float
        See `kept`.

    Raises
    ------
    UserError
        If there are fewer than three points, or all lie on one line, or `towards` lies in their
        plane.
    """
    kind = ("point of line", "points of lines")
    points = TriangulatedSurface(position, np.empty((0, 3), np.int64), None, source, line, kind)
    if len(position) < 3:
        raise points.wrong(f"a surface needs three points or more, not {len(position)}")
    _, extent, axes = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)
    if extent[1] <= COLLINEAR * extent[0]:
        raise points.wrong(
            f"all {len(position)} points lie on one line; a surface needs some beside it"
        )
    normal = axes[2]
    side = float(normal @ towards) / float(np.linalg.norm(towards))
    if abs(side) < ALONG:
        off = np.eye(3)[np.abs(normal).argmax()]
        raise points.wrong(
            f"towards: [{', '.join(f'{v:g}' for v in towards)}] lies in the plane of the points "
            f"and chooses no side of it; [{', '.join(f'{v:g}' for v in off)}] would"
        )
    normal = normal * np.sign(side)
    plane = np.stack([axes[0], np.cross(normal, axes[0])])
    flat = (position - position.mean(axis=0)) @ plane.T
    net = scipy.spatial.Delaunay(flat)
    triangles = net.simplices[kept(flat, net.simplices, net.neighbors, slivers)].astype(np.int64)
    clockwise = _double_area(flat, triangles) < 0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return replace(points, triangles=triangles)


def kept(
    flat: Array, triangles: NDArray[np.int32], neighbours: NDArray[np.int32], slivers: float
) -> BoolArray:
    """Keep triangles but those that a convex hull adds along a dented rim.

    A triangle goes if its longest side is of the rim, the opposite corner is not, and its height
    is below `slivers` times that side, the flattest first. Its other two sides are then of the
    rim. Every point stays the corner of a triangle.

    Parameters
    ----------
    flat : ndarray, shape (point, 2)
    triangles : ndarray of int, shape (triangle, 3)
    neighbours : ndarray of int, shape (triangle, 3)
        The triangle beyond the side that lies opposite of each corner; -1 where there is none.

    Returns
    -------
    ndarray of bool, shape (triangle,)
    """
    stays, beyond = np.ones(len(triangles), bool), neighbours.copy()
    corner = flat[triangles]
    side = np.linalg.norm(np.roll(corner, -1, axis=1) - np.roll(corner, 1, axis=1), axis=-1)
    apex = side.argmax(axis=1)
    flatness = np.abs(_double_area(flat, triangles)) / side.max(axis=1) ** 2
    on_rim = np.zeros(len(flat), bool)
    for c in range(3):
        on_rim[np.delete(triangles[beyond[:, c] < 0], c, axis=1)] = True
    waiting = [(flatness[t], t) for t in np.flatnonzero((beyond < 0).any(axis=1))]
    heapq.heapify(waiting)
    while waiting:
        flat_by, t = heapq.heappop(waiting)
        top = triangles[t, apex[t]]
        if flat_by >= slivers or not stays[t] or beyond[t, apex[t]] >= 0 or on_rim[top]:
            continue
        stays[t], on_rim[top] = False, True
        for other in beyond[t][beyond[t] >= 0]:
            beyond[other, beyond[other] == t] = -1
            heapq.heappush(waiting, (flatness[other], other))
    return stays


def _double_area(flat: Array, triangles: IntArray | NDArray[np.int32]) -> Array:
    """Compute twice the area of triangles in the plane, positive if counter-clockwise."""
    a, b, c = np.moveaxis(flat[triangles], 1, 0)
    (u0, u1), (v0, v1) = (b - a).T, (c - a).T
    return u0 * v1 - u1 * v0
