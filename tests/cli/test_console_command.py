"""The command sldvexp console: what it refuses before it serves anything, and what it advises."""

from __future__ import annotations

import importlib.util
import signal
import types

import numpy as np
import pytest
import yaml

from sldvexp import planner
from sldvexp.cli import console
from sldvexp.config.experiment import Experiment
from sldvexp.config.planning import PlanCriterion
from sldvexp.console import Console
from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose
from sldvexp.laser import TwoMirror
from sldvexp.planner.one_more import OneMore
from sldvexp.scan.session import Session
from sldvexp.volume import Grid
from tests.console.conftest import BENCH
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
        "sldvexp: console needs uvicorn: pip install 'sldvexp[console]' installs it, of a "
        "clone in the folder sldvexp pip install './sldvexp[console]'\n"
    )


@pytest.mark.whole
@pytest.mark.one_in(2)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_console_ends_in_order(tmp_path, number):
    served = Served(tmp_path)
    assert served.end(number) == 0
    *_, last = told = served.output.read_text().splitlines()
    assert len(told) == 3
    assert last == "the console has ended: no instrument was opened"


@pytest.fixture
def cut_off(tmp_path, monkeypatch):
    """The folder of a run of the user's own experiment, as Hydra leaves it, from where it began."""
    own, run = tmp_path / "my", tmp_path / "outputs" / "cut"
    (own / "experiment").mkdir(parents=True)
    (own / "experiment" / "bench.yaml").write_text(BENCH)
    (run / ".hydra").mkdir(parents=True)
    (run / ".hydra" / "overrides.yaml").write_text("- experiment=bench\n- seed=3\n")
    sources = [{"path": str(own), "provider": "command-line"}]
    told = {"runtime": {"cwd": str(tmp_path), "config_sources": sources}}
    told["job"] = {"config_name": "config"}
    (run / ".hydra" / "hydra.yaml").write_text(yaml.safe_dump({"hydra": told}))
    monkeypatch.chdir(tmp_path)
    return run


@pytest.fixture
def served(monkeypatch):
    """Consoles that end at once, to be looked at."""
    made = []
    monkeypatch.setattr(Console, "serve", lambda self: made.append(self))
    return made


@pytest.mark.whole
def test_settings_beside_a_run_that_goes_on_hold_for_aiming_and_for_going_on(cut_off, served):
    assert console.run([f"resume={cut_off}", "seed=7", "scan.structure.pixels=[4,5]"], None) == 0
    (one,) = served
    assert one.experiment.seed == 7
    assert one.experiment.scan.structure.pixels == [4, 5]
    gone_on = []

    def refused(settings, *_):
        gone_on.append(settings)
        raise UserError("another program has the folder")

    one._run = refused
    for _ in range(2):  # a run that could not go on still can
        one.bench.further["go_on"]({"do": "go_on"})
    assert gone_on == 2 * [[f"resume={cut_off}", "seed=7", "scan.structure.pixels=[4,5]"]]


@pytest.mark.whole
@pytest.mark.parametrize("added", ["scan.calibration.coarse.stride=16", "seed=7"])
def test_a_setting_that_kept_lines_do_not_go_with_is_refused_at_once(cut_off, served, added):
    (cut_off / "journal").mkdir()
    with pytest.raises(UserError) as error:
        console.run([f"resume={cut_off}", added], None)
    own = cut_off.parents[1] / "my"
    command = f"sldvexp console --config-dir {own} experiment=bench seed=3 {added}"
    assert str(error.value).endswith(f": begin a fresh console instead, {command}")
    assert console.run([f"resume={cut_off}", "volume.margin=0.01"], None) == 0
    assert len(served) == 1


@pytest.mark.whole
def test_what_is_aimed_beside_a_run_that_goes_on_is_an_experiment_made_of_its_own(cut_off, served):
    assert console.run([f"resume={cut_off}"], None) == 0
    (one,) = served
    for number, steps in enumerate([(-371, 1322), (-517, 601), (588, 318), (551, 1430)], 1):
        one.bench.marks.put("1", ("circle", number), steps)
    one.bench.further["write"]({"do": "write", "name": "aimed"})
    file = cut_off.parents[1] / "my" / "experiment" / "aimed.yaml"
    text = file.read_text()
    assert "/experiment/bench" in text
    assert "experiment=aimed seed=3" in text
    views = yaml.safe_load(text)["scan"]["calibration"]["views"]
    assert views["1"]["dac"][0] == [-371, 1322]


def test_another_folder_than_that_of_the_run_that_goes_on_is_refused(cut_off, served, tmp_path):
    (tmp_path / "other").mkdir()
    with pytest.raises(UserError, match=r"was begun with that of .*leave the option out"):
        console.run([f"resume={cut_off}"], str(tmp_path / "other"))


