"""`volume=revolution`: a closed shell of revolution, as a tube, a cone or a cup without its bottom.

A meridian turns once about the surface's own y axis: nodes stand in rows around it. The first
tangent points around, from the own z axis towards x, the second along the meridian, and the normal
out of the shell if the meridian is given upwards along y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.geometry import Meridian
from sldvexp.typing import Array, IntArray
from sldvexp.volume.base import Volume, vector
from sldvexp.volume.surface import TriangulatedSurface

#: Largest angle, deg, by which the meridian turns from one chord to the next.
TURN = 30.0
#: Fewest nodes around, so that tangents turn little between neighbours.
AROUND = 8


@register("volume", "revolution")
@dataclass
class Revolution(Volume):
    """A surface that closes in itself around an axis, its own y; `center` stands on that axis.

    Parameters
    ----------
    profile : list of [r, y]
        Points of the meridian in their order, each by its distance from the axis and its place
        along it: two of a tube or a cone, more of what bends, which a smooth curve connects.
        Normals point to the right of the way along them, r to the right and y upwards.
    shape : list of 2 int
        Nodes around, and along the meridian.
    tangent : list of 3 float
        As of other volumes; without it the first tangent points around.
    """

    profile: list[Any] = field(default_factory=lambda: [[0.06, -0.1], [0.06, 0.1]])
    shape: list[int] = field(default_factory=lambda: [36, 9])
    tangent: list[float] = field(default_factory=list)

    def check(self, checks: Checks) -> None:
        """Note what no closed shell can be."""
        known = len(checks.problems)
        vector(checks, "shape", list(self.shape), 2)
        for i, (nodes, least) in enumerate(zip(self.shape, (AROUND, 2), strict=False)):
            message = f"must be {least} nodes or more, not {nodes}"
            checks.require(nodes >= least, f"shape[{i}]", message)
        message = f"needs 2 points or more, not {len(self.profile)}"
        checks.require(len(self.profile) >= 2, "profile", message)
        for i, point in enumerate(self.profile):
            pair = isinstance(point, list) and len(point) == 2
            message = f"must be two numbers, [r, y], not {point}"
            checks.require(pair, f"profile[{i}]", message)
            if pair:
                vector(checks, f"profile[{i}]", point, 2)
        if len(checks.problems) == known:
            self._check_profile(checks)
        message = "goes with surfaces that have an edge; a closed one is seen from outside alone"
        checks.require(not self.sight.both_sides, "sight.both_sides", message)

    def _check_tangent(self, checks: Checks) -> None:
        if self.tangent:
            super()._check_tangent(checks)

    def _check_profile(self, checks: Checks) -> None:
        """Refuse meridians that meet the axis, and corners."""
        corners = np.array(self.profile, float)
        steps = np.diff(corners, axis=0)
        for i, step in enumerate(steps):
            there = f"is the point {i} again"
            checks.require(bool(np.any(step != 0)), f"profile[{i + 1}]", there)
        if (steps == 0).all(axis=1).any():
            return
        way = np.degrees(np.arctan2(steps[:, 1], steps[:, 0]))
        turn = np.abs((np.diff(way) + 180) % 360 - 180)
        for i, angle in enumerate(turn, start=1):
            message = (
                f"is a corner: the meridian turns there by {angle:.3g} deg; give more points where "
                "it bends, or end the surface before"
            )
            checks.require(angle <= TURN, f"profile[{i}]", message)
        meridian = Meridian(corners)
        nearest = meridian(meridian.samples)[:, 0].min() - self.margin
        message = (
            "must stay away from the axis, with all of its margin: a shell that is closed at an "
            "end is given without its middle"
        )
        checks.require(bool(nearest > 0), "profile", message)

    @property
    def meridian(self) -> Meridian:
        """Curve that turns about the axis, m."""
        return Meridian(self.unit.value * np.array(self.profile, float))

    def surface(self) -> TriangulatedSurface:
        """Make the surface in its own axes."""
        (around, along), curve = self.shape, self.meridian
        angle = np.repeat(2 * math.pi * np.arange(around) / around, along)
        t = np.tile(np.linspace(-curve.half, curve.half, along), around)
        first = np.stack([np.cos(angle), np.zeros_like(angle), -np.sin(angle)], axis=-1)
        position, normal = _turned(curve(t), angle), _turned(curve.normals(t), angle)
        triangles = _triangles(around, along)
        return TriangulatedSurface(position, triangles, normal, tangent=first)


def _turned(curve: Array, angle: Array) -> Array:
    """Turn vectors (r, y) about the axis, shape (node, 3)."""
    r, y = curve.T
    return np.stack([r * np.sin(angle), y, r * np.cos(angle)], axis=-1)


def _triangles(around: int, along: int) -> IntArray:
    """Make two triangles of each cell, the last row joined to the first, shape (triangle, 3)."""
    i, j = np.meshgrid(np.arange(around), np.arange(along - 1), indexing="ij")
    near, right = (i * along + j).ravel(), ((i + 1) % around * along + j).ravel()
    up, far = near + 1, right + 1
    forward = np.stack([near, right, far, near, far, up], axis=-1)
    backward = np.stack([near, right, up, right, far, up], axis=-1)
    even = ((i + j) % 2 == 0).ravel()
    return np.where(even[:, None], forward, backward).reshape(-1, 3)
