"""The same sweep under every launcher: the same dataset, and a sentence for what is missing."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from argparse import Namespace
from importlib.util import find_spec

import pytest
import xarray as xr
from hydra.errors import MissingConfigException

from sldvexp.config import Origins, messages
from sldvexp.sweep.sweep import BATCH, SIGNS, RunCount, Sweep, Watch, leave_sign

SWEEP = ("-m", "experiment=point", "reconstruction=absolute,relative", "seed=1,-1")
#: What is started with each launcher beside its name, and the module it comes with.
LAUNCHERS = {
    "joblib": ("hydra.launcher.n_jobs=2",),
    "submitit_local": (),
    "ray": ("+hydra.launcher.ray.init={num_cpus: 2, include_dashboard: false}",),
}


def launched(launcher):
    """The settings, if the launcher is installed."""
    if find_spec(f"hydra_plugins.hydra_{launcher.partition('_')[0]}_launcher") is None:
        pytest.skip(f"{launcher} is not installed")
    return (f"hydra/launcher={launcher}", *LAUNCHERS[launcher])


def table_of(folder):
    with xr.open_dataset(folder / "sweep.nc", engine="netcdf4", auto_complex=True) as table:
        return table.load().drop_vars("seconds").drop_attrs(deep=False)  # the command differs


def lines_of(out):
    """Those that tell how far a sweep is, without the time left."""
    return [
        line.partition(";")[0].partition(":")[0] for line in out.splitlines() if " done" in line
    ]


@pytest.mark.long
@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_same_dataset_under_every_launcher(launcher, sldvexp, tmp_path):
    settings = launched(launcher)
    assert sldvexp(*SWEEP, "hydra.sweep.dir=here").status == 1  # seed=-1
    done = sldvexp(*SWEEP, *settings, "hydra.sweep.dir=there")
    assert done.status == 1, done.err
    xr.testing.assert_identical(table_of(tmp_path / "there"), table_of(tmp_path / "here"))
    counted = [line for line in lines_of(done.out) if " of 4 " in line]
    assert counted[-1] == "2 of 4 done, 2 failed"
    assert len(counted) == 4

    # Again: what is done stays, and what failed is tried anew, here or elsewhere.
    runs = {run: run.stat().st_mtime_ns for run in (tmp_path / "there").glob("*/run.nc")}
    done = sldvexp(*SWEEP, *settings, "hydra.sweep.dir=there", "sweep.retry=missing")
    assert done.status == 1
    assert {run: run.stat().st_mtime_ns for run in runs} == runs
    assert not (tmp_path / "there" / SIGNS).exists()


#: What SLURM's commands do, as far as a sweep sees: the tasks of an array, one after the other.
SBATCH = """#!/bin/bash
tasks=$(sed -n 's/^#SBATCH --array=0-\\([0-9]*\\)%.*/\\1/p' "$1")
export SLURM_ARRAY_JOB_ID=7 SLURM_NTASKS=1 SLURM_JOB_NUM_NODES=1 SLURM_NODEID=0 SLURM_PROCID=0
export SLURM_LOCALID=0 SLURM_JOB_NODELIST=here
(for task in $(seq 0 "$tasks"); do
    SLURM_JOB_ID=$((7 + task)) SLURM_ARRAY_TASK_ID=$task bash "$1"
done) >/dev/null 2>&1 &
echo Submitted batch job 7
"""
SRUN = """#!/bin/bash
while [[ $1 == --* ]]; do [[ $1 == --unbuffered ]] && shift || shift 2; done
exec "$@"
"""
SACCT = "#!/bin/bash\necho 'JobID|State|NodeList'\n"


@pytest.mark.long
def test_same_dataset_under_slurm(sldvexp, tmp_path, monkeypatch):
    """Its commands are played, but submission, array, tasks and results are submitit's own."""
    launched("submitit_local")
    played = tmp_path / "bin"
    played.mkdir()
    for name, text in {"sbatch": SBATCH, "srun": SRUN, "sacct": SACCT}.items():
        (played / name).write_text(text)
        (played / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(played), prepend=os.pathsep)
    call = ("-m", "~experiment", "target=dissertation", "seed=1,-1")
    assert sldvexp(*call, "hydra.sweep.dir=here").status == 1  # seed=-1
    slurm = ("hydra/launcher=submitit_slurm", "hydra.launcher.partition=short")
    done = sldvexp(*call, *slurm, "hydra.sweep.dir=there")
    assert done.status == 1, done.err
    xr.testing.assert_identical(table_of(tmp_path / "there"), table_of(tmp_path / "here"))
    script = next((tmp_path / "there" / ".submitit").rglob("*submission*.sh"))
    assert "--partition=short" in script.read_text()


