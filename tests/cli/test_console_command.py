"""The command sldvexp console: what it refuses before it serves anything, and what it advises."""

from __future__ import annotations

import importlib.util
import signal
import types

import numpy as np
import pytest

from sldvexp import planner
from sldvexp.cli import console
from sldvexp.config.experiment import Experiment
from sldvexp.config.planning import PlanCriterion
from sldvexp.errors import UserError
from sldvexp.laser import TwoMirror
from sldvexp.volume import Grid
from tests.console.served import Served


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["experiment=pose"], "console: needs a scan and an instrument that scans"),
        (["experiment=plate", "--port", "99999"], "--port must be a number up to 65535, not 99999"),
        (["experiment=plate", "--port", "http"], "--port must be a number up to 65535, not http"),
        (["experiment=nowhere"], "nowhere"),
        (["experiment=plate", "scan.structure.pixels=[0,1]"], "must be two positive numbers"),
        (["experiment=plate", "-m"], "console takes no option --multirun"),
    ],
    ids=lambda words: " ".join(words) if isinstance(words, list) else "",
)
def test_mistake_is_told_in_a_sentence(sldvexp, words, told):
    done = sldvexp("console", *words)
    assert done.status == 1
    assert done.err.startswith("sldvexp: ")
    assert told in done.err


def test_packages_that_are_missing_are_named_with_what_installs_them(sldvexp, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "uvicorn" else found(name, *a)
    )
    done = sldvexp("console", "experiment=plate")
    assert done.status == 1
    assert done.err == (
        "sldvexp: console needs uvicorn: pip install 'sldvexp[console]' installs it\n"
    )


@pytest.mark.one_in(2)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_console_ends_in_order(tmp_path, number):
    served = Served(tmp_path)
    assert served.end(number) == 0
    assert len(served.output.read_text().splitlines()) == 2


@pytest.fixture
def planned(monkeypatch):
    """Plans that cost nothing: bounds of three views and of a fourth."""

    def plan(asked, undetermined=0, added=()):
        goal = types.SimpleNamespace(criterion=PlanCriterion.mean)
        place = types.SimpleNamespace(nodes=np.zeros((9, 3)))
        return types.SimpleNamespace(
            asked=asked, undetermined=undetermined, added=added, goal=goal, place=place
        )

    stand = types.SimpleNamespace(origin=[1, 2, 3.456], look_at=[0, 0, 0])
    now, after = plan(2e-3, undetermined=4), plan(1e-3, added=(stand,))
    monkeypatch.setattr(planner, "check_stands", lambda *_: now)
    monkeypatch.setattr(planner, "next_stand", lambda *_: after)
    monkeypatch.setattr(console, "_drawn", lambda plan, width=None: b"drawn")


VOLUME = Grid(size=[0.3, 0.2], shape=[5, 4], layers=2)


def test_advice_tells_what_is_reached_and_where_to_stand_next(planned):
    found = console.advice(Experiment(volume=VOLUME), {"pose": None, "image/1": None})
    assert found.figure == b"drawn"
    assert found.told == [
        "If you stopped here: 4 of 9 nodes are seen by too few views to determine all components.",
        "Stand next at (1.00, 2.00, 3.46) m and look at (0.00, 0.00, 0.00) m. Then: the r.m.s. "
        "bound is 1 mm/s, of the noise at every place by itself.",
    ]


def test_advice_without_a_volume_or_with_too_few_views_says_so(planned, monkeypatch):
    assert "Without a volume" in console.advice(Experiment(), {"image/1": None}).told[0]

    def few(*_):
        raise UserError("3 are needed")

    monkeypatch.setattr(planner, "next_stand", few)
    told = console.advice(Experiment(volume=VOLUME), {"image/1": None}).told
    assert told[-1] == "No stand can be advised: 3 are needed."
    monkeypatch.setattr(planner, "check_stands", few)
    assert console.advice(Experiment(volume=VOLUME), {"image/1": None}).told == [console.TOO_FEW]


def test_advice_before_a_scan_is_what_the_given_stands_reach(planned, monkeypatch):
    asked = []
    monkeypatch.setattr(planner, "check_stands", lambda *given: asked.append(given) or NOW)
    experiment = Experiment(volume=VOLUME)
    found = console.advice(experiment, {})
    assert asked == [(experiment,)]
    assert found.told[0].startswith("The stands that are given: the r.m.s. bound is 2 mm/s")
    assert (found.told[1], found.figure) == (console.BETTER, b"drawn")


NOW = types.SimpleNamespace(
    asked=2e-3, undetermined=0, goal=types.SimpleNamespace(criterion=PlanCriterion.mean)
)


def test_figure_of_a_plan_is_a_picture():
    experiment = Experiment(volume=VOLUME, laser=TwoMirror())
    experiment.plan.candidates = 50
    assert console._drawn(planner.plan(experiment)).startswith(b"\x89PNG")
