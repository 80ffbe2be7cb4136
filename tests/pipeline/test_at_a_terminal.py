"""A run at a real pseudo-terminal: rows while it is at work, five lines and no trace at the end."""

from __future__ import annotations

import codecs
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
from functools import partial

import pytest
from screen import Screen

#: A plate from two places, as quick as a scan can be; its poses are given.
SCAN = [
    "experiment=spoiled/clean",
    "scan.pixels=[13,15]",
    "report=none",
]
LONGEST = 300.0


class Terminal:
    """The command at a terminal of so many columns.

    Parameters
    ----------
    columns : int
    *arguments : str
        Of the command.
    **environment : str
    """

    def __init__(self, folder, columns, *arguments, **environment):
        self.screen, self.shown = Screen(columns), []
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        known = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "COLUMNS", "LINES")}
        begun = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sldvexp.cli.main", *arguments],
            stdin=slave, stdout=slave, stderr=slave, cwd=folder, start_new_session=True,
            preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # in a background too
            env={**known, "TERM": "xterm-256color", **environment},
        )  # fmt: skip
        os.close(slave)
        self.begun = begun

    def read(self, until=lambda: True, then=None):
        """Show what comes until something has happened, do something then, and go on to the end."""
        decoder, left = codecs.getincrementaldecoder("utf-8")(), ""
        while self.process.poll() is None or select.select([self.master], [], [], 0.2)[0]:
            assert time.monotonic() - self.begun < LONGEST
            if not select.select([self.master], [], [], 0.1)[0]:
                continue
            try:
                came = left + decoder.decode(os.read(self.master, 65536))
            except OSError:
                break
            begun = re.search(r"\x1b(\[[?\d;]*)?$", came)  # a sequence whose end is to come
            cut = begun.start() if begun else len(came)
            self.screen.feed(came[:cut])
            left = came[cut:]
            self.shown.append(self.screen.text)
            if then and until():
                then, _ = None, then()
        self.screen.feed(left)
        self.status = self.process.wait(LONGEST)
        return self.screen.text


def shows_and_has_written(terminal, folder):
    """Tell when rows of the scan are on the screen and a line of it is in the journal."""
    return lambda: (
        any("pixels, " in line for line in terminal.screen.text)
        and any((folder / "r" / "journal").rglob("[!.]*.npz"))
    )


def rows(terminal, pattern):
    return [line for text in terminal.shown for line in text if re.search(pattern, line)]


@pytest.mark.whole
@pytest.mark.parametrize("columns", [80, 40])
def test_rows_fit_and_five_lines_stay(tmp_path, columns):
    # Rows are drawn five times a second: the scan must last longer than that, also here.
    terminal = Terminal(tmp_path, columns, *SCAN, "scan.pixels=[60,60]", "hydra.run.dir=r")
    text = terminal.read()
    assert terminal.status == 0, text
    assert rows(terminal, r"step 2 of 9: scan, view \d of 5")
    assert rows(terminal, r"\d+ of 18000 pixels, \d+ %")
    assert rows(terminal, "step 5 of 9: velocity field")
    whole = " ".join(text)
    assert "step" not in whole.replace("steps", "")
    labels = [line.partition(":")[0] for line in text]
    assert [x for x in labels if x in ("found", "bounds", "verdict", "files", "next")] == [
        "found", "bounds", "verdict", "files", "next",
    ]  # fmt: skip
    assert terminal.screen.cursor
    assert "32" in terminal.screen.colours


@pytest.mark.whole
@pytest.mark.parametrize(
    ("how", "status"), [("key", 130), (signal.SIGTERM, 143), (signal.SIGINT, 130)]
)
def test_an_interruption_leaves_the_terminal_clean(tmp_path, how, status):
    terminal = Terminal(tmp_path, 60, *SCAN, "scan.pixels=[80,90]", "hydra.run.dir=r")

    def stop():
        if how == "key":  # as nobody's terminal is its controlling one here
            os.killpg(terminal.process.pid, signal.SIGINT)
        else:
            terminal.process.send_signal(how)

    text = terminal.read(shows_and_has_written(terminal, tmp_path), stop)
    assert terminal.status == status, text
    assert terminal.screen.cursor
    last = " ".join(text)
    assert "sldvexp: interrupted; what was scanned is kept, go on with: sldvexp" in last
    assert " %" not in last
    assert "━" not in last


@pytest.mark.whole
def test_a_terminal_that_is_closed_ends_the_run_in_order(tmp_path):
    terminal = Terminal(tmp_path, 60, *SCAN, "scan.pixels=[80,90]", "hydra.run.dir=r")

    def close():
        os.close(terminal.master)
        terminal.process.send_signal(signal.SIGHUP)

    with pytest.raises((OSError, ValueError)):
        terminal.read(shows_and_has_written(terminal, tmp_path), close)
    assert terminal.process.wait(LONGEST) == 129
    assert list((tmp_path / "r" / "journal").rglob("[!.]*.npz"))


@pytest.mark.whole
def test_no_colour_where_none_is_wanted(tmp_path):
    terminal = Terminal(tmp_path, 80, "experiment=point", "seed=-1", NO_COLOR="1")
    text = terminal.read()
    assert terminal.status == 1
    assert text == ["sldvexp: command line: seed must be zero or a positive integer, not -1"]
    assert not terminal.screen.colours


@pytest.mark.whole
def test_a_mistake_is_red_at_a_terminal(tmp_path):
    terminal = Terminal(tmp_path, 80, "experiment=point", "seed=-1")
    text = terminal.read()
    assert terminal.shown[0] == ["reading the configuration"]
    assert text == ["sldvexp: command line: seed must be zero or a positive integer, not -1"]
    assert "31" in terminal.screen.colours


@pytest.mark.whole
def test_a_command_shows_what_it_does_and_leaves_its_answer(tmp_path, sldvexp):
    sldvexp("experiment=point", "hydra.run.dir=r")
    terminal = Terminal(tmp_path, 80, "report", "r")
    assert terminal.read() == ["r/report.html"]
    assert terminal.shown[0] == ["loading the program"]
    assert rows(terminal, "making the page of r/run.nc  . s")
    assert terminal.screen.cursor


@pytest.mark.whole
def test_a_dumb_terminal_gets_plain_lines(tmp_path):
    terminal = Terminal(tmp_path, 80, "experiment=point", "hydra.run.dir=r", TERM="dumb")
    text = terminal.read()
    assert text[:2] == [
        "step 1 of 6: line-of-sight velocities",
        "step 2 of 6: comparison of the views of points",
    ]
    assert not terminal.screen.colours
