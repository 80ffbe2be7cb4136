"""The command as a whole: its start, its exit statuses, its files, and plugins of others."""

from __future__ import annotations

import copy
import errno
import fcntl
import hashlib
import json
import os
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
import yaml
from hydra.core.config_store import ConfigStore

from sldvexp.config import registry
from sldvexp.errors import UserError
from sldvexp.sweep.lock import locked

CONF = Path(__file__).parents[2] / "conf"
QUICK = ("~experiment", "target=dissertation")
POSE = ("experiment=pose", "check.pose_repeats.repeats=20")


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ("experiment=dissertation/registration --cfg job", "figure_4_28.reg"),
        ("--help", "contravariant"),
        ("list", "contravariant"),
        ("show scene=plate", "plate.thickness: 0.00"),
    ],
)
def test_what_answers_at_once_imports_nothing_heavy(loaded_by, arguments, answer):
    libraries, said = loaded_by("from sldvexp.cli.main import main; main()", *arguments.split())
    assert libraries == ""
    assert answer in said


def test_exit_status_tells_what_happened(sldvexp, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    assert sldvexp(*QUICK).status == 0
    assert sldvexp(*QUICK, "seed=-1").status == 1
    assert sldvexp(*QUICK, "expect.x={at_most: {target/position: 0.1}}").status == 2
    monkeypatch.setattr("sldvexp.pipeline.runner.run", interrupt)
    done = sldvexp(*QUICK)
    assert (done.status, done.err) == (130, "sldvexp: interrupted\n")


def test_mistake_shows_its_place_in_the_program_on_demand(sldvexp, monkeypatch):
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    with pytest.raises(UserError, match="seed"):
        sldvexp(*QUICK, "seed=-1")
    assert os.environ["HYDRA_FULL_ERROR"] == "1"
    monkeypatch.delenv("HYDRA_FULL_ERROR")
    sldvexp(*QUICK, "seed=-1")
    assert "HYDRA_FULL_ERROR" not in os.environ


def test_defect_is_not_called_a_mistake(sldvexp, monkeypatch):
    def stumble(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr("sldvexp.pipeline.runner.run", stumble)
    with pytest.raises(ZeroDivisionError):
        sldvexp(*QUICK)


def test_help_names_groups_and_how_to_go_on(sldvexp):
    done = sldvexp("--help")
    assert done.status == 0
    for group in ("target", "laser", "instrument", "pose", "reconstruction", "experiment"):
        assert group in done.out
    assert "sldvexp experiment=pose pose.path=mine.reg" in done.out


def test_configuration_is_shown_without_a_run(sldvexp, tmp_path):
    done = sldvexp("experiment=pose", "seed=7", "--cfg", "job")
    shown = yaml.safe_load(done.out)
    assert done.status == 0
    assert (shown["seed"], shown["pose"]["path"]) == (7, "conf://data/figure_4_28.csv")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.whole
def test_same_configuration_and_seed_give_the_same_bits(sldvexp):
    arguments = (*POSE, "instrument=file", "instrument.path=conf://data/point_measured.csv")
    arguments += ("reconstruction=absolute", "seed=3")
    one, two, other = (sldvexp(*arguments, *more).tree for more in ((), (), ("seed=4",)))
    assert one.groups == two.groups
    assert {"/pose", "/point", "/line_of_sight", "/examined/pose_repeats"} <= set(one.groups)
    for group in one.groups:
        assert set(one[group].variables) == set(two[group].variables)
        for name, variable in one[group].variables.items():
            assert variable.values.tobytes() == two[group][name].values.tobytes(), (group, name)
    repeats = "examined/pose_repeats/std_ratio"
    assert not np.array_equal(one[repeats], other[repeats])


@pytest.mark.whole
def test_run_says_how_it_was_made(sldvexp, tmp_path):
    reg = tmp_path / "mine.reg"
    reg.write_bytes((CONF / "data/figure_4_28.reg").read_bytes())
    attributes = sldvexp(*POSE, "pose.path=mine.reg", "seed=5").tree.attrs
    config = yaml.safe_load(attributes["config"])
    assert (config["seed"], config["pose"]["path"]) == (5, "mine.reg")
    assert attributes["config_sha256"] == hashlib.sha256(attributes["config"].encode()).hexdigest()
    digest = hashlib.sha256(reg.read_bytes()).hexdigest()
    assert json.loads(attributes["inputs_sha256"]) == {"mine.reg": digest}
    assert json.loads(attributes["packages"])["numpy"] == np.__version__
    assert attributes["seed"] == 5
    start, end = (datetime.fromisoformat(attributes[f"{t}_time"]) for t in ("start", "end"))
    assert start <= end
    assert start.tzinfo is not None


def test_write_that_fails_leaves_nothing(sldvexp, monkeypatch):
    def half(_, path):
        Path(path).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sldvexp.dataset.store._write", half)
    done = sldvexp(*QUICK)
    assert done.status == 1
    file = done.folder / ".new-run/run.nc"
    assert done.err == f"sldvexp: {file}: cannot be written: No space left on device\n"
    assert sorted(f.name for f in done.folder.iterdir()) == [".hydra", ".lock", "sldvexp.log"]


@pytest.mark.whole
def test_sweep_leaves_one_run_for_each_value(sldvexp, tmp_path):
    done = sldvexp("-m", *QUICK, "seed=1,2", "hydra.sweep.dir=sweep")
    assert done.status == 0
    files = (tmp_path / "sweep").glob("*/run.nc")
    assert {xr.open_datatree(f, engine="netcdf4").attrs["seed"] for f in files} == {1, 2}


@pytest.mark.whole
def test_sweep_goes_on_after_a_mistake(sldvexp, tmp_path):
    done = sldvexp("-m", *QUICK, "seed=-1,2", "hydra.sweep.dir=sweep")
    assert done.status == 1
    assert done.err == "sldvexp: command line: seed must be zero or a positive integer, not -1\n"
    (file,) = (tmp_path / "sweep").glob("*/run.nc")
    assert "seed=2" in file.parent.name


@pytest.fixture
def installed(monkeypatch):
    """Give entry points as if packages were installed that have them; undone afterwards."""
    for group, plugins in registry.BUILT_IN.items():
        for name in plugins:  # one that is first imported meanwhile would be lost afterwards
            registry.get(group, name)
    store = ConfigStore.instance()
    monkeypatch.setattr(store, "repo", copy.deepcopy(store.repo))
    monkeypatch.setattr(registry, "_plugins", {g: dict(p) for g, p in registry._plugins.items()})

    def install(**loaders):
        entries = [
            SimpleNamespace(
                name=name,
                value="a:b",
                load=load,
                dist=SimpleNamespace(name=f"{name}-1", version="1"),
            )
            for name, load in loaders.items()
        ]
        monkeypatch.setattr("importlib.metadata.entry_points", lambda group: entries)
        registry.load_installed.cache_clear()

    yield install
    registry.load_installed.cache_clear()


def test_broken_plugin_of_others_only_warns(sldvexp, installed):
    def broken():
        raise ImportError("no module named stranger")

    installed(stranger=broken)
    with pytest.warns(
        UserWarning, match="stranger of the package stranger-1 cannot be loaded: Imp"
    ):
        done = sldvexp(*QUICK, "check.x.plugin=nope")
    assert done.err.startswith("sldvexp: command line: check.x.plugin: there is no check=nope; ")
    assert sldvexp(*QUICK).status == 0


@pytest.mark.whole
def test_plugin_of_others_is_found(sldvexp, installed):
    from sldvexp.targets import FiducialPoints

    def load():
        plugin = type("Mine", (FiducialPoints,), {"__module__": "stranger"})
        registry.register("target", "mine")(plugin)

    installed(stranger=load)
    assert sldvexp("~experiment", "target=mine", "--cfg", "job").status == 0
    marks = "{1: {x: 0, y: 0}, 2: {x: 1, y: 0}, 3: {x: 0, y: 1}}"
    done = sldvexp("~experiment", "target=mine", f"target.fiducials={marks}")
    assert done.status == 0, done.err
    assert json.loads(done.tree.attrs["plugins"])["target"] == "mine"


@pytest.mark.parametrize("loaded", [True, False])
def test_two_plugins_of_one_name_are_refused(installed, monkeypatch, loaded):
    installed()
    if loaded:
        registry.get("pose", "given")
    else:
        monkeypatch.setattr(registry, "_plugins", {})
    with pytest.raises(UserError, match=r"two plugins are called pose=given: sldvexp\.pose\.given"):
        registry.register("pose", "given")(type("Given", (), {"__module__": "stranger"}))
    if loaded:
        assert registry.get("pose", "given").__module__ == "sldvexp.pose.given"


def test_first_defect_of_a_sweep_is_the_one_that_is_raised(sldvexp, monkeypatch):
    def stumble(cfg, folder, **others):
        raise ZeroDivisionError(cfg.seed)

    monkeypatch.setattr("sldvexp.pipeline.runner.run", stumble)
    with pytest.raises(ZeroDivisionError, match="1"):
        sldvexp("-m", *QUICK, "seed=1,2", "hydra.sweep.dir=sweep")


@pytest.mark.whole
def test_resume_keeps_the_configuration_and_any_folder(sldvexp, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/other.yaml").write_text("defaults: [config, _self_]\nseed: 77\n")
    folder = tmp_path / "a (b), 'c' \"d\""
    quoted = str(folder).replace("'", "\\'")
    options = ("--config-dir", "mine", "--config-name", "other")
    assert sldvexp(*QUICK, f"hydra.run.dir='{quoted}'", *options).status == 0
    (folder / "run.nc").unlink()
    done = sldvexp(f"resume={folder}", "hydra.run.dir=x")
    assert done.status == 0, done.err
    assert xr.open_datatree(folder / "run.nc", engine="netcdf4").attrs["seed"] == 77


def contents(folder):
    return {f: f.read_bytes() for f in folder.rglob("*") if f.is_file()}


@pytest.mark.one_in(6)
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "has a finished run; overwrite=true puts this one in its place"),
        (["seed=-1"], "seed must be zero"),
        (["overwrite=true", "seed=-1"], "seed must be zero"),
        (["overwrite=true", "pose.nope=1"], "is not a known setting"),
        (["overwrite=true", "pose=nope"], "there is no pose=nope"),
        (["overwrite=true", "+hydra.nope=1", "seed=x"], "must be a whole number"),
    ],
)
def test_a_refused_command_leaves_a_finished_run_as_it_was(sldvexp, tmp_path, arguments, told):
    where = f"hydra.run.dir={tmp_path}/same"
    assert sldvexp(*POSE, where).status == 0
    before = contents(tmp_path)
    assert {f.name for f in before} >= {"run.nc", "pose.txt", "overrides.yaml", "sldvexp.log"}
    done = sldvexp(*POSE, where, *arguments)
    assert done.status == 1
    assert told in done.err
    assert contents(tmp_path) == before


