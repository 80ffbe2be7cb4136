"""A session that is killed at any moment goes on where it was, and ends the same to the bit."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from sldvexp import dataset
from sldvexp.cli import main
from sldvexp.config import hydra_plugin, schema
from sldvexp.config.paths import conf_dir
from sldvexp.virtual_lab import LabServer, VirtualLab
from sldvexp.virtual_lab.server import Fault

#: Two small views over the socket, so that the instrument outlives whoever speaks to it.
SMALL = [
    "experiment=dissertation/automated_pose",
    "scan.coarse.pixels=180",
    "scan.fine.lines=8",
    "scan.sampling.samples=64",
    "scan.views={again: {dac: [[-142,-704],[-401,-1326],[673,-1632],[748,-646]]}}",
    "~expect.truth",
    "~expect.residuals",
]
VIEWS = "scene.views={again: {euler: [-1.153, 2.547, 1.913], origin: [0.862, 0.508, 1.553]}}"
LINES = 2 * 4 * (3 + 8)
#: How long an answer, a kept line and the end of a process are waited for, s.
LONGEST = 300.0
#: So long a killed session may go on after a certain number of its lines were kept, s.
MOMENT = 0.05

MOMENTS, QUICK = 25, 3
rng = np.random.default_rng(25)
KILLS = [
    pytest.param(
        int(rng.integers(LINES)),
        float(rng.uniform(0, MOMENT)),
        id=f"{k + 1}",
        marks=[pytest.mark.long] * (k >= QUICK),
    )
    for k in range(MOMENTS)
]

#: Children are copies of a process that has imported the program; they begin in a moment.
process = multiprocessing.get_context("forkserver")
process.set_forkserver_preload(
    ["sldvexp.cli.main", "sldvexp.pipeline.runner", "sldvexp.instrument.visa"]
)


class Counted(Fault):
    """No fault: counts the scan lines that the instrument was asked for.

    After the last of them it goes home when it is `free` to, so that a session which is going to be
    killed cannot be over before.
    """

    def __init__(self):
        super().__init__("MEAS:LIST")
        self.lines = 0
        self.free = threading.Event()

    def strikes(self, line):
        self.lines += line.startswith(self.command)
        if line.startswith("MIRR:HOME") and self.lines >= LINES:
            assert self.free.wait(LONGEST)
        return False

    def spoil(self, answer, send, server):
        raise AssertionError


def started(*arguments):
    """The command as a process of its own, which takes over the arguments of this one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["sldvexp", *arguments])
        child = process.Process(target=main.main)
        child.start()
    return child


def kept(folder):
    return [p for p in (folder / "journal").rglob("*.npz") if not p.name.startswith(".")]


def variables(folder):
    with dataset.load(folder / "run.nc") as tree:
        return {
            f"{node.path}/{name}": np.asarray(values)
            for node in tree.subtree
            for name, values in node.data_vars.items()
        }


@pytest.fixture(scope="module")
def instrument():
    """A server, its counter, and the settings of a session with it in a folder."""
    hydra_plugin.install()
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        e = schema.build(compose("config", overrides=[*SMALL, VIEWS]))
    counted = Counted()
    with LabServer(VirtualLab(e.scene, e.laser, e.target, e.seed), faults=[counted]) as server:
        there = ["instrument=visa", f"instrument.resource={server.resource}", "~scene"]
        there += [f"instrument.timeout={LONGEST}"]
        yield counted, lambda folder: [*SMALL, *there, f"hydra.run.dir={folder}"]
        counted.free.set()


@pytest.fixture(scope="module")
def whole(instrument, tmp_path_factory):
    """What a session gives that nobody disturbs."""
    counted, session = instrument
    folder = tmp_path_factory.mktemp("whole")
    counted.free.set()
    child = started(*session(folder))
    child.join()
    assert child.exitcode == 0
    assert counted.lines == LINES
    return variables(folder)


@pytest.mark.parametrize(("lines", "later"), KILLS)
def test_a_killed_session_ends_the_same(tmp_path, instrument, whole, lines, later):
    counted, session = instrument
    counted.lines = 0
    counted.free.clear()
    child = started(*session(tmp_path))
    while len(kept(tmp_path)) < lines and child.is_alive():
        time.sleep(0.002)
    time.sleep(later)
    os.kill(child.pid, signal.SIGKILL)
    child.join()
    counted.free.set()
    assert child.exitcode == -signal.SIGKILL
    there = kept(tmp_path)
    assert lines <= len(there) <= counted.lines <= len(there) + 1
    again = started(f"resume={tmp_path}")
    again.join()
    assert again.exitcode == 0
    # The line that was being measured is measured again, no other.
    assert LINES <= counted.lines <= LINES + 1
    found = variables(tmp_path)
    assert found.keys() == whole.keys()
    for name, values in whole.items():
        np.testing.assert_array_equal(values, found[name], err_msg=name)
