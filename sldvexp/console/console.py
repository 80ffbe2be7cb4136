"""Console as a whole: its board, its server, its bench, and the scan that it starts."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from sldvexp import dataset
from sldvexp.config.experiment import Experiment
from sldvexp.config.own_files import own_path
from sldvexp.config.paths import RUN_FILE
from sldvexp.console.afterwards import Advice, Advise
from sldvexp.console.bench import AimingBench
from sldvexp.console.board import NoticeBoard
from sldvexp.console.keeping import EarlierScan, KeptViews, ScanAhead, scan_ahead
from sldvexp.console.marks import FIDUCIAL, AimedMark, Name
from sldvexp.console.scanning import Asked, Scanning
from sldvexp.console.server import Server
from sldvexp.console.wishes import Wish
from sldvexp.console.written import CHOICE, command_with, settings_with, write_experiment
from sldvexp.dataset import RunData
from sldvexp.errors import UserError
from sldvexp.files import read_text
from sldvexp.report import REPORT_FILE, closing_lines
from sldvexp.session import Operator, Watcher
from sldvexp.session.interruption import (
    GO_ON,
    EndedScanError,
    InterruptedRun,
    UnfinishedError,
    resume_here,
)

log = logging.getLogger(__name__)

#: How long the end waits for advice that is being computed, s.
PATIENCE = 30.0

#: Progress before a session tells of any.
BEGINS = "The scan begins: the configuration is read and the instrument is opened …"
#: Scan of which nothing is going on.
AT_REST = {"running": False, "paused": False, "part": 0.0, "facts": {}, "resume": ""}
#: Places at which a run goes on.
AS_BEGUN = "Go on scans what is missing, at the places with which that run was begun"
#: How a kept scan goes on in the console itself, before the command that does it without.
HERE = "Go on does that here, or once this console has ended:"
#: The same of a scan that ends alike again unless something is mended, around that command.
MENDED = (
    "what was scanned is kept: once that is mended, Go on does here what {command} does without a "
    "page; to change a setting of the scan, begin a fresh console with it, without resume"
)
#: Runs settings with a watcher and an operator; the run's folder.
Run = Callable[[Sequence[str], Watcher, Operator], Path]


class Console:
    """A session in the browser; as a context manager it serves its page.

    Parameters
    ----------
    experiment : Experiment
        With ready plugins.
    settings : sequence of str
        Of which it was made.
    folder : Path
        Of the user, where aimed experiments are written.
    compose : callable
        Makes the experiment of settings.
    run : callable
        Runs settings, see `Run`.
    port : int
        0 takes a free one.
    advise : callable, optional
        Says where to stand next, from the groups of the views that are done; without any, what the
        stands reach that the configuration gives.
    unfinished : Path, optional
        Folder of a run that was cut off, which *Go on* goes on with.
    added : sequence of str
        Settings with which that goes on, besides its own.
    """

    def __init__(
        self,
        experiment: Experiment,
        settings: Sequence[str],
        folder: Path,
        compose: Callable[[Sequence[str]], Experiment],
        run: Run,
        port: int = 0,
        advise: Advise | None = None,
        unfinished: Path | None = None,
        added: Sequence[str] = (),
    ) -> None:
        self.experiment, self.settings, self.folder = experiment, list(settings), folder
        self.board = NoticeBoard()
        self.wishes: queue.Queue[Wish] = queue.Queue()
        self.bench = AimingBench(experiment, self.board, self.wishes)
        self.server = Server(self.board, self.wishes, lambda: self._page, self._figure, port)
        self._compose, self._run, self._advise = compose, run, advise
        self._page: Path | None = None
        self._plan, self._plans = Advice([]), 0
        self._advising: list[threading.Thread] = []
        self._ours: dict[Path, str] = {}  # files that were written, as they were
        self._written_as = ""  # name of the last of them
        self._written_marks: dict[str, dict[Name, AimedMark]] = {}  # with which it was
        self._unfinished, self._added = unfinished, list(added)
        self._earlier: EarlierScan | None = None  # the last one, of which the next keeps views
        self._warned = ""  # contradiction of marks of which was told at Scan
        self._shown = 0  # how often a tab was
        self._last: Scanning | None = None  # scan that has ended
        self._end: BaseException | None = None  # why, if it was not done
        self.bench.answered, self.bench.changed = self._answered, self._marks_changed
        self.bench.further = {
            "write": self._write,
            "scan": self._scan,
            "plan": self._examine,
            "go_on": self._go_on,
        }
        base = next((m[1] for s in settings if (m := CHOICE.fullmatch(s))), "session")
        self.board.tell("suggested", f"{base.rpartition('/')[2]}_aimed")
        self._show("aim")
        if unfinished is not None:
            told = f"The run in {unfinished} was cut off: Go on scans what is missing."
            self.board.tell("scan", {**AT_REST, "told": told, "resumable": True})
            self._show("scan")
        self._tell_ahead()

    @property
    def address(self) -> str:
        """Address of the page."""
        return self.server.address

    def __enter__(self) -> Console:
        self.server.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self.server.__exit__(*exception)
        # A thread that draws while the interpreter ends aborts the process.
        for thread in self._advising:
            thread.join(PATIENCE)
        if self._last is not None:
            self._last.join(PATIENCE)

    def _show(self, tab: str) -> None:
        """Let browsers show a tab, also one that they showed before and have left since."""
        self._shown += 1
        self.board.tell("phase", {"tab": tab, "count": self._shown})

    def serve(self) -> str:
        """Aim and scan as the controller wishes, until Ctrl-C; say then how the instrument is left.

        Raises
        ------
        UserError
            If the instrument cannot be left as it should be.
        """
        told = ""
        try:
            self.bench.serve()
        except InterruptedRun as stop:
            told = f"; {stop.kept.told} {GO_ON}{resume_here(stop.folder)}"
        except KeyboardInterrupt:
            pass
        return f"the console has ended: {self.bench.left_as}{told}"

    def _write(self, wish: Wish) -> None:
        """Write what was aimed, as an experiment."""
        self._written(wish)

    def _written(self, wish: Wish) -> list[str]:
        """Write what was aimed; give the settings of a run of it."""
        scan = self.bench.settings()
        if not scan:
            raise UserError("nothing is marked yet")
        name = wish.get("name")
        if not isinstance(name, str):
            raise UserError("an experiment needs a name")
        before = own_path(self.folder, "experiment", name)
        replace = wish.get("replace") is True or self._is_ours(before)
        path = write_experiment(self.folder, name, self.settings, scan, replace)
        self._note_written(path, name)
        self._tell_written()
        self.bench.say(f"Written to {path}.")
        return settings_with(self.settings, name)

    def _note_written(self, path: Path, name: str) -> None:
        self._ours[path] = path.read_text(encoding="utf-8")
        self._written_as, self._written_marks = name, self.bench.marks.every

    def _marks_changed(self) -> None:
        """Let what is told, and a file of which no mark is left, follow the marks."""
        self._tell_ahead()
        if not self._written_as:
            return
        path = own_path(self.folder, "experiment", self._written_as)
        if self._written_marks and not self.bench.marks.every and self._is_ours(path):
            write_experiment(self.folder, self._written_as, self.settings, {}, replace=True)
            self._note_written(path, self._written_as)
        self._tell_written()

    def _tell_written(self) -> None:
        """Say what scans the file that was written last, and whether it has the marks of now."""
        path = own_path(self.folder, "experiment", self._written_as)
        command = command_with(self.folder, self.settings, self._written_as)
        marks = self.bench.marks.every
        if self._written_marks != marks:
            told = f"{path} has earlier marks than these: Write brings it up to date"
            if not marks:  # the file is not this console's any more
                told = f"{path} was changed by somebody and keeps the marks taken back here"
        elif not marks:
            told = f"{path} has no marks any more; {command} scans what the console began with"
        else:
            told = f"{path}; {command} scans it"
        self.board.tell("written", told)

    def _is_ours(self, path: Path) -> bool:
        """Tell whether a file is one that this console wrote, and nobody changed since."""
        with suppress(UserError):  # it is not there, or no text
            return path in self._ours and read_text(path) == self._ours[path]
        return False

    def _scan(self, wish: Wish) -> None:
        """Scan what was aimed, as a run of the experiment that is written of it.

        Marks that contradict one another are told first, once.
        """
        if views := self.bench.marks.unmeasured():
            raise UserError(
                f"every mark of view {views[0]} was taken where it was predicted, so that nothing "
                "would be measured: move the beam onto what you see, and take each there"
            )
        told = self.bench.contradictions()
        if told not in ("", self._warned):
            self._warned = told
            raise UserError(f"{told}; or Scan again, which scans with the marks as they are")
        scan = self.bench.settings()
        settings = self._written(wish) if scan else self.settings
        experiment = self._compose(settings) if scan else self.experiment
        keep = [] if wish.get("anew") is True else self._ahead().keep
        kept = None
        if keep and self._earlier is not None:
            kept = KeptViews(self._earlier, keep, experiment)
        self._run_it(settings, experiment, kept=kept)

    def _ahead(self) -> ScanAhead:
        """Say which views Scan would take, and which it would keep."""
        marked = self.bench.marks.every
        names = dict.fromkeys([*self.experiment.scan.view_names(), *self.bench.views])
        own = set(self.experiment.scan.view_names()) | marked.keys()
        return scan_ahead([name for name in names if name in own], marked, self._earlier)

    def _tell_ahead(self) -> None:
        """Tell what Scan would do, and whether Go on counts what is aimed anew."""
        ahead, last, marked = self._ahead(), self._earlier, self.bench.marks.every
        changed = (v for v in self.bench.views if last and last.changed(v, marked.get(v, {})))
        views = list(changed)
        label = ahead.label
        told = f"{AS_BEGUN}{_not_counted(views, label, FIDUCIAL in self.bench.wanted)}"
        word = {"label": label, "keep": ahead.keep, "changed": views}
        self.board.tell("ahead", {**word, "go_on": told if self._unfinished is not None else ""})

    def _go_on(self, wish: Wish) -> None:
        """Go on with the run that failed or was stopped, or that was cut off before."""
        if self._unfinished is None:
            raise UserError("there is no scan to go on with")
        folder = self._unfinished
        settings = [f"resume={folder}", *self._added]
        experiment = self._compose(settings)
        self._run_it(settings, experiment, folder)

    def _run_it(
        self,
        settings: Sequence[str],
        experiment: Experiment,
        begun: Path | None = None,
        kept: KeptViews | None = None,
    ) -> None:
        """Run settings, and tell what becomes of it; a run that was begun can go on until done."""
        self.bench.leave()  # the run opens the instrument for itself
        self.bench.used = True
        advised = self._advise, self._tell_advice
        scanning = Scanning(experiment, self.board, self.wishes, *advised, kept)
        marks: Mapping[str, Mapping[Name, AimedMark]] = self.bench.marks.every
        if begun is not None:  # at whose places that run was begun, which are those of its file
            marks = self._earlier.marks if self._earlier is not None else {}
        self._show("scan")
        self.board.tell("scan", {**AT_REST, "told": BEGINS, "resumable": False})
        self.board.tell(
            "result", {"told": "The report stands here when the scan is done.", "page": False}
        )
        self.bench.say("")
        why, self._unfinished, self._end = "", begun, None
        try:
            folder = self._run(settings, scanning, Asked(scanning, self.bench.marks))
        except UserError as error:
            why = self._kept(error)
            self._ended(why, problem=True)
        except KeyboardInterrupt as stop:
            if not scanning.stopped:
                raise
            why = self._kept(stop) or "stopped"
            self._ended(why)
        else:
            self._unfinished = None
            self._page = folder / REPORT_FILE
            page = self._page.is_file()
            with dataset.load(folder / RUN_FILE) as tree:
                run = RunData.from_source(tree)
                lines = [list(line) for line in closing_lines(run, scanning.files)]
            told = f"The run is in {folder}."
            self.board.tell("result", {"told": told, "page": page, "lines": lines})
            self._show("result")
            self.bench.say("The scan is done.")
            why = "the run is done, and Result tells what was found"
        finally:
            scanning.end(why, resumable=self._unfinished is not None)
            self._last = scanning
            if scanning.folder is not None:
                views = tuple(sorted(scanning.whole)), tuple(sorted(scanning.begun))
                self._earlier = EarlierScan(scanning.folder, experiment, *views, marks)
            self._tell_ahead()
            if isinstance(self._end, EndedScanError) and self._end.not_home:
                self.bench.doubt()
            if scanning.lost:
                self.bench.steered = False

    def _examine(self, wish: Wish) -> None:
        """Say what the stands reach that the configuration gives, in a thread of its own."""
        if self._advise is None:
            raise UserError("nobody can say what these stands reach")
        self.board.tell("planned", {"told": ["Computing what these stands reach …"], "figure": 0})
        thread = threading.Thread(target=self._advise_beforehand, name="plan", daemon=True)
        self._advising = [*filter(threading.Thread.is_alive, self._advising), thread]
        thread.start()

    def _advise_beforehand(self) -> None:
        assert self._advise is not None
        try:
            advice = self._advise(self.experiment, {})
        except UserError as error:
            advice = Advice([f"{error}."])
        except Exception:
            log.exception("what the stands of the configuration reach")
            advice = Advice(["It could not be computed; the log says why."])
        self._tell_advice(advice)

    def _tell_advice(self, advice: Advice) -> None:
        self._plan, self._plans = advice, self._plans + 1
        shown = self._plans if advice.figure else 0  # so that a browser asks for it anew
        self.board.tell("planned", {"told": advice.told, "figure": shown})

    def _figure(self, narrow: bool) -> bytes:
        if self._plan.figure is None:
            return b""
        try:
            return self._plan.figure(narrow)
        except Exception:  # what is told of the plan stands without it
            log.exception("drawing a plan")
            return b""

    def _kept(self, error: BaseException) -> str:
        """Say why a run ended, and how the console itself goes on with it."""
        self._end = error
        if isinstance(error, UnfinishedError | InterruptedRun):
            self._unfinished, self._added = error.folder, []  # which the folder records by now
        return self._why(error)

    def _why(self, error: BaseException, answers: bool = False) -> str:
        """Say why a run ended; without how the instrument was left, if it answers again."""
        if not isinstance(error, EndedScanError | InterruptedRun):
            return str(error)
        parts = [error.why]
        if isinstance(error, EndedScanError) and not answers:
            parts += [error.not_home]
        if isinstance(error, UnfinishedError | InterruptedRun):
            kept = error.kept
            mended = MENDED.format(command=kept.command)
            parts += [mended if kept.mend else f"{kept.told} {HERE} {kept.command}"]
        return "; ".join(part for part in parts if part)

    def _answered(self) -> None:
        """Say no more that the mirrors may not be home: who answers was brought to its place."""
        if self._last is not None and self._end is not None:
            why = self._why(self._end, answers=True)
            self._last.retell(why)
            self.board.tell("result", {"told": why, "page": False})

    def _ended(self, why: str, problem: bool = False) -> None:
        self.board.tell("result", {"told": why, "page": False})
        self.bench.say(why, problem)


def _not_counted(views: Sequence[str], label: str, by_hand: bool) -> str:
    """Say of views that are aimed otherwise by now what Go on makes of it."""
    if not views:
        return "."
    named = f"view{'s' * (len(views) > 1)} {', '.join(views)}"
    if by_hand:  # a person points again, and the last answer counts
        return f"; marks of {named} that were taken since count in place of the older ones."
    return f"; what was marked since in {named} does not count. For that: {label}, at Aim."
