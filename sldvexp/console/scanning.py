"""A scan as browsers see and steer it: a `Watcher` and an `Operator` of the session.

It is told of every line, has its pixels painted, and between two lines hears what the controller
wishes. When the controller has gone it waits, with the mirrors home and the generator off, until
somebody steers again and says to go on.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from sldvexp.config.experiment import Experiment
from sldvexp.console.afterwards import Advise, Afterwards
from sldvexp.console.board import NoticeBoard
from sldvexp.console.marks import AimedMarks, AimedPerson
from sldvexp.console.painting import Painter
from sldvexp.lazy import xarray as xr
from sldvexp.session import LineDone, Operator, ViewAhead, Watcher, Wish

#: Part of a line's pixels that must not be trusted for it to be a bad one.
BAD = 0.2
#: Seconds that are told as such; more are minutes.
SECONDS, MINUTES = 90, 90


class Scanning(Watcher):
    """Shows a session to browsers and heeds the controller.

    Parameters
    ----------
    experiment : Experiment
    board : NoticeBoard
    wishes : queue of dict
    advise : callable, optional
        Sentences on what to do after a view, see `sldvexp.console.afterwards`.

    Attributes
    ----------
    stopped, lost, paused : bool
        Whether the controller has stopped it, has gone, and lets it wait.
    """

    def __init__(
        self,
        experiment: Experiment,
        board: NoticeBoard,
        wishes: queue.Queue[dict[str, Any]],
        advise: Advise | None = None,
    ) -> None:
        self.board, self.wishes = board, wishes
        self.stopped = self.lost = self.paused = False
        self._running, self._between, self._why = True, False, ""
        self._rest: Callable[[], None] | None = None
        self._step = ""
        self._views: tuple[ViewAhead, ...] = ()
        self._view: ViewAhead | None = None
        self._pixels = self._scanned = 0
        self._began, self._waited = time.monotonic(), 0.0
        self._last: LineDone | None = None
        self._painter = Painter(experiment, board, self._tell)
        self._afterwards = Afterwards(experiment, self._tell_done, advise, self._tell_advice)
        board.tell("done", [])

    # ---- what a session tells ----

    def step_begun(self, name: str, number: int, count: int) -> None:
        """See `Watcher`."""
        self._step = f"step {number} of {count}, {name}"
        self._tell()

    def session_begun(self, views: tuple[ViewAhead, ...]) -> None:
        """See `Watcher`."""
        self._views, self._between = views, True
        self._pixels = self._scanned = 0
        self._began, self._waited = time.monotonic(), 0.0

    def session_done(self) -> None:
        """See `Watcher`."""
        self._between = False
        self._tell()

    def view_begun(self, view: ViewAhead) -> None:
        """See `Watcher`."""
        self._view, self._rest, self._last = view, None, None
        self._tell()

    def arrived(self, rest: Callable[[], None]) -> None:
        """See `Watcher`."""
        self._rest = rest

    def line_done(self, line: LineDone) -> None:
        """See `Watcher`."""
        self._last = line
        if not line.again:
            self._pixels += len(line.dac)
            self._scanned += 0 if line.kept else len(line.dac)
        self._painter.put(line)

    def view_done(self, view: ViewAhead, groups: Mapping[str, xr.Dataset]) -> None:
        """See `Watcher`."""
        self._afterwards.view_done(view.name, groups)

    def between_lines(self, view: str, lines: str, done: int, count: int) -> Wish:
        """See `Watcher`."""
        while True:
            began = time.monotonic()
            try:
                wish = self.wishes.get() if self.paused else self.wishes.get_nowait()
            except queue.Empty:
                return Wish()
            self._waited += time.monotonic() - began
            if (made := self._heed(wish, lines, done)) is not None:
                return made

    def end(self) -> None:
        """Tell that nothing is scanned any more."""
        self._running, self.paused = False, False
        self._painter.end()
        self._afterwards.end()
        self.board.tell("ask", None)
        self._tell()

    # ---- what the controller wishes ----

    def _heed(self, wish: dict[str, Any], lines: str, done: int) -> Wish | None:
        """Do what is wished; what the session shall do, None if nothing."""
        name = wish["do"]
        if name == "lost":
            self.lost = True
            self._pause("Nobody is steering: the scan waits, the mirrors home, the generator off.")
        elif name == "taken":
            self.lost = False
        elif name == "pause":
            self._pause("Paused.")
        elif name == "go_on" and self.paused:
            self.paused = False
            self._tell()
        elif name == "stop":
            self.stopped = True
            return Wish(stop=True)
        elif name == "skip":
            self.paused = False
            return Wish(skip=True)
        elif name == "again" and done:
            return Wish(again=(done,))
        elif name == "again_bad":
            self._painter.settle()
            known = self._painter.bad.get(lines, {})
            if bad := tuple(k for k, part in sorted(known.items()) if part > BAD and k <= done):
                return Wish(again=bad)
        return None

    def _pause(self, why: str) -> None:
        if not self.paused and self._rest is not None:
            self._rest()
        self.paused, self._why = True, why
        self._tell()

    # ---- what browsers see ----

    def _tell_done(self, told: Mapping[str, list[str]]) -> None:
        self.board.tell("done", [{"name": name, "told": told[name]} for name in told])

    def _tell_advice(self, told: list[str]) -> None:
        self.board.tell("planned", told)

    def _tell(self) -> None:
        """Tell how far the scan is; in any thread."""
        total = sum(view.pixels for view in self._views)
        part = self._pixels / total if total else 0.0
        steerable = self._running and self._between
        word = {"running": steerable, "paused": self.paused, "part": part}
        self.board.tell("scan", word | {"told": self._sentence(part), "facts": self._facts(total)})

    def _facts(self, total: int) -> dict[str, str]:
        facts: dict[str, str] = {"step": self._step}
        view, line = self._view, self._last
        if view is not None and total:
            facts["view"] = f"{view.name}, {view.number} of {view.count}"
            facts["pixels"] = f"{self._pixels} of {total}"
        if line is not None:
            velocity, reference = line.level
            facts["lines"] = f"{line.lines.replace('_', ' ')}, line {line.number} of {line.count}"
            facts["level"] = f"velocity {velocity:.3g} V, reference {reference:.3g} V"
        for flag, count in list(self._painter.flagged.items()) if total else ():
            if count:
                facts[str(flag.name).replace("_", " ")] = f"{count} pixels of this view"
        return facts

    def _sentence(self, part: float) -> str:
        if not self._running:
            return "Nothing is scanned now."
        if self.paused:
            return self._why
        left = self._left()
        if not self._between:
            return f"{self._step} …"
        time_left = f", {in_words(left)} left" if left is not None and part < 1 else ""
        return f"{self._step}: {100 * part:.0f} % of the scan{time_left}"

    def _left(self) -> float | None:
        """Estimate how long the scan still takes, s, by the pixels that were scanned so far."""
        if not self._scanned:
            return None
        ahead = sum(view.pixels - view.kept for view in self._views) - self._scanned
        return max(ahead, 0) * (time.monotonic() - self._began - self._waited) / self._scanned


class Asked(Operator):
    """Asks the controller instead of the terminal.

    Parameters
    ----------
    scanning : Scanning
        Whose board shows the request, and whose wishes have the answer.
    marks : AimedMarks, optional
        Fiducials that were aimed at before the scan.
    """

    def __init__(self, scanning: Scanning, marks: AimedMarks | None = None) -> None:
        super().__init__(scanning)
        self._scanning, self._marks = scanning, marks or AimedMarks()

    def person(self, view: str) -> AimedPerson | None:
        """See `Operator`."""
        return self._marks.person(view)

    @contextmanager
    def keyboard(self) -> Iterator[None]:
        """See `Operator`; the keys of a terminal are not the controller's."""
        yield None

    def ask(self, request: str) -> str:
        """See `Operator`."""
        scanning = self._scanning
        text = request.strip().rstrip(":").replace("press Enter", "say Go on")
        scanning.board.tell("ask", {"text": text, "answer": "Enter" not in request})
        try:
            while True:
                wish = scanning.wishes.get()
                if wish["do"] == "answer" and isinstance(wish.get("text"), str):
                    return str(wish["text"]).strip()
                if wish["do"] in ("lost", "taken"):
                    scanning.lost = wish["do"] == "lost"
                elif wish["do"] == "stop":
                    scanning.stopped = True
                    raise KeyboardInterrupt
        finally:
            scanning.board.tell("ask", None)


def in_words(seconds: float) -> str:
    """Say a time as people do.

    Examples
    --------
    >>> in_words(42), in_words(240), in_words(5400)
    ('42 s', '4 min', '1 h 30 min')
    """
    if seconds < SECONDS:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < MINUTES else f"{minutes // 60} h {minutes % 60} min"
