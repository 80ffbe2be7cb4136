"""Shows what goes on: a few live rows at a terminal, plain lines where there is none.

Rows are drawn over and over in the same place and are gone in the end, so that only results stay
on the screen. A pipe, a file, a batch job and ``TERM=dumb`` get a line a step instead, of words
alone. `TimeLeft` estimates how long something takes from the parts of it that are done.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console, ConsoleOptions, RenderResult
from rich.live import Live
from rich.spinner import Spinner
from rich.text import Text

from sldvexp.telling import clear_note, is_terminal, live_stream

#: How often rows are drawn, Hz.
REFRESH = 5
#: Columns of the spinner before the first row.
SPINNER = 2
#: Largest count of each unit of time that is told in it.
MOST = 90


def span(seconds: float) -> str:
    """Say a time span in words.

    Examples
    --------
    >>> span(42), span(600), span(7200)
    ('42 s', '10 min', '2.0 h')
    """
    if seconds <= MOST:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes <= MOST else f"{minutes / 60:.1f} h"


def first_that_fits(candidates: Sequence[str], width: int) -> str:
    """Choose the first text that is not wider, else the last one, cut.

    Examples
    --------
    >>> first_that_fits(["step 3 of 7: scan", "step 3 of 7"], 12)
    'step 3 of 7'
    """
    chosen = next((text for text in candidates if len(text) <= width), candidates[-1])
    return chosen if len(chosen) <= width else f"{chosen[: max(width - 1, 0)]}…"


class Progress:
    """Rows that tell what goes on; a context, after which they are gone.

    Parameters
    ----------
    rows : callable
        Makes the rows for a width in columns.
    quiet : bool
        Whether nothing is shown and said at all.
    """

    def __init__(self, rows: Callable[[int], Sequence[str]], quiet: bool = False) -> None:
        self._rows, self._quiet = rows, quiet
        self._begun = time.monotonic()
        self._live: Live | None = None

    def __enter__(self) -> Progress:
        clear_note()
        stream = None if self._quiet else live_stream()
        if stream is not None:
            self._live = self._made(stream)
            # Drawn here first: a line that is printed before knows nothing of the rows to clear.
            self._live.start(refresh=True)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def say(self, line: str) -> None:
        """Print a plain line, unless standard output is a terminal that has the rows."""
        if not self._quiet and not (self._live is not None and is_terminal(sys.stdout)):
            print(line, flush=True)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Give the terminal back, for what would else be drawn over."""
        if self._live is None:
            yield
            return
        self._live.stop()
        try:
            yield
        finally:
            self._live.start(refresh=True)

    def _made(self, stream: TextIO) -> Live:
        console = Console(file=stream)
        return Live(
            self,
            console=console,
            refresh_per_second=REFRESH,
            transient=True,
            redirect_stdout=is_terminal(sys.stdout),
        )

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Draw the rows, a spinner before the first."""
        # One column less than there are: some terminals begin a new line behind the last.
        width = max(options.max_width - 1 - SPINNER, 1)
        frames = Spinner("dots" if console.encoding.startswith("utf") else "line").frames
        frame = frames[int((time.monotonic() - self._begun) * REFRESH * 2) % len(frames)]
        for k, row in enumerate(self._rows(width)):
            first = Text(frame if k == 0 else " ", style="green")
            yield Text.assemble(first, " ", row, no_wrap=True, overflow="crop")


@contextmanager
def doing(what: str) -> Iterator[None]:
    """Show at a terminal what is done inside, with how long it takes already.

    Nothing is said where there is no terminal: what a command prints there is read by programs.
    """
    begun = time.monotonic()

    def rows(width: int) -> Sequence[str]:
        seconds = span(time.monotonic() - begun)
        return [first_that_fits([f"{what}  {seconds}", what], width)]

    with Progress(rows, quiet=live_stream() is None):
        yield


class TimeLeft:
    """Time that is left of work whose parts take time in proportion to their units.

    The rate of a kind is the mean time of a unit over the last `RECENT` parts of that kind. A part
    of more than `OUTLIER` times the median counts for no more than that, as long as it is alone or
    of few: one that waited for an instrument to be plugged in again says nothing of the others,
    but hitches that come again and again are part of the work. Before a kind has begun, its units
    take what is known of them and as much besides as those of the kind that was measured last.

    Parameters
    ----------
    known : mapping of str to float, s
        For each kind, what a unit takes as far as that is known: the length of its record.
    """

    RECENT = 100
    OUTLIER = 4.0
    FEW = 0.05

    def __init__(self, known: Mapping[str, float]) -> None:
        self._known = dict(known)
        self._parts: dict[str, list[tuple[float, float]]] = {}
        self._last = ""

    def add(self, kind: str, units: float, seconds: float) -> None:
        """Note a part that is done."""
        if units > 0:
            self._parts.setdefault(kind, []).append((units, seconds))
            del self._parts[kind][: -self.RECENT]
            self._last = kind

    def forget(self, kind: str) -> None:
        """Take back all parts of a kind."""
        self._parts[kind] = []

    def rate(self, kind: str) -> float | None:
        """Estimate what a unit takes, s; None before any part is done."""
        if parts := self._parts.get(kind):
            done = list(parts)  # which another thread may add to
            most = self.OUTLIER * statistics.median(seconds / units for units, seconds in done)
            outliers = sum(seconds > most * units for units, seconds in done)
            if outliers > max(1, self.FEW * len(done)):
                most = math.inf
            usual = sum(min(seconds, most * units) for units, seconds in done)
            return usual / sum(units for units, _ in done)
        # Of the last kind nothing may be known for a moment, while its parts are put right.
        measured = self.rate(self._last) if self._last not in ("", kind) else None
        if measured is None:
            return None
        own, other = self._known.get(kind, 0.0), self._known.get(self._last, 0.0)
        if measured >= other or not other:
            return own + measured - other
        return measured * own / other  # a virtual lab, which does not wait for its samples

    def left(self, units: Mapping[str, float]) -> float | None:
        """Estimate the time left, s, for so many units of each kind; None if nothing is known."""
        rates = {kind: self.rate(kind) for kind, count in units.items() if count}
        if any(rate is None for rate in rates.values()):
            return None
        return sum(units[kind] * rate for kind, rate in rates.items() if rate is not None)
