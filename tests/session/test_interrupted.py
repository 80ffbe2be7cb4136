"""Ctrl-C, an operator at a terminal, and a terminal with nobody: all of them real processes."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import threading
import time
from functools import partial

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.config.paths import conf_dir
from sldvexp.testing.faults import Fault
from sldvexp.virtual_lab import LabServer, VirtualLab

COMMAND = [sys.executable, "-m", "sldvexp.cli.main"]
MINE = ["--config-dir", "lab", "experiment=mine", "hydra.run.dir=run"]
PATIENCE = 300.0  # for whatever comes in seconds on a quiet machine, s

EXPERIMENT = """# @package _global_
# Images of the plate from two places.
defaults:
  - _self_
  - override /scene: plate
  - override /scan: rectangle
  - override /instrument: simulated
  - override /signal: sine_fit
scene:
  views:
    a: {euler: [0.024, 2.910, -3.117], origin: [0.290, 0.530, 1.655]}
    b: {euler: [2.075, 2.988, -1.072], origin: [0.073, 0.015, 1.680]}
scan:
  views:
    a: {corners: [[-640, 140], [-640, -1440], [640, -1440], [640, 140]]}
    b: {corners: [[-640, 140], [-640, -1440], [640, -1440], [640, 140]]}
  pixels: [100, 12]
  sampling: {samples: 128}
"""


@pytest.fixture
def start(tmp_path):
    """Start a run in a folder of its own, heeding Ctrl-C whatever the tests were started from."""
    prepare(tmp_path)
    started = []

    def begin(*arguments, **more):
        heeds = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
        said = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "preexec_fn": heeds, **more}
        started.append(subprocess.Popen([*COMMAND, *arguments], cwd=tmp_path, **said))
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def prepare(folder):
    (folder / "lab" / "experiment").mkdir(parents=True)
    (folder / "lab" / "experiment" / "mine.yaml").write_text(EXPERIMENT)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Images of a run that nothing interrupts."""
    folder = tmp_path_factory.mktemp("whole")
    prepare(folder)
    subprocess.run([*COMMAND, *MINE], cwd=folder, check=True, stdout=subprocess.PIPE)
    return images(folder / "run")


def wait_for_lines(folder, count, process):
    end = time.monotonic() + PATIENCE
    while len(lines_of(folder)) < count and process.poll() is None and time.monotonic() < end:
        time.sleep(0.002)
    assert process.poll() is None, process.communicate()


def lines_of(folder):
    found = (folder / "journal").rglob("*.npz")
    return {p: p.stat().st_mtime_ns for p in found if not p.name.startswith(".")}


def images(folder):
    with dataset.load(folder / "run.nc") as tree:
        return {
            f"{view}/{name}": values.to_numpy()
            for view, image in tree["image"].children.items()
            for name, values in image.data_vars.items()
        }


def assert_same(one, two):
    assert one.keys() == two.keys()
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name], err_msg=name)


def assert_clean_stop(process, folder, signals, number=signal.SIGINT):
    """The operator is told in one sentence what is kept and how to go on."""
    for _ in range(signals):  # an operator seldom presses once
        process.send_signal(number)
        time.sleep(0.003)
    _, told = process.communicate(timeout=PATIENCE)
    resume = f"what was scanned is kept, go on with: sldvexp resume={folder}"
    *warnings, last = told.decode().splitlines(keepends=True)
    assert last == f"sldvexp: interrupted; {resume}\n"
    assert all(line.startswith("sldvexp: warning: scene.views: ") for line in warnings)
    assert process.returncode == 128 + number
    assert not (folder / "run.nc").exists()


@pytest.mark.long
@pytest.mark.parametrize(("lines", "signals"), [(20, 4), (120, 1)])
def test_ctrl_c_keeps_what_was_scanned(start, tmp_path, whole, lines, signals):
    folder = tmp_path / "run"
    process = start(*MINE)
    wait_for_lines(folder, lines, process)
    assert_clean_stop(process, folder, signals)
    kept = lines_of(folder)
    assert len(kept) >= lines
    assert start(f"resume={folder}").wait(PATIENCE) == 0
    assert kept.items() <= lines_of(folder).items()
    assert_same(images(folder), whole)


