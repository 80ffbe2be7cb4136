"""The same sweep again does what is missing, failed or changed, and nothing else."""

from __future__ import annotations

import os
import platform
import re
import time

import pytest
import xarray as xr

from sldvexp.config.experiment import Retry
from sldvexp.config.paths import conf_dir
from sldvexp.pipeline import provenance
from sldvexp.sweep import job, record
from sldvexp.sweep.plan import folder_name
from sldvexp.sweep.record import State

TINY = ("~experiment", "target=dissertation")
SEEDS = "seed=1,-2,3"
WHERE = "hydra.sweep.dir=swept"


@pytest.fixture
def sweep(sldvexp, tmp_path):
    """Do the sweep; which seeds' runs it has computed, by the bytes and times of their records."""

    def call(*added, seeds=SEEDS):
        before = fingerprints(tmp_path / "swept")
        done = sldvexp("-m", *TINY, seeds, WHERE, *added)
        after = fingerprints(tmp_path / "swept")
        return done, {seed for seed in after if after[seed] != before.get(seed)}

    return call


def fingerprints(folder):
    found = {}
    for path in folder.glob("*/record.json"):
        seed = re.search(r"seed=(-?\d+)", path.parent.name)[1]
        run = path.with_name("run.nc")
        files = [f for f in (path, run) if f.is_file()]
        found[seed] = [(f.stat().st_mtime_ns, f.read_bytes()) for f in files]
    return found


def run_of(folder, seed):
    return (
        folder / "swept" / folder_name(["~experiment=null", "target=dissertation", f"seed={seed}"])
    )


@pytest.mark.long
def test_only_what_failed_is_done_again(sweep):
    assert sweep()[1] == {"1", "-2", "3"}
    done, computed = sweep()
    assert (done.status, computed) == (1, {"-2"})
    done, computed = sweep("sweep.retry=missing")
    assert (done.status, computed) == (1, set())
    assert sweep("sweep.retry=failed")[1] == {"-2"}
    assert sweep("sweep.retry=all")[1] == {"1", "-2", "3"}


@pytest.mark.long
def test_only_new_values_are_done(sweep):
    sweep()
    assert sweep("sweep.retry=failed", seeds="seed=1,3,4")[1] == set()
    assert sweep("sweep.retry=missing", seeds="seed=1,-2,3,4")[1] == {"4"}


@pytest.mark.whole
@pytest.mark.parametrize("damage", ["torn record", "no run", "no record", "cut off"])
def test_what_is_missing_is_done_again(damage, sweep, tmp_path):
    sweep(seeds="seed=1,3")
    run = run_of(tmp_path, 3)
    if damage == "no run":
        (run / "run.nc").unlink()
    elif damage == "no record":
        (run / "record.json").unlink()
    elif damage == "torn record":
        (run / "record.json").write_text((run / "record.json").read_text()[:40])
    else:
        record.write(run, record.Record(State.running, record.read(run).identity))
        left = f".run.sldvexp-{os.getpid()}-{platform.node()}.nc"
        (run / left).write_bytes(b"half")
    done, computed = sweep(seeds="seed=1,3")
    assert (done.status, computed) == (0, {"3"})
    assert not list(run.glob(".run.*"))


@pytest.mark.whole
def test_other_version_of_a_package_does_it_again(sweep, monkeypatch):
    sweep(seeds="seed=1,3")
    monkeypatch.setattr(provenance, "versions", lambda: {"sldvexp": "0.0.0"})
    assert sweep(seeds="seed=1,3")[1] == {"1", "3"}


def test_scan_lines_of_other_settings_are_put_aside(tmp_path):
    def left(identity, retry=Retry.unfinished):
        (tmp_path / "journal").mkdir(exist_ok=True)
        record.write(tmp_path, record.Record(State.failed, "before"))
        job._put_aside(tmp_path, identity, retry)
        return sorted(path.name for path in tmp_path.glob("journal*"))

    assert left("before") == ["journal"]
    assert left("now") == ["journal-before-1"]
    assert left("before", Retry.all) == ["journal-before-1", "journal-before-2"]


@pytest.mark.long
def test_clock_that_goes_backwards_changes_nothing(sweep, monkeypatch):
    sweep(seeds="seed=1,3")
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert sweep(seeds="seed=1,3")[1] == set()


@pytest.mark.whole
def test_changed_input_file_does_it_again(sldvexp, tmp_path):
    mine = tmp_path / "mine.csv"
    mine.write_bytes((conf_dir() / "data" / "point_example.csv").read_bytes())
    call = (
        "-m",
        "experiment=point",
        "instrument.path=mine.csv,conf://data/point_example.csv",
        WHERE,
    )

    def times():
        found = (tmp_path / "swept").glob("*/run.nc")
        return {f.parent.name[-12:]: f.stat().st_mtime_ns for f in found}

    assert sldvexp(*call).status == 0
    before = times()
    assert sldvexp(*call).status == 0
    assert times() == before
    mine.write_text(mine.read_text().replace("450", "451"))
    assert sldvexp(*call).status == 0
    assert sum(before[name] != now for name, now in times().items()) == 1


@pytest.mark.long
def test_settings_decide_and_not_how_they_are_written(sweep, sldvexp, tmp_path):
    """A run is known by its whole configuration, so that a default that changes is noticed."""
    sweep(seeds="seed=1,3")
    path = run_of(tmp_path, 3) / "record.json"
    path.write_text(path.read_text().replace(record.read(path.parent).identity, "another"))
    assert sweep(seeds="seed=1,3")[1] == {"3"}


def test_interrupted_sweep_leaves_what_it_has(sldvexp, tmp_path, monkeypatch):
    from sldvexp.pipeline import runner

    whole = runner.run

    def run(cfg, folder, **others):
        if cfg.seed == 3:
            raise KeyboardInterrupt
        return whole(cfg, folder, **others)

    monkeypatch.setattr(runner, "run", run)
    done = sldvexp("-m", *TINY, "seed=1,3,5", WHERE)
    assert done.status == 130
    with xr.open_dataset(tmp_path / "swept/sweep.nc", engine="netcdf4") as table:
        assert table["state"].values.tolist() == ["done", "running", "waiting"]
        assert table["reason"].values.tolist() == ["", "the run was cut off", "not begun"]


@pytest.mark.whole
def test_a_choice_that_does_not_exist_leaves_the_sweep_as_it_is(sldvexp, tmp_path):
    swept = ("-m", "~experiment", "report=none", WHERE)
    assert sldvexp(*swept, "target=dissertation,fiducials", "seed=1").status == 0
    before = (tmp_path / "swept/sweep.nc").read_bytes()
    done = sldvexp(*swept, "target=dissertation,fiducial", "seed=1")
    assert done.status == 1
    assert "there is no target=fiducial; did you mean fiducials?" in done.err
    assert (tmp_path / "swept/sweep.nc").read_bytes() == before
