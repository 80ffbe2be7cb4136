"""A sweep from the command line: its folder, its lock, and what it leaves behind at the end.

`RunCount` says how far it is after every run that was computed; for runs of other processes
`Watch` waits for the sign that each leaves.
"""

from __future__ import annotations

import os
import shlex
import shutil
import threading
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType

from sldvexp.errors import UserError
from sldvexp.pipeline.provenance import about_program
from sldvexp.pipeline.run_progress import RunProgress
from sldvexp.progress import doing, span
from sldvexp.report import Report
from sldvexp.sweep import record
from sldvexp.sweep.collect import collect
from sldvexp.sweep.lock import LOCK_FILE, locked
from sldvexp.sweep.plan import RESOLVER, Plan, folder_name, register_resolver
from sldvexp.sweep.record import State, Stopwatch
from sldvexp.sweep.shared_steps import SHARED
from sldvexp.sweep.summary import write_summary
from sldvexp.sweep.time_left import SweepTimeLeft
from sldvexp.writing import require_no_links, sweep_up

SWEEPS = Path("outputs/sweeps")

IN_THIS_PROCESS = "basic"
#: How many runs Hydra's sweeper gives to the launcher at once.
BATCH = "hydra.sweeper.max_batch_size"
#: Launchers that begin all runs at once, however few processors there are.
UNBOUNDED = ("submitit_local",)


