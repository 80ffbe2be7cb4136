"""A scan as browsers see and steer it: a `Watcher` and an `Operator` of the session.

It is told of every line, shows its pixels on the board, and between two lines hears what the
controller wishes. When the controller has gone it waits, with the mirrors home and the generator
off, until somebody steers again and says to go on.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.console.afterwards import Advise, Afterwards
from sldvexp.console.board import Board
from sldvexp.lazy import xarray as xr
from sldvexp.scan import ImageScan
from sldvexp.session import LineDone, Operator, ViewAhead, Watcher, Wish
from sldvexp.signal import Flag
from sldvexp.typing import IntArray

#: Side of the square in which an image is drawn, over its own.
AROUND = 1.06
#: Part of a line's pixels that must not be trusted for it to be a bad one.
BAD = 0.2
MILLI = 1e3


class Scanning(Watcher):
    """Shows a session to browsers and heeds the controller.

    Parameters
    ----------
    experiment : Experiment
    board : Board
    wishes : queue of dict
    advise : callable, optional
        Sentences on what to do after a view, see `sldvexp.console.afterwards`.
    """

    def __init__(
        self,
        experiment: Experiment,
        board: Board,
        wishes: queue.Queue[dict[str, Any]],
        advise: Advise | None = None,
    ) -> None:
        self.experiment, self.board, self.wishes = experiment, board, wishes
        self.stopped = self.lost = self.paused = False
        self._rest: Callable[[], None] | None = None
        self._step = ""
        self._views: tuple[ViewAhead, ...] = ()
        self._view: ViewAhead | None = None
        self._pixels = self._scanned = self._kept = 0
        self._seconds = self._waited = 0.0
        self._began = time.monotonic()
        self._flags: dict[int, int] = {}
        self._bad: dict[str, dict[int, float]] = {}
        self._last: LineDone | None = None
        self._shown = ""
        self._afterwards = Afterwards(experiment, self._tell_done, advise, self._tell_advice)
        board.tell("done", [])
        board.begin("image")

    # ---- what a session tells ----

    def step_begun(self, name: str, number: int, count: int) -> None:
        """See `Watcher`."""
        self._step = f"step {number} of {count}, {name}"
        self._tell()

    def session_begun(self, views: tuple[ViewAhead, ...]) -> None:
        """See `Watcher`."""
        self._views = views
        self._pixels = self._scanned = self._kept = 0
        self._began, self._waited = time.monotonic(), 0.0

    def view_begun(self, view: ViewAhead) -> None:
        """See `Watcher`."""
        self._view, self._rest = view, None
        self._flags, self._bad, self._shown = {}, {}, ""
        self._tell()

    def arrived(self, rest: Callable[[], None]) -> None:
        """See `Watcher`."""
        self._rest = rest

    def line_done(self, line: LineDone) -> None:
        """See `Watcher`."""
        image = line.image
        flags = image.flags.astype(np.uint8)
        self._bad.setdefault(line.lines, {})[line.number] = float(np.mean(flags != 0))
        if not line.again:
            self._pixels += len(flags)
            self._scanned += 0 if line.kept else len(flags)
            for flag in Flag:
                self._flags[flag] = self._flags.get(flag, 0) + int(np.sum(flags & flag != 0))
        self._last = line
        value = MILLI * np.abs(image.velocity[:, 0])
        value = np.where(np.isfinite(value), value, 0.0).astype(np.float32)
        self._show(line, value, flags)
        self._tell()

    def view_done(self, view: ViewAhead, groups: Mapping[str, xr.Dataset]) -> None:
        """See `Watcher`."""
        self._afterwards.view_done(view.name, groups)

    def between_lines(self, view: str, lines: str, done: int, count: int) -> Wish:
        """See `Watcher`."""
        while True:
            try:
                wish = self.wishes.get() if self.paused else self.wishes.get_nowait()
            except queue.Empty:
                return Wish()
            if (made := self._heed(wish, lines, done)) is not None:
                return made

    def end(self) -> None:
        """Tell that nothing is scanned any more."""
        self.paused = False
        self.board.tell("ask", None)
        self._tell(running=False)
        self._afterwards.end()

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
            known = self._bad.get(lines, {})
            if bad := tuple(k for k, part in known.items() if part > BAD and k <= done):
                return Wish(again=bad)
        return None

    def _pause(self, why: str) -> None:
        if not self.paused:
            self.paused = True
            if self._rest is not None:
                self._rest()
        self._tell(why)

    # ---- what browsers see ----

    def _show(self, line: LineDone, value: Any, flags: Any) -> None:
        """Add a line's pixels to the picture of what is scanned; another one begins it anew."""
        shown = f"{line.view} {line.lines}"
        if shown != self._shown:
            self._shown = shown
            low, high = self._extent(line)
            self.board.begin("image", low=low, high=high, name=shown)
        tall, wide = spacing(line.dac, self._extent(line), line.count if self._grid(line) else 0)
        arrays = [line.dac.astype(np.int32).ravel(), value, flags]
        self.board.add("image", arrays, tall=tall, wide=wide)

    def _tell_done(self, told: Mapping[str, list[str]]) -> None:
        self.board.tell("done", [{"name": name, "told": told[name]} for name in told])

    def _tell_advice(self, told: list[str]) -> None:
        self.board.tell("planned", told)

    def _grid(self, line: LineDone) -> bool:
        """Tell whether a line is a row of a grid of pixels."""
        parts = self.experiment.scan.parts(line.view)
        images = [p for p in parts if isinstance(p, ImageScan) and p.kind == line.kind]
        return bool(images) and images[0].shape(line.view) is not None

    def _extent(self, line: LineDone) -> tuple[list[int], list[int]]:
        """Find a square of DAC steps around all lines of an image, or around this line."""
        parts = self.experiment.scan.parts(line.view)
        images = [p for p in parts if isinstance(p, ImageScan) and p.kind == line.kind]
        dac = images[0].known_pixels(line.view) if images else line.dac
        low, high = dac.min(axis=0), dac.max(axis=0)
        side = int(AROUND * (high - low).max()) + 2
        low = ((low + high - side) // 2).astype(int)
        return low.tolist(), (low + side).tolist()

    def _tell(self, why: str = "", running: bool = True) -> None:
        total = sum(view.pixels for view in self._views)
        kept = sum(view.kept for view in self._views)
        part = self._pixels / total if total else 0.0
        facts: dict[str, str] = {"step": self._step}
        if self._view is not None and total:
            facts["view"] = f"{self._view.name}, {self._view.number} of {self._view.count}"
        if (line := self._last) is not None:
            velocity, reference = line.level
            facts["lines"] = f"{line.lines.replace('_', ' ')}, line {line.number} of {line.count}"
            facts["pixels"] = f"{self._pixels} of {total}, {100 * part:.0f} %"
            facts["level"] = f"velocity {velocity:.3g} V, reference {reference:.3g} V"
            for flag, count in self._flags.items():
                if count:
                    facts[str(Flag(flag).name).replace("_", " ")] = f"{count} pixels"
        seconds = time.monotonic() - self._began
        left = (total - kept - self._scanned) * seconds / self._scanned if self._scanned else None
        told = why or self._sentence(part, left, running)
        word = {"running": running, "paused": self.paused, "part": part, "told": told}
        self.board.tell("scan", word | {"facts": facts, "left": left})

    def _sentence(self, part: float, left: float | None, running: bool) -> str:
        if not running:
            return "Nothing is scanned now."
        time_left = f", {in_words(left)} left" if left else ""
        return f"{self._step}: {100 * part:.0f} %{time_left}"


class Asked(Operator):
    """Asks the controller instead of the terminal.

    Parameters
    ----------
    scanning : Scanning
        Whose board shows the request, and whose wishes have the answer.
    """

    def __init__(self, scanning: Scanning) -> None:
        super().__init__(scanning)
        self._scanning = scanning

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


def spacing(dac: IntArray, extent: tuple[list[int], list[int]], rows: int) -> tuple[int, int]:
    """Find how high and wide a pixel of a line is drawn, DAC steps, so that it meets the next.

    Parameters
    ----------
    rows : int
        Of a grid of pixels whose row the line is; 0 of a line alone.
    """
    steps = np.abs(np.diff(dac, axis=0))
    along = max(int(np.ceil(np.median(steps.max(axis=1)))), 1) if len(steps) else 1
    if not rows:
        return along, along
    return max(int(np.ceil((extent[1][0] - extent[0][0]) / rows)), 1), along


def in_words(seconds: float) -> str:
    """Say a time as people do.

    Examples
    --------
    >>> in_words(42), in_words(240), in_words(5400)
    ('42 s', '4 min', '1 h 30 min')
    """
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