@pytest.mark.long
@pytest.mark.parametrize("lines", [5, 100, 130])
def test_a_killed_session_repeats_nothing_that_was_finished(start, tmp_path, whole, lines):
    folder = tmp_path / "run"
    process = start(*MINE)
    wait_for_lines(folder, lines, process)
    process.kill()
    process.wait()
    kept = lines_of(folder)
    assert start(f"resume={folder}").wait(PATIENCE) == 0
    assert kept.items() <= lines_of(folder).items()
    assert_same(images(folder), whole)


def served(composed, *faults):
    made = composed()
    lab = VirtualLab(made.scene, made.laser, None, 0)
    return LabServer(lab, faults=faults)


class Halved(Fault):
    """Half of the answer; the rest comes when the client hangs up or asks something else."""

    def __init__(self, command, after):
        super().__init__(command, after=after)
        self.sent = threading.Event()

    def spoil(self, answer, send, server):
        half = len(answer) // 2
        send(answer[:half])
        self.sent.set()
        select.select([server._client], [], [])
        send(answer[half:])


@pytest.mark.parametrize(
    ("signals", "number"),
    [
        pytest.param(1, signal.SIGINT, marks=pytest.mark.long),
        pytest.param(4, signal.SIGINT, marks=pytest.mark.whole),
        pytest.param(2, signal.SIGTERM, marks=pytest.mark.whole),
        pytest.param(1, signal.SIGHUP, marks=pytest.mark.long),
    ],
)
def test_a_stop_within_an_answer_leaves_the_instrument_in_order(
    start, tmp_path, composed, signals, number
):
    """The interrupted answer's rest must not be taken for that of the commands which go home."""
    folder, halved = tmp_path / "run", Halved("DATA?", after=10)
    with served(composed, halved) as server:
        socket = [f"instrument.resource={server.resource}", f"instrument.timeout={PATIENCE}"]
        process = start(*MINE, "instrument=visa", *socket)
        while not halved.sent.wait(0.1):
            assert process.poll() is None, process.communicate()
        assert len(lines_of(folder)) == 10
        assert server.dialect.lab.position != (0, 0)
        assert_clean_stop(process, folder, signals, number)
        assert server.dialect.lab.position == (0, 0)
        assert not server.dialect.playing
    assert len(lines_of(folder)) == 10


@pytest.fixture
def terminal(start, tmp_path, composed):
    """A terminal in front of an instrument that cannot move itself."""
    profile = (conf_dir() / "profile" / "virtual_lab.yaml").read_text().splitlines()
    fixed = [line for line in profile if not line.startswith("  view:")]
    assert len(fixed) == len(profile) - 1
    (tmp_path / "fixed.yaml").write_text("\n".join(fixed))
    with served(composed) as server:
        yield Terminal(server, start)


class Terminal:
    def __init__(self, server, start):
        self.server, self._start = server, start
        self.shown = ""

    def run(self, *arguments):
        self._keys, there = pty.openpty()

        def controlled():
            os.setsid()
            fcntl.ioctl(there, termios.TIOCSCTTY, 0)
            signal.signal(signal.SIGINT, signal.SIG_DFL)

        ends = {"stdin": there, "stdout": there, "stderr": there, "preexec_fn": controlled}
        self.process = self._start(*arguments, **ends)
        os.close(there)

    def session(self):
        socket = [f"instrument.resource={self.server.resource}", f"instrument.timeout={PATIENCE}"]
        self.run(*MINE, "instrument=visa", "instrument.profile=fixed.yaml", *socket)

    def press(self, keys):
        os.write(self._keys, keys.encode())

    def read_until(self, text, patience=PATIENCE):
        """What is shown up to a text that the cursor then stands behind, or up to the end."""
        self.shown = ""
        end = time.monotonic() + patience
        while not (text and self.shown.endswith(text)) and time.monotonic() < end:
            if not select.select([self._keys], [], [], 0.1)[0]:
                continue
            try:
                self.shown += os.read(self._keys, 2**16).decode(errors="replace")
            except OSError:  # the run has ended
                break
        return self.shown

    def close(self):
        """Close the window, as one does who goes home."""
        os.close(self._keys)

    def status(self):
        self.read_until(None)
        return self.process.wait(PATIENCE)

    def stop(self):
        """Press Ctrl-C, again if it came just before the question began to listen."""
        shown = ""
        while self.process.poll() is None:
            self.press("\x03")
            shown += self.read_until(None, patience=1.0)
        self.shown = shown
        return self.process.returncode