class Sweep:
    """One call of the command with ``-m``; a context in which no other may use its folder.

    Parameters
    ----------
    options : Namespace
        Of the command line.

    Attributes
    ----------
    batched : bool
        Whether the launcher gets some of the runs only when others are done.

    Raises
    ------
    UserError
        If the runs' folders are to have other names; on entering, if another sweep is at work in
        the same folder.
    """

    def __init__(self, options: Namespace) -> None:
        self.plan = Plan.from_overrides(options.overrides)
        self._command = _command(options)
        given = [o.partition("=") for o in options.overrides]
        chosen = [value for key, _, value in given if key == "hydra.sweep.dir"]
        own = str(Path(options.config_dir).resolve()) if options.config_dir else ""
        self._others = own, options.config_name or ""
        default = SWEEPS / self.plan.sweep_name(*self._others)
        self.folder = Path(chosen[-1].strip("'\"")) if chosen else default
        self._added = [] if chosen else [f"hydra.sweep.dir='{self.folder}'"]
        if any(key == "hydra.sweep.subdir" for key, _, _ in given):
            raise UserError(
                "command line: hydra.sweep.subdir cannot be set: a run's folder is named by its "
                "settings, so that a sweep finds it again; hydra.sweep.dir chooses where they lie"
            )
        self._added.append(f"hydra.sweep.subdir=${{{RESOLVER}:}}")
        launchers = [value for key, _, value in given if key == "hydra/launcher"]
        self._launcher = launchers[-1] if launchers else IN_THIS_PROCESS
        self.batched = any(key == BATCH for key, _, _ in given)
        if self._launcher in UNBOUNDED and not self.batched:
            self._added.append(f"{BATCH}={os.cpu_count() or 1}")
            self.batched = True
        self._held, self._made = ExitStack(), False
        self._count = RunCount(self.folders, self.plan.jobs)
        register_resolver()

    def arguments(self, arguments: Sequence[str]) -> list[str]:
        """Write the command line with the folders of this sweep."""
        return [*self._added, *arguments]

    @property
    def folders(self) -> list[Path]:
        """Of all runs, in the plan's order."""
        return [self.folder / folder_name(job) for job in self.plan.jobs]

    def __enter__(self) -> Sweep:
        self._made = not self.folder.exists()
        require_no_links(self.folder)
        held = locked(self.folder / LOCK_FILE, wait=False)
        try:
            self._held.enter_context(held)
        except BlockingIOError:
            raise UserError(
                f"{self.folder}: another sweep is at work in this folder; wait for it, or choose "
                "another with hydra.sweep.dir=..."
            ) from None
        sweep_up(self.folder, self.folder / SHARED)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._made and not any(p.is_dir() for p in self.folder.iterdir()):
            shutil.rmtree(self.folder, ignore_errors=True)  # refused before a run began
        self._held.close()

    def claim(self) -> None:
        """Make the folder this sweep's own; see `Plan.claim`."""
        self.plan.claim(self.folder, *self._others)

    @property
    def first(self) -> bool:
        """True if no run has come to its end in this process."""
        return self._count.none

    def alike(self, *keys: str) -> bool:
        """Tell whether all runs have the same of some keys of the configuration."""
        swept = {name.partition(".")[0].partition("@")[0] for name in self.plan.names}
        return swept.isdisjoint(keys)

    @property
    def begun(self) -> bool:
        """True if any run has left a record."""
        return any((folder / record.FILE).is_file() for folder in self.folders)

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Tell, while in it, what runs of other processes come to as they end."""
        if self._launcher == IN_THIS_PROCESS:
            yield
            return
        shown = doing(f"{len(self.plan.jobs)} runs by {self._launcher}")
        with shown, Watch(self.folder, self.tell):
            yield

    def tell(self, run: str, computed: bool) -> None:
        """Print how far this is, after a run.

        Parameters
        ----------
        run : str
            Its folder.
        computed : bool
            Whether it was done now.
        """
        if line := self._count.tell(Path(run), computed):
            print(line, flush=True)

    def watcher(self) -> RunProgress:
        """Make who shows at the terminal how the next run gets on."""
        return RunProgress(title=self._count.next)

    def finish(self, rank: str, report: Report | None = None) -> set[str]:
        """Leave one dataset and one table of all runs, and print them in order of merit.

        Parameters
        ----------
        rank : str
            Headline to rank by, see `sldvexp.sweep.ranking.ranked_by`.
        report : Report, optional
            Makes a page about all of it.

        Returns
        -------
        set of str
            States that runs are in, see `sldvexp.sweep.record.State`.
        """
        with doing(f"collecting {len(self.folders)} runs"):
            table = collect(self.plan.names, self.plan.cells(), self.folders)
        table.attrs |= {"command": self._command, **about_program()}
        write_summary(table, self.plan.names, self.folder, rank, report)
        return {str(state) for state in table["state"].values.ravel()}


def _command(options: Namespace) -> str:
    """Write the command line again."""
    where = {"--config-dir": options.config_dir, "--config-name": options.config_name}
    given = [word for name, value in where.items() if value for word in (name, value)]
    return shlex.join(["sldvexp", "-m", *given, *options.overrides])


class RunCount:
    """Counts the runs of a sweep, as one process does them.

    Parameters
    ----------
    folders : sequence of Path
        Of all runs, in the plan's order.
    jobs : sequence of sequence of str
        Their overrides.
    """

    def __init__(self, folders: Sequence[Path], jobs: Sequence[Sequence[str]]):
        self._numbers = {folder.name: number for number, folder in enumerate(folders)}
        self._total = len(jobs)
        self._finished = self._failed = 0
        self._left = SweepTimeLeft(jobs)
        self._watch = Stopwatch()

    @property
    def none(self) -> bool:
        """True before the first run is counted."""
        return self._finished + self._failed == 0

    @property
    def next(self) -> str:
        """Title of the run that is next, as in ``run 2 of 6``."""
        return f"run {self._finished + self._failed + 1} of {self._total}"

    def tell(self, run: Path, computed: bool) -> str:
        """Count a run; the line about it, empty if it was done already.

        Parameters
        ----------
        run : Path
            Its folder.
        computed : bool
            Whether it was done now.
        """
        found, total = record.read(run), self._total
        failed = found.state is State.failed
        self._finished += not failed
        self._failed += failed
        spent, self._watch = self._watch.seconds(), Stopwatch()
        self._left.add(self._numbers[run.name], found, spent if computed else None)
        if not computed:
            return ""
        open_runs = total - self._finished - self._failed
        told = f"{self._finished} of {total} done"
        told += f", {self._failed} failed" if self._failed else ""
        left = self._left.seconds if open_runs else None
        told += f"; about {span(left)} left" if left is not None else ""
        return f"{told}: {run}"


#: Folder of the signs, in that of the sweep.
SIGNS = ".signs"
PERIOD = 0.5  # s


def leave_sign(run: Path, computed: bool) -> None:
    """Let the process that watches know that a run has come to its end.

    Parameters
    ----------
    run : Path
        Its folder.
    computed : bool
        Whether it was done now.
    """
    signs = run.parent / SIGNS
    with suppress(OSError):  # the run itself is not the worse for it
        signs.mkdir(exist_ok=True)
        (signs / f"{int(computed)}{run.name}").touch()


class Watch:
    """Looks for signs while it is entered; none is missed at the end.

    Parameters
    ----------
    folder : Path
        Of the sweep.
    tell : callable
        Gets the folder of each run that came to its end, and whether it was done now.
    """

    def __init__(self, folder: Path, tell: Callable[[str, bool], None]):
        self.folder, self.tell = folder, tell
        self._seen: set[str] = set()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Watch:
        shutil.rmtree(self.folder / SIGNS, ignore_errors=True)  # of a sweep that was killed
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._over.set()
        self._thread.join()
        self._look()
        shutil.rmtree(self.folder / SIGNS, ignore_errors=True)

    def _watch(self) -> None:
        while not self._over.wait(PERIOD):
            self._look()

    def _look(self) -> None:
        signs = self.folder / SIGNS
        names = {sign.name for sign in signs.iterdir()} if signs.is_dir() else set()
        for name in sorted(names - self._seen):
            self._seen.add(name)
            self.tell(str(self.folder / name[1:]), name[0] == "1")
