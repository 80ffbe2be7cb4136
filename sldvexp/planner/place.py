"""Place: the object in its room, and what of it a stand would see, or why not.

A node of the surface is seen if it faces the stand within the incidence allowed, nothing stands in
between, the mirrors reach it, and it is neither too near nor too far. A stand is refused as a whole
if it is outside of the room or in a forbidden part of it, or does not see the whole calibration
object, from whose circles its pose is found, as where one of them or the structure hides another,
or if it does not reach a corner of the region that is to be scanned.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.config.planning import ForbiddenBox, PlanRoom
from sldvexp.errors import UserError
from sldvexp.field.visibility.projection import Occlusion
from sldvexp.field.visibility.view import View
from sldvexp.geometry import golden_sphere
from sldvexp.laser import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.planner.marks import TargetMarks
from sldvexp.planner.stand_limits import StandLimits
from sldvexp.planner.structure import Structure, crosses
from sldvexp.planner.turning import angles_of
from sldvexp.scan import Scan
from sldvexp.scan.rectangle import Rectangle
from sldvexp.scan.session import Session
from sldvexp.typing import Array, BoolArray, IntArray
from sldvexp.volume import Prisms, Volume

#: Nodes that stands are compared on while they are looked for.
NODES_FOR_SEARCH = 150
#: Directions in which the outermost nodes are among them.
OUTWARD = 100
#: Of its extent: height over a tangent plane that is only round-off.
ROUNDING = 1e-6
#: Part by which the region goes beyond what must be in it, so that the outermost nodes have pixels
#: on all sides.
BESIDE = 0.015
#: Depth of an object over its lesser extent, up to which it is flat, and up to which it has none.
FLAT, THIN = 0.2, 1e-3
#: Corners of a region are told to a tenth of a millimetre.
DECIMALS_OF_REGION = 4
#: Incidence up to which the edges of circles are still found well, deg.
OBLIQUE = 72.0


class Unseen(IntEnum):
    """Why a stand does not see a node, or is refused as a whole; `seen` is neither."""

    seen = 0
    behind = 1
    incidence = 2
    hidden = 3
    blocked = 4
    mirrors = 5
    near = 6
    far = 7
    outside = 8
    forbidden = 9
    target_mirrors = 10
    target_incidence = 11
    target_blocked = 12
    behind_target = 13
    target_hidden = 14
    rim_behind_target = 15
    region_mirrors = 16
    target_behind_structure = 17

    @property
    def told(self) -> str:
        """Words of a table."""
        return _TOLD[self]


_TOLD = {
    Unseen.seen: "seen",
    Unseen.behind: "facing away",
    Unseen.incidence: "beyond the incidence allowed",
    Unseen.hidden: "hidden by the surface itself",
    Unseen.blocked: "behind a forbidden box",
    Unseen.mirrors: "beyond the mirrors",
    Unseen.near: "too near",
    Unseen.far: "too far",
    Unseen.outside: "stands outside of the room",
    Unseen.forbidden: "stands in a forbidden box",
    Unseen.target_mirrors: "calibration object beyond the mirrors",
    Unseen.target_incidence: "calibration object too oblique",
    Unseen.target_blocked: "calibration object behind a forbidden box",
    Unseen.behind_target: "hidden by the calibration object",
    Unseen.target_hidden: "a circle of the calibration object hidden by another one",
    Unseen.rim_behind_target: "the structure beside the surface hidden by the calibration object",
    Unseen.region_mirrors: "a corner of the scanned region beyond the mirrors",
    Unseen.target_behind_structure: "calibration object hidden by the structure",
}

#: Settings that each reason comes from, for messages.
SETTING_OF = {
    Unseen.behind: "the normals of the volume",
    Unseen.incidence: "plan.room.incidence",
    Unseen.hidden: "the shape of the volume",
    Unseen.blocked: "plan.room.forbidden",
    Unseen.mirrors: "plan.room.mirrors",
    Unseen.near: "plan.room.distance",
    Unseen.far: "plan.room.distance",
    Unseen.outside: "plan.room.low and plan.room.high",
    Unseen.forbidden: "plan.room.forbidden",
    Unseen.target_mirrors: "plan.room.mirrors with the calibration object",
    Unseen.target_incidence: "plan.room.incidence with the calibration object",
    Unseen.target_blocked: "plan.room.forbidden with the calibration object",
    Unseen.behind_target: "the shape of the calibration object",
    Unseen.target_hidden: "the shape of the calibration object",
    Unseen.rim_behind_target: "volume.margin with the shape of the calibration object",
    Unseen.region_mirrors: "plan.room.mirrors with corners_at of the scanned region",
    Unseen.target_behind_structure: "the structure before the calibration object",
}


@dataclass(frozen=True, eq=False)
class Place:
    """Object, calibration object, laser and room.

    Parameters
    ----------
    nodes : ndarray, shape (node, 3), m
        Of the surface: some of them, or all.
    frame : ndarray, shape (node, 3, 3)
    outline : ndarray, shape (point, 3), m
        Corners of all that is imaged: the volume's outermost layers and their margin.
    region : ndarray, shape (corner, 3), m
        Corners of the region that the scan is told of in the world; none without.
    """

    nodes: Array
    frame: Array
    outline: Array
    region: Array
    marks: TargetMarks
    laser: TwoMirror
    room: PlanRoom
    both_sides: bool
    surface: Prisms
    clearance: float | None

    @classmethod
    def from_experiment(cls, experiment: Experiment, new_stands: bool = True) -> Place:
        """Take the object and its room from a configuration.

        Parameters
        ----------
        new_stands : bool
            Whether limits of the room that nothing says are the usual ones, or none.

        Raises
        ------
        UserError
            If there is no volume or no laser, or a forbidden box holds the object.
        """
        volume: Volume | None = experiment.volume
        if volume is None:
            raise UserError(
                "plan: there is no volume, so that nobody knows what is to be seen; choose one "
                "with volume=grid, volume=mesh ..., or an experiment that has one"
            )
        if experiment.laser is None:
            raise UserError("plan: there is no laser, whose mirrors limit where it can stand")
        prisms = volume.prisms()
        marks = TargetMarks.from_target(experiment.target)
        room = experiment.plan.room
        grazing = np.cos(np.radians(room.incidence))
        place = cls(
            prisms.surface,
            prisms.frame,
            outline_of(prisms, volume.unit.value * volume.margin),
            region_of(experiment.scan),
            marks,
            experiment.laser,
            room.for_new_stands() if new_stands else room,
            volume.sight.both_sides,
            prisms,
            float(np.ptp(prisms.depth)) / 2 / grazing
            if hides_itself(prisms, volume.sight.both_sides)
            else None,
        )
        place._check_boxes()
        return place

    @property
    def middle(self) -> Array:
        """Middle of the surface, m."""
        return np.asarray((self.nodes.max(axis=0) + self.nodes.min(axis=0)) / 2)

    @cached_property
    def structure(self) -> Structure:
        """Surface and region around it, which hide the calibration object."""
        return Structure.from_surface(self.surface, self.region)

    @property
    def to_be_seen(self) -> Array:
        """Points that beams of every stand must reach together, shape (point, 3), m."""
        return np.concatenate([self.outline, self.region, self.marks.position])

    def with_nodes(self, chosen: IntArray) -> Place:
        """Keep some nodes only."""
        return replace(self, nodes=self.nodes[chosen], frame=self.frame[chosen])

    def with_usual_region(self) -> Place:
        """Have a region around the object scanned where nothing tells one."""
        if len(self.region):
            return self
        return replace(self, region=region_around(self.outline, self.frame))

    def thinned(self) -> Place:
        """Keep so many nodes as stands are compared on, spread over the surface."""
        return self.with_nodes(of_search(self.nodes))

    def examine(
        self, origins: Array, rotations: Array, limits: StandLimits | None = None
    ) -> StandExamination:
        """Find what each stand sees, and why not the rest.

        Parameters
        ----------
        limits : StandLimits, optional
            In place of those of the room, here and in what this asks.
        """
        way = origins[:, None] - self.nodes[None]
        directions = way / np.linalg.norm(way, axis=-1, keepdims=True)
        why = np.zeros(directions.shape[:2], np.int64)
        for reason, lost in self.losses(origins, rotations, limits).items():
            why[lost & (why == 0)] = reason
        refused = np.zeros(len(origins), np.int64)
        for reason, out in self.refusals(origins, rotations, limits).items():
            refused[out & (refused == 0)] = reason
        if self.clearance is not None:
            self._hide(origins, rotations, why, refused)
        return StandExamination(origins, rotations, directions, why, refused)

    def losses(
        self, origins: Array, rotations: Array, limits: StandLimits | None = None
    ) -> dict[Unseen, BoolArray]:
        """Find the nodes that each limit costs each stand, (stand, node); the first counts."""
        limits = limits or StandLimits.from_room(self.room)
        way = origins[:, None] - self.nodes[None]
        distance = np.linalg.norm(way, axis=-1)
        cosine = np.einsum("sni,ni->sn", way, self.frame[:, 2]) / distance
        cosine = np.abs(cosine) if self.both_sides else cosine
        found = {
            Unseen.behind: cosine <= 0,
            Unseen.incidence: cosine < np.cos(np.radians(limits.incidence)),
            Unseen.near: distance < limits.nearest,
            Unseen.far: distance > limits.farthest,
            Unseen.mirrors: self._beyond(origins, rotations, self.nodes, limits),
        }
        return found | {
            Unseen.blocked: self._blocked(origins, self.nodes),
            Unseen.behind_target: self.marks.hides(origins, self.nodes),
        }

    @property
    def incidence_of_circles(self) -> float:
        """Largest angle between a beam and the normal of a circle, deg."""
        return min(self.room.incidence, OBLIQUE)

    def refusals(
        self, origins: Array, rotations: Array, limits: StandLimits | None = None
    ) -> dict[Unseen, BoolArray]:
        """Find the stands that each limit refuses as a whole, (stand,); the first counts.

        What the structure hides is found of stands that nothing else refuses.
        """
        marks, limits = self.marks, limits or StandLimits.from_room(self.room)
        found = {
            **self.refusals_of_room(origins, limits),
            Unseen.target_incidence: self.too_oblique(origins, limits),
            Unseen.target_mirrors: np.asarray(
                self._beyond(origins, rotations, marks.position, limits).any(axis=1)
            ),
            Unseen.target_blocked: np.asarray(self._blocked(origins, marks.position).any(axis=1)),
            Unseen.target_hidden: marks.hide_themselves(origins),
            Unseen.rim_behind_target: np.asarray(marks.hides(origins, self.outline).any(axis=1)),
            Unseen.region_mirrors: np.asarray(
                self._beyond(origins, rotations, self.region, limits).any(axis=1)
            ),
        }
        rest = np.flatnonzero(~np.any(list(found.values()), axis=0))
        hidden = np.zeros(len(origins), bool)
        hidden[rest] = marks.too_few(marks.hidden_by(self.structure, origins[rest]))
        return found | {Unseen.target_behind_structure: hidden}

    def too_oblique(self, origins: Array, limits: StandLimits | None = None) -> BoolArray:
        """Tell from which stands a circle is too oblique, however they are turned, (stand,)."""
        marks, limits = self.marks, limits or StandLimits.from_room(self.room)
        way = origins[:, None] - marks.position[None]
        cosine = np.einsum("smi,mi->sm", way, marks.normal) / np.linalg.norm(way, axis=-1)
        faces = np.any(marks.normal != 0, axis=1)
        largest = np.minimum(limits.incidence, OBLIQUE)
        oblique = (cosine < np.cos(np.radians(largest))) & faces
        return np.asarray(oblique.any(axis=1))

    def refusals_of_room(
        self, origins: Array, limits: StandLimits | None = None
    ) -> dict[Unseen, BoolArray]:
        """Find the stands that the room does not allow, (stand,)."""
        limits = limits or StandLimits.from_room(self.room)
        inside = np.zeros(len(origins), bool)
        for box in self.room.forbidden.values():
            inside |= np.all((origins > box.low) & (origins < box.high), axis=1)
        outside = np.any((origins < limits.low) | (origins > limits.high), axis=1)
        return {Unseen.outside: outside, Unseen.forbidden: inside}

    def allowed(self, origins: Array, limits: StandLimits | None = None) -> BoolArray:
        """Tell which stands the room allows, (stand,)."""
        return ~np.any(list(self.refusals_of_room(origins, limits).values()), axis=0)

    def _beyond(
        self, origins: Array, rotations: Array, points: Array, limits: StandLimits
    ) -> BoolArray:
        """Tell which points the mirrors do not reach, (stand, point)."""
        angles = angles_of(origins, rotations, points, self.laser)
        return ~self.laser.reaches(angles, limits.mirrors[:, None])

    def _blocked(self, origins: Array, points: Array) -> BoolArray:
        """Tell which points are behind a box that stops beams, (stand, point)."""
        blocked = np.zeros((len(origins), len(points)), bool)
        for box in self.solid:
            blocked |= crosses(origins, points, box.low, box.high)
        return blocked

    @property
    def solid(self) -> list[ForbiddenBox]:
        """Boxes that stop beams."""
        return [box for box in self.room.forbidden.values() if not box.beams]

    def _hide(self, origins: Array, rotations: Array, why: IntArray, refused: IntArray) -> None:
        """Mark the nodes that the surface itself hides from stands that are not refused."""
        assert self.clearance is not None
        for k in np.flatnonzero((refused == 0) & (why == 0).any(axis=1)):
            view = View.from_arrays(
                "stand", rotations[k], origins[k], [0.0], 1.0, dac=np.zeros((1, 2))
            )
            surface, triangles = self.surface.surface, self.surface.triangles
            occlusion = Occlusion.prepare(view, self.laser, surface, triangles, self.clearance)
            seen = np.flatnonzero(why[k] == 0)
            why[k, seen[occlusion.hides(self.nodes[seen])]] = Unseen.hidden

    def _check_boxes(self) -> None:
        """Refuse boxes in which the object itself stands, and through which no beam passes."""
        for name, box in self.room.forbidden.items():
            for what, points in (
                ("object", self.nodes),
                ("calibration object", self.marks.centres),
            ):
                inside = np.all((points > box.low) & (points < box.high), axis=1)
                if inside.any() and not box.beams:
                    raise UserError(
                        f"plan.room.forbidden.{name}: holds {inside.sum()} of {len(inside)} points "
                        f"of the {what} itself, which nothing outside of it could see; make the "
                        "box smaller, or let beams through with beams: true"
                    )


@dataclass(frozen=True, eq=False)
class StandExamination:
    """What stands see.

    Attributes
    ----------
    origins : ndarray, shape (stand, 3), m
    rotations : ndarray, shape (stand, 3, 3)
    directions : ndarray, shape (stand, node, 3)
        Unit vectors from the nodes to the stands.
    why : ndarray of int, shape (stand, node)
        Why a node is not seen, an `Unseen`.
    refused : ndarray of int, shape (stand,)
        Why a stand is refused as a whole, an `Unseen`.
    """

    origins: Array
    rotations: Array
    directions: Array
    why: IntArray
    refused: IntArray

    @property
    def seen(self) -> BoolArray:
        """Nodes that each stand sees, shape (stand, node)."""
        return np.asarray(self.why == Unseen.seen)

    @property
    def share(self) -> Array:
        """Part of the nodes that each stand sees, 0 where it is refused, shape (stand,)."""
        return np.where(self.refused == 0, self.seen.mean(axis=1), 0.0)

    @property
    def looks(self) -> Array:
        """Directions, zero where a node is not seen."""
        return self.directions * self.seen[..., None]

    def take(self, chosen: IntArray | BoolArray | list[int]) -> StandExamination:
        """Keep some stands."""
        return StandExamination(*(values[chosen] for values in vars(self).values()))

    def and_also(self, other: StandExamination) -> StandExamination:
        """Put the stands of another behind these."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return StandExamination(*(np.concatenate(pair) for pair in pairs))


