"""Sweeps that are killed, in processes of their own in which nothing can be tidied up."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from sldvexp.sweep import record
from sldvexp.sweep.record import State

#: Runs that share a step, whose results differ, and of which some come to the same.
SWEEP = ("-m", "experiment=pose", "~check.pose_repeats", "expect={}", "report=none")
WHERE = "hydra.sweep.dir=swept"
LONGEST = 600.0  # s, until a run more is done
ALONE = 60.0  # s, until workers notice that they are alone, on however busy a machine


def start(folder, *settings):
    call = [sys.executable, "-m", "sldvexp.cli.main", *SWEEP, *settings, WHERE]
    return subprocess.Popen(
        call, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )


def finish(folder, *settings):
    process = start(folder, *settings)
    _, said = process.communicate()
    assert process.returncode == 0, said.decode()


def finished(folder):
    """Runs that are done, each with the bytes and inodes of its record and dataset."""
    found = {}
    for path in (folder / "swept").glob("*/record.json"):
        if record.read(path.parent).state is State.done:
            files = [path, path.with_name("run.nc")]
            found[path.parent.name] = [(f.stat().st_ino, f.read_bytes()) for f in files]
    return found


class Watcher(threading.Thread):
    """Opens everything that appears under its final name in a sweep's folder, as others might."""

    def __init__(self, folder):
        super().__init__(daemon=True)
        self.folder, self.seen, self.torn = folder, set(), []
        self.over = threading.Event()

    def run(self):
        while not self.over.wait(0.01):
            self.look()

    def look(self):
        shared = ".shared/[!.]*.json"  # a name with a dot is one of what is still being written
        for pattern in ("*/run.nc", "*/record.json", "sweep.nc", "sweep.csv", shared):
            for path in self.folder.glob(pattern):
                try:
                    now = path.stat()
                    version = (path, now.st_ino, now.st_mtime_ns, now.st_size)
                    if version not in self.seen:
                        opened(path)
                        self.seen.add(version)
                except FileNotFoundError:
                    pass  # a run that is begun again takes its old result away
                except Exception as error:
                    self.torn.append(f"{path}: {error!r}")


def opened(path):
    """Open a file and read something of all that is in it."""
    if path.suffix == ".json":
        json.loads(path.read_text())
    elif path.suffix == ".nc":
        with netCDF4.Dataset(path) as file:
            assert file.ncattrs(), "has no attributes"
            for group in [file, *file.groups.values()]:
                for variable in group.variables.values():
                    variable[:]
    else:
        assert path.read_text().endswith("\n")


@contextmanager
def watched(folder):
    watcher = Watcher(folder)
    watcher.start()
    yield watcher
    watcher.over.set()
    watcher.join()
    watcher.look()
    assert watcher.torn == []
    assert watcher.seen


def results(folder):
    with xr.open_dataset(folder / "swept/sweep.nc", engine="netcdf4", auto_complex=True) as table:
        return table.load().drop_vars("seconds").drop_attrs(deep=False)  # the command differs


def wait_for_runs(process, swept, done):
    """Wait until so many runs are done, or the sweep is over."""
    deadline = time.monotonic() + LONGEST
    while len(list(swept.glob("*/run.nc"))) < done and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def kill_when(process, folder, done, later):
    """Kill a sweep and its workers some time after so many runs are done; False if it was over."""
    wait_for_runs(process, folder / "swept", done)
    time.sleep(later)
    over = process.poll() is not None
    if not over:
        os.killpg(process.pid, signal.SIGKILL)
    _, said = process.communicate()
    assert not over or process.returncode == 0, said.decode()
    return not over


def killed_and_resumed(tmp_path, settings, runs, kills, seed):
    """How many runs were done before each kill."""
    rng = np.random.default_rng(seed)
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    whole.mkdir()
    cut.mkdir()
    finish(whole, *settings)
    kept, counts = {}, []
    with watched(cut / "swept"):
        for done in np.sort(rng.integers(1, runs, kills)):
            killed = kill_when(start(cut, *settings), cut, max(done, len(kept)), rng.uniform(0, 1))
            now = finished(cut)
            assert kept.items() <= now.items()  # neither changed nor written anew
            assert killed or len(now) == runs
            kept = now
            counts.append(len(kept))
        finish(cut, *settings)
    now = finished(cut)
    assert kept.items() <= now.items()
    assert len(now) == runs
    xr.testing.assert_identical(results(cut), results(whole))
    assert list((cut / "swept").rglob(".*.sldvexp-*")) == []  # what was not finished is gone
    return counts


@pytest.mark.long
def test_killed_sweep_goes_on_to_the_same_end(tmp_path):
    settings = ("laser.mirror_offset=0,0.01", "seed=1,2,3")
    counts = killed_and_resumed(tmp_path, settings, runs=6, kills=1, seed=5)
    assert counts[0] > 0


@pytest.mark.long
@pytest.mark.parametrize("launcher", ["basic", "joblib"])
def test_sweep_killed_ten_times_goes_on_to_the_same_end(launcher, tmp_path, capsys):
    if launcher == "joblib":
        pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    offsets = ",".join(f"{0.002 * k:.3f}" for k in range(12))
    settings = (f"laser.mirror_offset={offsets}", "seed=range(1,9)", f"hydra/launcher={launcher}")
    settings += ("hydra.launcher.n_jobs=2",) if launcher == "joblib" else ()
    counts = killed_and_resumed(tmp_path, settings, runs=96, kills=10, seed=7)
    with capsys.disabled():
        print(f"\n96 runs, {launcher}: done before each of 10 kills: {counts}")
    assert counts[0] < counts[-1]


def below(process):
    """Processes that a process has started, and those that they have."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it may end meanwhile
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    found = {process}
    while more := {p for p, parent in parents.items() if parent in found} - found:
        found |= more
    return found - {process}


@pytest.mark.whole
@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="waits for the end of others' children")
def test_workers_of_a_killed_sweep_end_themselves(tmp_path, capsys):
    """Nobody waits for them any more, nor would anybody tell them to stop."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    parallel = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    process = start(tmp_path, "seed=range(1,60)", *parallel)
    wait_for_runs(process, tmp_path / "swept", 1)
    workers = {p: os.pidfd_open(p) for p in below(process.pid)}
    assert len(workers) >= 2
    process.kill()
    process.wait()
    killed = time.monotonic()
    for worker, opened in workers.items():
        assert select.select([opened], [], [], ALONE)[0], f"{worker} is still at work"
        os.close(opened)
    process.communicate()
    with capsys.disabled():
        print(f"\nworkers of a killed sweep ended after {time.monotonic() - killed:.1f} s")
    finish(tmp_path, "seed=range(1,4)")
