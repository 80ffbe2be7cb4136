"""How far a sweep is: one line on the terminal after every run that was computed."""

from __future__ import annotations

from pathlib import Path

from sldvexp.sweep import record
from sldvexp.sweep.record import State, Stopwatch

#: Largest count of each unit that is told in it.
MOST = 90


class Progress:
    """Counts the runs of a sweep, as one process does them.

    Parameters
    ----------
    total : int
        Runs of the sweep.
    folder : Path
        Of the sweep.
    """

    def __init__(self, total: int, folder: Path):
        self.total, self.folder = total, folder
        self._finished = self._failed = self._computed = 0
        self._busy = 0.0
        self._watch = Stopwatch()

    def tell(self, run: Path, computed: bool) -> str:
        """Count a run; the line about it, empty if it was done already.

        Parameters
        ----------
        run : Path
            Its folder.
        computed : bool
            Whether it was done now.
        """
        failed = record.read(run).state is State.failed
        self._finished += not failed
        self._failed += failed
        spent, self._watch = self._watch.seconds(), Stopwatch()
        if not computed:
            return ""
        self._computed += 1
        self._busy += spent
        open_runs = self.total - self._finished - self._failed
        told = f"{self._finished} of {self.total} done"
        told += f", {self._failed} failed" if self._failed else ""
        told += f"; about {span(open_runs * self._busy / self._computed)} left" if open_runs else ""
        return f"{told}: {run}"


def span(seconds: float) -> str:
    """A time span in words, such as ``3 min``."""
    if seconds <= MOST:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes <= MOST else f"{minutes / 60:.1f} h"