def test_a_run_of_another_root_than_experiments_are_made_for_goes_on_without_a_page(cut_off):
    told = cut_off / ".hydra" / "hydra.yaml"
    told.write_text(told.read_text().replace("config_name: config", "config_name: mine"))
    with pytest.raises(UserError, match=r"--config-name mine, .*; sldvexp resume=.*/cut goes on"):
        console.run([f"resume={cut_off}"], None)


@pytest.fixture
def planned(monkeypatch):
    """Plans that cost nothing: bounds of three views and of a fourth."""

    def plan(asked, undetermined=0, added=()):
        goal = types.SimpleNamespace(criterion=PlanCriterion.mean)
        place = types.SimpleNamespace(nodes=np.zeros((9, 3)))
        return types.SimpleNamespace(
            asked=asked,
            undetermined=undetermined,
            added=added,
            goal=goal,
            place=place,
            one_more=OneMore(0.42, 0.05) if added else None,
        )

    origin, look_at = np.array([1, 2, 3.456]), np.array([0.0, -0.001, 0.0])
    stand = types.SimpleNamespace(origin=origin, look_at=look_at)
    now, after = plan(2e-3, undetermined=4), plan(1e-3, added=(stand,))
    monkeypatch.setattr(planner, "check_stands", lambda *_: now)
    monkeypatch.setattr(planner, "next_stand", lambda *_: after)
    return now, after


VOLUME = Grid(size=[0.3, 0.2], shape=[5, 4], layers=2)


def test_advice_tells_what_is_reached_and_where_to_stand_next(planned):
    found = console.advice(Experiment(volume=VOLUME), {"pose": None, "image/1": None})
    assert found.figure._plan is planned[1]
    assert found.told == [
        "1 of 1 view is done: 1.",
        "If you stopped here: 4 of 9 nodes are seen by too few views to determine all components.",
        "Stand next at (1.00, 2.00, 3.46) m and look at (0.00, 0.00, 0.00) m. Then: the r.m.s. "
        "bound is 1 mm/s where every place is taken by itself, by the noise alone; that of a "
        "smooth field is smaller.",
        "One stand more lowers the bound by 42 % at best.",
    ]


def test_advice_without_a_volume_or_with_too_few_views_says_so(planned, monkeypatch):
    assert "Without a volume" in console.advice(Experiment(), {"image/1": None}).told[0]

    def few(*_):
        raise UserError("3 are needed")

    monkeypatch.setattr(planner, "next_stand", few)
    told = console.advice(Experiment(volume=VOLUME), {"image/1": None}).told
    assert told[-1] == "No stand can be advised: 3 are needed."
    monkeypatch.setattr(planner, "check_stands", few)
    last = console.advice(Experiment(volume=VOLUME), {"image/1": None}).told
    assert last == ["1 of 1 view is done: 1.", console.TOO_FEW, console.NO_MORE]


def test_advice_in_mid_scan_counts_the_views_that_are_done_and_to_come(planned, monkeypatch):
    def few(*_):
        raise UserError("3 are needed")

    monkeypatch.setattr(planner, "next_stand", few)
    monkeypatch.setattr(planner, "check_stands", few)
    views = {name: KnownPose([0, 0, 0], [0, 0, 1]) for name in ("1", "2", "3", "4")}
    experiment = Experiment(volume=VOLUME, scan=Session(poses=views))
    assert console.advice(experiment, {"image/1": None, "image/2": None}).told == [
        "2 of 4 views are done: 1 and 2. Still to come: 3 and 4.",
        console.TOO_FEW,
    ]


def test_advice_before_a_scan_is_what_the_given_stands_reach(planned, monkeypatch):
    asked = []
    monkeypatch.setattr(planner, "check_stands", lambda *given: asked.append(given) or NOW)
    experiment = Experiment(volume=VOLUME)
    found = console.advice(experiment, {})
    assert asked == [(experiment,)]
    assert found.told[0].startswith("The stands that are given: the r.m.s. bound is 2 mm/s")
    assert found.told[1] == console.BETTER
    assert found.figure._plan is NOW


NOW = types.SimpleNamespace(
    asked=2e-3,
    undetermined=0,
    goal=types.SimpleNamespace(criterion=PlanCriterion.mean),
    given=(),
    stands=(),
    place=None,
)


@pytest.mark.whole
def test_figure_of_a_plan_is_drawn_as_it_is_asked_for_and_once(monkeypatch):
    experiment = Experiment(volume=VOLUME, laser=TwoMirror())
    experiment.plan.candidates = 50
    widths, draw = [], planner.figure.draw

    def drawn(plan, width=None):
        widths.append(width)
        return draw(plan, width=width)

    monkeypatch.setattr(planner.figure, "draw", drawn)
    figure = console.PlanFigure(planner.plan(experiment))
    assert widths == []
    narrow, again = figure(True), figure(True)
    assert narrow.startswith(b"\x89PNG")
    assert again is narrow
    assert widths == [console.NARROW]
    assert figure(False) != narrow
    assert widths == [console.NARROW, None]
