"""`pose=bundle`: points whose places are unknown, seen from several views, and a known distance.

Poses and points are adjusted together (`sldvexp.pose.free_points`), without a start
(`sldvexp.pose.bundle_start`). Distances between points, or ranges to them, set the scale, and
nothing else does: an error of one part in a thousand moves an instrument 2 m away by 2 mm. The
world's axes are those of three points, or the ones in which the points fit their rough coordinates
best; bounds are those in these axes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity
from sldvexp.errors import Checks, UserError, nearest
from sldvexp.geometry import rigid_transform
from sldvexp.io.registration import RegistrationTable, to_dataset
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import JointCovariance, PoseMethod, PoseResult, pose_to_dataset
from sldvexp.pose.bundle_start import configurations
from sldvexp.pose.free_points import (
    AdjustedPoints,
    Configuration,
    Sightings,
    frame_of_points,
    frame_of_rough,
    gauged_covariance,
)
from sldvexp.pose.from_points import require_laser, unlikely_residuals
from sldvexp.pose.registration import RegistrationFiles
from sldvexp.pose.wrong_sightings import (
    JudgedSightings,
    exchanged_sightings,
    freedom,
    judge_sightings,
    wrong_distances,
)
from sldvexp.statistics import chi_square_p_value
from sldvexp.targets import Target
from sldvexp.typing import Array, IntArray
from sldvexp.units import LengthUnit

#: Least standard deviation of a length, as a part of it: one that is exact.
EXACT = 1e-7
#: Rise of the cost from which another configuration is refuted: 0.1 % of chi-square of 2.
REFUTED_RISE = 13.8
#: Extent of three points across their line, as a part of its length, that makes a plane.
COLLINEAR = 1e-3


@dataclass
class Distance:
    """A known distance between two points.

    Parameters
    ----------
    points : list of 2 int
        Their numbers.
    length : float
    std : float
        Standard deviation of the length; 0 if it is exact.
    unit : LengthUnit
        Of both.
    """

    points: list[int] = field(default_factory=list)
    length: float = 0.0
    std: float = 0.0
    unit: LengthUnit = LengthUnit.m

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no distance can be."""
        two = len(self.points) == 2 and self.points[0] != self.points[1]
        checks.require(two, f"{name}.points", f"must be two points, not {self.points}")
        checks.positive(f"{name}.length", self.length)
        checks.non_negative(f"{name}.std", self.std)


