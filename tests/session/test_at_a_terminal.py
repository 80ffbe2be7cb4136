"""Marks aimed at by a person at a real pseudo-terminal, before an instrument of its own process."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from contextlib import suppress

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.instrument.person import read_answer
from sldvexp.session.session import scan_views
from sldvexp.virtual_lab import LabServer, VirtualLab
from tests.session.test_by_keys import HAND

PATIENCE = 60.0
UP, DOWN, RIGHT, LEFT = (f"\x1b[{way}" for way in "ABCD")


class Terminal:
    """A run at a real terminal, in front of an instrument on a socket."""

    def __init__(self, folder, *arguments, columns=100):
        self.keys, there = pty.openpty()
        fcntl.ioctl(there, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        self.modes = termios.tcgetattr(self.keys)

        def controlled():
            os.setsid()
            fcntl.ioctl(there, termios.TIOCSCTTY, 0)
            signal.signal(signal.SIGINT, signal.SIG_DFL)

        command = [sys.executable, "-m", "sldvexp.cli.main", *arguments]
        ends = {"stdin": there, "stdout": there, "stderr": there, "preexec_fn": controlled}
        environment = {**os.environ, "TERM": "xterm"}
        self.process = subprocess.Popen(command, cwd=folder, env=environment, **ends)
        os.close(there)
        self.shown = ""

    def until(self, text):
        """Read until a text was shown since the last time; all of that."""
        shown, end = "", time.monotonic() + PATIENCE
        while text not in shown and time.monotonic() < end:
            if select.select([self.keys], [], [], 0.1)[0]:
                try:
                    shown += os.read(self.keys, 2**16).decode(errors="replace")
                except OSError:  # the run has ended
                    break
        self.shown += shown
        assert text in shown, self.shown
        return shown

    def type(self, keys):
        os.write(self.keys, keys.encode())

    def status(self):
        while self.process.poll() is None:
            if select.select([self.keys], [], [], 0.1)[0]:
                with suppress(OSError):
                    self.shown += os.read(self.keys, 2**16).decode(errors="replace")
        return self.process.returncode


class ByHand:
    """Runs by hand with the whole command, in front of the virtual lab's server."""

    def __init__(self, made, folder):
        self.made, self.place, self.folder = made, folder, folder / "run"
        self.lab = VirtualLab(made.scene, made.laser, None, 0)
        points = made.target.points()
        steps = np.rint(self.lab.true_dac(points.position)).astype(int).tolist()
        self.where = dict(zip(points.number.tolist(), steps, strict=True))
        self.server = LabServer(self.lab)

    def start(self, **how):
        settings = [
            *("~experiment", "target=fiducials", "scan=by_hand", "scan.views={a: {}}"),
            *("pose=manual", "instrument=visa", f"instrument.resource={self.server.resource}"),
            *(f"instrument.timeout={PATIENCE}", f"hydra.run.dir={self.folder}"),
        ]
        return Terminal(self.place, *settings, **how)

    def steer(self, terminal, number):
        """Bring the beam onto a mark: some steps typed, the last ones by arrow keys; take it."""
        up_down, left_right = self.where[number]
        terminal.type(f"={up_down - 2} {left_right + 3}\n1{UP}{UP}{RIGHT}{RIGHT}{RIGHT}")
        terminal.until(f"beam {up_down} {left_right}  ")
        assert self.lab.position == (up_down, left_right)
        terminal.type("\r")


@pytest.fixture
def by_hand(composed, tmp_path):
    made = ByHand(composed("target=fiducials"), tmp_path)
    with made.server:
        yield made


