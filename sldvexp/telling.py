"""Sentences on standard error: mistakes in red, warnings in yellow, in words alone in a file.

``NO_COLOR`` in the environment, of any value, and ``TERM=dumb`` keep a terminal without colours.
"""

from __future__ import annotations

import logging
import os
import sys

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
    name = f"sldvexp: {kind}: " if kind else "sldvexp: "
    if has_colours():
        name = f"{colour}{name.rstrip()}{PLAIN} "
    print(f"{name}{shown(sentence)}", file=sys.stderr, flush=True)


def has_colours() -> bool:
    """Tell whether standard error is a terminal that shows colours, and wanted to."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM", "") in DUMB:
        return False
    try:
        return sys.stderr.isatty()
    except (ValueError, AttributeError):  # closed, or none at all
        return False


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
