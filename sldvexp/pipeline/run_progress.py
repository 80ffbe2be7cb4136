"""Progress of a run as the terminal shows it: the step, and of a scan view, line, pixels and time.

Time left is that of the scan. It is estimated from the lines that were scanned, see
`sldvexp.progress.TimeLeft`: lines of the journal cost nothing and do not count, nor does the time
in which a person was asked. The first line of a view takes longer, since it opens the instrument;
that excess is counted once for each view to come. What is computed between lines is added in
proportion.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

from sldvexp.lazy import xarray as xr
from sldvexp.progress import Progress, TimeLeft, first_that_fits, span
from sldvexp.session.tally import PixelTally
from sldvexp.session.watching import GO_ON, LineDone, ViewAhead, Watcher, Wish, in_words

#: Columns of the bar: at least, or there is none, and at most.
LEAST, MOST = 8, 30


class RunProgress(Watcher):
    """Shows a run's steps, and the views and lines of its scan.

    Parameters
    ----------
    quiet : bool
        Whether nothing is shown and said at all.
    title : str
        Of one run of many, shown before its step; such a run says no lines.
    clock : callable
        Seconds, never backwards.
    """

    def __init__(
        self, quiet: bool = False, title: str = "", clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._title, self._clock = title, clock
        self._progress = Progress(self.rows, quiet)
        self._step, self._begun = "", clock()
        self._scan: ScanProgress | None = None
        self._lock = threading.Lock()  # of the scan, which is drawn in a thread of its own

    def __enter__(self) -> None:
        self._progress.__enter__()

    def __exit__(self, *exception: object) -> None:
        self._progress.__exit__(*exception)

    def rows(self, width: int) -> Sequence[str]:
        """Make the rows for a width."""
        title = f"{self._title}, " if self._title else ""
        if (scan := self._scan) is not None:
            with self._lock:
                return scan.rows(f"{title}{self._step}", width)
        seconds = span(self._clock() - self._begun)
        long = f"{title}{self._step}  {seconds}"
        return [first_that_fits([long, f"{title}{self._step}", self._step], width)]

    def step_begun(self, name: str, number: int, count: int) -> None:
        """See `Watcher`."""
        self._step, self._begun = f"step {number} of {count}: {name}", self._clock()
        self._say(self._step)

    def session_begun(self, views: tuple[ViewAhead, ...]) -> None:
        """See `Watcher`."""
        self._scan = ScanProgress(views, self._clock)

    def view_begun(self, view: ViewAhead) -> None:
        """See `Watcher`."""
        if self._scan is not None:
            with self._lock:
                self._scan.view_begun(view)
                line = self._scan.line
            self._say(line)  # not with the lock: who draws has that of the terminal, and waits here

    def between_lines(self, view: str, lines: str, done: int, count: int) -> Wish:
        """See `Watcher`."""
        if self._scan is not None:
            with self._lock:
                self._scan.between_lines(lines, done, count)
        return GO_ON

    def line_done(self, line: LineDone) -> None:
        """See `Watcher`."""
        if self._scan is not None:
            with self._lock:
                self._scan.line_done(line)

    def view_done(self, view: ViewAhead, groups: Mapping[str, xr.Dataset]) -> None:
        """See `Watcher`."""
        if self._scan is not None:
            with self._lock:
                self._scan.view_done(view)

    def session_done(self) -> None:
        """See `Watcher`."""
        self._scan = None

    @contextmanager
    def asking(self, request: str) -> Iterator[None]:
        """See `Watcher`."""
        begun = self._clock()
        try:
            with self._progress.paused():
                yield
        finally:
            if self._scan is not None:
                self._scan.waited += self._clock() - begun

    def _say(self, line: str) -> None:
        if not self._title:
            self._progress.say(line)


class ScanProgress:
    """How far a scan is, and how long it will take.

    Parameters
    ----------
    views : sequence of ViewAhead
    clock : callable
        Seconds, never backwards.

    Attributes
    ----------
    waited : float, s
        In which a person was asked, or let it wait, since the last line.
    tally : PixelTally
        Of the pixels.
    """

    def __init__(self, views: Sequence[ViewAhead], clock: Callable[[], float]) -> None:
        self._views, self._clock = views, clock
        parts = [part for view in views for part in view.parts]
        known = {p.kind: p.seconds / p.pixels for p in parts if p.pixels}
        self._lines = TimeLeft(known)
        self.tally = PixelTally(views)
        self._kept: Counter[str] = Counter()  # pixels to come of this view that the journal has
        self._view = views[0]
        self._where = ""
        self._opening: list[float] = []  # excess of each view's first line, s
        self._is_first = True  # whether the next line is a view's first
        self._alone: tuple[str, int, float] | None = None  # the only line so far
        self._scanning = self._computing = self.waited = 0.0
        self._stamp = clock()

    def view_begun(self, view: ViewAhead) -> None:
        """Note a view."""
        self._view, self._where, self._is_first = view, "", True
        self._kept = Counter({part.kind: part.kept for part in view.parts})
        self._stamp, self.waited = self._clock(), 0.0

    def between_lines(self, lines: str, done: int, count: int) -> None:
        """Note where the scan is, and what was computed since the last line."""
        if done < count:
            self._where = in_words(lines, done + 1, count)
        self._computing += self._since()

    def line_done(self, line: LineDone) -> None:
        """Note a line."""
        seconds, pixels = self._since(), len(line.dac)
        self.tally.line_done(line)
        if line.kept:
            self._kept[line.kind] -= 0 if line.searches else pixels
            return
        self._scanning += seconds
        if self._is_first and self._lines.rate(line.kind) is not None:
            seconds = self._without_opening(line.kind, pixels, seconds)
        elif self._alone and self._alone[0] == line.kind:
            first, self._alone = self._alone, None  # now it can be told what of it was opening
            self._lines.forget(line.kind)
            self._lines.add(line.kind, pixels, seconds)
            self._lines.add(*first[:2], self._without_opening(*first))
            return
        elif self._is_first:
            self._alone = line.kind, pixels, seconds
        self._is_first = False
        self._lines.add(line.kind, pixels, seconds)

    def _without_opening(self, kind: str, pixels: int, seconds: float) -> float:
        """Take from the time of a view's first line what it needed more than others."""
        excess = max(seconds - (self._lines.rate(kind) or 0.0) * pixels, 0.0)
        self._opening.append(excess)
        return seconds - excess

    def view_done(self, view: ViewAhead) -> None:
        """Note that the rest of a view will not come, if it was skipped."""
        self._computing += self._since()
        self.tally.view_done(view)

    @property
    def share(self) -> float:
        """Share of all pixels that are done, from 0 to 1."""
        return self.tally.share

    @property
    def seconds_left(self) -> float | None:
        """Time left in s, None if it cannot be told."""
        every, done = self.tally.total, self.tally.done
        ahead = [view for view in self._views if view.number > self._view.number]
        kept = self._kept.copy()
        for view in ahead:
            kept.update({part.kind: part.kept for part in view.parts})
        left = {kind: max(every[kind] - done[kind] - kept[kind], 0) for kind in every}
        seconds = self._lines.left(left)
        if seconds is None or not self._scanning:
            return None
        opened = self._opening[1:] or self._opening or [0.0]
        closed = [self._view, *ahead] if self._is_first else ahead
        to_open = sum(view.kept < view.pixels for view in closed)
        besides = self._computing / self._scanning
        return seconds * (1 + besides) + to_open * sum(opened) / len(opened)

    @property
    def line(self) -> str:
        """Plain line about the view that begins."""
        view = self._view
        told = f"view {view.number} of {view.count}, {view.name}"
        told += f": {view.pixels} pixels" if view.pixels else ""
        told += f", {view.kept} of them kept before" if view.kept else ""
        left = self.seconds_left
        return told if left is None else f"{told}; about {span(left)} left"

    def rows(self, step: str, width: int) -> Sequence[str]:
        """Make the rows for a width, of which narrow ones tell less."""
        view = f"view {self._view.number} of {self._view.count}"
        named = f"{view}, {self._view.name}"
        first = first_that_fits([f"{step}, {named}", f"{step}, {view}", named, view], width)
        total = self.tally.total.total()
        if not total:
            return [first]
        pixels = f"{self.tally.done.total()} of {total} pixels"
        left = self.seconds_left
        known = [] if left is None else [f"{span(left)} left"]
        percent = f"{100 * self.share:.0f} %"
        every = [*filter(None, [self._where]), pixels, percent, *known]
        told = [every, [pixels, percent, *known], [percent, *known], [percent]]
        second = first_that_fits([", ".join(each) for each in told], width)
        room = min(width - len(second) - 2, MOST)
        room -= room % 4  # so that it does not change with every digit
        if room >= LEAST:
            full = round(room * self.share)
            second = f"{'━' * full}{'┄' * (room - full)}  {second}"
        return [first, second]

    def _since(self) -> float:
        """Take the time since the last event, without that in which a person was asked."""
        now = self._clock()
        passed, self._stamp = now - self._stamp - self.waited, now
        self.waited = 0.0
        return max(passed, 0.0)