@pytest.mark.whole
def test_results_are_replaced_only_by_better_ones(sldvexp, tmp_path, monkeypatch):
    folder = tmp_path / "same"
    where = (f"hydra.run.dir={folder}", "overwrite=true")
    assert sldvexp(*POSE, *where).status == 0
    before = {name: (folder / name).read_bytes() for name in ("run.nc", "pose.txt")}

    def stumble(_):
        raise ZeroDivisionError

    with monkeypatch.context() as broken:
        broken.setattr("sldvexp.pipeline.runner.pose_text", stumble)
        with pytest.raises(ZeroDivisionError):
            sldvexp(*POSE, *where)
    assert {name: (folder / name).read_bytes() for name in before} == before
    given = ("~experiment", "pose=given", f"pose.path={folder}/run.nc")
    assert sldvexp(*given, *where).status == 0
    assert (folder / "run.nc").read_bytes() != before["run.nc"]
    assert sldvexp(*QUICK, *where).status == 0
    assert not (folder / "pose.txt").exists()  # of the pose that is not in run.nc any more


def test_a_finished_run_is_not_gone_on_with(sldvexp):
    done = sldvexp(*QUICK)
    again = sldvexp(f"resume={done.folder}")
    assert again.status == 1
    assert "this run is finished" in again.err


def test_version(sldvexp):
    done = sldvexp("--version")
    assert done.status == 0
    assert done.out.startswith(f"sldvexp {version('sldvexp')}")


def test_two_runs_in_one_folder(sldvexp, tmp_path):
    with locked(tmp_path / "run0/.lock"):
        done = sldvexp("~experiment", "target=dissertation")
    assert done.status == 1
    assert done.err == f"sldvexp: {tmp_path / 'run0'}: another run is at work in this folder\n"
    assert not (done.folder / "run.nc").exists()


@pytest.mark.parametrize("system", ["without locks there", "without locks at all"])
def test_a_system_without_locks(sldvexp, monkeypatch, system):
    def refused(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    if system == "without locks there":
        monkeypatch.setattr(fcntl, "flock", refused)
    else:
        monkeypatch.setattr("sldvexp.sweep.lock.fcntl", None)
    assert sldvexp("~experiment", "target=dissertation").status == 0
