"""A scan as browsers see and steer it: a `Watcher` and an `Operator` of the session.

It is told of every line, has its pixels painted, and between two lines hears what the controller
wishes. When the controller has gone it waits, with the mirrors home and the generator off, until
somebody steers again and says to go on.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import JOURNAL
from sldvexp.console.afterwards import Advice, Advise, Afterwards
from sldvexp.console.board import NoticeBoard
from sldvexp.console.keeping import KeptViews
from sldvexp.console.marks import AimedMarks, AimedPerson, circle_numbers
from sldvexp.console.painting import Painter
from sldvexp.lazy import xarray as xr
from sldvexp.pipeline.run_progress import ScanProgress
from sldvexp.progress import span
from sldvexp.session import Journal, LineDone, Operator, ViewAhead, Watcher, Wish
from sldvexp.session.interruption import resume_here
from sldvexp.session.watching import GO_ON, in_words

#: What a scan says that has lost its controller, and what it says to the next.
LEFT = "Nobody is steering: the scan waits, the mirrors home, the generator off."
TAKEN = "The scan waits, the mirrors home, the generator off, until you say to go on."
#: Part of a line's pixels that must not be trusted for it to be a bad one.
BAD = 0.2


class Scanning(Watcher):
    """Shows a session to browsers and heeds the controller.

    Parameters
    ----------
    experiment : Experiment
    board : NoticeBoard
    wishes : queue of dict
    advise : callable, optional
        Says what to do after a view, see `sldvexp.console.afterwards`.
    advised : callable, optional
        Gets that.
    kept : KeptViews, optional
        Views that are not scanned, since another run has.

    Attributes
    ----------
    stopped, lost, paused : bool
        Whether the controller has stopped it, has gone, and lets it wait.
    whole, begun : set of str
        Views of which everything is there, and of which anything is.
    folder : Path or None
        Of its run, once that is known.
    files : list of Path
        That it has left, once it is done.
    """

    def __init__(
        self,
        experiment: Experiment,
        board: NoticeBoard,
        wishes: queue.Queue[dict[str, Any]],
        advise: Advise | None = None,
        advised: Callable[[Advice], None] | None = None,
        kept: KeptViews | None = None,
    ) -> None:
        self.board, self.wishes, self._experiment = board, wishes, experiment
        self.stopped = self.lost = self.paused = False
        self.whole: set[str] = set(kept.views if kept else [])
        self._kept, self.begun = kept, set(self.whole)
        self._running, self._between, self._why = True, False, ""
        self._resumable = False
        self._rest: Callable[[], None] | None = None
        self._step = ""
        self._folder: Path | None = None
        self.files: list[Path] = []
        self._view: ViewAhead | None = None
        self._progress: ScanProgress | None = None
        self._lock = threading.Lock()  # of the progress, of which the painter's thread tells too
        self._last: LineDone | None = None
        self._painter = Painter(experiment, board, self._tell)
        self._afterwards = Afterwards(experiment, self._tell_done, advise, advised)
        board.tell("done", [])

    # ---- what a session tells ----

    def run_begun(self, folder: Path) -> None:
        """See `Watcher`."""
        self._folder = folder.absolute()
        if self._kept is not None:
            self._kept.copy_to(self._folder)
        self._tell()

    @property
    def folder(self) -> Path | None:
        """Folder of its run, once that is known."""
        return self._folder

    def run_done(self, files: list[Path]) -> None:
        """See `Watcher`."""
        self.files = files

    def step_begun(self, name: str, number: int, count: int) -> None:
        """See `Watcher`."""
        self._step = f"{number} of {count}, {name}"
        self._tell()

    def session_begun(self, views: tuple[ViewAhead, ...]) -> None:
        """See `Watcher`."""
        self._between = True
        self._progress = ScanProgress(views, time.monotonic)

    def session_done(self) -> None:
        """See `Watcher`."""
        self._between = False
        self._tell()

    def view_begun(self, view: ViewAhead) -> None:
        """See `Watcher`."""
        self._view, self._rest, self._last = view, None, None
        self.begun.add(view.name)
        with self._lock:
            if self._progress is not None:
                self._progress.view_begun(view)
        self._tell()

    def arrived(self, rest: Callable[[], None]) -> None:
        """See `Watcher`."""
        self._rest = rest

    def line_done(self, line: LineDone) -> None:
        """See `Watcher`."""
        self._last = line
        with self._lock:
            if self._progress is not None:
                self._progress.line_done(line)
        self._painter.put(line)

    def view_done(self, view: ViewAhead, groups: Mapping[str, xr.Dataset]) -> None:
        """See `Watcher`."""
        with self._lock:
            if self._progress is not None:
                self._progress.view_done(view)
        if self._folder is None or Journal(self._folder / JOURNAL / view.name).left is None:
            self.whole.add(view.name)  # the rest of it was not skipped
        self._afterwards.view_done(view.name, groups)

    def between_lines(self, view: str, lines: str, done: int, count: int) -> Wish:
        """See `Watcher`."""
        with self._lock:
            if self._progress is not None:
                self._progress.between_lines(lines, done, count)
        while self.paused or not self.wishes.empty():
            with self.asking(lines):
                wish = self.wishes.get()
            if (made := self._heed(wish, lines, done)) is not None:
                return made
        return GO_ON

    @contextmanager
    def asking(self, request: str) -> Iterator[None]:
        """See `Watcher`; the time in it is none of the scan's."""
        began = time.monotonic()
        try:
            yield
        finally:
            with self._lock:
                if self._progress is not None:
                    self._progress.waited += time.monotonic() - began

    def end(self, why: str = "", resumable: bool = False) -> None:
        """Tell that nothing is scanned any more, and why, if the scan is not done.

        Parameters
        ----------
        resumable : bool
            Whether what is missing can be scanned.
        """
        self._running, self.paused, self._why = False, False, why
        self._resumable = resumable
        self._painter.end()
        self._afterwards.end()
        self.board.tell("ask", None)
        self._tell()

    def join(self, seconds: float) -> None:
        """Wait so long, after the end, for what is still being told of the views."""
        self._afterwards.join(seconds)

    def retell(self, why: str) -> None:
        """Tell in other words why nothing is scanned any more."""
        self._why = why
        self._tell()

    # ---- what the controller wishes ----

    def _heed(self, wish: dict[str, Any], lines: str, done: int) -> Wish | None:
        """Do what is wished; what the session shall do, None if nothing."""
        name = wish["do"]
        if name == "lost":
            self.lost = True
            self._pause(LEFT)
        elif name == "taken":
            self.lost = False
            if self.paused:
                self._why = TAKEN
                self._tell()
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
            if self.paused:
                self._why = "Paused; the last line is scanned again."
                self._tell()
            return Wish(again=(done,))
        elif name == "again" and self.paused:
            self._why = "Paused; there is no line yet to scan again."
            self._tell()
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

    def _tell(self) -> None:
        """Tell how far the scan is; in any thread."""
        done = total = 0
        part, left = 0.0, None
        with self._lock:
            if (progress := self._progress) is not None:
                done, total = progress.tally.done.total(), progress.tally.total.total()
                part, left = progress.share, progress.seconds_left
        steerable = self._running and self._between
        word: dict[str, Any] = {"running": steerable, "paused": self.paused, "part": part}
        word["resumable"] = self._resumable
        word["resume"] = "" if self._folder is None else resume_here(self._folder)
        told = {"told": self._sentence(part, left), "facts": self._facts(done, total)}
        self.board.tell("scan", word | told)

    def _facts(self, done: int, total: int) -> dict[str, str]:
        facts: dict[str, str] = {"step": self._step}
        if self._folder is not None:
            facts["kept in"] = str(self._folder)
        if self._kept is not None:
            facts["not scanned anew"] = self._kept.told
        view, line = self._view, self._last
        if view is not None and total:
            facts["view"] = f"{view.name}, {view.number} of {view.count}"
            facts["pixels"] = f"{done} of {total}"
        if line is not None:
            velocity, reference = line.level
            circles = circle_numbers(self._experiment, line.view)
            facts["line"] = in_words(line.lines, line.number, line.count, circles)
            facts["level"] = f"velocity {velocity:.3g} V, reference {reference:.3g} V"
        for flag, count in list(self._painter.flagged.items()) if total else ():
            if count:
                pixels = f"{count} pixel{'s' * (count > 1)} of this view"
                facts[str(flag.name).replace("_", " ")] = pixels
        return facts

    def _sentence(self, part: float, left: float | None) -> str:
        if not self._running:
            return (
                f"Nothing is scanned now: {self._why}" if self._why else "Nothing is scanned now."
            )
        if self.paused:
            return self._why
        if not self._between:
            return f"step {self._step} …"
        time_left = f", {span(left)} left" if left is not None and part < 1 else ""
        return f"step {self._step}: {100 * part:.0f} % of the scan{time_left}"


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
        return self._answer(request, with_text=True)

    def wait_for(self, request: str) -> None:
        """See `Operator`."""
        self._answer(request, with_text=False)

    def _answer(self, request: str, with_text: bool) -> str:
        """Wait for what the controller answers, which may have a text, by *Go on*."""
        scanning = self._scanning
        text = request.strip().rstrip(":").replace("press Enter", "say Go on")
        text = text.replace("Enter", "Go on")  # the key of a terminal, a button of the page
        scanning.board.tell("ask", {"text": text, "answer": with_text})
        try:
            while True:
                with scanning.asking(request):
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
