"""Circles that fit the object worse than edges and accuracy explain: found, and what causes it.

All views are adjusted to all edges together. The least sum of squares, with that of the circles'
machining errors and of the intrinsics over their priors, is larger than what ellipses of their own
leave of the same edges. With Q for the sums and f for the degrees of freedom

    F = (Q_pose - Q_ellipses) / (f_pose - f_ellipses) / max(Q_ellipses / f_ellipses, 1)

is about one if the object is the target and the mirrors are as calibrated. Pointing noise, which is
random, is in both sums already; what is wrong moves and bends whole ellipses and is in one only.

One cause at a time is set free and everything adjusted anew: a circle's place, height and radius,
as good as leaving the circle out, or an intrinsic that all views share. What that takes off Q is an
F test of the cause alone, which sees a smaller mistake. A cause explains a misfit if F rejects what
it leaves no longer. Of those that do, the one with the least ``Q + q log n`` is named, q being the
numbers set free, with all that the edges cannot tell from it.

An object that is larger as a whole moves every pose away and enlarges the mirror offset in
proportion; nothing else tells its size, which is therefore named with the mirror offset.

A cause that moves the poses by d widens their covariance by ``d d'`` and by what freeing it costs;
a misfit that nothing explains multiplies it by F. Bounds that would be more than twice as wide are
left, and the poses void.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.errors import UserError
from sldvexp.geometry import vector_from_rotation
from sldvexp.image import ScanLineEdges
from sldvexp.laser import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.pose.base import EXTRINSICS, JointCovariance
from sldvexp.pose.circle_images import CircleImages
from sldvexp.pose.edge_points import EdgePoints
from sldvexp.pose.edge_solver import ERRORS, RIM, EdgePoses, solve_edges
from sldvexp.pose.intrinsics import nominal_intrinsics
from sldvexp.pose.least_squares import INTRINSICS
from sldvexp.pose.pointing import lack_of_fit
from sldvexp.targets import Circles, std_of_bound
from sldvexp.typing import Array

#: Probability that right circles and mirrors are doubted, for all views together.
FALSE_ALARM = 0.01
#: Differences of ``Q + q log n`` below which two causes cannot be told apart.
ALIKE = 6.0
#: How many times wider bounds may become.
TOO_SMALL = 2.0
#: What a free cause is known to be: far worse than anybody measures, so that data decides.
LOOSE_CIRCLE = 0.01
LOOSE = dict(zip(INTRINSICS, (0.05, 0.1, 0.1, 0.1, 0.1), strict=True))
#: Least standard deviation of a circle beside a free one, m.
EXACT = 1e-8

#: A circle by its number, or an intrinsic by its name.
Cause = int | str

#: Rotation and origin of each view.
Places = Sequence[tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class EdgeProblem:
    """Edges of all views, and what is known of the object and the mirrors.

    Parameters
    ----------
    adjust, shared : mapping of str to float
        Intrinsics adjusted for each view and for all, with the standard deviations of their priors.
    """

    images: Sequence[CircleImages]
    circles: Circles
    laser: TwoMirror
    adjust: Mapping[str, float]
    shared: Mapping[str, float]
    max_iterations: int
    points: list[EdgePoints] = field(init=False)

    def __post_init__(self) -> None:
        made = [edge_points(i, self.laser, self.circles) for i in self.images]
        object.__setattr__(self, "points", made)

    @property
    def views(self) -> list[str]:
        """Names of the views."""
        return [i.view for i in self.images]

    def solve(self, starts: Places, free: Cause | None = None) -> EdgePoses:
        """Adjust all views, with one cause set free."""
        adjust, shared = dict(self.adjust), dict(self.shared)
        std = self.circles.unit.value * std_of_bound(self.circles.accuracy)
        of_circles = np.full(len(self.circles.circles), std)
        if isinstance(free, str):
            (adjust if free in adjust else shared)[free] = LOOSE[free]
        elif free is not None:
            of_circles = np.maximum(of_circles, EXACT)
            of_circles[sorted(self.circles.circles).index(free)] = LOOSE_CIRCLE
        return solve_edges(
            self.points,
            mirror_offset=self.laser.mirror_offset,
            views=self.views,
            starts=starts,
            adjust=adjust,
            shared=shared,
            circle_std=of_circles,
            max_iterations=self.max_iterations,
        )

    def misfit(self, found: EdgePoses, set_free: int = 0) -> tuple[float, float]:
        """Test what poses leave of the edges, after so many numbers were set free.

        Returns
        -------
        ratio, probability : float
            F, and the probability of a larger one.
        """
        free = sum(map(np.isinf, self.shared.values()))
        each = RIM + 1 + sum(map(np.isinf, self.adjust.values()))
        edges = sum(len(p.radius) for p in self.points)
        freedom = edges - each * len(self.points) - free - set_free
        return lack_of_fit([i.pointing for i in self.images], found.cost, freedom)

    def causes(self) -> Iterator[Cause]:
        """List what may be wrong and is not free already."""
        known = {**self.adjust, **self.shared}
        yield from (n for n in INTRINSICS if not known.get(n, 0.0) >= LOOSE[n])
        yield from sorted(self.circles.circles)


@dataclass(frozen=True, eq=False)
class Freed:
    """A cause that is set free, with the poses that it makes.

    Parameters
    ----------
    numbers : int
        That are free with it.
    score : float
        ``Q + q log n``, but for a constant.
    probability : float
        Of poses that it improves as much, if it is right.
    """

    cause: Cause
    found: EdgePoses
    numbers: int
    score: float
    probability: float


def edge_points(images: CircleImages, laser: TwoMirror, circles: Circles) -> EdgePoints:
    """Gather all edge points of a view with the circles that they belong to."""
    edges = images.edges
    numbers = [np.full(len(e.std), number) for number, e in edges.items()]
    return EdgePoints.from_dac(
        circles,
        laser,
        np.concatenate(numbers),
        np.concatenate([e.position for e in edges.values()]),
        np.concatenate([e.direction for e in edges.values()]),
        np.concatenate([e.std for e in edges.values()]),
        np.concatenate([_growth_std(e) for e in edges.values()]),
    )


def _growth_std(edges: ScanLineEdges) -> Array:
    return np.zeros((len(edges.std), 2)) if edges.growth_std is None else edges.growth_std


def judge_circles(
    problem: EdgeProblem, found: EdgePoses, places: Places, joint: JointCovariance
) -> tuple[list[Finding], JointCovariance]:
    """Test object and mirrors; say what is wrong with them, and widen the poses' covariance by it.

    Parameters
    ----------
    found : EdgePoses
        Of the problem.
    places : sequence of (rotation, origin)
        Poses to which `joint` belongs: these or those of another method.

    Returns
    -------
    findings : list of Finding
        None if nothing is wrong, else one.
    joint : JointCovariance
        Wider, unless the finding is void.
    """
    ratio, probability = problem.misfit(found)
    freed = list(_freed(problem, found))
    # Half of the false alarms for the whole, half for all causes together.
    least = min((f.probability for f in freed), default=1.0) * len(freed)
    probability = 2 * min(probability, least)
    if not probability < FALSE_ALARM:
        return [], joint
    explained = _explanations(problem, freed)
    if explained:
        wider = _with_causes(joint, found, places, explained)
    else:
        wider = replace(joint, matrix=ratio * joint.matrix)
    worst = float(np.sqrt(np.max(np.diag(wider.matrix) / np.diag(joint.matrix))))
    severity = Severity.void if worst > TOO_SMALL else Severity.doubtful
    bounds = (
        f"and bounds that had it in them would be {worst:.1f} times as wide: they are left, and "
        "void"
        if severity is Severity.void
        else f"and the bounds are made up to {worst:.1f} times as wide for it"
    )
    told = _told(problem, found, explained)
    bad = _bad_views(problem, found)
    *some, last = bad
    views = f"views {', '.join(some)} and {last}" if some else f"view {last}"
    where = " or ".join(_name(e.cause) for e in explained) or views
    rms = max(p.residual_rms for p in found.poses)
    finding = Finding(
        "calibration",
        where,
        f"{views}: the circles' images fit the object to {rms:.2g} DAC steps rms, worse than the "
        f"edges' noise and the circles' accuracy explain; {told}, {bounds}",
        severity,
        ratio,
        probability,
        rms,
        " or ".join(filter(None, (_remedy(e.cause) for e in explained))),
        views=tuple(bad),
    )
    return [finding], joint if severity is Severity.void else wider


def _freed(problem: EdgeProblem, found: EdgePoses) -> Iterator[Freed]:
    """Adjust all views with one cause after the other set free."""
    places = [(p.rotation, p.origin) for p in found.poses]
    pointing = [i.pointing for i in problem.images]
    freedom = sum(p.freedom for p in pointing)
    if freedom <= 0:
        return
    noise = max(sum(p.chi_square for p in pointing) / freedom, 1.0)
    edges = sum(len(p.residual) for p in found.poses)
    for cause in problem.causes():
        numbers = 1 if isinstance(cause, str) else ERRORS
        try:
            free = problem.solve(places, cause)
        except UserError:
            continue
        better = max(found.cost - free.cost, 0.0) / noise
        yield Freed(
            cause,
            free,
            numbers,
            float(numbers * np.log(edges) - better),
            float(scipy.special.fdtrc(numbers, freedom, better / numbers)),
        )


def _explanations(problem: EdgeProblem, freed: Sequence[Freed]) -> list[Freed]:
    """Take the causes that explain a misfit, the likeliest first, and only those like it."""
    explained = [f for f in freed if problem.misfit(f.found, f.numbers)[1] >= FALSE_ALARM]
    explained.sort(key=lambda e: e.score)
    return [e for e in explained if e.score < explained[0].score + ALIKE]


def _with_causes(
    joint: JointCovariance, found: EdgePoses, places: Places, explained: Sequence[Freed]
) -> JointCovariance:
    """Add to the covariance of poses what each cause moves them by, and what freeing it costs."""
    matrix, own = joint.matrix.copy(), _extrinsics(joint)
    before = found.joint.matrix[np.ix_(*2 * (_extrinsics(found.joint),))]
    for e in explained:
        moved = np.concatenate(
            [
                part
                for (rotation, origin), p in zip(places, e.found.poses, strict=True)
                for part in (vector_from_rotation(p.rotation @ rotation.T), p.origin - origin)
            ]
        )
        after = e.found.joint.matrix[np.ix_(*2 * (_extrinsics(e.found.joint),))]
        matrix[np.ix_(own, own)] += np.outer(moved, moved) + after - before
    return replace(joint, matrix=matrix)


def _extrinsics(joint: JointCovariance) -> list[int]:
    """Find the extrinsics of all views among the unknowns."""
    size = len(EXTRINSICS) + len(joint.own)
    return [v * size + k for v in range(len(joint.views)) for k in range(len(EXTRINSICS))]


def _name(cause: Cause) -> str:
    """Name a cause as findings do."""
    return cause if isinstance(cause, str) else f"circle {cause}"


def _remedy(cause: Cause) -> str:
    """Name the setting that would repair it."""
    return f"pose.shared={{{cause}:{LOOSE[cause]:g}}}" if isinstance(cause, str) else ""


def _told(problem: EdgeProblem, found: EdgePoses, explained: Sequence[Freed]) -> str:
    """Say what explains the misfit."""
    if not explained:
        return "no single circle, mirror gain, zero or mirror offset explains that"
    return " or ".join(_size(problem, e) for e in explained) + " explains that"


def _size(problem: EdgeProblem, freed: Freed) -> str:
    """Say how large a cause is."""
    cause, found = freed.cause, freed.found
    if not isinstance(cause, str):
        x, y, _, radius = 1e3 * found.moved[sorted(problem.circles.circles).index(cause)]
        wider = f"{abs(2 * radius):.2g} mm {'wider' if radius > 0 else 'narrower'}"
        beside = f"{np.hypot(x, y):.2g} mm beside its place"
        return f"circle {cause}, {beside} and {wider} than the target tells,"
    place = INTRINSICS.index(cause)
    value = found.poses[0].intrinsics[place]
    more = value - nominal_intrinsics(problem.laser.mirror_offset)[place]
    if cause == INTRINSICS[0]:
        if not problem.laser.mirror_offset:
            return f"{cause}, {1e3 * more:+.2g} mm,"
        # In units of the target, mirrors before a larger object are closer together.
        object_size = f"{abs(100 * more / value):.2g} % {'smaller' if more > 0 else 'larger'}"
        return f"{cause}, {1e3 * more:+.2g} mm, or an object that is {object_size},"
    if cause.startswith("gain"):
        return f"{cause}, {100 * more:+.2g} %,"
    return f"{cause}, {np.degrees(more):+.2g} deg,"


def _bad_views(problem: EdgeProblem, found: EdgePoses) -> list[str]:
    """Name the views that fit badly, or all if none does so by itself."""
    tests = {
        i.view: lack_of_fit([i.pointing], float(p.residual @ p.residual), p.dof)[1]
        for i, p in zip(problem.images, found.poses, strict=True)
    }
    return [v for v, p in tests.items() if p < FALSE_ALARM / len(tests)] or [*tests]
