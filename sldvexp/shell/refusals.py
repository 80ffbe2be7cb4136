"""Surfaces that no field can be found on: outlines that cross themselves, and unseen ones.

An outline crosses itself if a place of it lies in several triangles. A surface faces a view where
its normal has a component towards the instrument; if it faces none, only its back is seen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field import View
from sldvexp.geometry import Bins
from sldvexp.shell.outline import Outline
from sldvexp.typing import Array

#: Thickness over the longer side of a surface from which no theory of thin sheets is meant.
THICK = 0.5
#: Barycentric coordinate of a place beyond which it lies inside of a triangle, and not at its rim.
INSIDE = 0.01


def require_no_crossing(outline: Outline) -> None:
    """Complain about triangles that lie over others.

    Raises
    ------
    UserError
        If some do.
    """
    if outline.closed:
        return  # by construction
    corners = outline.corners[outline.triangles]
    bins = Bins.from_boxes(corners.min(axis=1), corners.max(axis=1))
    place, triangle = bins.pairs(corners.mean(axis=1))
    share = _barycentric(corners[triangle], corners.mean(axis=1)[place])
    over = (share > INSIDE).all(axis=1) & (place != triangle)
    if over.any():
        low, high = (1e3 * f(corners[place[over]].mean(axis=1), axis=0) for f in (np.min, np.max))
        raise UserError(
            f"the volume's surface crosses itself: {len(np.unique(place[over]))} of "
            f"{len(corners)} triangles lie over others, between {low[0]:.4g} and {high[0]:.4g} mm "
            f"along its first direction and {low[1]:.4g} and {high[1]:.4g} mm along its second"
        )


def require_thin(outline: Outline, thickness: float) -> None:
    """Complain about a sheet that is nearly as thick as its surface is long.

    Parameters
    ----------
    thickness : float, m

    Raises
    ------
    UserError
        If it is.
    """
    longer = float((outline.high - outline.low).max())
    if thickness > THICK * longer:
        raise UserError(
            f"material.thickness is {thickness:.4g} m, and the surface is {longer:.4g} m long: "
            "that is no thin sheet; is the thickness in m?"
        )


def too_few_pixels(
    count: int, needed: int, views: Sequence[View], outline: Outline, face: float
) -> UserError:
    """Say why so few pixels meet a surface: it turns its back to all views, or lies elsewhere."""
    frames = outline.chart.frames(outline.corners)
    points = outline.chart.points(outline.corners, face)
    facing = [np.einsum("pi,pi->p", view.origin - points, frames[:, 2]).max() > 0 for view in views]
    if not any(facing) and not outline.both_sides:
        return UserError(
            f"the surface turns its back to {'the view' if len(views) == 1 else 'all views'}: its "
            "normals point away from where the instrument stood; turn volume.euler, or set "
            "volume.flip of a mesh; or volume.sight.both_sides=true if its back was measured"
        )
    side = "" if outline.both_sides else " from the side of its normals"
    return UserError(
        f"{count} pixels of all views together meet the surface{side}, "
        f"where {needed} are needed: does the volume lie where the structure is, inside of the "
        "images?"
    )


def _barycentric(corners: Array, places: Array) -> Array:
    """Compute barycentric coordinates of places in triangles, shape (place, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    u, v, p = b - a, c - a, places - a
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (p[:, 0] * v[:, 1] - p[:, 1] * v[:, 0]) / area
        t = (u[:, 0] * p[:, 1] - u[:, 1] * p[:, 0]) / area
    return np.column_stack([1 - s - t, s, t])
