"""Keys of a terminal one by one, and a terminal that is as it was before, however that ended."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import sys
import termios
import time
import tty

import pytest

from sldvexp.session.keyboard import Keyboard, TerminalLostError

UP, DOWN, RIGHT, LEFT = (f"\x1b[{way}" for way in "ABCD")


class Screen:
    """The other end of a terminal that this process sits at."""

    def __init__(self, monkeypatch):
        self.end, there = pty.openpty()
        self.there = os.fdopen(there, "r+b", buffering=0)
        self.files = os.fdopen(os.dup(there), "r"), os.fdopen(os.dup(there), "w")
        self.monkeypatch = monkeypatch
        monkeypatch.setenv("TERM", "xterm")
        self.resize(80)

    def sit_down(self):
        """Take the streams of the test itself, which are others than those of a fixture."""
        self.monkeypatch.setattr(sys, "stdin", self.files[0])
        self.monkeypatch.setattr(sys, "stdout", self.files[1])

    @property
    def modes(self):
        return termios.tcgetattr(self.there)

    def resize(self, columns):
        fcntl.ioctl(self.there, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))

    def type(self, keys):
        os.write(self.end, keys.encode())

    def shown(self):
        text = b""
        while select.select([self.end], [], [], 0.05)[0]:
            text += os.read(self.end, 65536)
        return text.decode()

    def close(self):
        for file in (*self.files, self.there):
            file.close()
        os.close(self.end)


@pytest.fixture
def screen(monkeypatch):
    made = Screen(monkeypatch)
    yield made
    made.close()


def keys(screen, typed, count):
    with Keyboard() as keyboard:
        screen.type(typed)
        return [keyboard.key(2.0) for _ in range(count)]


def test_keys_have_names(screen):
    screen.sit_down()
    found = keys(screen, f"{UP}{DOWN}{RIGHT}{LEFT}\x1bOA\x1b[1;2C\rg+\x7f\x04", 11)
    assert [key.name for key in found] == [
        *("up", "down", "right", "left", "up", "right", "enter", "g", "+", "backspace", "end"),
    ]
    assert [key.shift for key in found] == [False] * 5 + [True] + [False] * 5


def test_what_is_not_known_is_left_out(screen):
    """Function keys, the mouse and Delete send what is no key here."""
    screen.sit_down()
    found = keys(screen, "a\x1b[15~\x1b[3~\x1b[M\x1bOPb", 2)
    assert [key.name for key in found] == ["a", "b"]


def test_an_arrow_may_come_in_two_pieces_and_escape_alone(screen):
    screen.sit_down()
    with Keyboard() as keyboard:
        screen.type("\x1b")
        assert keyboard.key(2.0).name == "escape"
        keyboard._pending = "\x1b"  # the first piece
        screen.type("[A")
        assert keyboard.key(2.0).name == "up"


def test_nobody_waits_longer_than_said(screen):
    screen.sit_down()
    with Keyboard() as keyboard:
        begun = time.monotonic()
        assert keyboard.key(0.1) is None
        assert 0.1 <= time.monotonic() - begun < 2.0
        assert not keyboard.is_waiting
        screen.type("ab")
        assert keyboard.is_waiting
        assert keyboard.key(0.0).name == "a"
        assert keyboard.is_waiting


@pytest.mark.parametrize("error", [None, KeyboardInterrupt, ValueError])
def test_the_terminal_is_as_it_was(screen, error):
    screen.sit_down()
    before = screen.modes
    try:
        with Keyboard():
            assert not screen.modes[3] & (termios.ECHO | termios.ICANON)
            assert screen.modes[3] & termios.ISIG
            if error is not None:
                raise error
    except (KeyboardInterrupt, ValueError):
        pass
    assert screen.modes == before


def test_the_last_line_is_drawn_anew_and_stays_one(screen):
    screen.sit_down()
    with Keyboard() as keyboard:
        keyboard.status("beam 0 0")
        assert screen.shown() == "\r\x1b[Kbeam 0 0"
        keyboard.status("beam 0 0")
        assert screen.shown() == ""
        keyboard.say("taken")
        assert screen.shown() == "\r\x1b[Ktaken\r\n\r\x1b[Kbeam 0 0"
        screen.resize(6)
        keyboard.status("beam 0 1")
        assert screen.shown() == "\r\x1b[Kbeam "
    assert screen.shown() == "\r\x1b[K"


def ended(*_):
    return b""


def gone(*_):
    raise OSError(5, "Input/output error")


@pytest.mark.parametrize("read", [ended, gone])
def test_a_terminal_that_is_lost_is_said_to_be(screen, monkeypatch, read):
    screen.sit_down()
    with Keyboard() as keyboard:
        monkeypatch.setattr(os, "read", read)
        screen.type("a")
        with pytest.raises(TerminalLostError):
            keyboard.key()
        monkeypatch.undo()


def test_a_pipe_or_a_dumb_terminal_has_no_keys(screen, monkeypatch):
    screen.sit_down()
    assert Keyboard.is_there()
    for term in ("dumb", None):
        monkeypatch.setenv("TERM", term) if term else monkeypatch.delenv("TERM")
        assert not Keyboard.is_there()
    monkeypatch.setenv("TERM", "xterm")
    with open(os.devnull) as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        assert not Keyboard.is_there()
    monkeypatch.setattr(sys, "stdin", None)
    assert not Keyboard.is_there()


def test_raw_modes_of_others_are_given_back_too(screen):
    screen.sit_down()
    tty.setraw(screen.there)
    before = screen.modes
    with Keyboard():
        pass
    assert screen.modes == before
