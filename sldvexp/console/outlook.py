"""Predictions from the marks of a view: where the next ones lie, how far each is off, and outlines.

Places whose coordinates are known, circles and fiducials, give a rough pose from the third on
(`sldvexp.pose.Aiming`). By it the outlines of the calibration object and of the structure are
drawn, and the region that is imaged is the box of DAC steps around the structure's surface.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.console.marks import CIRCLE, CORNER, FIDUCIAL, Name, Steps, parts_of
from sldvexp.errors import UserError
from sldvexp.geometry import rotation_from_euler
from sldvexp.pose import Aiming, AimingPlace
from sldvexp.scan.by_hand import ByHand
from sldvexp.session.by_person import known_marks
from sldvexp.targets import Circles
from sldvexp.targets.base import std_of_bound
from sldvexp.typing import Array, IntArray

#: Points of a circle's outline, and of a structure's at most.
ROUND, MOST = 24, 200


@dataclass
class Foresight:
    """Predictions from the marks of a view.

    Parameters
    ----------
    predicted : dict of (kind, number) to pair
        DAC steps of places, also of those that are marked.
    residual : dict of (kind, number) to float
        Steps by which a mark is off where the others put it.
    outlines : list of ndarray, shape (point, 2), steps
    told : str
        Of the pose, in a sentence or two.
    """

    predicted: dict[Name, Steps] = field(default_factory=dict)
    residual: dict[Name, float] = field(default_factory=dict)
    outlines: list[Array] = field(default_factory=list)
    told: str = ""


class Outlook:
    """Predicts from the marks of a view.

    Parameters
    ----------
    experiment : Experiment
    wanted : dict of str to list of int
        Numbers of the places by their kinds.
    """

    def __init__(self, experiment: Experiment, wanted: Mapping[str, list[int]]) -> None:
        self.laser = experiment.laser
        self.wanted = wanted
        self.places = known_places(experiment, wanted)
        target, volume = experiment.target, experiment.volume
        self.rims = circle_rims(target) if isinstance(target, Circles) else []
        self.structure = [] if volume is None else surface_outlines(volume)

    def of(self, marks: Mapping[Name, Steps]) -> Foresight:
        """Tell what the marks of a view tell."""
        found = Foresight()
        aiming = Aiming(self.laser, list(self.places.values()))
        for name, place in self.places.items():
            if name in marks:
                aiming.take(place.name, marks[name])
        if not aiming.pose:
            found.told = aiming.weakness() or aiming.contradiction()
            return found
        for name, place in self.places.items():
            if name in marks and (off := aiming.residual(place.name)) is not None:
                found.residual[name] = float(np.hypot(*off.steps))
            try:
                found.predicted[name] = aiming.predict(place.name).steps
            except UserError:  # it cannot be seen from here
                continue
        found.outlines = [self._seen(aiming, rim) for rim in (*self.rims, *self.structure)]
        found.predicted |= self._corners(found.outlines[len(self.rims) :])
        x, y, z = aiming.pose.origin
        std = np.sqrt(np.diag(aiming.pose.covariance)[3:]).max()
        told = f"The instrument stands at about ({x:.2f}, {y:.2f}, {z:.2f}) m +- {std:.2g}."
        wrong = aiming.contradiction() or aiming.weakness()
        found.told = f"{told} But {wrong}." if wrong else told
        return found

    def _seen(self, aiming: Aiming, points: Array) -> Array:
        dac, _ = aiming.steps_at(points)
        return dac[np.isfinite(dac).all(axis=1)]

    def _corners(self, structure: list[Array]) -> dict[Name, Steps]:
        """Lay the box of the region that is imaged around the structure."""
        if CORNER not in self.wanted or not structure or not all(len(s) for s in structure):
            return {}
        low, high = self.laser.board.value
        seen = np.clip(np.concatenate(structure), low, high)
        a, b = np.floor(seen.min(axis=0)).astype(int), np.ceil(seen.max(axis=0)).astype(int)
        corners = [(a[0], a[1]), (a[0], b[1]), (b[0], b[1]), (b[0], a[1])]
        return {(CORNER, k): (int(u), int(v)) for k, (u, v) in enumerate(corners, 1)}


def known_places(
    experiment: Experiment, wanted: Mapping[str, list[int]]
) -> dict[Name, AimingPlace]:
    """List places whose coordinates are known, by kind and number."""
    found: dict[Name, AimingPlace] = {}
    target = experiment.target
    if CIRCLE in wanted and isinstance(target, Circles):
        std = np.full(3, target.unit.value * std_of_bound(target.accuracy))
        for number, rim in zip(sorted(target.circles), circle_rims(target), strict=True):
            place = AimingPlace(f"circle {number}", rim.mean(axis=0), std)
            found[CIRCLE, number] = place
    for part in parts_of(experiment).values():
        for mark in known_marks(part, target) if isinstance(part, ByHand) else ():
            place = AimingPlace(f"mark {mark.number}", mark.position, mark.std)
            found[FIDUCIAL, mark.number] = place
    return found


def circle_rims(target: Circles) -> list[Array]:
    """Place points evenly around the edge of every circle, in the order of numbers, m."""
    angle = 2 * np.pi * np.arange(ROUND) / ROUND
    rims = []
    for number in sorted(target.circles):
        circle = target.circles[number]
        plane = target.planes[circle.plane]
        x, y, _ = plane.axes()
        across, up = (
            np.outer(f(angle) * circle.diameter / 2, e) for f, e in ((np.cos, x), (np.sin, y))
        )
        centre = np.array(plane.origin, float) + circle.x * x + circle.y * y
        rims.append(target.unit.value * (centre + across + up))
    return rims


def surface_outlines(volume: Any) -> list[Array]:
    """Find the rims of a volume's surface in the world, each widened by its margin, m."""
    own = volume.surface()
    to_world = rotation_from_euler(volume.euler)
    position = own.position @ to_world + volume.unit.value * np.array(volume.center, float)
    away = position - position.mean(axis=0)
    length = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), np.finfo(float).tiny)
    # The corner of a margin is sqrt(2) of it away, a side's middle once; the wider is taken.
    wider = position + np.sqrt(2.0) * volume.unit.value * volume.margin * away / length
    loops = rims(own.triangles)
    return [wider[loop[:: max(1, len(loop) // MOST)]] for loop in loops]


def rims(triangles: IntArray) -> list[IntArray]:
    """Chain the edges that belong to one triangle only into closed loops of nodes.

    Examples
    --------
    >>> [loop.tolist() for loop in rims(np.array([[0, 1, 2], [1, 3, 2]]))]
    [[0, 1, 3, 2]]
    """
    edges = np.concatenate([triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    known = {(int(a), int(b)) for a, b in edges}
    following: dict[int, list[int]] = defaultdict(list)
    for a, b in sorted(known):
        if (b, a) not in known:
            following[a].append(b)
    loops = []
    while following:
        start = min(following)
        loop, node = [start], start
        while node in following:
            after = following[node].pop()
            if not following[node]:
                del following[node]
            if after == start:
                break
            loop.append(after)
            node = after
        loops.append(np.array(loop))
    return loops
