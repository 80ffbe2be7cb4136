"""Plans: better than chance, as good as promised, and the next stand after others."""

from __future__ import annotations

import time

import numpy as np
import pytest

from sldvexp import planner
from sldvexp.errors import UserError
from sldvexp.planner import StandPlan
from sldvexp.planner.criterion import Goal, covariance_of
from sldvexp.planner.place import Place, of_search
from sldvexp.planner.search import candidates
from sldvexp.planner.turning import angles_of
from tests.composing import experiment
from tests.planner.planned_experiments import PILLAR, SMALL, plan_of

PLANS = [
    ("plan.criterion=mean", "plan.stands=3", PILLAR),
    ("plan.criterion=worst", "plan.of=in_plane"),
    ("plan.of=[1,0,1]", "plan.stands=4"),
]


def compared(settings: tuple[str, ...], layouts: int) -> tuple[float, float]:
    """Compute a plan's closed form and the best of so many random layouts, with its factors."""
    e = experiment("experiment=plate", *settings)
    found = plan_of(*settings)
    place = Place.from_experiment(e)
    chosen = of_search(place.nodes)
    thinned = place.with_nodes(chosen)
    looks = candidates(thinned, e.plan.candidates, np.random.default_rng(99)).examined.looks
    goal = Goal.evenly(found.goal.wanted[chosen], found.goal.criterion)
    goal = goal.with_factor(found.goal.factor[chosen])
    if found.goal.criterion.name == "mean":  # which a plan has before there are any factors
        goal = goal.with_factor(np.ones(len(chosen)))
    rng = np.random.default_rng(7)
    random = [
        goal.of(covariance_of(looks[rng.choice(len(looks), e.plan.stands, replace=False)]))
        for _ in range(layouts)
    ]
    return goal.of(covariance_of(found.examined.looks[:, chosen])), min(random)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("settings", PLANS)
def test_a_plan_is_better_than_random_layouts(settings):
    planned, best = compared((*SMALL, *settings), 300)
    assert planned < best


@pytest.mark.long
@pytest.mark.parametrize("settings", PLANS)
def test_a_plan_is_better_than_ten_thousand_random_layouts(settings):
    begun = time.process_time()
    planner.plan(experiment("experiment=plate", *settings))
    assert time.process_time() - begun < 10
    planned, best = compared(settings, 10_000)
    assert planned < best


@pytest.mark.whole
def test_a_plan_reaches_the_mean_of_the_best_cone():
    """Within 1 %: all nodes of a plate cannot be seen from one cone."""
    found = planner.plan(experiment("experiment=plate", *SMALL))
    assert 1.0 < closed_form(found) / np.sqrt(3 / 5) < 1.01


@pytest.mark.whole
def test_the_same_seed_gives_the_same_stands_and_another_one_others():
    one, same, other = (
        planner.plan(experiment("experiment=plate", *SMALL, f"seed={seed}")) for seed in (0, 0, 1)
    )
    places = [np.array([s.origin for s in p.stands]) for p in (one, same, other)]
    np.testing.assert_array_equal(places[0], places[1])
    assert not np.array_equal(places[0], places[2])
    assert one.asked == pytest.approx(other.asked, rel=0.02)


@pytest.mark.whole
@pytest.mark.parametrize("thickness", [0.0002, 0.036])
def test_a_planned_view_images_what_it_sees_of_the_volume_and_little_beside(thickness):
    e = experiment("experiment=plate", *SMALL, "plan.stands=3", f"volume.thickness={thickness}")
    found = planner.plan(e)
    for stand in found.stands:
        to_all = angles_of(
            stand.origin[None], stand.rotation[None], found.place.outline, found.place.laser
        )
        seen = found.place.laser.dac_from_angle(to_all[0])
        beside = np.array([seen.min(axis=0) - stand.corners.min(axis=0)])
        beside = np.append(beside, stand.corners.max(axis=0) - seen.max(axis=0))
        assert beside.min() > 0
        assert (beside.reshape(2, 2) / np.ptp(seen, axis=0)).max() < 0.03


@pytest.mark.whole
def test_all_planned_stands_keep_the_limits():
    found = planner.plan(experiment("experiment=plate", *SMALL, "plan.stands=4"))
    assert len(found.stands) == found.new == 4
    assert (found.examined.refused == 0).all()
    assert found.examined.seen.all()
    low, high = found.place.laser.board.value
    for stand in found.stands:
        assert stand.circles.shape == (4, 2)
        assert (0.96 * low <= stand.circles).all()
        assert (stand.circles <= 0.96 * high).all()


@pytest.mark.whole
def test_stands_go_around_a_pillar():
    free = planner.plan(experiment("experiment=plate", *SMALL))
    x, y, z = free.stands[0].origin
    box = f"{{low: [{x - 0.3}, {y - 0.3}, {z - 0.3}], high: [{x + 0.3}, {y + 0.3}, {z + 0.3}]}}"
    found = planner.plan(
        experiment("experiment=plate", *SMALL, f"plan.room.forbidden={{pillar: {box}}}")
    )
    assert (found.examined.refused == 0).all()
    assert found.examined.seen.all()
    gap = [np.abs(s.origin - free.stands[0].origin).max() for s in found.stands]
    assert min(gap) >= 0.3


