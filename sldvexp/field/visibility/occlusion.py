"""Which points a surface hides from a view: beams against triangles, sorted into bins first.

A beam is one place of the image, so that a triangle can stop only the beams inside its own image.
Both are sorted into the bins of a grid over the image's plane, and a beam meets the triangles of
its bin. On that plane ``(tan(up_down), tan(left_right) / cos(up_down))`` images of straight lines
are straight but for the mirror offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.visibility.two_mirror_projection import to_laser
from sldvexp.field.visibility.view import View
from sldvexp.geometry.bins import Bins
from sldvexp.laser.model import project
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.typing import Array, BoolArray, IndexArray

#: Of its size: how far the image of a triangle may bulge out of the box of its corners.
BULGE = 0.02
#: How many beams meet their triangles at once.
BLOCK = 65536


@dataclass(frozen=True, eq=False)
class Occlusion:
    """A surface as one view sees it.

    Parameters
    ----------
    view : View
    mirror_offset : float, m
    corner : ndarray, shape (triangle, 3, 3), m
        In the laser frame, (corner, axis).
    clearance : float, m
        A point is hidden by what stands in front of it by more than this along the beam. For
        points at most h from the surface: h over the cosine of the steepest accepted angle.
    bins : Bins
        Of the triangles, on the image's plane.
    """

    view: View
    mirror_offset: float
    corner: Array
    clearance: float
    bins: Bins

    @classmethod
    def prepare(
        cls, view: View, laser: TwoMirror, nodes: Array, triangles: IndexArray, clearance: float
    ) -> Occlusion:
        """Sort the triangles of a surface into bins.

        Parameters
        ----------
        view : View
        laser : TwoMirror
        nodes : ndarray, shape (node, 3), m
        triangles : ndarray of int, shape (triangle, 3)
        clearance : float, m

        Raises
        ------
        UserError
            If no triangle stands in front of the instrument.
        """
        corner = to_laser(view, nodes)[triangles]
        corner = corner[(corner[..., 2] > 0).all(axis=1)]
        if not len(corner):
            raise UserError(f"view {view.name}: the whole surface is behind the instrument")
        plane = _plane(project(corner, laser.mirror_offset))
        bulge = BULGE * np.ptp(plane, axis=1)
        bins = Bins.from_boxes(plane.min(axis=1) - bulge, plane.max(axis=1) + bulge)
        return cls(view, laser.mirror_offset, corner, clearance, bins)

    def hides(self, points: Array) -> BoolArray:
        """Which points stand behind the surface, shape (point,).

        Parameters
        ----------
        points : ndarray, shape (point, 3), m
            In the world, in front of the instrument.
        """
        hidden = np.zeros(len(points), bool)
        for k in range(0, len(points), BLOCK):
            hidden[k : k + BLOCK] = self._hides(to_laser(self.view, points[k : k + BLOCK]))
        return hidden

    def _hides(self, end: Array) -> BoolArray:
        angles = project(end, self.mirror_offset)
        beam, triangle = self.bins.pairs(_plane(angles))
        begin = np.zeros_like(end)
        begin[:, 0] = self.mirror_offset * np.tan(angles[:, 1])
        way = end - begin
        # Beyond this part of the way the beam is at the point's own piece of the surface.
        part = 1.0 - self.clearance / np.linalg.norm(way, axis=1)
        met = _meets(begin[beam], way[beam], part[beam], self.corner, triangle)
        return np.bincount(beam[met], minlength=len(end)) > 0


def _meets(begin: Array, way: Array, part: Array, corner: Array, triangle: IndexArray) -> BoolArray:
    """Whether each beam ``begin + s way``, 0 < s < part, meets its triangle."""
    a, b, c = np.moveaxis(corner, 1, 0)
    normal = np.cross(b - a, c - a)
    height = np.einsum("ti,ti->t", normal, a)[triangle]
    n = normal[triangle]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (height - np.einsum("pi,pi->p", n, begin)) / np.einsum("pi,pi->p", n, way)
    ahead = np.flatnonzero((s > 0) & (s < part))
    hit = begin[ahead] + s[ahead, None] * way[ahead]
    inside = np.ones(len(ahead), bool)
    t, n = triangle[ahead], n[ahead]
    for p, q in ((a, b), (b, c), (c, a)):
        edge = (q - p)[t]
        inside &= np.einsum("pi,pi->p", np.cross(edge, hit - p[t]), n) >= 0
    met = np.zeros(len(s), bool)
    met[ahead[inside]] = True
    return met


def _plane(angles: Array) -> Array:
    """Places on the image's plane, shape (..., 2)."""
    up_down, left_right = np.moveaxis(angles, -1, 0)
    return np.stack([np.tan(up_down), np.tan(left_right) / np.cos(up_down)], axis=-1)
