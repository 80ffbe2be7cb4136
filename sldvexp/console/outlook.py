"""Predictions from the marks of a view: where the next ones lie, how far each is off, and outlines.

A view whose rough pose the scan has is predicted by that at once, and better with every mark
(`sldvexp.laser.corrected_pose`). Without one, places whose coordinates are known, circles and
fiducials, give a pose from the third on (`sldvexp.pose.Aiming`); with four or more marks that pose
is taken in any case. By it the outlines of the calibration object and of the structure are drawn.
The region that is imaged is the box around the scan's `corners_at` as seen, or else around the
structure's surface.
"""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.console.marks import CIRCLE, CORNER, FIDUCIAL, Name, Steps, configured, parts_of
from sldvexp.console.misfit import MarkMisfit, misfits_of
from sldvexp.console.spots import CirclePattern, SpotsSeen, assign
from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose, euler_from_rotation, rotation_from_euler
from sldvexp.laser import beyond_told, corrected_pose, dac_jacobian, dac_of_points
from sldvexp.laser.aiming import FOUND, ROUGH
from sldvexp.pose import Aiming, AimingPlace
from sldvexp.pose.aiming import FEWEST, SURE, pointing_of
from sldvexp.pose.rough_pose import RoughPose, predicted_angles, predicted_steps
from sldvexp.scan.by_hand import ByHand
from sldvexp.scan.lines import box_corners
from sldvexp.scan.rectangle import Rectangle
from sldvexp.session.by_person import known_marks
from sldvexp.targets import Circles, unseen_circles
from sldvexp.targets.base import std_of_bound
from sldvexp.typing import Array, IntArray

log = logging.getLogger(__name__)

#: Distance by which a rough pose may be wrong, m.
NEAR = 0.3
#: Places that cannot be aimed at of which is told in words.
MOST_TOLD = 2
#: What circles that cannot be aimed at mean for the scan.
ALL_CIRCLES = "The scan needs every circle: turn the instrument, or stand where all are seen."
#: How places are come to that may be elsewhere.
OTHERWISE = " Go there (g) again goes to where it may be instead."
#: Pixels of the picture in which circles are marked, across the board's range.
PIXELS = 640
#: Points of a circle's outline, and of a structure's at most.
ROUND, MOST = 24, 200