def closed_form(found: StandPlan) -> float:
    """Compute what was asked for without the pixels, in units of their noise."""
    plain = found.goal.with_factor(np.ones(len(found.place.nodes)))
    return plain.of(covariance_of(found.examined.looks))


THREE = ("~scene.views.4", "~scene.views.5")


@pytest.mark.whole
def test_one_planned_stand_after_three_sees_what_the_last_two_of_the_dissertation_see():
    given = planner.check_stands(experiment("experiment=plate", *SMALL))
    found = planner.next_stand(experiment("experiment=plate", *SMALL, *THREE))
    assert [s.name for s in found.stands] == ["1", "2", "3", "4"]
    assert closed_form(found) < 1.02 * closed_form(given)


@pytest.mark.long
def test_one_planned_stand_after_three_does_what_the_last_two_of_the_dissertation_do():
    given = planner.check_stands(experiment("experiment=plate", "plan.drop_out=0"))
    found = planner.next_stand(experiment("experiment=plate", "plan.drop_out=0", *THREE))
    assert found.asked < 1.02 * given.asked


@pytest.mark.whole
def test_a_check_says_what_stands_do_not_see():
    found = planner.check_stands(experiment("experiment=plate", *SMALL, "plan.room.incidence=20"))
    assert found.new == 0
    assert not found.examined.seen.all()
    assert planner.check_stands(experiment("experiment=plate", *SMALL)).examined.seen.all()


@pytest.mark.whole
def test_a_wanted_bound_gets_as_many_stands_as_it_needs():
    settings = ("experiment=plate", *SMALL)
    four = planner.plan(experiment(*settings, "plan.stands=4"))
    found = planner.plan(experiment(*settings, f"plan.wanted={1.01 * four.asked}"))
    assert len(found.stands) == 4
    assert found.asked <= 1.01 * four.asked
    assert list(found.by_count) == [3, 4, 5, 6, 7, 8]
    assert list(found.by_count.values()) == sorted(found.by_count.values(), reverse=True)


@pytest.mark.whole
def test_a_bound_that_is_out_of_reach_is_refused():
    told = (
        r"^plan.wanted=1e-06: 1e-06 mm/s is out of reach: 8 stands, the most, reach 0\.0\d+ mm/s, "
        r"\S+ times as much; with \S+ times the samples a pixel or the pixels it is within reach; "
        "plan.unit is mm_per_s$"
    )
    settings = ("plan.unit=mm_per_s", "plan.wanted=1e-6")
    with pytest.raises(UserError, match=told):
        planner.plan(experiment("experiment=plate", *SMALL, *settings))


def test_bounds_and_noise_are_wanted_in_a_unit():
    said = experiment(
        "experiment=plate", "plan.unit=mm_per_s", "plan.wanted=0.07", "plan.noise=0.4"
    )
    assert said.plan.in_si("wanted") == pytest.approx(7e-5)
    assert said.plan.in_si("noise") == pytest.approx(4e-4)
    assert experiment("experiment=plate").plan.in_si("wanted") is None


@pytest.mark.whole
def test_more_noise_makes_bounds_wider_in_proportion():
    one, two = (
        planner.plan(experiment("experiment=plate", *SMALL, f"plan.noise={noise}"))
        for noise in (1e-4, 3e-4)
    )
    assert one.noise == pytest.approx(1e-4 * np.sqrt(2 / 512))
    np.testing.assert_allclose(two.bounds, 3 * one.bounds)


@pytest.mark.whole
def test_a_gage_counts_its_ends_alone_and_has_the_bound_of_its_strain():
    ends = "[[0.30,0.14,0],[0.52,0.14,0]]"
    found = planner.plan(
        experiment("experiment=plate", *SMALL, "plan.drop_out=0", f"plan.gage={ends}")
    )
    gage = found.gage
    assert gage is not None
    assert np.abs(gage.along) == pytest.approx([1, 0, 0])
    x = found.expected.components.index("x")
    at_ends = found.bounds[gage.nodes, x]
    assert found.asked == pytest.approx(np.sqrt(np.mean(at_ends**2)), rel=0.05)
    difference = np.sqrt(np.sum(at_ends**2)) / gage.length / (2 * np.pi * 197)
    assert gage.strain(found.asked, 197) == pytest.approx(difference, rel=0.05)
    everywhere = planner.plan(experiment("experiment=plate", *SMALL, "plan.drop_out=0"))
    assert found.asked < 0.9 * np.sqrt(np.mean(everywhere.bounds[gage.nodes, x] ** 2))


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("ends", "told"),
    [
        ("[[0.3,0.14,0],[0.3,0.14,1]]", "is 1 m away from the surface"),
        ("[[0.3,0.14,0],[0.301,0.14,0]]", "both ends are at the same node"),
    ],
)
def test_gages_that_are_none_are_refused(ends, told):
    with pytest.raises(UserError, match=told):
        planner.plan(experiment("experiment=plate", *SMALL, f"plan.gage={ends}"))
