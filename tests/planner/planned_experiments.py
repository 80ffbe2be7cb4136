"""What tests of plans set."""

from __future__ import annotations

from functools import cache

from sldvexp.planner import StandPlan
from sldvexp.planner.done import NOBODY
from sldvexp.planner.planned import _Task
from tests.composing import experiment

#: A field so coarse that its bounds take a moment.
SMALL = ("volume.shape=[9,7]", "volume.layers=3", "plan.candidates=300")

#: Something that stands in the way of stands.
PILLAR = "plan.room.forbidden={pillar: {low: [0.9,-1,0.8], high: [1.2,2,1.1]}}"


@cache
def plan_of(*settings: str) -> StandPlan:
    """Plan once for all tests of a process; nobody changes the plan, and no limits are tried."""
    task = _Task.of(experiment("experiment=plate", *settings), NOBODY)
    return task.planned(task.experiment.plan.stands)