@pytest.mark.whole
def test_a_terminal_that_is_closed_leaves_the_instrument_in_order(terminal, tmp_path):
    """SIGHUP comes, and every word to the terminal is an error from then on."""
    folder = tmp_path / "run"
    terminal.session()
    terminal.read_until(prompt("a"))
    terminal.server.dialect.lab.use_view("a")
    terminal.press("\n")
    wait_for_lines(folder, 3, terminal.process)
    terminal.close()
    assert terminal.process.wait(PATIENCE) == 128 + signal.SIGHUP
    assert terminal.server.dialect.lab.position == (0, 0)
    assert not terminal.server.dialect.playing
    assert f"go on with: sldvexp resume={folder}" in (folder / "sldvexp.log").read_text()


def prompt(view):
    return f"Move the instrument to the view {view}, then press Enter: "


@pytest.mark.long
def test_the_operator_is_asked_once_a_view(terminal, tmp_path, whole):
    terminal.session()
    for view in "ab":
        assert terminal.read_until(prompt(view)).endswith(prompt(view))
        # Nothing is drawn over the question while it stands, and nothing moves.
        time.sleep(0.3)
        assert select.select([terminal._keys], [], [], 0)[0] == []
        assert terminal.server.dialect.lab.position == (0, 0)
        terminal.server.dialect.lab.use_view(view)
        terminal.press("\n")
    assert terminal.status() == 0
    assert "Image of the view b (100 x 12): " in terminal.shown
    assert_same(images(tmp_path / "run"), whole)


@pytest.mark.long
@pytest.mark.parametrize("status", [1, 130])
def test_a_question_without_an_answer_is_a_clean_stop(terminal, tmp_path, whole, status):
    folder = tmp_path / "run"
    terminal.session()
    terminal.read_until(prompt("a"))
    terminal.server.dialect.lab.use_view("a")
    terminal.press("\n")
    terminal.read_until(prompt("b"))
    said = "interrupted"
    if status == 130:
        assert terminal.stop() == status
    else:
        said = f"nobody is at the terminal to answer {prompt('b')[:-2]!r}"
        terminal.press("\x04")
        assert terminal.status() == status
    told = f"sldvexp: {said}; what was scanned is kept, go on with: sldvexp resume={folder}"
    assert f"{told}\r\n" in terminal.shown
    assert "Traceback" not in terminal.shown
    # The first view is complete: the operator need not go back there.
    terminal.run(f"resume={folder}")
    terminal.read_until("Enter: ")
    assert prompt("a") not in terminal.shown
    terminal.server.dialect.lab.use_view("b")
    terminal.press("\n")
    assert terminal.status() == 0
    assert_same(images(folder), whole)


@pytest.mark.long
def test_a_view_that_was_begun_must_be_as_it_was(terminal, tmp_path):
    folder = tmp_path / "run"
    terminal.session()
    terminal.read_until(prompt("a"))
    terminal.server.dialect.lab.use_view("a")
    terminal.press("\n")
    wait_for_lines(folder, 3, terminal.process)
    assert terminal.stop() == 130
    terminal.run(f"resume={folder}")
    shown = terminal.read_until("Press Enter to go on: ")
    assert "The view a is scanned in part: the instrument must stand exactly where" in shown
    assert terminal.stop() == 130