@pytest.mark.long
def test_five_marks_at_a_real_terminal(by_hand, composed, tmp_path):
    """Steered, predicted, taken back, cut off and gone on with; then the pose is right."""
    terminal = by_hand.start()
    for number in (1, 2, 3):
        terminal.until(f"View a, mark {number} at ")
        terminal.until("light [#")
        by_hand.steer(terminal, number)
    shown = terminal.until("g goes there")
    assert "mark 3: taken at" in shown
    terminal.until("beam")
    terminal.type("u")
    terminal.until("View a, mark 3 at ")
    terminal.until("beam {} {}  ".format(*by_hand.where[3]))
    terminal.type("\r")
    terminal.until("View a, mark 4 at ")
    terminal.type("\x03")
    assert terminal.status() == 130, terminal.shown
    assert termios.tcgetattr(terminal.keys) == terminal.modes
    assert (
        f"what was scanned is kept, go on with: sldvexp resume={by_hand.folder}" in terminal.shown
    )
    assert by_hand.lab.position == (0, 0)

    terminal = Terminal(tmp_path, f"resume={by_hand.folder}", columns=50)
    terminal.until("g goes there")
    terminal.until("to go")
    terminal.type("g")
    terminal.until("to go +0 +0")
    by_hand.steer(terminal, 4)
    shown = terminal.until("g goes there")
    expected = re.search(r"mark 5 at .*expected at (-?\d+) (-?\d+) steps", shown)
    np.testing.assert_allclose([*map(int, expected.groups())], by_hand.where[5], atol=3)
    terminal.until("to go")
    terminal.type("g")
    terminal.until(f"beam {expected[1]} {expected[2]}  ")
    terminal.type(f"1{UP}{DOWN}\r")
    shown = terminal.until("View a, mark 6 at ")
    assert "steps from where the others put it (+-" in shown
    terminal.type("h")
    terminal.until("Enter goes on")
    terminal.type("\r")
    assert terminal.status() == 0, terminal.shown
    assert termios.tcgetattr(terminal.keys) == terminal.modes
    with dataset.load(by_hand.folder / "run.nc") as tree:
        registration, pose = tree["registration"].load(), tree["pose"].load()
        verdict = tree["verdict"].attrs["verdict"]
    assert registration["point"].values.tolist() == [1, 2, 3, 4, 5]
    found = registration["dac"].isel(view=0).values
    np.testing.assert_allclose(found, [by_hand.where[n] for n in (1, 2, 3, 4, 5)], atol=2)
    off = np.abs(pose["origin"].values[0] - by_hand.made.scene.views["a"].origin)
    assert (off < pose["origin_confidence"].values[0]).all()
    assert verdict == "trusted"
    configured = composed(*HAND, "pose=manual")
    made = scan_views(configured, tmp_path / "configured")
    other = configured.pose.estimate(configured.laser, configured.target, made).pose
    apart = np.abs(pose["origin"].values[0] - other["origin"].values[0])
    bound = pose["origin_confidence"].values[0] + other["origin_confidence"].values[0]
    assert (apart < bound).all()


@pytest.mark.long
def test_five_invented_places_are_told_at_once_and_void(by_hand):
    terminal = by_hand.start()
    invented = [(-500, 300), (250, -900), (1200, 40), (-30, 700), (640, 1100)]
    for number, (up_down, left_right) in enumerate(invented, 1):
        terminal.until(f"View a, mark {number} at ")
        terminal.type(f"={up_down} {left_right}\n\r")
    terminal.until("marks 1, 2, 3, 4 and 5 contradict one another by ")
    terminal.type("h")
    terminal.until("Enter twice goes on")
    terminal.type("\r\r")
    assert terminal.status() == 0, terminal.shown
    with dataset.load(by_hand.folder / "run.nc") as tree:
        found = tree["verdict"].load()
    assert found.attrs["verdict"] == "void"
    assert "points 1, 2, 3, 4 and 5 contradict one another by" in found["text"].values[0]
    assert found["subject"].values[0] == "view a, points 1, 2, 3, 4 and 5"


@pytest.mark.long
@pytest.mark.parametrize("end", ["SIGTERM", "SIGHUP", "instrument", "terminal"])
def test_whatever_happens_the_beam_goes_home_and_the_terminal_is_given_back(by_hand, end):
    terminal = by_hand.start()
    terminal.until("light [#")
    by_hand.steer(terminal, 1)
    terminal.until("View a, mark 2 at ")
    if end == "instrument":
        by_hand.server.__exit__()
        terminal.type(UP)
        assert terminal.status() == 1
    elif end == "terminal":
        os.close(terminal.keys)
        assert terminal.process.wait(PATIENCE) in (1, 129)
    else:
        terminal.process.send_signal(getattr(signal, end))
        assert terminal.status() == 128 + getattr(signal, end)
    if end != "terminal":
        assert termios.tcgetattr(terminal.keys) == terminal.modes
    if end != "instrument":
        assert by_hand.lab.position == (0, 0)
        assert not by_hand.server.dialect.playing
    kept = by_hand.folder.rglob("mark_1.json")
    assert [read_answer(path)["answer"] for path in kept] == [by_hand.where[1]]
