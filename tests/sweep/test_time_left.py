"""The time left of a sweep is true: shared steps are counted as often as they are computed."""

from __future__ import annotations

import itertools
import time

import pytest

from sldvexp.sweep.record import Record, State
from sldvexp.sweep.time_left import SweepTimeLeft

#: What steps take, s; the scan is shared by runs that differ in what comes after it.
STEPS = {"scan": 50.0, "pose": 2.0, "velocity field": 5.0, "checks": 1.0}
BESIDES, LOADING, TAKING = 0.5, 4.0, 0.1


class Swept:
    """A sweep whose steps take known times, run by run."""

    def __init__(self, jobs, workers=1):
        self.jobs, self.workers = jobs, workers
        self.records = []
        seen = set()
        for number, job in enumerate(jobs):
            values = dict(o.split("=") for o in job)
            decides = {
                "scan": (values.get("seed"),),
                "pose": (values.get("seed"), values.get("pose")),
                "velocity field": tuple(sorted(values.items())),
            }
            steps, reused = {}, []
            for name, seconds in STEPS.items():
                key = (name, decides.get(name))
                taken = name in decides and key in seen
                seen.add(key)
                steps[name] = TAKING if taken else seconds
                reused += [name] * taken
            if number == 0:
                steps["scan"] += LOADING
            total = sum(steps.values()) + BESIDES
            self.records.append(Record(State.done, seconds=total, steps=steps, reused=reused))

    def errors(self):
        """Relative error of what is told after each run, None where nothing is told."""
        left, found = SweepTimeLeft(self.jobs), []
        for number, record in enumerate(self.records):
            left.add(number, record, record.seconds / self.workers)
            true = sum(r.seconds for r in self.records[number + 1 :]) / self.workers
            told = left.seconds
            found.append(None if told is None else (told - true) / (true or 1.0))
        return found


def product(**keys):
    rows = itertools.product(*([f"{k}={v}" for v in values] for k, values in keys.items()))
    return [list(row) for row in rows]


SWEEPS = {
    "methods of one scan": product(reconstruction=["a", "b", "c", "d", "e"]),
    "a scan a seed": product(seed=[1, 2, 3, 4]),
    "poses within seeds": product(seed=[1, 2, 3], pose=["bitangent", "edge"]),
    "seeds within methods": product(reconstruction=["a", "b"], seed=[1, 2, 3]),
}


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", SWEEPS)
def test_it_is_true_from_the_second_run_on(name):
    first, *rest = Swept(SWEEPS[name]).errors()
    assert first is None or abs(first) < 0.2
    assert all(abs(error) < 0.2 for error in rest), rest


def test_runs_side_by_side_take_less():
    assert all(abs(e) < 0.2 for e in Swept(SWEEPS["a scan a seed"], 2).errors()[1:])


def test_a_short_first_run_tells_more_of_loading():
    left = SweepTimeLeft(product(seed=[1, 2, 3]))
    left.add(0, Record(State.done, seconds=6.0, steps={"pose": 5.5}), 6.0)
    assert left.seconds is None
    left.add(1, Record(State.done, seconds=1.0, steps={"pose": 0.5}), 1.0)
    assert left.seconds == pytest.approx(1.0)


def test_runs_that_were_done_before_cost_nothing_and_say_nothing():
    jobs = product(reconstruction=["a", "b", "c"])
    left = SweepTimeLeft(jobs)
    left.add(0, Record(State.done, seconds=60.0, steps={"scan": 50.0}), None)
    assert left.seconds is None
    taken = Record(
        State.done, seconds=40.0, steps={"scan": 0.1, "velocity field": 39.0}, reused=["scan"]
    )
    left.add(1, taken, 40.0)
    assert left.seconds == pytest.approx(40.0)


def test_telling_the_time_left_costs_little_beside_a_run():
    """Processor time; measured 0.3 s. What decides the steps of a run was found anew each time."""
    jobs = product(
        experiment=["plate"],
        seed=range(200),
        pose=["edge"],
        reconstruction=["absolute"],
        solver=["cholesky"],
        report=["none"],
    )
    left, record = SweepTimeLeft(jobs), Record(State.done, seconds=10.0, steps=STEPS)
    begun = time.process_time()
    for number in range(3):
        left.add(number, record, 10.0)
        assert number == 0 or left.seconds is not None
    assert time.process_time() - begun < 3.0
