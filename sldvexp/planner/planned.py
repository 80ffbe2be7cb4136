"""Plan of stands: found, or given, with the bounds that they reach.

`plan` finds stands for a configuration, `next_stand` the one that helps most after those that are
there, and `check_stands` says what given stands see. All three return a `StandPlan`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.config.planning import FEWEST_STANDS, MOST_STANDS, PlanCriterion
from sldvexp.dataset import RunData
from sldvexp.errors import UserError
from sldvexp.planner import done
from sldvexp.planner.criterion import Goal, covariance_of, directions_wanted, variances
from sldvexp.planner.done import NOBODY, GivenStands
from sldvexp.planner.expected import ExpectedBounds, expected_bounds
from sldvexp.planner.gage import PlannedGage
from sldvexp.planner.images import Stand, empty_image, raster_of, stand_at
from sldvexp.planner.limits import ActiveLimit, active_limits
from sldvexp.planner.one_more import OneMore, one_more
from sldvexp.planner.place import Place, StandExamination, of_search
from sldvexp.planner.search import FeasiblePlaces, candidates, exchange, greedy, move
from sldvexp.scan.base import Sampling, Scan
from sldvexp.typing import Array, IntArray

#: Noise of the vibrometer before a sine is fitted, where nothing tells it: 0.5 % of 0.1 m/s, r.m.s.
USUAL_NOISE = 5e-4


@dataclass(frozen=True, eq=False)
class StandPlan:
    """Stands with what they see and the bounds that they reach.

    Attributes
    ----------
    stands : tuple of Stand
        Those that were there already, then the new ones.
    new : int
        How many of the last are new.
    place : Place
        With all nodes of the surface.
    examined : StandExamination
        What each stand sees of these.
    goal : Goal
        What was asked for, with the nodes' factors.
    expected : ExpectedBounds
        In units of the pixels' noise.
    noise : float, m/s
        Standard error of a pixel's velocity, of real and imaginary part each.
    confidence : float
        Level of the bounds.
    by_count : dict of int to float
        Bound asked for that so many stands reach, m/s; only with a bound wanted.
    gage : PlannedGage, optional
        What was planned for, if it is a strain.
    one_more : OneMore, optional
        Worth of the new stand after those that were there.
    limits : tuple of ActiveLimit
        Of the room, which hold the new stands back.
    """

    stands: tuple[Stand, ...]
    new: int
    place: Place
    examined: StandExamination
    goal: Goal
    expected: ExpectedBounds
    noise: float
    confidence: float
    by_count: dict[int, float]
    gage: PlannedGage | None = None
    one_more: OneMore | None = None
    limits: tuple[ActiveLimit, ...] = ()

    @property
    def bounds(self) -> Array:
        """Half-widths of the intervals of every node's components, (node, component), m/s."""
        return np.asarray(self._scale * self.expected.std)

    @property
    def asked(self) -> float:
        """Bound that was asked for, by the criterion, m/s."""
        return self._scale * self.goal.of(covariance_of(self.examined.looks))

    @property
    def mean(self) -> Array:
        """Root mean square of `bounds` over the nodes that are determined, (component,), m/s."""
        return np.asarray(np.sqrt(np.nanmean(self.bounds**2, axis=0)))

    @property
    def worst(self) -> Array:
        """Largest of `bounds`, (component,), m/s."""
        return np.asarray(np.nanmax(self.bounds, axis=0))

    @property
    def undetermined(self) -> int:
        """How many nodes have a component that is not determined."""
        return int(np.isnan(self.expected.std).any(axis=1).sum())

    @property
    def by_node(self) -> Array:
        """Bound asked for, of each node by itself, (node,), m/s; NaN where not determined."""
        square = variances(covariance_of(self.examined.looks), self.goal.wanted)
        worst = self.goal.criterion is PlanCriterion.worst
        own = square.max(axis=1) if worst else square.mean(axis=1)
        known = np.isfinite(self.expected.std).all(axis=1)
        return np.where(known, self._scale * self.goal.factor * np.sqrt(own), np.nan)

    @property
    def added(self) -> tuple[Stand, ...]:
        """New stands."""
        return self.stands[len(self.stands) - self.new :]

    @property
    def given(self) -> tuple[Stand, ...]:
        """Stands that were there already."""
        return self.stands[: len(self.stands) - self.new]

    @property
    def _scale(self) -> float:
        return NormalDist().inv_cdf(0.5 + self.confidence / 2) * self.noise


