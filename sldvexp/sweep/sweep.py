"""A sweep from the command line: its folder, its lock, and what it leaves behind at the end."""

from __future__ import annotations

import fcntl
import os
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from sldvexp.errors import UserError
from sldvexp.sweep.plan import RESOLVER, Plan, folder_name, register_resolver

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
        self._lock: int | None = None
        register_resolver()

    def arguments(self, arguments: Sequence[str]) -> list[str]:
        """The command line with the folders of this sweep."""
        return [*arguments, *self._added]

    @property
    def folders(self) -> list[Path]:
        """Of all runs, in the plan's order."""
        return [self.folder / folder_name(job) for job in self.plan.jobs]

    def __enter__(self) -> Sweep:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(self.folder / LOCK_FILE, os.O_CREAT | os.O_RDWR)
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"{self.folder}: another sweep is at work in this folder; wait for it, or choose "
                "another with hydra.sweep.dir=..."
            ) from None
        except OSError as error:
            raise UserError(f"{self.folder}: cannot be written: {error.strerror}") from None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._lock is not None:
            os.close(self._lock)

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
