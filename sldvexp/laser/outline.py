"""Outline of a part as the mirrors see it: where along a line of angles the beam leaves the part.

Beams that meet any triangle of the part's mesh fall on it, all others pass. The outline is where
the one turn into the other, also around holes: places of edges that belong to one triangle, or that
a triangle seen from its front shares with one seen from its back, with the part on one side and
nothing on the other. Coordinates here are angles over the angle of one DAC step, called steps; a
board whose calibration is not straight has others, which `steps_of_dac` turns into these.

A scan line through e along the unit vector u meets the outline at e + t u. A place q(s) on an edge
of the mesh lies there if ``(q(s) - e) x u = 0``, and with n across the edge's image the place moves
along the line by ``dt = n . dq / (n . u)`` where a small turn and shift of the instrument move
q by dq. Edges between curved faces move on the part, but along the beam, which changes nothing to
first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.geometry import Bins, skew
from sldvexp.laser.model import project, project_jacobian, rays
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.typing import Array, BoolArray, IndexArray, IntArray

#: Pieces of the part's extent in which edges are straight as the mirrors see them.
PIECES = 48
#: How far to both sides of an outline a beam is looked at, rad.
BESIDE = 5e-5
#: Pairs of beams and triangles that are tested at once.
AT_ONCE = 2_000_000
#: Newton's steps to a place on a scan line.
STEPS = 3
#: Cosine between scan line and edge beyond which the two do not cross.
GRAZING = 0.99
#: How far a triangle's sides bend as the mirrors see them, as a part of its box.
BEND = 0.05
#: Deviation of a barycentric coordinate that is rounding.
ROUNDING = 1e-9


class Crossings(NamedTuple):
    """Places where scan lines meet the outline.

    Parameters
    ----------
    line : ndarray of int, shape (K,)
        Scan line of each.
    along : ndarray, shape (K,), steps
        From the line's point to the outline, along the line.
    jacobian : ndarray, shape (K, 6), steps per rad and per m
        Of `along` by a small turn of the laser frame and by its origin.
    edge : ndarray of int, shape (K,)
        Edge of the mesh.
    """

    line: IndexArray
    along: Array
    jacobian: Array
    edge: IndexArray


class Pieces(NamedTuple):
    """Straight pieces of edges that may be seen as outline.

    Parameters
    ----------
    edge : ndarray of int, shape (M,)
    ends : ndarray, shape (M, 2, 3), m
    steps : ndarray, shape (M, 2, 2)
        Images of the ends.
    """

    edge: IndexArray
    ends: Array
    steps: Array


@dataclass(frozen=True, eq=False)
class PartOutline:
    """A part's mesh, made ready for its outline.

    Parameters
    ----------
    position : ndarray, shape (node, 3), m
        In the world.
    triangles : ndarray of int, shape (triangle, 3)
    edges : ndarray of int, shape (edge, 2)
        Nodes of each edge of a triangle, once.
    beside : ndarray of int, shape (edge, 2)
        Triangles on both sides; -1 if there is none, -2 if there are more than two.
    """

    position: Array
    triangles: IntArray
    edges: IntArray
    beside: IntArray

    @classmethod
    def from_mesh(cls, position: ArrayLike, triangles: IntArray) -> PartOutline:
        """Find the edges of a mesh.

        Examples
        --------
        >>> square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        >>> part = PartOutline.from_mesh(square, np.array([[0, 1, 2], [0, 2, 3]]))
        >>> len(part.edges), int(np.sum(part.beside[:, 1] == -1))
        (5, 4)
        """
        every = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, which, count = np.unique(every, axis=0, return_inverse=True, return_counts=True)
        which = which.reshape(-1)
        order = np.argsort(which, kind="stable")
        first = np.cumsum(count) - count
        beside = np.full((len(edges), 2), -1)
        beside[:, 0] = order[first] // 3
        two = count == 2
        beside[two, 1] = order[first[two] + 1] // 3
        beside[count > 2] = -2
        return cls(np.asarray(position, float), triangles, edges, beside)

    @property
    def extent(self) -> float:
        """Largest side of the box around the part, m."""
        return float(np.ptp(self.position, axis=0).max())

    def pieces(self, rotation: Array, origin: Array, laser: TwoMirror) -> Pieces:
        """Cut the edges that may be outline from a place into straight pieces."""
        front = (
            np.einsum("ti,ti->t", self._normal, origin - self.position[self.triangles[:, 0]]) > 0
        )
        one, other = self.beside.T
        inner = other >= 0
        # Neighbours that are wound against each other have no common front: such edges stay, and
        # what beams meet beside them decides.
        hidden = inner & (front[one] == front[other]) & self._wound_alike
        chosen = np.flatnonzero(~hidden)
        a, b = np.moveaxis(self.position[self.edges[chosen]], 1, 0)
        count = np.ceil(np.linalg.norm(b - a, axis=1) * PIECES / self.extent).astype(int)
        count = np.maximum(count, 1)
        own = np.repeat(np.arange(len(chosen)), count)
        place = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
        share = np.stack([place, place + 1], axis=1) / count[own, None]
        ends = a[own, None] + share[..., None] * (b - a)[own, None]
        seen = (ends - origin) @ rotation.T
        steps = project(seen, laser.mirror_offset) / laser.step
        before = (seen[..., 2] > 0).all(axis=1)
        return Pieces(chosen[own][before], ends[before], steps[before])

    @cached_property
    def _normal(self) -> Array:
        """Normals of the triangles, of twice their area, shape (triangle, 3), m^2."""
        corners = self.position[self.triangles]
        return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])

    @cached_property
    def _wound_alike(self) -> BoolArray:
        """Tell which edges two triangles go along in opposite senses, shape (edge,)."""
        ahead = np.zeros((len(self.edges), 2), bool)
        for side in range(2):
            corners = self.triangles[np.maximum(self.beside[:, side], 0)]
            following = np.roll(corners, -1, axis=1)
            ahead[:, side] = (
                (corners == self.edges[:, :1]) & (following == self.edges[:, 1:])
            ).any(axis=1)
        return np.asarray(ahead[:, 0] != ahead[:, 1])

    def covers(self, steps: Array, rotation: Array, origin: Array, laser: TwoMirror) -> BoolArray:
        """Tell which beams meet the part.

        Parameters
        ----------
        steps : ndarray, shape (K, 2)
            Angles over the angle of one step.

        Returns
        -------
        ndarray of bool, shape (K,)
        """
        seen = (self.position - origin) @ rotation.T
        before = (seen[self.triangles, 2] > 0).all(axis=1)
        if not before.any():
            return np.zeros(len(steps), bool)
        corners = seen[self.triangles[before]]
        images = (project(seen, laser.mirror_offset) / laser.step)[self.triangles[before]]
        least, most = images.min(axis=1), images.max(axis=1)
        bend = BEND * (most - least).max(axis=1, keepdims=True) + ROUNDING
        beam, triangle = Bins.from_boxes(least - bend, most + bend).pairs(steps)
        hit = np.zeros(len(steps), bool)
        for low in range(0, len(beam), AT_ONCE):
            own = slice(low, low + AT_ONCE)
            met = _meets(steps[beam[own]], corners[triangle[own]], laser)
            hit[beam[own][met]] = True
        return hit

    def crossings(
        self,
        point: Array,
        direction: Array,
        rotation: Array,
        origin: Array,
        laser: TwoMirror,
        reach: float,
        nearest: int = 4,
    ) -> Crossings:
        """Find where scan lines leave the part, going along them.

        Parameters
        ----------
        point, direction : ndarray, shape (line, 2), steps and unit vectors
        rotation : ndarray, shape (3, 3)
            World to laser.
        origin : ndarray, shape (3,), m
        reach : float, steps
            How far from its point a line is followed to both sides.
        nearest : int
            Most edges that are looked at on each line, the nearest first.

        Examples
        --------
        >>> square = [[-0.1, -0.1, 2], [0.1, -0.1, 2], [0.1, 0.1, 2], [-0.1, 0.1, 2]]
        >>> part = PartOutline.from_mesh(square, np.array([[0, 1, 2], [0, 2, 3]]))
        >>> right = np.array([[0.0, 1.0]])
        >>> pose = np.eye(3), np.zeros(3), TwoMirror()
        >>> part.crossings(np.array([[0.0, 460.0]]), right, *pose, reach=30).along.round(1)
        array([9.])
        """
        pieces = self.pieces(rotation, origin, laser)
        line, piece = _met(pieces.steps, point, direction, reach, nearest)
        found = _placed(pieces, piece, point[line], direction[line], rotation, origin, laser)
        along, jacobian, good = found
        good &= np.abs(along) <= reach
        line, piece, along, jacobian = line[good], piece[good], along[good], jacobian[good]
        at = point[line] + along[:, None] * direction[line]
        aside = BESIDE / float(laser.step.mean()) * direction[line]
        both = self.covers(np.concatenate([at - aside, at + aside]), rotation, origin, laser)
        inside, beyond = np.split(both, 2)
        kept = inside & ~beyond
        return Crossings(line[kept], along[kept], jacobian[kept], pieces.edge[piece[kept]])

    def outline(
        self, rotation: Array, origin: Array, laser: TwoMirror, count: int
    ) -> tuple[Array, Array]:
        """Spread places evenly along the whole outline.

        Returns
        -------
        point : ndarray, shape (count, 2), steps
        outward : ndarray, shape (count, 2)
            Unit vectors across the outline, away from the part.

        Raises
        ------
        UserError
            If no part of it is before the instrument.

        Examples
        --------
        >>> square = [[-0.1, -0.1, 2], [0.1, -0.1, 2], [0.1, 0.1, 2], [-0.1, 0.1, 2]]
        >>> part = PartOutline.from_mesh(square, np.array([[0, 1, 2], [0, 2, 3]]))
        >>> point, outward = part.outline(np.eye(3), np.zeros(3), TwoMirror(), 8)
        >>> bool((np.sum(point * outward, axis=1) > 400).all())
        True
        """
        pieces = self.pieces(rotation, origin, laser)
        middle = pieces.steps.mean(axis=1)
        ahead = pieces.steps[:, 1] - pieces.steps[:, 0]
        length = np.linalg.norm(ahead, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            normal = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1) / length[:, None]
        aside = BESIDE / float(laser.step.mean()) * normal
        both = np.concatenate([middle + aside, middle - aside])
        left, right = np.split(self.covers(both, rotation, origin, laser), 2)
        seen = (left != right) & (length > 0)
        if not seen.any():
            raise UserError("no outline of the part is before the instrument")
        ends = np.cumsum(length[seen])
        at = ends[-1] * (np.arange(count) + 0.5) / count
        own = np.minimum(np.searchsorted(ends, at), len(ends) - 1)
        share = 1 - (ends[own] - at) / length[seen][own]
        point = pieces.steps[seen][own, 0] + share[:, None] * ahead[seen][own]
        outward = np.where(left[seen][own, None], -1.0, 1.0) * normal[seen][own]
        return point, outward


def _meets(steps: Array, corners: Array, laser: TwoMirror) -> BoolArray:
    """Tell which beams meet their triangles, shape (pair,).

    Parameters
    ----------
    steps : ndarray, shape (pair, 2)
    corners : ndarray, shape (pair, 3, 3), m
        In the laser frame.
    """
    start, along = rays(steps * laser.step, laser.mirror_offset)
    first = corners[:, 0]
    one, other = corners[:, 1] - first, corners[:, 2] - first
    normal = np.cross(one, other)
    height = np.sum(along * normal, axis=1)
    # Moeller and Trumbore: weights of the corners where the beam meets the plane.
    to_first = first - start
    turned = np.cross(along, to_first)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.sum(to_first * normal, axis=1) / height
        u = -np.sum(turned * other, axis=1) / height
        v = np.sum(turned * one, axis=1) / height
        inside = (u >= -ROUNDING) & (v >= -ROUNDING) & (u + v <= 1 + ROUNDING)
    return np.asarray(inside & (distance > 0))


def _met(
    steps: Array, point: Array, direction: Array, reach: float, nearest: int
) -> tuple[IndexArray, IndexArray]:
    """Find pieces that scan lines cross within reach, the nearest few of each line."""
    chunk = max(1, AT_ONCE // max(len(steps), 1))
    found = []
    for low in range(0, len(point), chunk):
        own = slice(low, low + chunk)
        line, piece = _met_at_once(steps, point[own], direction[own], reach, nearest)
        found.append((line + low, piece))
    line, piece = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return line, piece


def _met_at_once(
    steps: Array, point: Array, direction: Array, reach: float, nearest: int
) -> tuple[IndexArray, IndexArray]:
    """Find the same of a few scan lines."""
    x, y = np.moveaxis(steps, -1, 0)  # (piece, end)
    u, v = direction.T[..., None]

    def aside(end: int) -> Array:
        """Distances of ends from the straight lines, shape (line, piece)."""
        return np.asarray(u * (y[:, end] - point[:, 1:]) - v * (x[:, end] - point[:, :1]))

    one, other = aside(0), aside(1)
    # A piece holds its first end, so that a line through a corner meets one piece.
    line, piece = np.nonzero((one < 0) != (other < 0))
    one, other = one[line, piece], other[line, piece]
    ahead = np.sum(direction[line, None] * (steps[piece] - point[line, None]), axis=-1)
    along = np.abs(ahead[:, 0] + one / (one - other) * (ahead[:, 1] - ahead[:, 0]))
    near = along <= reach + 1
    line, piece, along = line[near], piece[near], along[near]
    order = np.lexsort((along, line))
    line, piece = line[order], piece[order]
    rank = np.arange(len(line)) - np.searchsorted(line, line)
    return line[rank < 2 * nearest], piece[rank < 2 * nearest]


def _placed(
    pieces: Pieces,
    piece: IndexArray,
    point: Array,
    direction: Array,
    rotation: Array,
    origin: Array,
    laser: TwoMirror,
) -> tuple[Array, Array, BoolArray]:
    """Place crossings exactly; differentiate them; tell which do not graze their edge."""
    start = pieces.ends[piece, 0]
    ahead = pieces.ends[piece, 1] - start
    share = np.full(len(piece), 0.5)

    def cross(a: Array, b: Array) -> Array:
        return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])

    for k in range(STEPS + 1):
        seen = (start + share[:, None] * ahead - origin) @ rotation.T
        by_place = project_jacobian(seen, laser.mirror_offset)[0] / laser.step[:, None]
        away = project(seen, laser.mirror_offset) / laser.step - point
        tangent = np.einsum("kij,kj->ki", by_place, ahead @ rotation.T)
        if k < STEPS:
            slope = cross(tangent, direction)
            share = share - cross(away, direction) / np.where(slope == 0, np.inf, slope)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    across = np.sum(normal * direction, axis=1)
    good = np.abs(across) > np.sqrt(1 - GRAZING**2)
    across = np.where(good, across, 1.0)
    moved = np.concatenate([-skew(seen), np.broadcast_to(-rotation, (len(seen), 3, 3))], axis=-1)
    jacobian = np.einsum("ki,kij->kj", normal, by_place @ moved) / across[:, None]
    return np.sum(away * direction, axis=1), jacobian, good


def steps_of_dac(dac: ArrayLike, laser: TwoMirror) -> Array:
    """Give the angles of DAC steps over the angle of one step.

    Examples
    --------
    >>> steps_of_dac([[100.0, -20.0]], TwoMirror()).round(6)
    array([[100., -20.]])
    """
    return np.asarray(laser.angle_from_dac(dac) / laser.step)