def plan(experiment: Experiment) -> StandPlan:
    """Find stands for a configuration.

    Raises
    ------
    UserError
        If there is no volume, no stand is feasible, or a wanted bound is out of reach.

    Examples
    --------
    >>> from sldvexp.config.experiment import Experiment
    >>> from sldvexp.laser import TwoMirror
    >>> from sldvexp.volume import Grid
    >>> plate = Grid(size=[0.3, 0.2], shape=[5, 4], layers=2)
    >>> experiment = Experiment(volume=plate, laser=TwoMirror())
    >>> experiment.plan.candidates = 50
    >>> found = plan(experiment)
    >>> [stand.name for stand in found.stands], found.undetermined
    (['1', '2', '3', '4', '5'], 0)
    """
    task = _Task.of(experiment, NOBODY)
    settings, wanted = experiment.plan, experiment.plan.in_si("wanted")
    if wanted is None:
        return task.with_limits(task.planned(settings.stands))
    by_count: dict[int, float] = {}
    for count in range(FEWEST_STANDS, MOST_STANDS + 1):
        by_count[count] = task.estimated(count)
    enough = [n for n, bound in by_count.items() if bound <= wanted]
    for count in (n for n in by_count if n >= min(enough, default=MOST_STANDS)):
        found = task.planned(count)
        if found.asked <= wanted:
            found = task.with_limits(found)
            return replace(found, by_count=by_count | {count: found.asked})
    ratio = found.asked / wanted
    raise UserError(
        f"plan.wanted={settings.wanted:g}: {1e3 * wanted:.3g} mm/s is out of reach: "
        f"{MOST_STANDS} stands, the most, reach {1e3 * found.asked:.3g} mm/s, {ratio:.3g} times as "
        f"much; with {ratio**2:.2g} times the samples a pixel or the pixels it is within reach; "
        f"plan.unit is {settings.unit.name}"
    )


def next_stand(experiment: Experiment, run: RunData | None = None) -> StandPlan:
    """Find the stand that helps most after those that are there.

    Parameters
    ----------
    run : RunData, optional
        With the poses and images that are done; without it the stands of the configuration.

    Examples
    --------
    >>> from sldvexp.config.experiment import Experiment
    >>> from sldvexp.laser import TwoMirror
    >>> from sldvexp.volume import Grid
    >>> plate = Grid(size=[0.3, 0.2], shape=[5, 4], layers=2)
    >>> experiment = Experiment(volume=plate, laser=TwoMirror())
    >>> experiment.plan.candidates = 50
    >>> from sldvexp.geometry import KnownPose
    >>> from sldvexp.pose.given import Given
    >>> places = [0.8, 0.0, 1.3], [-0.8, 0.2, 1.3], [0.0, -0.8, 1.4]
    >>> poses = [KnownPose(origin=place, look_at=[0.0, 0.0, 0.0]) for place in places]
    >>> experiment.pose = Given(views=dict(zip("abc", poses)))
    >>> found = next_stand(experiment)
    >>> [stand.name for stand in found.stands], found.new
    (['a', 'b', 'c', '1'], 1)
    """
    task = _Task.of(experiment, _given(experiment, run))
    return task.planned(1)


def check_stands(experiment: Experiment, run: RunData | None = None) -> StandPlan:
    """Say what given stands see, and which bounds they reach.

    Parameters
    ----------
    run : RunData, optional
        With their poses and images; without it the stands of the configuration.

    Examples
    --------
    >>> from sldvexp.config.experiment import Experiment
    >>> from sldvexp.laser import TwoMirror
    >>> from sldvexp.volume import Grid
    >>> plate = Grid(size=[0.3, 0.2], shape=[5, 4], layers=2)
    >>> experiment = Experiment(volume=plate, laser=TwoMirror())
    >>> experiment.plan.candidates = 50
    >>> from sldvexp.geometry import KnownPose
    >>> from sldvexp.pose.given import Given
    >>> places = [0.8, 0.0, 1.3], [-0.8, 0.2, 1.3], [0.0, -0.8, 1.4]
    >>> poses = [KnownPose(origin=place, look_at=[0.0, 0.0, 0.0]) for place in places]
    >>> experiment.pose = Given(views=dict(zip("abc", poses)))
    >>> check_stands(experiment).examined.seen.all(axis=1).tolist()
    [True, True, True]
    """
    task = _Task.of(experiment, _given(experiment, run), new_stands=False)
    return task.result(())


