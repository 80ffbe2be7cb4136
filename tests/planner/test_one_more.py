"""One stand more: not beside another one where the criterion is flat, and told what it is worth."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import planner
from sldvexp.config.planning import PlanCriterion
from sldvexp.geometry import KnownPose
from sldvexp.planner.criterion import Goal, covariance_of, directions_wanted
from sldvexp.planner.one_more import AS_GOOD, OneMore, one_more
from sldvexp.planner.place import Place
from sldvexp.planner.search import candidates, examined
from sldvexp.pose.given import Given
from tests.composing import experiment
from tests.planner.planned_experiments import SMALL

#: Seven stands on the best cone around the plate's middle: all components have the same bound, and
#: the eighth is worth the same anywhere.
MIDDLE = np.array([0.42, 0.14, 0.0])
TURNS = np.radians(np.arange(7) * 360 / 7 + 12)
CONE = MIDDLE + 1.6 * np.stack([0.8 * np.cos(TURNS), 0.8 * np.sin(TURNS), np.full(7, 0.6)], axis=1)


def direction(places):
    ways = places - MIDDLE
    return ways / np.linalg.norm(ways, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def searched():
    """Feasible places, and the goal that they are compared by."""
    place = Place.from_experiment(experiment("experiment=plate", *SMALL)).thinned()
    found = candidates(place, 200, np.random.default_rng(0)).examined
    goal = Goal.evenly(directions_wanted("all", place.frame), PlanCriterion.mean)
    return place, found, goal


@pytest.mark.parametrize("count", [3, 5, 7])
def test_of_places_as_good_as_the_best_the_farthest_is_taken(searched, count):
    place, found, goal = searched
    there = CONE[:: 7 // count][:count]
    begun = examined(place, there).looks
    tried = found.and_also(examined(place, there))  # as a search may end beside a stand
    taken, worth = one_more(goal, tried, begun, there, MIDDLE)
    values = goal.with_one_more(covariance_of(begun), tried.looks)
    own = goal.with_one_more(covariance_of(begun), taken.looks)[0]
    assert own <= (1 + AS_GOOD) * values.min()
    good = tried.origins[values <= (1 + AS_GOOD) * values.min()]
    nearest = (direction(good) @ direction(there).T).max(axis=1)
    assert (direction(taken.origins) @ direction(there).T).max() == nearest.min()
    assert worth is not None
    before = goal.of(covariance_of(begun))
    assert worth.best == pytest.approx(1 - values.min() / before)
    assert worth.least == pytest.approx(1 - values.max() / before)


def test_what_one_more_is_worth_is_said_plainly():
    flat = "one stand more lowers the bound by 7 %, wherever it stands; this place is the one "
    assert OneMore(0.0743, 0.0738).told == f"{flat}farthest from the others"
    assert OneMore(0.42, 0.05).told == "one stand more lowers the bound by 42 % at best"


def test_of_stands_that_determine_nothing_nobody_says_what_one_more_is_worth(searched):
    place, found, goal = searched
    _, worth = one_more(goal, found, examined(place, CONE[:2]).looks, CONE[:2], MIDDLE)
    assert worth is None


@pytest.mark.whole
def test_the_next_stand_after_many_is_not_beside_one_of_them():
    e = experiment("experiment=plate", *SMALL)
    e.pose = Given(
        views={
            str(k): KnownPose(origin=place.tolist(), look_at=[0.3, 0.14, 0.0])
            for k, place in enumerate(CONE, 1)
        }
    )
    found = planner.next_stand(e)
    (new,) = found.added
    angle = np.degrees(np.arccos((direction(CONE) @ direction(new.origin)).max()))
    assert angle > 20
    assert found.one_more is not None
    assert 0.04 < found.one_more.least < found.one_more.best < 0.06
    assert "wherever it stands" in found.one_more.told