@pytest.mark.long
def test_one_batch_after_the_other(sldvexp, tmp_path):
    """Submitit's local executor begins all that it is given at once."""
    settings = (*launched("submitit_local"), f"{BATCH}=1", "hydra.sweep.dir=swept")
    assert sldvexp("-m", "~experiment", "target=dissertation", "seed=1,2", *settings).status == 0
    times = []
    for run in (tmp_path / "swept").glob("*/run.nc"):
        with xr.open_datatree(run, engine="netcdf4") as tree:
            times.append((tree.attrs["start_time"], tree.attrs["end_time"]))
    (_, first_ended), (second_began, _) = sorted(times)
    assert first_ended < second_began


def test_no_more_at_once_than_processors():
    def added(*settings):
        options = Namespace(overrides=["seed=1,2", *settings], config_dir=None, config_name=None)
        return [a for a in Sweep(options).arguments([]) if a.startswith(BATCH)]

    local = "hydra/launcher=submitit_local"
    assert added(local) == [f"{BATCH}={os.cpu_count()}"]
    assert added(local, f"{BATCH}=3") == []
    assert added("hydra/launcher=joblib") == []
    assert added(local, "hydra/launcher=joblib") == []


def test_mistake_in_a_later_batch_starts_nothing(sldvexp, tmp_path):
    settings = ("seed=1,x", f"{BATCH}=1", "hydra.sweep.dir=swept")
    done = sldvexp("-m", "~experiment", "target=dissertation", *settings)
    assert done.status == 1
    assert done.err == "sldvexp: command line: seed must be a whole number, not x\n"
    assert list(tmp_path.iterdir()) == []


def test_launcher_that_is_not_installed():
    def told(name):
        error = MissingConfigException("", f"hydra/launcher/{name}")
        return messages.of_composition(error, Origins(["-m", f"hydra/launcher={name}"]))

    needs = "command line: hydra/launcher={} needs a package that is not installed: "
    assert told("ray") == needs.format("ray") + "pip install 'sldvexp[ray]'"
    assert told("joblib") == needs.format("joblib") + "pip install 'sldvexp[parallel]'"
    slurm = needs.format("submitit_slurm") + "pip install 'sldvexp[slurm]'"
    assert told("submitit_slurm") == slurm
    assert "there is no hydra/launcher=slarm; " in told("slarm")


def test_no_slurm_here(sldvexp, monkeypatch, tmp_path):
    launched("submitit_local")
    monkeypatch.setenv("PATH", str(tmp_path))
    done = sldvexp("-m", "experiment=point", "seed=1,2", "hydra/launcher=submitit_slurm")
    assert done.status == 1
    (sentence,) = done.err.splitlines()
    assert "hydra/launcher=submitit_slurm submits to SLURM, which is not here" in sentence


@pytest.mark.long
@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_process_that_is_lost(launcher, tmp_path):
    """It costs a sentence and its run, which the same command then does."""
    swept = ["experiment=plate", "seed=1,2", "scan.structure.pixels=[15,17]"]
    call = [sys.executable, "-m", "sldvexp.cli.main", "-m", *swept, *launched(launcher)]
    call += ["hydra.sweep.dir=swept"]
    sweep = subprocess.Popen(call, cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
    while not (records := list((tmp_path / "swept").glob("*/record.json"))):
        assert sweep.poll() is None, sweep.communicate()
        time.sleep(0.05)
    os.kill(json.loads(records[0].read_text())["process"], signal.SIGKILL)
    said = sweep.communicate()[1].decode()
    assert sweep.returncode == 1
    told = [line for line in said.splitlines() if line.startswith("sldvexp: ")]
    assert len(told) == 1
    assert "a process that did a run was lost" in told[0]
    assert "Traceback" not in said
    states = table_of(tmp_path / "swept")["state"].values.tolist()
    assert "running" in states


def test_signs_of_runs_are_told_once_each(tmp_path, capsys):
    (tmp_path / SIGNS).mkdir()
    (tmp_path / SIGNS / "1seed=9").touch()  # of a sweep that was killed
    told = []
    with Watch(tmp_path, lambda run, computed: told.append((run, computed))):
        leave_sign(tmp_path / "seed=1", True)
        leave_sign(tmp_path / "seed=2", False)
    assert sorted(told) == [(str(tmp_path / "seed=1"), True), (str(tmp_path / "seed=2"), False)]
    assert not (tmp_path / SIGNS).exists()
    assert RunCount([tmp_path / "seed=2"], [["seed=2"]]).tell(tmp_path / "seed=2", False) == ""