def region_of(scan: Scan | None) -> Array:
    """Find the corners of the region to scan that is told in the world, shape (corner, 3), m."""
    part = scan.structure if isinstance(scan, Session) else scan
    if not isinstance(part, Rectangle):
        return np.zeros((0, 3))
    return np.array(part.corners_at, float).reshape(-1, 3) * part.unit.value


def region_around(outline: Array, frame: Array) -> Array:
    """Lay the region to scan around a flat object, where nothing tells it, shape (corner, 3), m.

    It is a rectangle around each of the two faces that are farthest apart, larger than the outline
    on each side by `BESIDE`: a view scans the box that holds both as it sees them. Of an object
    without depth it is one rectangle, of one that is not flat there is none.

    Examples
    --------
    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> region_around(square, np.eye(3)[None]).round(3).tolist()[0]
    [-0.015, -0.015, 0.0]
    >>> len(region_around(np.concatenate([square, square + [0, 0, 0.01]]), np.eye(3)[None]))
    8
    """
    axes = frame[0]
    along = outline @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    extent, depth = (high - low)[:2], (high - low)[2]
    if depth > FLAT * extent.min():
        return np.zeros((0, 3))
    (a, b), (c, d) = low[:2] - BESIDE * extent, high[:2] + BESIDE * extent
    faces = (low[2], high[2]) if depth > THIN * extent.min() else ((low + high)[2] / 2,)
    corners = [[u, v, w] for w in faces for u, v in ((a, b), (c, b), (c, d), (a, d))]
    return np.asarray((np.array(corners) @ axes).round(DECIMALS_OF_REGION))


