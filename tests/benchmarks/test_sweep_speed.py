"""What a sweep costs beside the work itself, and what its runs save by sharing.

Processor time of processes of their own, in pairs. Figures are asserted with
``SLDVEXP_BENCHMARK=1`` only; otherwise nothing of it is done.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        os.environ.get("SLDVEXP_BENCHMARK") != "1",
        reason="takes minutes of a quiet machine; set SLDVEXP_BENCHMARK=1",
    ),
]

RUNS = 40
NOTHING = ("~experiment", "target=dissertation", "report=none")
OF_HYDRA = 1.5
MANY, MS_OF_MANY = 1000, 10.0
SHARED = 4.0
PARALLEL = 1.7

#: Times, from one end of a run to the next, within one process.
MARKED = """
import sys, time
from sldvexp.cli import main as app
from sldvexp.sweep import job

times, perform = [], job.perform

def marked(*args):
    done = perform(*args)
    times.append(time.process_time())
    return done

job.perform = marked
try:
    app.main()
except SystemExit:
    pass
print(*times, file=sys.stderr)
"""


@pytest.fixture
def ours(cost_of):
    """Processor time of a call of the command in a folder."""

    def call(folder, *settings):
        return cost_of([sys.executable, "-m", "sldvexp.cli.main", *settings], folder).seconds

    return call


def test_overhead_of_a_run_that_does_nothing(tmp_path, ours, bare_program, cost_of):
    """By the difference of sweeps of different lengths, so that starting costs nothing."""

    def of_hydra(runs):
        call = [sys.executable, "bare.py", "-m", f"seed=range(0,{runs})"]
        return cost_of(call, tmp_path).seconds

    def of_ours(runs):
        return ours(tmp_path, "-m", *NOTHING, f"seed=range(0,{runs})", f"hydra.sweep.dir=r{runs}")

    ratios = []
    for pair in range(3):
        each = [(work(RUNS + pair) - work(2)) / RUNS for work in (of_hydra, of_ours)]
        ratios.append(each[1] / each[0])
        print(f"a run that does nothing: Hydra {each[0] * 1e3:.0f} ms, ours", end=" ")
        print(f"{each[1] * 1e3:.0f} ms, {ratios[-1]:.2f} times")
    assert statistics.median(ratios) <= OF_HYDRA


def test_many_runs_in_one_process_cost_no_more_each(tmp_path):
    """The last of a thousand runs cost what the first did: 80 to 100 ms of processor time each.

    The disk is waited for six times a run, so that elapsed time is no measure of it.
    """
    call = [sys.executable, "-c", MARKED, "-m", *NOTHING, f"seed=range(0,{MANY})"]
    call += ["hydra.sweep.dir=many"]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=False)
    times = [float(word) for word in done.stderr.split()[-MANY:]]
    each = [(b - a) * 1e3 for a, b in pairwise(times)]
    first, last = statistics.median(each[5:105]), statistics.median(each[-100:])
    print(f"{MANY} runs: {first:.0f} ms each of the first, {last:.0f} ms each of the last")
    assert last - first <= MS_OF_MANY


def test_method_combinations_share_a_session(tmp_path, ours):
    session = ("experiment=plate", "report=none", "volume.shape=[9,7]")
    one = ours(tmp_path, *session, "hydra.run.dir=one")
    methods = (
        "pose=bitangent,edge",
        "reconstruction=absolute,relative,combined,contravariant,samplewise,absolute_full",
        "solver=iterative,cholesky",
    )
    all_of_them = ours(tmp_path, "-m", *session, *methods, "hydra.sweep.dir=all")
    print(f"24 combinations cost {all_of_them / one:.1f} times one run ({one:.1f} s)")
    assert len(list(Path(tmp_path / "all").glob("*/run.nc"))) == 24
    assert all_of_them <= SHARED * one


def test_two_workers(tmp_path, ours):
    """Elapsed time, so that nothing else may be running.

    The two processes take some 5 s to start: 6 runs do not make up for it (1.4 times), 20 do.
    """
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    session = ("experiment=plate", "report=none", "volume.shape=[9,7]", "seed=range(1,21)")
    took = {}
    for name, more in {
        "basic": (),
        "joblib": ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2"),
    }.items():
        began = time.perf_counter()
        ours(tmp_path, "-m", *session, *more, f"hydra.sweep.dir={name}")
        took[name] = time.perf_counter() - began
    faster = took["basic"] / took["joblib"]
    print(f"2 workers {faster:.2f} times as fast; load {os.getloadavg()[0]:.1f}")
    assert faster >= PARALLEL