@dataclass
class MeasuredRange:
    """A measured distance from an instrument to a point.

    Parameters
    ----------
    view : str
        From the place that `pose/origin` tells of it, the middle of its up-down mirror; a range
        finder that counts from elsewhere has to be corrected for it.
    point : int
    length : float
    std : float
        Standard deviation of the length; 0 if it is exact.
    unit : LengthUnit
        Of both.
    """

    view: str = ""
    point: int = 0
    length: float = 0.0
    std: float = 0.0
    unit: LengthUnit = LengthUnit.m

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no range can be."""
        checks.require(bool(self.view), f"{name}.view", "must name a view")
        checks.positive(f"{name}.length", self.length)
        checks.non_negative(f"{name}.std", self.std)


@register("pose", "bundle")
@dataclass
class Bundle(RegistrationFiles, PoseMethod):
    """Poses of all views from unknown points that they see, with one known distance or range.

    Two views must see five points in common, each further one four points that others see.
    Object points of the registration data are rough coordinates, and count only for the world's
    axes. Wrong sightings are left out and named (`sldvexp.pose.wrong_sightings`).

    Parameters
    ----------
    distances : list of Distance
        As ``[{points: [1, 2], length: 0.3, std: 0.0002}]``. These and ranges set the scale; one of
        either is enough.
    ranges : list of MeasuredRange
        As ``[{view: front, point: 1, length: 1.652, std: 0.001}]``.
    frame : list of 3 int
        Points that make the world's axes: the origin, one on the x axis, one in the x-y plane on
        y's positive side. Without them the axes are those in which all points fit the rough
        coordinates of the registration data best.
    pointing : float, DAC steps
        Standard deviation of the pointing at a mark, of each mirror.
    confidence : float
        Level of the intervals.
    """

    distances: list[Distance] = field(default_factory=list)
    ranges: list[MeasuredRange] = field(default_factory=list)
    frame: list[int] = field(default_factory=list)
    pointing: float = 1.0
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        self.check_files(checks)
        checks.positive("pointing", self.pointing)
        checks.probability("confidence", self.confidence)
        for k, distance in enumerate(self.distances):
            distance.check(checks, f"distances[{k}]")
        for k, measured in enumerate(self.ranges):
            measured.check(checks, f"ranges[{k}]")
        three = len(self.frame) in (0, 3) and len(set(self.frame)) == len(self.frame)
        checks.require(three, "frame", f"must be three different points, not {self.frame}")
        checks.done()

    @property
    def known_lengths(self) -> list[Distance | MeasuredRange]:
        """Distances and ranges, in this order."""
        return [*self.distances, *self.ranges]

    def estimate(
        self, laser: TwoMirror | None, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> PoseResult:
        """Solve all views together."""
        tables = self.tables(tree)
        laser = require_laser(laser)
        network = Network.from_tables(tables, laser, self)
        found = configurations(
            network.sightings, len(tables), len(network.number), 2.0 * len(network.sightings)
        )
        if not found:
            raise UserError(
                f"views {', '.join(t.name for t in tables)}: no places of instruments and points "
                "explain the angles; are the points' numbers the same in all views, and the "
                "mirrors wired as laser says?"
            )
        judged = judge_sightings(network.sightings, found)
        best, other = network.chosen(judged)
        placed, covariance = network.in_world(best, judged.sightings)
        findings = [
            *network.unseen,
            *_wrong(network, judged, best),
            *_ambiguous(network, judged, other),
        ]
        return self._result(network, judged, placed, covariance, findings)

    def _result(
        self,
        network: Network,
        judged: JudgedSightings,
        placed: Configuration,
        covariance: Array,
        findings: list[Finding],
    ) -> PoseResult:
        """Make the groups of poses and points."""
        names, laser = network.views, network.laser
        sightings = network.sightings
        views = 6 * len(names)
        joint = JointCovariance(names, [], [], covariance[:views, :views])
        residual = np.full((len(names), len(network.number), 2), np.nan)
        steps = sightings.residual(placed)[: 2 * len(sightings)].reshape(-1, 2) * sightings.std
        residual[sightings.view, sightings.point] = steps
        used = np.ones(len(sightings), bool)
        used[judged.left_out] = False
        square = [np.mean(steps[used & (sightings.view == v)] ** 2) for v in range(len(names))]
        dof = freedom(judged.sightings, placed)
        cost = judged.sightings.residual(placed)
        pose = pose_to_dataset(
            names,
            placed.rotation,
            placed.origin,
            joint.of_views(),
            np.full(len(names), np.inf),
            self.confidence,
            joint=joint,
            coords={"point": network.number},
            residual=residual,
            residual_rms=np.sqrt(square),
            s=np.full(len(names), self.pointing * np.sqrt(cost @ cost / max(dof, 1))),
        )
        pose.attrs["mirror_offset"] = laser.mirror_offset
        pose.attrs["step"] = laser.step
        pose.attrs["source"] = ", ".join(dict.fromkeys(Path(s).name for s in network.sources))
        pose.attrs["notes"] = "\n".join(_notes(self, network))
        return PoseResult(pose, _registration(network, used, placed, covariance), findings)


@dataclass(frozen=True, eq=False)
class Network:
    """Sightings with the names of their views and points.

    Parameters
    ----------
    views : list of str
    number : ndarray of int, shape (P,)
        Of the points.
    rough : ndarray, shape (P, 3), m
        Their rough coordinates.
    sightings : Sightings
    frame : list of int
        Indices of the points that make the world's axes; empty for the rough coordinates.
    laser : TwoMirror
    sources : list of str
    unseen : list of Finding
        About points that only one view sees.
    """

    views: list[str]
    number: IntArray
    rough: Array
    sightings: Sightings
    frame: list[int]
    laser: TwoMirror
    sources: list[str]
    unseen: list[Finding]

    @classmethod
    def from_tables(
        cls, tables: Sequence[RegistrationTable], laser: TwoMirror, method: Bundle
    ) -> Network:
        """Join the views of registration data.

        Raises
        ------
        UserError
            If there are too few views, points or distances.
        """
        sign = np.ones(2)
        sign[[m.value for m in method.inverted]] = -1
        every, count = np.unique(np.concatenate([t.number for t in tables]), return_counts=True)
        number = every[count > 1]
        _require_enough(tables, number, method)
        tables = [t.part(np.isin(t.number, number)) for t in tables]
        view = np.concatenate([np.full(len(t.number), k) for k, t in enumerate(tables)])
        point = np.concatenate([np.searchsorted(number, t.number) for t in tables])
        rough = np.zeros((len(number), 3))
        for t in reversed(tables):
            rough[np.searchsorted(number, t.number)] = t.object_point
        known = method.known_lengths
        length, std = (
            np.array([getattr(d, key) * d.unit.value for d in known]) for key in ("length", "std")
        )
        names = [t.name for t in tables]
        ends = [np.searchsorted(number, d.points).tolist() for d in method.distances]
        ends += [
            [len(number) + names.index(r.view), int(np.searchsorted(number, r.point))]
            for r in method.ranges
        ]
        sightings = Sightings(
            view,
            point,
            sign * np.concatenate([t.angle_through(laser) for t in tables]),
            laser.step,
            method.pointing,
            laser.mirror_offset,
            np.array(ends),
            length,
            np.maximum(std, EXACT * length),
        )
        return cls(
            names,
            number,
            rough,
            sightings,
            np.searchsorted(number, method.frame).tolist(),
            laser,
            [t.source for t in tables],
            [_unseen(int(n), tables) for n in every[count == 1]],
        )

    def name(self, k: int) -> str:
        """Name a sighting."""
        view, point = self.sightings.view[k], self.sightings.point[k]
        return f"point {self.number[point]} of view {self.views[view]}"

    def view_of(self, k: int) -> str:
        """Name the view of a sighting."""
        return self.views[self.sightings.view[k]]

    def between(self, k: int) -> str:
        """Name the ends of a known distance."""
        one, other = self.sightings.pairs[k]
        if one < len(self.number):
            return f"points {self.number[one]} and {self.number[other]}"
        return f"view {self.views[one - len(self.number)]} and point {self.number[other]}"

    def chosen(self, judged: JudgedSightings) -> tuple[AdjustedPoints, AdjustedPoints | None]:
        """Choose a configuration, and give the next that the angles cannot refute, if any.

        Of configurations that fit as well, that whose points are most like the rough coordinates.
        """
        least = judged.found[0].cost
        alike = [f for f in judged.found if f.cost < least + REFUTED_RISE]
        if len(alike) > 1 and np.ptp(self.rough, axis=0).any():
            alike.sort(key=lambda f: self._unlike(f.at))
        return alike[0], alike[1] if len(alike) > 1 else None

    def _unlike(self, at: Configuration) -> float:
        """Sum the squared distances of points from their rough coordinates."""
        turn, shift = rigid_transform(at.points, self.rough)
        return float(np.sum((at.points @ turn.T + shift - self.rough) ** 2))

    def in_world(self, found: AdjustedPoints, sightings: Sightings) -> tuple[Configuration, Array]:
        """Turn a configuration into the world's axes; give the covariance of all unknowns there.

        Raises
        ------
        UserError
            If the points make no axes, or angles and distances do not determine everything.
        """
        points = found.at.points
        base = points[self.frame] if self.frame else self.rough
        extent = np.linalg.svd(base - base.mean(axis=0), compute_uv=False)
        if extent[1] <= COLLINEAR * extent[0]:
            raise UserError(_no_axes(self))
        if self.frame:
            turn, shift, constraints = frame_of_points(points, self.frame)
        else:
            turn, shift, constraints = frame_of_rough(points, self.rough)
        placed = found.at.seen_from(turn, shift)
        covariance = gauged_covariance(sightings, placed, constraints)
        if covariance is None:
            raise UserError(
                "the angles and distances do not determine all poses and points: see more points "
                "in common, or see them from places further apart"
            )
        return placed, covariance


def _require_enough(tables: Sequence[RegistrationTable], number: IntArray, method: Bundle) -> None:
    """Refuse too few views, points and distances, and those of unknown points."""
    if len(tables) < 2:
        raise UserError(
            f"pose=bundle needs two views or more of the same points, not {len(tables)}; of known "
            "points one view is enough: pose=manual"
        )
    if not method.distances and not method.ranges:
        raise UserError(
            "pose=bundle needs a known distance, which sets the scale: "
            "pose.distances=[{points: [1, 2], length: 0.3, std: 0.0002}], or a range: "
            "pose.ranges=[{view: front, point: 1, length: 1.652, std: 0.001}]"
        )
    views = [t.name for t in tables]
    for k, measured in enumerate(method.ranges):
        if measured.view not in views:
            raise UserError(
                f"pose.ranges[{k}].view: there is no view {measured.view}; "
                f"{nearest(measured.view, views)}"
            )
    where = [(f"distances[{k}].points", d.points) for k, d in enumerate(method.distances)]
    where += [(f"ranges[{k}].point", [r.point]) for k, r in enumerate(method.ranges)]
    for key, named in [*where, ("frame", method.frame)]:
        for n in named:
            if n not in number:
                known = ", ".join(map(str, number))
                raise UserError(
                    f"pose.{key}: no two views see a point {n}; those that they see are {known}"
                )
    counts = {t.name: int(np.isin(t.number, number).sum()) for t in tables}
    angles, unknowns = 2 * sum(counts.values()), 6 * len(tables) + 3 * len(number) - 7
    few = [name for name, count in counts.items() if count < 4]
    if few:
        raise UserError(
            f"view {few[0]} sees {counts[few[0]]} points that another view sees too; "
            "its pose needs four"
        )
    if angles < unknowns or max(counts.values()) < 5:
        raise UserError(
            f"{len(number)} points in {len(tables)} views are too few: {angles} angles for "
            f"{unknowns} unknowns; two views must see five points in common, better six in three"
        )


def _no_axes(network: Network) -> str:
    """Say why there are no axes of the world."""
    if network.frame:
        numbers = ", ".join(str(network.number[k]) for k in network.frame)
        return f"pose.frame: the points {numbers} lie on one line and make no axes"
    return (
        "the registration data has no rough coordinates that would make the world's axes: name "
        "three points that do with pose.frame=[1, 2, 3]"
    )


def _unseen(number: int, tables: Sequence[RegistrationTable]) -> Finding:
    """Say that a point was seen once."""
    return Finding(
        "unseen",
        f"point {number}",
        f"point {number} is seen from one view alone, which tells no place, and is left out",
        Severity.note,
    )


def _wrong(network: Network, judged: JudgedSightings, best: AdjustedPoints) -> Iterator[Finding]:
    """Say which sightings contradict the others, and where the errors as stated are too small."""
    where = f"views {', '.join(network.views)}"
    doubted = not judged.agree or bool(judged.left_out)
    if wrong := wrong_distances(network.sightings, judged.found[0]) if doubted else []:
        yield _wrong_distance(network, wrong, judged.p_value)
        return
    alone = len(judged.left_out) == 1
    pairs = [] if alone or not doubted else [*exchanged_sightings(network.sightings, judged)]
    if len(pairs) == 1 and (not judged.left_out or len(judged.left_out) == 2):
        yield _exchanged(network, pairs[0], judged)
        return
    if not judged.agree:
        yield unlikely_residuals(network.views, judged.p_value)
        return
    names = [network.name(k) for k in judged.left_out]
    others = " or ".join(network.name(k) for k in judged.or_else)
    for k, (name, size) in enumerate(zip(names, judged.size, strict=True)):
        last = k == len(names) - 1
        told = f"; {others} would explain it as well" if others and last else ""
        yield Finding(
            "wrong_point",
            name,
            f"{name} lies {size:.3g} DAC steps beside where the others put it "
            f"(p = {judged.p_value:.1g}), and is left out{told}",
            Severity.void if told else Severity.note,
            p_value=judged.p_value,
            size=size,
            remedy=f"point at {name} again, or remove it",
            views=(network.view_of(judged.left_out[k]),),
        )
    dof = freedom(judged.sightings, best.at)
    if dof <= 0:
        text = f"{where}: as many unknowns as angles, so that a wrong point cannot be seen"
        yield Finding("untested", where, text, Severity.doubtful)
        return
    probability = float(chi_square_p_value(best.cost, dof))
    if not names and probability < 0.01:
        yield unlikely_residuals(network.views, probability)


def _exchanged(network: Network, pair: tuple[int, int], judged: JudgedSightings) -> Finding:
    """Say that two sightings have each other's numbers."""
    one, other = (network.name(k) for k in pair)
    out = bool(judged.left_out)
    told = "both are left out" if out else "the poses rest on them as they are"
    return Finding(
        "exchanged_points",
        f"{one} and {other}",
        f"{one} and {other} seem to be exchanged, since all agree with each other's angles for the "
        f"two; {told}",
        Severity.doubtful if out else Severity.void,
        p_value=judged.p_value,
        remedy="exchange their numbers in the registration data",
        views=tuple(dict.fromkeys(network.view_of(k) for k in pair)),
    )