def outline_of(prisms: Prisms, margin: float) -> Array:
    """Find the corners of the outermost layers, widened along the surface by a margin, m."""
    layers = prisms.position.reshape(prisms.layers, -1, 3)[[0, -1]]
    step = margin * prisms.frame[:, :2]
    points = [layers]
    if margin:
        points += [layers + a * step[:, 0] + b * step[:, 1] for a in (-1, 1) for b in (-1, 1)]
    every = np.concatenate(points).reshape(-1, 3)
    hull = scipy.spatial.ConvexHull(every, qhull_options="QJ")
    return np.asarray(every[hull.vertices])


def hides_itself(prisms: Prisms, both_sides: bool) -> bool:
    """Tell whether a surface can hide a part of itself that faces the instrument.

    It cannot if all of it is below the tangent plane of each node, ``n_i . (P_j - P_i) <= 0``: then
    it is convex. From behind only a flat one does not.

    Examples
    --------
    >>> from sldvexp.volume import Grid
    >>> bent = Grid(size=[0.3, 0.2], shape=[5, 4], layers=2, radius=0.5)
    >>> hides_itself(bent.prisms(), both_sides=False), hides_itself(bent.prisms(), both_sides=True)
    (False, True)
    """
    nodes, normal = prisms.surface, prisms.frame[:, 2]
    some = spread(nodes, NODES_FOR_SEARCH)
    height = nodes @ normal[some].T - np.einsum("ni,ni->n", nodes[some], normal[some])
    above = ROUNDING * np.ptp(nodes, axis=0).max()
    return bool((np.abs(height) if both_sides else height).max() > above)


def of_search(points: Array) -> IntArray:
    """Choose the nodes that stands are compared on: spread ones, and all that lie outermost.

    A stand that sees the corners of a flat surface sees all between them.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(30.0), np.arange(20.0), indexing="ij")
    >>> plate = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> np.isin([0, 19, 580, 599], of_search(plate)).all()
    np.True_
    """
    azimuth, polar = golden_sphere(OUTWARD)
    sine = np.sin(polar)
    ways = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)])
    return np.union1d(spread(points, NODES_FOR_SEARCH), (points @ ways).argmax(axis=0))


def spread(points: Array, count: int) -> IntArray:
    """Choose points that are far from one another, each the farthest from those before.

    Examples
    --------
    >>> spread(np.array([[0.0, 0, 0], [0.1, 0, 0], [1, 0, 0]]), 2).tolist()
    [0, 2]
    """
    if len(points) <= count:
        return np.arange(len(points))
    chosen = np.zeros(count, int)
    nearest = np.full(len(points), np.inf)
    for k in range(1, count):
        last = points[chosen[k - 1]]
        nearest = np.minimum(nearest, np.sum((points - last) ** 2, axis=1))
        chosen[k] = int(np.argmax(nearest))
    return np.sort(chosen)
