"""Places where the beams of an image's pixels meet the surface, and how they move with the pose.

A beam starts at ``b = origin + R' s(angles)`` along ``d = R' w(angles)`` and meets the given
surface at ``P = b + t d``. If the pose changes by a rotation vector w of the laser frame and by a
displacement of the origin, the beam's point that was at P moves by ``dQ = R' (P_l x w) + d origin``
and its direction by ``R' (w_l x w)``; the point on the surface stays on the tangent plane, so that
``dP = (1 - d n'/(n'd)) dQ``. If the surface stands higher by h, P moves along the beam by
``d h/(n'd)``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sldvexp.field import View
from sldvexp.field.visibility.projection import image_plane, to_laser, triangle_bins
from sldvexp.geometry import skew
from sldvexp.laser import TwoMirror, project, rays
from sldvexp.targets import Circles
from sldvexp.targets.shadows import circles_met
from sldvexp.typing import Array, BoolArray, IndexArray
from sldvexp.volume import Prisms, Volume

#: How far, in barycentric coordinates, a beam may miss a triangle and still meet it.
RIM = 1e-9


@dataclass(frozen=True, eq=False)
class MeasuredSurface:
    """The given surface, and which beams see it.

    Attributes
    ----------
    laser : TwoMirror
        As configured.
    prisms : Prisms
        Of the volume around it: its triangles and frames.
    nodes : ndarray, shape (surface_node, 3), m
        At depth 0.
    grazing : float, rad
        Steepest angle between a normal and a beam.
    one_sided : bool
        Only the side that the normals point to is seen.
    """

    laser: TwoMirror
    prisms: Prisms
    nodes: Array
    grazing: float
    one_sided: bool

    @classmethod
    def of(cls, volume: Volume, laser: TwoMirror) -> MeasuredSurface:
        """Take the surface that a volume is laid around."""
        prisms = volume.prisms()
        grazing = float(np.radians(volume.sight.grazing))
        return cls(laser, prisms, prisms.surface, grazing, not volume.sight.both_sides)

    @property
    def thickness(self) -> float:
        """Thickness of the volume, m."""
        return float(np.ptp(self.prisms.depth))

    def raised(self, height: float) -> MeasuredSurface:
        """Move the surface along its normals."""
        return replace(self, nodes=self.nodes + height * self.prisms.frame[:, 2])


@dataclass(frozen=True, eq=False)
class PixelBeams:
    """PixelBeams of some pixels of one view that meet the surface.

    Attributes
    ----------
    pixel : ndarray of int, shape (beam,)
        Of the view's image.
    point : ndarray, shape (beam, 3), m
        On the surface, in the world.
    direction : ndarray, shape (beam, 3)
        Unit vectors from the surface to the instrument, ``v = V . direction``.
    point_by_pose : ndarray, shape (beam, 3, 6), m/rad and 1
        Derivatives by a rotation vector of the laser frame and by the origin.
    direction_by_pose : ndarray, shape (beam, 3, 6), 1/rad and 1/m
    point_by_height : ndarray, shape (beam, 3)
        Derivative by the height of the surface.
    """

    pixel: IndexArray
    point: Array
    direction: Array
    point_by_pose: Array
    direction_by_pose: Array
    point_by_height: Array

    @classmethod
    def trace(cls, view: View, surface: MeasuredSurface, pixels: IndexArray) -> PixelBeams:
        """Follow the beams of some pixels to where they first meet the surface.

        Parameters
        ----------
        pixels : ndarray of int
            Those that miss the surface, or meet it too steeply or from behind, are left out.
        """
        laser, prisms = view.laser(surface.laser), surface.prisms
        start, along = rays(laser.angle_from_dac(view.dac[pixels]), laser.mirror_offset)
        begin, way = view.origin + start @ view.rotation, along @ view.rotation
        beam, triangle, far, share = _first_met(view, laser, surface, begin, way)
        normal = np.einsum("bk,bki->bi", share, prisms.frame[prisms.triangles[triangle], 2])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        begin, way = begin[beam], way[beam]
        facing = -np.einsum("bi,bi->b", normal, way)
        kept = (facing if surface.one_sided else np.abs(facing)) >= np.cos(surface.grazing)
        point = (begin + far[:, None] * way)[kept]
        return cls._with_derivatives(view, pixels[beam[kept]], point, way[kept], normal[kept])

    @classmethod
    def _with_derivatives(
        cls, view: View, pixel: IndexArray, point: Array, way: Array, normal: Array
    ) -> PixelBeams:
        """Differentiate by the pose and by the height; see the module."""
        rotation, across = view.rotation.T, np.einsum("bi,bi->b", normal, way)
        in_laser = (point - view.origin) @ view.rotation.T
        same = np.broadcast_to(np.eye(3), (len(point), 3, 3))
        moved = np.concatenate([rotation @ skew(in_laser), same], axis=2)
        along = np.einsum("bi,bip->bp", normal, moved) / across[:, None]
        turned = rotation @ skew(way @ view.rotation.T)
        return cls(
            pixel,
            point,
            -way,
            moved - way[:, :, None] * along[:, None],
            -np.concatenate([turned, np.zeros_like(turned)], axis=2),
            way / across[:, None],
        )

    def take(self, kept: IndexArray | BoolArray) -> PixelBeams:
        """Keep some of the beams."""
        return PixelBeams(**{name: values[kept] for name, values in self.__dict__.items()})


def on_circles(view: View, surface: MeasuredSurface, target: Circles) -> BoolArray:
    """Find pixels whose beams meet a circle of the calibration object before the surface, (pixel,).

    What returns there is the object's motion, or that of what it rests on.
    """
    laser = view.laser(surface.laser)
    start, along = rays(laser.angle_from_dac(view.dac), laser.mirror_offset)
    begin, way = view.origin + start @ view.rotation, along @ view.rotation
    circle = circles_met(begin, way, target)
    found = np.isfinite(circle)
    if found.any():
        some = np.flatnonzero(found)
        beam, _, far, _ = _first_met(view, laser, surface, begin[some], way[some])
        found[some[beam]] = circle[some[beam]] < far
    return found


def _first_met(
    view: View, laser: TwoMirror, surface: MeasuredSurface, begin: Array, way: Array
) -> tuple[IndexArray, IndexArray, Array, Array]:
    """Find the nearest triangle that each beam meets.

    Returns
    -------
    beam, triangle : ndarray of int, shape (met,)
    far : ndarray, shape (met,), m
        Along the beam.
    share : ndarray, shape (met, 3)
        Barycentric coordinates.
    """
    corners = surface.nodes[surface.prisms.triangles]
    in_laser = to_laser(view, surface.nodes)[surface.prisms.triangles]
    ahead = np.flatnonzero((in_laser[..., 2] > 0).all(axis=1))
    if not len(ahead) or not len(begin):
        return (*np.zeros((2, 0), np.intp), np.zeros(0), np.zeros((0, 3)))
    bins = triangle_bins(in_laser[ahead], laser)
    end = project(to_laser(view, begin + way), laser.mirror_offset)
    beam, box = bins.pairs(image_plane(end))
    triangle = ahead[box]
    far, share = _meet(begin[beam], way[beam], corners[triangle])
    met = (share >= -RIM).all(axis=1) & (far > 0)
    beam, triangle, far, share = beam[met], triangle[met], far[met], share[met]
    order = np.lexsort((far, beam))
    first = order[np.r_[True, np.diff(beam[order]) > 0]] if len(order) else order
    return beam[first], triangle[first], far[first], share[first]


def _meet(begin: Array, way: Array, corners: Array) -> tuple[Array, Array]:
    """Intersect beams with the planes of their triangles: distance and barycentric coordinates."""
    a, b, c = np.moveaxis(corners, 1, 0)
    one, other, away = b - a, c - a, begin - a
    # Cramer's rule: determinants of three columns are triple products.
    across, aside = np.cross(way, other), np.cross(away, one)
    area = np.einsum("bi,bi->b", one, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        solved = [
            np.einsum("bi,bi->b", *pair) / area
            for pair in ((away, across), (way, aside), (other, aside))
        ]
    s, t, far = np.where(area == 0, -1.0, solved)
    return far, np.stack([1 - s - t, s, t], axis=1)
