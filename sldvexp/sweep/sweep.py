"""A sweep from the command line: its folder, its lock, and what it leaves behind at the end."""

from __future__ import annotations

import shutil
from argparse import Namespace
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

from sldvexp.errors import UserError
from sldvexp.sweep import record
from sldvexp.sweep.lock import locked
from sldvexp.sweep.plan import RESOLVER, Plan, folder_name, register_resolver
from sldvexp.sweep.progress import Progress

SWEEPS = Path("outputs/sweeps")
LOCK_FILE = ".lock"


class Sweep:
    """One call of the command with ``-m``; a context in which no other may use its folder.

    Parameters
    ----------
    options : Namespace
        Of the command line.

    Raises
    ------
    UserError
        If the runs' folders are to have other names; on entering, if another sweep is at work in
        the same folder.
    """

    def __init__(self, options: Namespace) -> None:
        self.plan = Plan.of(options.overrides)
        given = [o.partition("=") for o in options.overrides]
        chosen = [value for key, _, value in given if key == "hydra.sweep.dir"]
        own = str(Path(options.config_dir).resolve()) if options.config_dir else ""
        default = SWEEPS / self.plan.sweep_name(own, options.config_name or "")
        self.folder = Path(chosen[-1].strip("'\"")) if chosen else default
        self._added = [] if chosen else [f"hydra.sweep.dir='{self.folder}'"]
        if any(key == "hydra.sweep.subdir" for key, _, _ in given):
            raise UserError(
                "command line: hydra.sweep.subdir cannot be set: a run's folder is named by its "
                "settings, so that a sweep finds it again; hydra.sweep.dir chooses where they lie"
            )
        self._added.append(f"hydra.sweep.subdir=${{{RESOLVER}:}}")
        self._held, self._made = ExitStack(), False
        self._progress = Progress(len(self.plan.jobs), self.folder)
        register_resolver()

    def arguments(self, arguments: Sequence[str]) -> list[str]:
        """The command line with the folders of this sweep."""
        return [*arguments, *self._added]

    @property
    def folders(self) -> list[Path]:
        """Of all runs, in the plan's order."""
        return [self.folder / folder_name(job) for job in self.plan.jobs]

    def __enter__(self) -> Sweep:
        self._made = not self.folder.exists()
        held = locked(self.folder / LOCK_FILE, wait=False)
        try:
            self._held.enter_context(held)
        except BlockingIOError:
            raise UserError(
                f"{self.folder}: another sweep is at work in this folder; wait for it, or choose "
                "another with hydra.sweep.dir=..."
            ) from None
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

    @property
    def begun(self) -> bool:
        """Whether any run has left a record."""
        return any((folder / record.FILE).is_file() for folder in self.folders)

    def tell(self, run: str, computed: bool) -> None:
        """Print how far this is, after a run.

        Parameters
        ----------
        run : str
            Its folder.
        computed : bool
            Whether it was done now.
        """
        if line := self._progress.tell(Path(run), computed):
            print(line, flush=True)

    def finish(self, rank: str) -> set[str]:
        """Leave one dataset and one table of all runs, and print them in order of merit.

        Parameters
        ----------
        rank : str
            Headline to rank by, see `sldvexp.sweep.ranking.ranked_by`.

        Returns
        -------
        set of str
            States that runs are in, see `sldvexp.sweep.record.State`.
        """
        from sldvexp.sweep.collect import collect
        from sldvexp.sweep.summary import write_summary

        table = collect(self.plan.names, self.plan.cells(), self.folders)
        write_summary(table, self.plan.names, self.folder, rank)
        return {str(state) for state in table["state"].values.ravel()}