def _given(experiment: Experiment, run: RunData | None) -> GivenStands:
    place = Place.from_experiment(experiment, new_stands=False)
    if run is None:
        return done.of_experiment(experiment, place)
    return done.of_run(run, experiment, place)


@dataclass(eq=False)
class _Task:
    """What is the same for any number of stands; candidates are drawn once."""

    experiment: Experiment
    given: GivenStands
    place: Place
    thinned: Place
    chosen: IntArray
    whole: Goal
    goal: Goal
    gage: PlannedGage | None
    rng: np.random.Generator
    found: FeasiblePlaces | None = None
    fewest: StandPlan | None = None

    @classmethod
    def of(cls, experiment: Experiment, given: GivenStands, new_stands: bool = True) -> _Task:
        place = Place.from_experiment(experiment, new_stands=False)
        searched = Place.from_experiment(experiment)
        if new_stands:
            place, searched = place.with_usual_region(), searched.with_usual_region()
        settings = experiment.plan
        gage = PlannedGage.from_ends(settings.gage, place)
        chosen = of_search(place.nodes)
        if gage is None:
            wanted = directions_wanted(settings.of, place.frame)
            whole = Goal.evenly(wanted, settings.criterion)
            goal = Goal.evenly(wanted[chosen], settings.criterion)
        else:
            chosen = np.union1d(chosen, gage.nodes)
            wanted = directions_wanted(gage.along.tolist(), place.frame)
            weight = np.bincount(gage.nodes, minlength=len(place.nodes)) / 2
            whole = replace(Goal.evenly(wanted, settings.criterion), weight=weight)
            goal = whole.of_nodes(chosen)
        rng = np.random.default_rng(experiment.seed)
        thinned = searched.with_nodes(chosen)
        return cls(experiment, given, place, thinned, chosen, whole, goal, gage, rng)

    def estimated(self, count: int) -> float:
        """Estimate the bound that so many stands reach, m/s, before they are moved in space.

        The factors of the nodes are those of the fewest stands.
        """
        if self.fewest is None:
            self.fewest = self.planned(FEWEST_STANDS)
        first = self.fewest
        factor = first.goal.factor[self.chosen]
        goal, begun = self.goal.with_factor(factor), self._looks_of_given()
        assert self.found is not None
        looks = self.found.examined.looks
        chosen = exchange(goal, looks, greedy(goal, looks, count, begun), begun)
        of_subset = first.asked / goal.of(covariance_of(self._subset(first)))
        return of_subset * goal.of(covariance_of(looks[chosen]))

    def _subset(self, plan: StandPlan) -> Array:
        """Give the directions of a plan's stands at the nodes that are searched on."""
        return plan.examined.looks[:, self.chosen]

    def planned(self, count: int) -> StandPlan:
        """Find so many stands beside those given.

        Factors of the nodes are not known before there is a layout; the worst node depends on
        them, so that the layout is then found once more.
        """
        if self.found is None:
            wanted = self.experiment.plan.candidates
            self.found = candidates(self.thinned, wanted, self.rng)
        begun = self._looks_of_given()
        looks, least = self.found.examined.looks, self.found.least
        chosen = exchange(self.goal, looks, greedy(self.goal, looks, count, begun), begun)
        stands = self.found.examined.take(chosen)
        goal = self.goal
        stands = move(goal, self.thinned, stands, least, begun, self.rng)
        if goal.criterion is PlanCriterion.worst:
            result = self.result(self._stands(stands), drop_outs=False)
            factor = result.goal.factor[self.chosen]
            goal = self.goal.with_factor(factor)
            again = exchange(goal, looks, chosen, begun)
            stands = self.found.examined.take(again)
            stands = move(goal, self.thinned, stands, least, begun, self.rng)
        if not self.given.stands:
            return self.result(self._stands(stands))
        there = np.array([stand.origin for stand in self.given.stands])
        tried = self.found.examined.and_also(stands)
        stands, worth = one_more(goal, tried, begun, there, self.place.middle)
        return replace(self.result(self._stands(stands)), one_more=worth)

    def with_limits(self, plan: StandPlan) -> StandPlan:
        """Find the limits of the room that hold the new stands of a plan back."""
        assert self.found is not None
        new = plan.added
        stands = self.thinned.examine(
            np.array([stand.origin for stand in new]), np.array([stand.rotation for stand in new])
        )
        goal = self.goal.with_factor(plan.goal.factor[self.chosen])
        begun, seed = self._looks_of_given(), self.experiment.seed
        limits = active_limits(goal, self.thinned, stands, self.found.least, begun, seed)
        return replace(plan, limits=tuple(limits))

    def result(self, added: Sequence[Stand], drop_outs: bool = True) -> StandPlan:
        """Compute what the given and the new stands see, and their bounds.

        Parameters
        ----------
        drop_outs : bool
            Whether pixels are lost to speckle, which are others in every layout.
        """
        e = self.experiment
        stands = (*self.given.stands, *added)
        examined = self.place.examine(
            np.array([s.origin for s in stands]), np.array([s.rotation for s in stands])
        )
        first = len(self.given.stands)
        images = [
            *self.given.images,
            *(
                empty_image(s, e, raster_of(s, e), k if drop_outs else None, self.place)
                for k, s in enumerate(added, first)
            ),
        ]
        expected = expected_bounds(images, self.place.laser, e.volume, e.reconstruction, e.solver)
        goal = self.whole.with_factor(_factors(examined, expected, self.place.frame, self.whole))
        confidence = getattr(e.reconstruction, "confidence", 0.95)
        noise = self.given.noise if e.plan.noise is None else None
        noise = _pixel_noise(e) if noise is None else noise
        return StandPlan(
            stands,
            len(added),
            self.place,
            examined,
            goal,
            expected,
            noise,
            confidence,
            by_count={},
            gage=self.gage,
        )

    def _looks_of_given(self) -> Array:
        """Give directions from which the given stands see the nodes that are searched on."""
        place, stands = self.place.with_nodes(self.chosen), self.given.stands
        if not stands:
            return np.zeros((0, len(place.nodes), 3))
        return place.examine(
            np.array([s.origin for s in stands]), np.array([s.rotation for s in stands])
        ).looks

    def _stands(self, found: StandExamination) -> tuple[Stand, ...]:
        """Name the new stands, from left to right as one faces the object."""
        taken = {stand.name for stand in self.given.stands}
        numbers = (n for n in map(str, range(1, 1000)) if n not in taken)
        order = np.argsort(found.origins[:, 0])
        return tuple(
            stand_at(name, found.origins[k].round(3), self.place)
            for name, k in zip(numbers, order, strict=False)
        )


