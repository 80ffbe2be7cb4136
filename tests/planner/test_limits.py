"""Limits of the room that hold stands back, and stands that are one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp import planner
from sldvexp.cli.plan import told
from sldvexp.planner.done import NOBODY
from sldvexp.planner.images import stand_at
from sldvexp.planner.limits import nearly_one
from sldvexp.planner.search import examined, move, move_in_rooms
from tests.composing import experiment
from tests.planner.planned_experiments import SMALL


def test_stands_that_nearly_coincide_are_told():
    e = experiment("experiment=plate", *SMALL)
    place = planner.planned.Place.from_experiment(e)
    origins = {"1": [0.1, 0.1, 1.5], "2": [0.11, 0.1, 1.51], "3": [0.4, 0.1, 1.5]}
    stands = [stand_at(name, np.array(origin), place) for name, origin in origins.items()]
    (one,) = nearly_one(stands, place)
    assert one.startswith("stands 1 and 2 stand 14 mm apart: they are one stand measured twice")


@pytest.mark.whole
def test_the_limit_that_costs_most_is_named_with_what_loosening_it_gives():
    """Under a ceiling of 0.1 m no stand sees the plate from above; elsewhere there is room."""
    settings = ["experiment=plate", *SMALL, "plan.room.low=[null,-1,null]", "plan.stands=4"]
    low = experiment(*settings, "plan.room.high=[null,0.1,null]")
    found = planner.plan(low)
    first = found.limits[0]
    assert (first.setting, first.before) == ("plan.room.high=[null,0.5,null]", "[null,0.1,null]")
    wider = planner.plan(experiment(*settings, first.setting))
    assert 1 - wider.asked / found.asked == pytest.approx(first.gain, abs=0.1)
    (line,) = (line for line in told(found, "", low) if line.startswith("the room limits"))
    assert "with plan.room.high=[null,0.5,null] in place of [null,0.1,null] the bound" in line
    assert not any("the room limits" in line for line in told(replace(found, limits=()), "", low))


def test_stands_are_moved_in_rooms_together_as_in_each_alone(monkeypatch):
    monkeypatch.setattr("sldvexp.planner.search.FIRST_STEP", 0.02)
    e = experiment("experiment=plate", *SMALL)
    task = planner.planned._Task.of(e, NOBODY)
    place, room = task.thinned, task.thinned.room
    given = examined(place, np.array([[-0.6, 0.2, 1.2], [0.7, -0.3, 1.3]]))
    rooms = [room, replace(room, mirrors=1.0), replace(room, distance=[0.9, 1.45])]
    others = given, 0.5, task._looks_of_given()

    def rng():
        return np.random.default_rng(3)

    together = move_in_rooms(task.goal, place, rooms, *others, [rng() for _ in rooms])
    for moved, of in zip(together, rooms, strict=True):
        alone = move(task.goal, replace(place, room=of), *others, rng())
        np.testing.assert_array_equal(moved.origins, alone.origins)
        np.testing.assert_array_equal(moved.why, alone.why)
    assert not np.array_equal(together[0].origins, given.origins)
    assert not np.array_equal(together[0].origins, together[2].origins)