def _wrong_distance(network: Network, wrong: Sequence[int], p_value: float) -> Finding:
    """Say which known distances contradict everything else."""
    ends = [network.between(k) for k in wrong]
    names = " or ".join(f"that of {pair}" for pair in ends)
    return Finding(
        "wrong_distance",
        " or ".join(f"distance of {pair}" for pair in ends),
        f"the known distances contradict one another: {names} is wrong, without which everything "
        f"agrees (p = {p_value:.1g}); the poses rest on all of them",
        Severity.void,
        p_value=p_value,
        remedy="measure the distances in pose.distances and pose.ranges again",
    )


def _ambiguous(
    network: Network, judged: JudgedSightings, other: AdjustedPoints | None
) -> Iterator[Finding]:
    """Say that the angles allow other places."""
    if other is None:
        return
    where = f"views {', '.join(network.views)}"
    first = judged.found[0].cost
    told = (
        "the one most like the rough coordinates is taken"
        if np.ptp(network.rough, axis=0).any()
        else "the best is taken"
    )
    yield Finding(
        "other_pose",
        where,
        f"{where}: other places of instruments and points fit nearly as well (squared residuals "
        f"{abs(other.cost - first):.2g} apart), and {told}; points off one plane, or another view, "
        "tell them apart",
        Severity.doubtful,
        statistic=abs(other.cost - first),
    )


