"""Structure: the surface that is measured, with what goes on beyond it, which hides what is behind.

The beam from O to P meets the triangle a, b, c at

    O + s (P - O) = a + u (b - a) + v (c - a),

inside where u, v and 1 - u - v are not negative (Moeller and Trumbore), and P is hidden if s lies
between 0 and the part of the way that ends a little before P. Only beams that cross the box around
the structure, along its own axes, can meet it: of a plate these are few.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.typing import Array, BoolArray
from sldvexp.volume import Prisms

#: Pairs of beams and triangles that are tried together.
AT_ONCE = 200_000
#: By how much the box is wider than what it holds, m.
PAD = 1e-3
#: Round-off of a beam through the common edge of two triangles.
EDGE = 1e-9
#: Corners of a region that is a plane one, and of one before and one behind a body.
PLANE, BODY = 4, 8


@dataclass(frozen=True, eq=False)
class Structure:
    """Triangles that stop beams.

    Parameters
    ----------
    corners : ndarray, shape (triangle, 3, 3), m
    axes : ndarray, shape (3, 3)
        Unit rows, of the box around them.
    """

    corners: Array
    axes: Array

    @classmethod
    def from_surface(cls, prisms: Prisms, region: Array) -> Structure:
        """Take the surface, and the region that is scanned of it, which goes on beyond.

        Parameters
        ----------
        region : ndarray, shape (corner, 3), m
            Of a body one around its front, then one around its back: the surface is between.
        """
        corners = prisms.surface[prisms.triangles]
        if len(region) == BODY:
            region = (region[:PLANE] + region[PLANE:]) / 2
        if len(region) == PLANE:
            a, b, c, d = region
            corners = np.concatenate([corners, np.array([[a, b, c], [a, c, d]])])
        return cls(corners, prisms.frame[0])

    def hides(self, origins: Array, points: Array, before: float) -> BoolArray:
        """Tell which points the structure hides from stands, shape (stand, point).

        Parameters
        ----------
        origins : ndarray, shape (stand, 3), m
        points : ndarray, shape (point, 3), m
        before : float, m
            Along the beam: what is nearer to a point than this does not hide it.

        Examples
        --------
        >>> a, b, c, d = [0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]
        >>> plate = Structure(np.array([[a, b, c], [a, c, d]]), np.eye(3))
        >>> points = np.array([[0.5, 0.5, -0.1], [0.5, 0.5, 0.1], [1.5, 0.5, -0.1]])
        >>> plate.hides(np.array([[0.5, 0.5, 1.0]]), points, 0.002).tolist()
        [[True, False, False]]
        """
        hidden = np.zeros((len(origins), len(points)), bool)
        near, mark = np.nonzero(self._may_hide(origins, points))
        size = max(1, AT_ONCE // len(self.corners))
        for k in range(0, len(near), size):
            stand, point = near[k : k + size], mark[k : k + size]
            way = points[point] - origins[stand]
            until = 1 - before / np.linalg.norm(way, axis=1)
            hidden[stand, point] = (self._met(origins[stand], way) < until[:, None]).any(axis=1)
        return hidden

    def _may_hide(self, origins: Array, points: Array) -> BoolArray:
        """Tell which beams cross the box around the structure."""
        held = self.corners.reshape(-1, 3) @ self.axes.T
        low, high = held.min(axis=0) - PAD, held.max(axis=0) + PAD
        return crosses(origins @ self.axes.T, points @ self.axes.T, low, high)

    def _met(self, origins: Array, ways: Array) -> Array:
        """Find the part of each way at which each triangle is met, infinite if it is not.

        Shape (beam, triangle).
        """
        a, ab, ac = self.corners[:, 0], *(self.corners[:, k] - self.corners[:, 0] for k in (1, 2))
        normal, turned = np.cross(ab, ac), np.cross(ways, origins)
        # Triple products, of sums over the coordinates alone: no array of beams by triangles by 3.
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / (ways @ normal.T)
            u = inverse * (turned @ ac.T - ways @ np.cross(a, ac).T)
            v = inverse * (ways @ np.cross(a, ab).T - turned @ ab.T)
            part = inverse * (np.einsum("ti,ti->t", a, normal) - origins @ normal.T)
            inside = (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1 + EDGE) & (part > 0)
        return np.where(inside, part, np.inf)


def crosses(origins: Array, points: Array, low: ArrayLike, high: ArrayLike) -> BoolArray:
    """Tell which ways from stands to points cross a box, shape (stand, point).

    A way ``O + s (P - O)`` is between the two planes of an axis for an interval of s; it crosses
    the box if the three intervals and that from 0 to 1 have something in common.
    """
    begin, way = origins[:, None], points[None] - origins[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (np.asarray(low) - begin) / way, (np.asarray(high) - begin) / way
    enters = np.fmax(np.fmin(one, other).max(axis=-1), 0.0)
    leaves = np.fmin(np.fmax(one, other).min(axis=-1), 1.0)
    return np.asarray(enters < leaves)
