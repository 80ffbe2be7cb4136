"""A session that ends at any moment, however, goes on where it was and ends the same to the bit."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time

import numpy as np
import pytest

from sldvexp import dataset, stopping
from sldvexp.cli import main
from sldvexp.testing import power
from sldvexp.virtual_lab import LabServer, VirtualLab
from sldvexp.virtual_lab.server import Fault
from tests.composing import experiment

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
#: Syncs before the first of a line: of the folder, of Hydra's files, of the journal's folder.
BEGINNING = 9
#: How long an answer, a kept line and the end of a process are waited for, s.
LONGEST = 300.0
#: So long a killed session may go on after a certain number of its lines were kept, s.
MOMENT = 0.05

#: Sessions of each kind, and how many of them are not left to the long tests.
KILLS, STOPS, CUTS, QUICK = 50, 20, 20, 2
rng = np.random.default_rng(25)


def moments(count, *kinds):
    """When a session ends: after so many lines, and some time later; and one kind of end each."""
    return [
        pytest.param(
            int(rng.integers(LINES)),
            float(rng.uniform(0, MOMENT)),
            *([kinds[k % len(kinds)]] if kinds else []),
            id=f"{k + 1}",
            marks=[pytest.mark.long] * (k >= QUICK),
        )
        for k in range(count)
    ]


#: Children are copies of a process that has imported the program; they begin in a moment.
process = multiprocessing.get_context("forkserver")
process.set_forkserver_preload(
    ["sldvexp.cli.command", "sldvexp.pipeline.runner", "sldvexp.instrument.visa"]
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

    def restart(self):
        self.lines = 0
        self.free.clear()

    def strikes(self, line):
        self.lines += line.startswith(self.command)
        if line.startswith("MIRR:HOME") and self.lines >= LINES:
            assert self.free.wait(LONGEST)
        return False

    def spoil(self, answer, send, server):
        raise AssertionError


def started(*arguments, **more):
    """The command as a process of its own, which takes over the arguments of this one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["sldvexp", *arguments])
        how = {"target": power.recorded, "args": (main.main, arguments), "kwargs": more}
        child = process.Process(**how if more else {"target": main.main})
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


@pytest.fixture(scope="module", autouse=True)
def _heeding():
    """Let sessions heed what whoever started these tests ignores, as nohup does."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in stopping.SIGNALS[1:]}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture(scope="module")
def instrument(_heeding):
    """A counter, the settings of a session with the server in a folder, and the server."""
    e = experiment(*SMALL, VIEWS)
    counted = Counted()
    with LabServer(VirtualLab(e.scene, e.laser, e.target, e.seed), faults=[counted]) as server:
        there = ["instrument=visa", f"instrument.resource={server.resource}", "~scene"]
        there += [f"instrument.timeout={LONGEST}"]
        yield counted, lambda folder: [*SMALL, *there, f"hydra.run.dir={folder}"], server
        counted.free.set()


@pytest.fixture(scope="module")
def whole(instrument, tmp_path_factory):
    """What a session gives that nobody disturbs."""
    counted, session, _ = instrument
    folder = tmp_path_factory.mktemp("whole")
    counted.free.set()
    child = started(*session(folder))
    child.join()
    assert child.exitcode == 0
    assert counted.lines == LINES
    return variables(folder)


def when(child, folder, lines, later):
    """Wait until a session has kept so many lines, and a little longer."""
    while len(kept(folder)) < lines and child.is_alive():
        time.sleep(0.002)
    time.sleep(later)


def goes_on(folder, counted, whole, session):
    """The line that was being measured is measured again, no other."""
    begun = (folder / "journal").is_dir()  # until then the command is just given again
    again = started(f"resume={folder}") if begun else started(*session(folder))
    again.join()
    assert again.exitcode == 0
    assert LINES <= counted.lines <= LINES + 1
    found = variables(folder)
    assert found.keys() == whole.keys()
    for name, values in whole.items():
        np.testing.assert_array_equal(values, found[name], err_msg=name)
    left = [p for p in folder.rglob(".*") if p.name not in (".hydra", ".lock")]
    assert left == []  # what was not finished is gone


@pytest.mark.whole
@pytest.mark.parametrize(("lines", "later"), moments(KILLS))
def test_a_killed_session_ends_the_same(tmp_path, instrument, whole, lines, later):
    counted, session, _ = instrument
    counted.restart()
    child = started(*session(tmp_path))
    when(child, tmp_path, lines, later)
    os.kill(child.pid, signal.SIGKILL)
    child.join()
    counted.free.set()
    assert child.exitcode == -signal.SIGKILL
    there = kept(tmp_path)
    assert lines <= len(there) <= counted.lines <= len(there) + 1
    goes_on(tmp_path, counted, whole, session)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("lines", "later", "number"), moments(STOPS, signal.SIGTERM, signal.SIGHUP)
)
def test_a_session_that_a_signal_ends_leaves_the_instrument_in_order(
    tmp_path, instrument, whole, lines, later, number
):
    counted, session, server = instrument
    counted.restart()
    child = started(*session(tmp_path))
    when(child, tmp_path, lines + 1, later)  # before it, there is nothing that could be stopped
    os.kill(child.pid, number)
    counted.free.set()
    child.join()
    assert child.exitcode == 128 + number
    assert server.dialect.lab.position == (0, 0)
    assert not server.dialect.playing
    told = (tmp_path / "sldvexp.log").read_text().splitlines()[-1]
    assert told.endswith(
        f"interrupted; what was scanned is kept, go on with: sldvexp resume={tmp_path}"
    )
    goes_on(tmp_path, counted, whole, session)


def test_a_signal_that_is_ignored_stops_nothing():
    """Whoever starts the program decides, as nohup does."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopping.handlers_kept():
            stopping.heed()
            signal.raise_signal(signal.SIGHUP)
            with pytest.raises(stopping.Stopped) as stopped:
                signal.raise_signal(signal.SIGTERM)
            assert stopping.exit_status(stopped.value) == 143
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.fixture(scope="module")
def synced(instrument, whole, tmp_path_factory):
    """How often a session syncs that nobody disturbs."""
    counted, session, _ = instrument
    counted.restart()
    counted.free.set()
    folder, record = (tmp_path_factory.mktemp(name) for name in ("recorded", "record"))
    child = started(*session(folder), folder=folder, record=record)
    child.join()
    assert child.exitcode == 0
    return power.count_syncs(record)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("part", "names"),
    [
        pytest.param(
            float(rng.uniform()),
            [*power.Names][k % 2],
            id=f"{k + 1}",
            marks=[pytest.mark.long] * (k >= QUICK),
        )
        for k in range(CUTS)
    ],
)
def test_a_power_cut_takes_no_line_that_was_kept(tmp_path, instrument, whole, synced, part, names):
    """The disk then has what was synced, whatever was written later."""
    counted, session, _ = instrument
    counted.restart()
    counted.free.set()
    folder, record = tmp_path / "run", tmp_path / "record"
    folder.mkdir()
    # The first syncs are those of the folder and of Hydra's files, without which nothing goes on.
    cut = BEGINNING + int(part * (synced - BEGINNING))
    child = started(*session(folder), folder=folder, record=record, cut=cut)
    child.join()
    assert child.exitcode == -signal.SIGKILL
    power.cut_power(folder, record, names)
    assert counted.lines - 1 <= len([p for p in kept(folder) if p.stat().st_size])
    if (folder / "run.nc").exists():
        found = variables(folder)
        assert all(np.array_equal(values, found[name]) for name, values in whole.items())
    else:
        goes_on(folder, counted, whole, session)