@dataclass
class Foresight:
    """Predictions from the marks of a view.

    Parameters
    ----------
    predicted : dict of (kind, number) to pair
        DAC steps of places, also of those that are marked.
    instead : dict of (kind, number) to list of pair
        DAC steps at which places that are not marked may be instead.
    misfit : dict of (kind, number) to MarkMisfit
        Marks beside where the others put them.
    outlines : list of ndarray, shape (point, 2), steps
    out : dict of (kind, number) to str
        Places that are not marked and cannot be: what they are instead.
    told : str
        Of the pose, in some sentences.
    wrong : str
        Which marks contradict one another; empty if none do.
    """

    predicted: dict[Name, Steps] = field(default_factory=dict)
    instead: dict[Name, list[Steps]] = field(default_factory=dict)
    misfit: dict[Name, MarkMisfit] = field(default_factory=dict)
    outlines: list[Array] = field(default_factory=list)
    out: dict[Name, str] = field(default_factory=dict)
    told: str = ""
    wrong: str = ""


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
        self.rough = experiment.scan.rough_poses()
        self.configured = configured(experiment)
        target, volume = experiment.target, experiment.volume
        self.circles = target if isinstance(target, Circles) else None
        self.rims = [] if self.circles is None else circle_rims(self.circles)
        self.structure = [] if volume is None else surface_outlines(volume)
        parts = (p for p in parts_of(experiment).values() if isinstance(p, Rectangle))
        self.region = next(parts, None)

    def of(
        self, marks: Mapping[Name, Steps], view: str, seen: SpotsSeen | None = None
    ) -> Foresight:
        """Tell what the marks of a view tell, and its rough pose, and what was seen beside it."""
        try:
            found = self._foresight(marks, view, seen or SpotsSeen())
        except (UserError, np.linalg.LinAlgError) as error:
            # What cannot be foreseen shall not hide what was marked.
            log.debug("foreseeing the marks of the view %s", view, exc_info=True)
            found = Foresight(told=f"Nothing is predicted: {error}.")
        found.out = {name: why for name, why in found.out.items() if name not in marks}
        if found.out:
            each = [f"{self.places[name].name} is {why}" for name, why in found.out.items()]
            told = "; ".join(each[:MOST_TOLD])
            more = f", and {len(each) - MOST_TOLD} more as the list says" * (len(each) > MOST_TOLD)
            needed = f" {ALL_CIRCLES}" if any(kind == CIRCLE for kind, _ in found.out) else ""
            found.told += f" {told[0].upper()}{told[1:]}{more}.{needed}"
        return found

    def _foresight(self, marks: Mapping[Name, Steps], view: str, seen: SpotsSeen) -> Foresight:
        """Tell the same, without what cannot be aimed at."""
        known = {name: steps for name, steps in marks.items() if name in self.places}
        rough = self.rough.get(view)
        aiming = self._aiming(rough)
        for name, steps in known.items():
            aiming.take(self.places[name].name, steps)
        refuted = aiming.refuted
        near = len(known) < SURE and (rough is not None and self._near(view, aiming.poses))
        if refuted or near:
            right = {k: dac for k, dac in known.items() if self.places[k].name not in refuted}
            return self._by_rough_pose(right, view, aiming.contradiction(), seen)
        if aiming.pose is None:
            wrong = aiming.contradiction()
            told = aiming.weakness() or wrong or self._more(len(known), view)
            return Foresight(told=told, wrong=wrong)
        found = self._foreseen(aiming.poses, view)
        misfits = misfits_of(aiming, aiming.taken, self._aiming)
        for name, place in self.places.items():
            if place.name in misfits:
                found.misfit[name] = misfits[place.name]
                found.predicted[name] = misfits[place.name].expected
            elif name not in found.out and name not in marks:
                with suppress(UserError):  # the mirrors do not reach it, or nobody knows yet
                    expected = aiming.predict(place.name)
                    found.predicted[name] = expected.steps
                    found.instead[name] = [_steps(dac) for dac in expected.others]
        std = np.sqrt(np.diag(aiming.pose.covariance)[3:]).max()
        told = f"The instrument stands at about {_metres(aiming.pose.origin, std)}."
        found.wrong = aiming.contradiction()
        doubt = found.wrong or aiming.weakness()
        found.told = f"{told} But {doubt}." if doubt else told
        found.told += OTHERWISE * any(found.instead.values())
        return found

    def _aiming(self, rough: KnownPose | None = None) -> Aiming:
        """Begin to aim at all places."""
        return Aiming(self.laser, list(self.places.values()), self._pointing(), rough)

    def _more(self, known: int, view: str) -> str:
        """Say what marks are for, before there are enough of them."""
        if not self.places or known >= FEWEST:
            return ""
        one = next(iter(self.places.values())).name.partition(" ")[0]
        own = "The experiment has steps of this view, which Scan uses where nothing is marked. "
        own *= view in self.configured and not known
        left = FEWEST - known
        which = f"{left} {one}s{' more' * bool(known)}, which do not all lie in a line, tell"
        if left == 1:
            which = f"One {one} more, beside the line of these, tells"
        return f"{own}{which} where the others lie."

    def _pointing(self) -> float:
        """Say how well places are pointed at, steps: at circles to half a pixel of the picture."""
        low, high = self.laser.board.value
        return (high - low) / PIXELS / 2 if self.rims else pointing_of(self.laser)

    def _near(self, view: str, poses: Sequence[RoughPose]) -> bool:
        """Tell whether a view's rough pose is among those that few marks allow."""
        place = self.rough[view].place
        return not poses or any(np.linalg.norm(pose.origin - place) < NEAR for pose in poses)

    def _by_rough_pose(
        self, known: Mapping[Name, Steps], view: str, wrong: str, seen: SpotsSeen
    ) -> Foresight:
        """Predict by a view's rough pose, corrected by marks and by spots of looks."""
        rough = self.rough[view].rotation, self.rough[view].place
        pose = self._corrected(rough, {name: (dac, FOUND) for name, dac in known.items()})
        spots, unsure = self._spots(pose, known, seen)
        if spots:
            marked: dict[Name, tuple[Array | Steps, float]] = {}
            marked |= {name: (dac, FOUND) for name, dac in known.items()}
            pose = self._corrected(rough, {**marked, **spots})
        likely = RoughPose(*pose, np.zeros((6, 6)), cost=0, dof=0, probability=1)
        found = self._foreseen([likely], view)
        place = f"the instrument stands at about {_metres(pose[1])}."
        each = [f"{len(known)} mark{'s' * (len(known) > 1)}"] * bool(known)
        each += [f"{len(spots)} spot{'s' * (len(spots) > 1)} of the look"] * bool(spots)
        if not each and not wrong:
            searched = " Circles are searched from there: scan at once," if self.rims else " Scan,"
            ways = f"{searched} or take marks where they are known." if not found.out else ""
            found.told = f"By the scan's rough pose {place}{ways}"
        elif not each:
            found.told = f"By the scan's rough pose {place}"
        else:
            found.told = f"By the scan's rough pose, corrected by {' and '.join(each)}, {place}"
        found.instead = unsure
        found.told += _unsure_told({self.places[k].name: len(each) for k, each in unsure.items()})
        found.told += f" But {wrong}." if wrong else ""
        found.wrong = wrong
        return found

    def _corrected(
        self, rough: tuple[Array, Array], found: Mapping[Name, tuple[Array | Steps, float]]
    ) -> tuple[Array, Array]:
        """Correct a rough pose by places that were found at steps, to standard deviations."""
        if not found:
            return rough
        points = np.array([self.places[name].position for name in found])
        dac = np.array([place for place, _ in found.values()], float)
        std = np.array([[std] for _, std in found.values()])
        names = [self.places[name].name for name in found]
        with suppress(UserError):  # marks that no pose near this one explains
            return corrected_pose(points, dac, *rough, self.laser, names, std)
        return rough

    def _spots(
        self, pose: tuple[Array, Array], known: Mapping[Name, Steps], seen: SpotsSeen
    ) -> tuple[dict[Name, tuple[Array, float]], dict[Name, list[Steps]]]:
        """Say which circles are which spots, to standard deviations, and where others may be.

        Circles that are marked are where they are marked; no other one is what is seen there.
        """
        spots, circles = seen.spots, [name for name in self.places if name[0] == CIRCLE]
        if not spots or not circles:
            return {}, {}
        points = np.array([self.places[name].position for name in circles])
        names = [self.places[name].name for name in circles]
        try:
            dac = dac_of_points(points, *pose, self.laser, names)
        except UserError:  # not all are within reach from there
            return {}, {}
        jacobian = dac_jacobian(points, *pose, self.laser)
        likely = RoughPose(*pose, np.zeros((6, 6)), cost=0, dof=0, probability=1)
        area = np.array([_area(predicted_steps([likely], r, self.laser)[0]) for r in self.rims])
        marked = np.array([name in known for name in circles])
        rows = jacobian[marked].reshape(-1, 6) / self._pointing()
        pattern = CirclePattern(dac, jacobian, area, np.diag(ROUGH**-2.0) + rows.T @ rows)
        found = assign(pattern, spots, seen)
        sure = {
            circles[k]: (spots[j].dac, float(np.hypot(spots[j].std, self._pointing())))
            for k, j in found.spots.items()
            if not marked[k]
        }
        free = ((k, each) for k, each in found.open.items() if not marked[k])
        return sure, {circles[k]: [_steps(spots[j].dac) for j in each] for k, each in free}

    def _foreseen(self, poses: Sequence[RoughPose], view: str) -> Foresight:
        """Predict all places, outlines and corners by the likeliest poses."""

        def seen(points: Array) -> Array:
            return predicted_steps(poses, points, self.laser)[0]

        found = Foresight(out=self._out(poses))
        for name, place in self.places.items():
            dac = seen(place.position[None])[0]
            if np.isfinite(dac).all() and name not in found.out:
                found.predicted[name] = _steps(dac)
        outlines = [seen(points) for points in (*self.rims, *self.structure)]
        found.outlines = [dac[np.isfinite(dac).all(axis=1)] for dac in outlines]
        if CORNER in self.wanted:
            corners = self._region(poses[0], view) or self._box(found.outlines[len(self.rims) :])
            found.predicted |= {(CORNER, k): (u, v) for k, (u, v) in enumerate(corners, 1)}
        return found

    def _out(self, poses: Sequence[RoughPose]) -> dict[Name, str]:
        """Say of places why nobody can aim at them: they show their back, or are out of reach."""
        hidden = {} if self.circles is None else unseen_circles(poses[0].origin, self.circles)
        found = {(CIRCLE, number): why for number, why in hidden.items()}
        points = np.array([place.position for place in self.places.values()]).reshape(-1, 3)
        angles, _ = predicted_angles(poses, points, self.laser)
        for name, angle in zip(self.places, angles, strict=True):
            if name not in found and (beyond := beyond_told(angle, self.laser)):
                found[name] = beyond
        return found

    def _region(self, pose: RoughPose, view: str) -> list[list[int]]:
        """Say the corners of the scan's own region; none if it has none, or not all is seen."""
        if self.region is None:
            return []
        at = KnownPose(euler_from_rotation(pose.rotation).tolist(), pose.origin.tolist())
        with suppress(UserError):
            corners: list[list[int]] = self.region.box(view, at, self.laser).tolist()
            return corners
        return []

    def _box(self, structure: list[Array]) -> list[list[int]]:
        """Lay the box of the region that is imaged around the structure."""
        if not structure or not all(len(s) for s in structure):
            return []
        low, high = self.laser.board.value
        seen = np.clip(np.concatenate(structure), low, high)
        ends = np.floor(seen.min(axis=0)), np.ceil(seen.max(axis=0))
        box: list[list[int]] = box_corners(*ends, self.laser.ways).tolist()
        return box