def _notes(method: Bundle, network: Network) -> Iterator[str]:
    """Say what the scale and the axes rest on."""
    std = 1 / np.sqrt(np.sum((network.sightings.length / network.sightings.length_std) ** 2))
    if any(d.std for d in method.known_lengths):
        yield f"the known distances give the scale to {100 * std:.2g} %"
    if method.frame:
        one, other, third = method.frame
        yield (
            f"the world's origin is point {one}, point {other} lies on the x axis, point {third} "
            "in the x-y plane"
        )
    else:
        yield "the world's axes are those in which the points fit their rough coordinates best"


def _registration(
    network: Network, used: Array, placed: Configuration, covariance: Array
) -> xr.Dataset:
    """Make the group ``registration`` with the places that were found."""
    first = 6 * len(network.views)
    std = np.sqrt(np.maximum(np.diag(covariance)[first:], 0.0)).reshape(-1, 3)
    tables, masks = [], []
    for k, name in enumerate(network.views):
        own = network.sightings.view == k
        point, angle = network.sightings.point[own], network.sightings.angle[own]
        tables.append(
            RegistrationTable(
                name,
                network.number[point],
                placed.points[point],
                angle,
                network.laser.dac_from_angle(angle),
                object_std=std[point],
            )
        )
        masks.append(used[own])
    return to_dataset(tables, masks)
