"""Sentences on standard error: mistakes in red, warnings in yellow, in words alone in a file.

At a terminal also a note of what is done before anything else can be shown, which takes no library.

``NO_COLOR`` in the environment, of any value, and ``TERM=dumb`` keep a terminal without colours.
"""

from __future__ import annotations

import logging
import os
import stat
import sys
from contextlib import suppress
from typing import TextIO

from sldvexp.limits import shown

#: Colours of the program's name before a sentence, as terminals know them.
RED, YELLOW = "\x1b[1;31m", "\x1b[1;33m"
PLAIN = "\x1b[0m"
#: Terminals that have no colours.
DUMB = ("dumb", "unknown")


def tell(sentence: str, colour: str = RED, kind: str = "") -> None:
    """Print a sentence on standard error, behind the program's name.

    Parameters
    ----------
    sentence : str
        In it may be words of a file: nothing in them acts on a terminal.
    colour : str
        Of the name.
    kind : str
        Word behind the name, as ``warning``.
    """
    clear_note()
    name = f"sldvexp: {kind}: " if kind else "sldvexp: "
    if has_colours():
        name = f"{colour}{name.rstrip()}{PLAIN} "
    print(f"{name}{shown(sentence)}", file=sys.stderr, flush=True)


def has_colours() -> bool:
    """Tell whether standard error is a terminal that shows colours, and wanted to."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM", "") in DUMB:
        return False
    return is_terminal(sys.stderr)


def live_stream() -> TextIO | None:
    """Find the terminal for live rows: standard error, or standard output; None if there is none.

    Behind a pipe somebody else may write to the same terminal, so nothing is drawn there then.
    """
    if os.environ.get("TERM", "") in DUMB:
        return None
    if is_terminal(sys.stdout):
        return sys.stderr if is_terminal(sys.stderr) else sys.stdout
    return sys.stderr if is_terminal(sys.stderr) and _is_file(sys.stdout) else None


def is_terminal(stream: TextIO) -> bool:
    """Tell whether a stream is a terminal; one that is closed is none."""
    with suppress(ValueError, AttributeError):  # closed, or none at all
        return stream.isatty()
    return False


def _is_file(stream: TextIO) -> bool:
    with suppress(OSError, ValueError, AttributeError):
        return stat.S_ISREG(os.fstat(stream.fileno()).st_mode)
    return False


#: Whether a note stands on the terminal's last line.
_noted = False


def note(text: str) -> None:
    """Write one line to a terminal, in plain words at once, until something else is shown there."""
    global _noted
    clear_note()
    if (stream := live_stream()) is not None:
        with suppress(OSError):
            stream.write(text)
            stream.flush()
            _noted = True


def clear_note() -> None:
    """Take the note away."""
    global _noted
    if _noted and (stream := live_stream()) is not None:
        with suppress(OSError):
            stream.write("\r\x1b[2K")
            stream.flush()
    _noted = False


class WarningHandler(logging.Handler):
    """Tells what is logged as a warning in a sentence; the log's file has time and place besides.

    Parameters
    ----------
    stream : object
        Is not used: rows that are drawn on a terminal may take standard error over meanwhile.
    """

    def __init__(self, stream: object = None) -> None:
        super().__init__()

    def emit(self, record: logging.LogRecord) -> None:
        """Tell it."""
        try:
            tell(" ".join(record.getMessage().split()), YELLOW, record.levelname.lower())
        except Exception:  # a log must not end what is logged
            self.handleError(record)