def _steps(dac: Array) -> Steps:
    return round(float(dac[0])), round(float(dac[1]))


def _area(outline: Array) -> float:
    """Compute the area within an outline, squared; NaN of one that is not wholly known."""
    x, y = (outline - outline.mean(axis=0)).T
    return float(abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2)


def _unsure_told(unsure: Mapping[str, int]) -> str:
    """Say of which places the look leaves open which spot they are.

    Examples
    --------
    >>> _unsure_told({"circle 1": 2})[:60]
    ' 2 spots of the look are near circle 1: which? Look at a wid'
    """
    near = {name: count for name, count in unsure.items() if count > 1}
    if near:
        which = " and ".join(f"{count} spots of the look are near {n}" for n, count in near.items())
    elif unsure:
        which = f"a spot of the look may be {' or '.join(unsure)}"
    else:
        return ""
    ways = f"Look at a wider part, or take a sure one first.{OTHERWISE}"
    return f" {which[0].upper()}{which[1:]}: which? {ways}"


def _metres(point: Array, std: float | None = None) -> str:
    """Write a place, and how sure it is, with as many digits as that has.

    Examples
    --------
    >>> _metres(np.array([0.0412, 1.09, 0.985]), 0.00571)
    '(0.0412, 1.0900, 0.9850) m, to a standard deviation of 0.0057 m'
    """
    sure = std is not None and np.isfinite(std) and std > 0
    digits = max(2, 1 - math.floor(math.log10(std))) if std is not None and sure else 2
    place = "(" + ", ".join(f"{x:.{digits}f}" for x in point) + ") m"
    return f"{place}, to a standard deviation of {std:.{digits}f} m" if sure else place


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
    count = int(edges.max(initial=0)) + 1
    ahead, back = edges @ [count, 1], edges @ [1, count]  # a number for each edge and its reverse
    alone = np.unique(ahead[~np.isin(ahead, back)])
    following: dict[int, list[int]] = defaultdict(list)
    for a, b in zip(*(of.tolist() for of in divmod(alone, count)), strict=True):
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
