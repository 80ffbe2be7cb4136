"""Marks: the points of the calibration object that a pose is found from, and what hides them.

A circle is lost where the structure is before its rim, or before what rests around it: lines that
are scanned across it go on there. Of single points a pose needs some only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sldvexp.planner.structure import Structure
from sldvexp.targets import Circles, Target
from sldvexp.targets.shadows import SPAN, Discs, hidden_behind_circles, shaded
from sldvexp.typing import Array, BoolArray

#: Points on the rim of each circle that beams must reach.
RIM = 8
#: Points from which a pose follows without any ambiguity; three have several.
ENOUGH = 4
#: How far before a rim, and before a mark that may lie on the structure itself, this must be to
#: hide it, m along the beam.
BEFORE_RIM, BEFORE_MARK = 0.002, 0.01


@dataclass(frozen=True, eq=False)
class TargetMarks:
    """Points of the calibration object that beams must reach.

    Parameters
    ----------
    position : ndarray, shape (mark, 3), m
    normal : ndarray, shape (mark, 3)
        Zero where a mark is seen from everywhere.
    centres : ndarray, shape (circle, 3), m
        Of its circles, which a scan is told of; none of other objects.
    circles : Circles, optional
        The object, if it has circles.
    """

    position: Array
    normal: Array
    centres: Array
    circles: Circles | None = None

    @classmethod
    def from_target(cls, target: Target | None) -> TargetMarks:
        """Take the rims of circles, or the points of any other object."""
        if target is None:
            return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))
        if not isinstance(target, Circles):
            position = target.points().position
            return cls(position, np.zeros_like(position), np.zeros((0, 3)))
        centres, rims, normals = [], [], []
        turn = np.arange(RIM) * 2 * np.pi / RIM
        for number in sorted(target.circles):
            circle = target.circles[number]
            plane = target.planes[circle.plane]
            axes = plane.axes()
            centre = np.array(plane.origin) + np.array([circle.x, circle.y]) @ axes[:2]
            ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ axes[:2]
            centres.append(centre)
            rims.append(centre + circle.diameter / 2 * ring)
            normals.append(np.broadcast_to(axes[2], ring.shape))
        unit = target.unit.value
        rim, normal = unit * np.concatenate(rims), np.concatenate(normals)
        return cls(rim, normal, unit * np.array(centres), target)

    @cached_property
    def discs(self) -> Discs | None:
        """The circles as discs, if it has some."""
        return None if self.circles is None else Discs.from_circles(self.circles)

    def hides(self, origins: Array, points: Array) -> BoolArray:
        """Tell which points the circles hide from stands, (stand, point)."""
        if self.discs is None:
            return np.zeros((len(origins), len(points)), bool)
        return np.asarray(hidden_behind_circles(origins, points, self.discs).any(axis=2))

    def incidences(self, origin: Array) -> dict[int, float]:
        """Find the largest angle of incidence on each circle from a stand, deg, by its number."""
        if self.circles is None:
            return {}
        way = origin - self.position
        cosine = np.sum(way * self.normal, axis=1) / np.linalg.norm(way, axis=1)
        least = cosine.reshape(-1, RIM).min(axis=1)
        angles = np.degrees(np.arccos(np.clip(least, -1, 1)))
        return dict(zip(sorted(self.circles.circles), angles.tolist(), strict=True))

    def hide_themselves(self, origins: Array) -> BoolArray:
        """Tell from which stands a circle is hidden by another one, (stand,)."""
        on_one_plane = self.circles and len({c.plane for c in self.circles.circles.values()}) == 1
        if self.discs is None or on_one_plane:
            return np.zeros(len(origins), bool)
        return np.asarray(shaded(origins, self.discs).any(axis=(1, 2)))

    def hidden_by(self, structure: Structure, origins: Array) -> BoolArray:
        """Tell which circles, or single marks, the structure hides from stands, (stand, mark)."""
        if self.circles is None:
            return structure.hides(origins, self.position, BEFORE_MARK)
        rims = self.position.reshape(-1, RIM, 3)
        middle = self.centres[:, None]
        around = np.concatenate([rims, middle + SPAN * (rims - middle)], axis=1)
        hidden = structure.hides(origins, around.reshape(-1, 3), BEFORE_RIM)
        return np.asarray(hidden.reshape(len(origins), len(rims), 2 * RIM).any(axis=2))

    def too_few(self, hidden: BoolArray) -> BoolArray:
        """Tell from which stands a pose cannot be found, (stand,), by what is hidden from each.

        A scan of circles finds all of them or none.
        """
        count = hidden.shape[1]
        needed = count if self.circles is not None else min(count, ENOUGH)
        return np.asarray((~hidden).sum(axis=1) < needed)
