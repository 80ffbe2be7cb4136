"""Projection of points in space into a view: where in its image, from where, with which weights.

The two-mirror model gives the mirror angles that hit a point and, through the board's calibration,
its image point in DAC steps. The image's interpolation there is a row of weights of pixels, so that
everything that follows is linear in the measured velocities. Weights come with their derivatives by
the image point, and the image point with its derivatives by the pose: together they say what an
error of the pose does to the velocity.

Occlusion: a beam is one place of the image, so that a triangle can stop only the beams inside its
own image. Both are sorted into the bins of a grid over the image's plane, and a beam meets the
triangles of its bin. On that plane ``(tan(up_down), tan(left_right) / cos(up_down))`` images of
straight lines are straight but for the mirror offset.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from sldvexp.errors import UserError
from sldvexp.field.visibility.view import View
from sldvexp.geometry import Bins
from sldvexp.image import Interpolation, Interpolator
from sldvexp.image.interpolation.base import Located, spread
from sldvexp.laser import MIRRORS, TwoMirror, project, project_with_directions
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray

#: Steepest accepted angle between the surface's normal and the direction to the instrument, rad.
GRAZING = np.radians(75.0)

#: Points that stay in the cache, whatever is computed of them.
POINTS_AT_ONCE = 8192
#: Each axis with the other two after it.
CYCLES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))

BEHIND = "behind the instrument"
OFF_BOARD = "off the board"
FACING_AWAY = "occluded or facing away"
OUTSIDE = "outside the image"
FLAGGED = "flagged"


@dataclass(frozen=True, eq=False)
class ViewSamples:
    """Samples as one view sees them.

    Parameters
    ----------
    valid : ndarray of bool, shape (sample,)
        Where the view has a velocity.
    directions : ndarray, shape (sample, 3)
        Unit vectors from the surface to the instrument, ``v = V . D``, in world axes; a component
        of all samples is contiguous.
    weights : csr_array, shape (sample, pixel)
        Of the pixels' velocities; rows are empty where not `valid`.
    located : Located
        Cells of the image that `valid` samples are in.
    interpolator : Interpolator
    dac : ndarray, shape (sample, 2), steps
        Where the samples are in the image, not rounded; NaN behind the instrument and off the
        board. An entry of all samples is contiguous.
    lost : dict of str to int
        How many samples have no velocity, by the reason.
    """

    valid: BoolArray
    directions: Array
    weights: scipy.sparse.csr_array
    located: Located
    interpolator: Interpolator
    dac: Array
    lost: dict[str, int]

    def velocity(self, view: View) -> ComplexArray:
        """Interpolate velocities, shape (sample, frequency), m/s; 0 where not `valid`."""
        return np.asarray(self.weights @ view.velocity)

    def slopes(self, values: Array) -> Array:
        """Differentiate the image by both steps, shape (2, sample, column); 0 where not `valid`.

        Parameters
        ----------
        values : ndarray, shape (pixel, column)
        """
        place, count = self.located.place, len(self.valid)
        if len(place) == count:
            return self.interpolator.slopes(self.located, self.dac, values)
        found = np.zeros((2, count, values.shape[1]))
        found[:, place] = self.interpolator.slopes(self.located, self.dac[place], values)
        return found

    def of(self, some: IndexArray) -> ViewSamples:
        """Take some of the samples; `lost` counts all of them.

        Parameters
        ----------
        some : ndarray of int, shape (sample,)
            Ascending.
        """
        at, valid = self.located, self.valid[some]
        found = np.searchsorted(at.place, some[valid])
        located = Located(
            np.flatnonzero(valid),
            at.corner[found],
            at.weight[found],
            at.outside[some],
            at.flagged[some],
        )
        directions = np.ascontiguousarray(self.directions[some].T).T
        parts = (valid, directions, self.weights[some], located, self.interpolator, self.dac[some])
        return ViewSamples(*parts, self.lost)

    def std(self, view: View) -> Array:
        """Compute standard errors of `velocity`, shape (sample,), m/s; 0 where not `valid`.

        ``sqrt(sum w^2 std^2)``, the errors of different pixels being independent; the root mean
        square over the frequencies where the pixels' errors change with them.
        """
        square = np.square(view.std).reshape(len(view.std), -1).mean(axis=1)
        return np.sqrt(self.weights.power(2) @ square)


def project_samples(
    view: View,
    laser: TwoMirror,
    points: Array,
    normals: Array | None,
    method: Interpolation | Interpolator,
    *,
    grazing: float = GRAZING,
    occlusion: Occlusion | None = None,
) -> ViewSamples:
    """Find sample points in a view's image (Section 5.3.5). Any number at once, or block by block.

    Parameters
    ----------
    points : ndarray, shape (sample, 3), m
        In the world.
    normals : ndarray, shape (sample, 3), optional
        Unit normals of the surface on the side that is measured; without them every point is
        taken to face the instrument.
    method : Interpolation or Interpolator
        ``method.prepare(view)`` makes the latter once for all blocks.
    grazing : float, rad
        Points seen under a larger angle from their normal are left out.
    occlusion : Occlusion, optional
        What stands in the way.

    Raises
    ------
    UserError
        If the image cannot be interpolated; see `Interpolation.prepare`.
    """
    interpolator = method.prepare(view) if isinstance(method, Interpolation) else method
    found = sight(view, laser, points)
    before = ~(found.behind | found.off_board)
    away = np.zeros(len(points), bool)
    if normals is not None:
        away = before & (np.einsum("si,si->s", normals, found.directions) < np.cos(grazing))
    if occlusion is not None:
        candidates = np.flatnonzero(before & ~away)
        away[candidates] = occlusion.hides(points[candidates])
    left = before & ~away
    if left.all():  # nothing is copied
        weights = interpolator.at(found.dac)
        value, located = weights.value, weights.located
    else:
        kept = np.flatnonzero(left)
        weights = interpolator.at(found.dac[kept])
        value = spread(weights.value, kept, len(points))
        located = Located(
            kept[weights.located.place],
            *weights.located[1:3],
            _among(weights.outside, kept, len(points)),
            _among(weights.flagged, kept, len(points)),
        )
    reasons = {
        BEHIND: found.behind,
        OFF_BOARD: found.off_board,
        FACING_AWAY: away,
        OUTSIDE: located.outside,
        FLAGGED: located.flagged,
    }
    lost = {reason: int(np.count_nonzero(where)) for reason, where in reasons.items()}
    valid = left & ~(located.outside | located.flagged)
    value.sort_indices()  # now, and not when somebody needs it: sums keep their order
    return ViewSamples(valid, found.directions, value, located, interpolator, found.dac, lost)


def _among(some: BoolArray, rows: IndexArray, count: int) -> BoolArray:
    """Put values of some rows among all, the others being False."""
    found = np.zeros(count, bool)
    found[rows] = some
    return found


class ProjectedPoints(NamedTuple):
    """Points as they are in a view.

    Parameters
    ----------
    dac : ndarray, shape (point, 2), steps
        Not rounded; NaN where one of the two below holds.
    behind, off_board : ndarray of bool, shape (point,)
    directions : ndarray, shape (point, 3)
        Unit vectors from the point to the instrument, in world axes.
    """

    dac: Array
    behind: BoolArray
    off_board: BoolArray
    directions: Array


def sight(view: View, laser: TwoMirror, points: Array) -> ProjectedPoints:
    """Project points in space to image points (Section 5.3.5), with direction cosines of the beams.

    Parameters
    ----------
    laser : TwoMirror
        As configured; see `View.laser`.
    points : ndarray, shape (point, 3), m
        In the world.
    """
    count, own = len(points), view.laser(laser)
    reach = own.reach
    behind, off_board = np.empty((2, count), bool)
    found = ProjectedPoints(np.empty((2, count)).T, behind, off_board, np.empty((3, count)).T)
    for first in range(0, count, POINTS_AT_ONCE):
        some = slice(first, first + POINTS_AT_ONCE)
        in_laser = to_laser(view, points[some])
        angles, directions = project_with_directions(in_laser, own.mirror_offset)
        steps = own.steps_within(angles, reach)
        behind[some] = in_laser[:, 2] <= 0
        if behind[some].any():
            steps[behind[some]] = np.nan
        off_board[some] = np.isnan(steps[:, 0]) & ~behind[some]
        found.dac[some] = steps
        np.matmul(view.rotation.T, directions.T, out=found.directions.T[:, some])
    return found


def to_laser(view: View, points: Array) -> Array:
    """Turn points into the view's laser frame, ``R (P - origin)``, shape (point, 3), m.

    A coordinate of all points is contiguous.
    """
    turned: Array = view.rotation @ points.T
    turned -= (view.rotation @ view.origin)[:, None]
    return turned.T


def angle_slope(laser: TwoMirror, dac: Array) -> Array:
    """Change of the angle with the DAC step, shape (..., 2), rad/step."""
    largest = laser.board.value[1]
    slopes = [polynomial.polyder(getattr(laser, m).coefficients) for m in MIRRORS]
    each = [polynomial.polyval(dac[..., i] / largest, s) for i, s in enumerate(slopes)]
    return np.stack(each, axis=-1) / largest


#: Of its size: how far the image of a triangle may bulge out of the box of its corners.
BULGE = 0.02


def triangle_bins(corner: Array, laser: TwoMirror) -> Bins:
    """Sort triangles into bins by the boxes that their images lie in.

    Parameters
    ----------
    corner : ndarray, shape (triangle, 3, 3), m
        In the laser's frame, in front of the instrument.
    """
    plane = image_plane(project(corner, laser.mirror_offset))
    bulge = BULGE * np.ptp(plane, axis=1)
    return Bins.from_boxes(plane.min(axis=1) - bulge, plane.max(axis=1) + bulge)


#: How many beams meet their triangles at once.
BLOCK = 65536


@dataclass(frozen=True, eq=False)
class Occlusion:
    """A surface as one view sees it.

    Parameters
    ----------
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
        return cls(view, laser.mirror_offset, corner, clearance, triangle_bins(corner, laser))

    def hides(self, points: Array) -> BoolArray:
        """Mark points that stand behind the surface, shape (point,).

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
        beam, triangle = self.bins.pairs(image_plane(angles))
        begin = np.zeros_like(end)
        begin[:, 0] = self.mirror_offset * np.tan(angles[:, 1])
        way = end - begin
        # Beyond this part of the way the beam is at the point's own piece of the surface.
        part = 1.0 - self.clearance / np.linalg.norm(way, axis=1)
        met = _meets(begin[beam], way[beam], part[beam], self.corner, triangle)
        return np.bincount(beam[met], minlength=len(end)) > 0


def _meets(begin: Array, way: Array, part: Array, corner: Array, triangle: IndexArray) -> BoolArray:
    """Test whether each beam ``begin + s way``, 0 < s < part, meets its triangle."""
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


def image_plane(angles: Array) -> Array:
    """Map angles to places on the image's plane, shape (..., 2)."""
    up_down, left_right = np.moveaxis(angles, -1, 0)
    return np.stack([np.tan(up_down), np.tan(left_right) / np.cos(up_down)], axis=-1)