def _factors(
    examined: StandExamination, expected: ExpectedBounds, frame: Array, goal: Goal
) -> Array:
    """Divide the estimator's standard errors by those of the closed form, (node,).

    Components count as much as they are part of the directions that are asked for: of one that no
    stand sees the closed form knows the prior only.
    """
    axes = directions_wanted("all", frame) if expected.components[0] == "x" else frame
    closed = variances(covariance_of(examined.looks), axes)
    part = np.square(np.einsum("nci,nui->ncu", axes, goal.wanted)).sum(axis=2)
    part = np.where(np.isfinite(expected.std), part, 0.0)
    ratio = np.nan_to_num(expected.std**2 / closed)
    total = part.sum(axis=1)
    of_known = (ratio * part).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, np.sqrt(of_known), 1.0)


def _pixel_noise(experiment: Experiment) -> float:
    """Compute the standard error of a pixel's velocity: a sine fitted to n samples of white noise.

    Of real and imaginary part each it is ``sqrt(2 / n)`` times the noise of a sample.
    """
    rms = experiment.plan.in_si("noise")
    if rms is None and experiment.scene is not None:
        vibrometer = experiment.scene.noisy_vibrometer
        rms = vibrometer.noise * vibrometer.full_scale
    rms = USUAL_NOISE if rms is None else rms
    return float(rms * np.sqrt(2 / sampling_of(experiment.scan).samples_in_all))


def sampling_of(scan: Any) -> Sampling:
    """Find how the pixels of the images are sampled."""
    if isinstance(scan, Scan):
        for part in (p for view in scan.view_names() for p in scan.parts(view)):
            if part.kind == "image":
                return part.sampling
    return Sampling()
