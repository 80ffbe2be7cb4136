"""A session that was killed goes on where it stopped and ends the same, to the bit."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from sldvexp import dataset

# Two small views: fewer and shorter lines than the dissertation's, all circles.
SMALL = [
    "experiment=dissertation/automated_pose",
    "target=dissertation",
    "scan.coarse.pixels=180",
    "scan.fine.lines=12",
    "scan.sampling.samples=128",
    "scan.views={again: {dac: [[-142,-704],[-401,-1326],[673,-1632],[748,-646]]}}",
    "scene.views={again: {euler: [-1.153, 2.547, 1.913], origin: [0.862, 0.508, 1.553]}}",
    "~expect.truth",
]
COMMAND = [sys.executable, "-m", "sldvexp.app"]


def variables(folder):
    with dataset.load(folder / "run.nc") as tree:
        return {
            f"{node.path}/{name}": np.asarray(values)
            for node in tree.subtree
            for name, values in node.data_vars.items()
        }


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    subprocess.run([*COMMAND, *SMALL, f"hydra.run.dir={folder}"], cwd=folder, check=True,
                   capture_output=True)  # fmt: skip
    return folder


@pytest.mark.parametrize("lines", [1, 23, 45])
def test_a_killed_session_ends_the_same(tmp_path, whole, lines):
    folder = tmp_path / "run"
    session = subprocess.Popen(
        [*COMMAND, *SMALL, f"hydra.run.dir={folder}"], cwd=tmp_path, stdout=subprocess.DEVNULL
    )
    kept = []
    while len(kept) < lines and session.poll() is None:
        time.sleep(0.005)
        kept = [p for p in (folder / "journal").rglob("*.npz") if not p.name.startswith(".")]
    os.kill(session.pid, signal.SIGKILL)
    session.wait()
    assert not (folder / "run.nc").exists()
    before = {p: p.stat().st_mtime_ns for p in kept}
    done = subprocess.run(
        [*COMMAND, f"resume={folder}"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    # No finished line was measured again.
    assert {p: p.stat().st_mtime_ns for p in kept} == before
    one, two = variables(whole), variables(folder)
    assert one.keys() == two.keys()
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name], err_msg=name)


def test_only_a_run_can_be_resumed(sldvexp, tmp_path):
    done = sldvexp(f"resume={tmp_path}")
    assert done.status == 1
    assert "is not the folder of a run" in done.err


def test_a_recorded_session_is_replayed_to_the_bit(sldvexp, whole):
    small = [a for a in SMALL if not a.startswith("scene")]
    again = sldvexp(*small, "instrument=replay", f"instrument.path={whole}", "~scene")
    assert again.status == 0, again.err
    one, two = variables(whole), variables(again.folder)
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name], err_msg=name)
    other = sldvexp(*small, "instrument=replay", f"instrument.path={whole}", "~scene",
                    "scan.fine.lines=13")  # fmt: skip
    assert other.status == 1
    assert "a recording can only be scanned as it was" in other.err


def test_scan_lines_of_another_seed_are_not_used(sldvexp, whole):
    other = sldvexp(*SMALL, "seed=1", f"hydra.run.dir={whole}")
    assert other.status == 1
    assert "has scan lines of another configuration" in other.err
