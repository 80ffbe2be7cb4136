"""Triangles between points that no file joins, so that a surface can be drawn of them.

The points are seen along the normal of the plane that is nearest to them, and joined there by
Delaunay's triangulation; triangles that span gaps are left out. That is a surface only where the
points are nearly flat: of others nothing is guessed.
"""

from __future__ import annotations

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, IntArray

#: Extent across the plane, over the shorter one in it, beyond which points are no surface.
FLAT = 0.3
#: Edges longer than so many median ones span a gap.
GAP = 3.0


def joined_in_plane(position: Array) -> IntArray:
    """Join points that lie nearly in a plane, shape (triangle, 3); none of other points.

    Corners are counter-clockwise seen from the side to which the largest part of the plane's normal
    is positive.

    Examples
    --------
    >>> joined_in_plane(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])).tolist()
    [[0, 1, 2]]
    """
    away = position - position.mean(axis=0)
    if len(position) < 3 or not np.isfinite(position).all():
        return np.empty((0, 3), np.int64)
    _, extent, axes = np.linalg.svd(away, full_matrices=True)
    flat = extent[2] if len(extent) > 2 else 0.0
    if extent[1] <= 1e-9 * extent[0] or flat > FLAT * extent[1]:
        return np.empty((0, 3), np.int64)
    normal = axes[2] * np.sign(axes[2][np.abs(axes[2]).argmax()])
    plane = away @ np.stack([axes[0], np.cross(normal, axes[0])], axis=1)
    found = scipy.spatial.Delaunay(plane).simplices.astype(np.int64)
    a, b, c = np.moveaxis(plane[found], 1, 0)
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    found[area < 0] = found[area < 0][:, ::-1]
    edges = np.linalg.norm(plane[found] - plane[np.roll(found, 1, axis=1)], axis=2)
    kept = (edges.max(axis=1) <= GAP * np.median(edges)) & (abs(area) > 1e-9 * abs(area).max())
    first = found[kept].argmin(axis=1)[:, None]
    return np.take_along_axis(found[kept], (first + np.arange(3)) % 3, axis=1)


def joined_points(line_of_sight: xr.Dataset) -> tuple[Array, IntArray, IntArray]:
    """Find where the points of several lines of sight are, and what joins them.

    Returns
    -------
    position : ndarray, shape (point, 3), m
    triangles : ndarray of int, shape (triangle, 3)
        By points; if the file that they come from joins none, those in the points' plane.
    lines : ndarray of int, shape (line, 2)

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> joined_points(xr.Dataset({"position": (("point", "axis"), corners)}))[1].tolist()
    [[0, 1, 2]]
    """
    none = xr.DataArray(np.empty((0, 0), np.int64))
    corners, ends = (line_of_sight.get(name, none).values for name in ("triangle", "line"))
    position = line_of_sight["position"].transpose("point", "axis").values
    if not corners.size and not ends.size:
        corners = joined_in_plane(position)
    return position, corners.reshape(-1, 3).astype(np.int64), ends.reshape(-1, 2).astype(np.int64)
