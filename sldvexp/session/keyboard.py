"""Keys of a terminal one by one, with a line at its bottom that is drawn anew.

Keys need no Enter and are not echoed; Ctrl-C and signals work as ever. However it ends, the
terminal is as it was before. Python's own `termios` does it: no more is needed of a library than
to read arrow keys, and curses would take the whole screen, with all that was said before.
"""

from __future__ import annotations

import os
import re
import select
import sys
import time
from contextlib import suppress
from typing import Any, NamedTuple

from sldvexp.stopping import undisturbed

try:
    import termios
except ImportError:  # Windows
    termios = None  # type: ignore[assignment]

#: How long the rest of an arrow key's bytes may take, s; a connection may cut them in two.
SPLIT = 0.1
#: Columns of a terminal that does not tell.
COLUMNS = 80
#: Begins the line anew and clears it.
AFRESH = "\r\x1b[K"

#: Keys by what they send.
NAMED = {"\r": "enter", "\n": "enter", "\x7f": "backspace", "\x08": "backspace", "\x04": "end"}
ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_ARROW = re.compile(r"\x1b(?:\[(?:1;([1-8]))?|O)([ABCD])")
#: What a key that is not known here sends.
_OTHER = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|O.)")
SHIFT = 1


class Key(NamedTuple):
    """One key: its name or the character that it writes, and whether Shift was held."""

    name: str
    shift: bool = False


class TerminalLostError(Exception):
    """The terminal is gone: its window was closed, or the connection was lost."""


class Keyboard:
    """Keys and screen of this process's terminal; a context manager."""

    def __init__(self) -> None:
        self._input, self._output = sys.stdin.fileno(), sys.stdout
        self._before: list[Any] = []
        self._pending = ""
        self._shown = ""

    @staticmethod
    def is_there() -> bool:
        """Tell whether a person sits at a terminal that can draw a line anew."""
        try:
            seen = sys.stdin.isatty() and sys.stdout.isatty()
        except (AttributeError, ValueError):  # there is none, or it is closed
            return False
        return seen and termios is not None and os.environ.get("TERM", "dumb") != "dumb"

    def __enter__(self) -> Keyboard:
        with undisturbed():
            self._before = termios.tcgetattr(self._input)
            keys = termios.tcgetattr(self._input)
            keys[3] &= ~(termios.ICANON | termios.ECHO)
            keys[6][termios.VMIN], keys[6][termios.VTIME] = 1, 0
            # Whoever suspended the program here would have neither echo nor lines in the shell.
            keys[6][termios.VSUSP] = b"\0"
            termios.tcsetattr(self._input, termios.TCSADRAIN, keys)
        return self

    def __exit__(self, *exception: object) -> None:
        # A terminal that is lost has nothing to be restored.
        with undisturbed(), suppress(OSError, termios.error, TerminalLostError):
            termios.tcsetattr(self._input, termios.TCSADRAIN, self._before)
            self.status("")

    def key(self, patience: float | None = None) -> Key | None:
        """Wait for a key, for some seconds or as long as it takes; None if none came.

        Raises
        ------
        TerminalLostError
            If there will be no more keys.
        """
        end = None if patience is None else time.monotonic() + patience
        while True:
            if (key := self._next()) is not None:
                return key
            left = None if end is None else max(0.0, end - time.monotonic())
            if not self._wait(left):
                return None

    @property
    def is_waiting(self) -> bool:
        """True if more was typed than was taken."""
        return bool(self._pending) or self._wait(0.0)

    def say(self, text: str) -> None:
        """Write lines above the last one."""
        shown = self._shown
        self._write(f"{AFRESH}{text}\n")
        self._shown = ""
        self.status(shown)

    def status(self, text: str) -> None:
        """Draw the last line anew, cut to the terminal's width so that it stays one."""
        if text[: self.columns - 1] == self._shown:
            return
        self._shown = text[: self.columns - 1]
        self._write(f"{AFRESH}{self._shown}")

    @property
    def columns(self) -> int:
        """Width of the terminal, as it is now."""
        with suppress(OSError):
            return max(os.get_terminal_size(self._output.fileno()).columns, 2)
        return COLUMNS

    def _next(self) -> Key | None:
        """Take one key of what came."""
        while self._pending:
            if self._pending[0] != "\x1b":
                first, self._pending = self._pending[0], self._pending[1:]
                return Key(NAMED.get(first, first))
            if match := _ARROW.match(self._pending):
                self._pending = self._pending[match.end() :]
                held = int(match[1] or 1) - 1
                return Key(ARROWS[match[2]], bool(held & SHIFT))
            if match := _OTHER.match(self._pending):
                self._pending = self._pending[match.end() :]
            elif not self._wait(SPLIT):
                # Escape itself, or something that begins with it and has no end.
                self._pending = self._pending[1:]
                return Key("escape")
        return None

    def _wait(self, seconds: float | None) -> bool:
        """Wait for more of what is typed."""
        try:
            if not select.select([self._input], [], [], seconds)[0]:
                return False
            came = os.read(self._input, 1024)
        except OSError:
            came = b""
        if not came:
            raise TerminalLostError
        self._pending += came.decode(errors="ignore")
        return True

    def _write(self, text: str) -> None:
        try:
            self._output.write(text)
            self._output.flush()
        except OSError:
            raise TerminalLostError from None
