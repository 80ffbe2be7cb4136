"""Summary of a comparison of runs: `sweep.nc`, `sweep.csv`, and a ranking on the terminal."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from sldvexp import dataset
from sldvexp.config.paths import RUN_FILE
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.progress import doing
from sldvexp.report import NARROWEST, REPORT_FILE, Report, attempt
from sldvexp.sweep import ranking

SWEEP_FILE, TABLE_FILE = "sweep.nc", "sweep.csv"


def write_summary(
    table: xr.Dataset, keys: Sequence[str], folder: Path, rank: str, report: Report | None
) -> None:
    """Write both files and the page about them, and print the ranking.

    Parameters
    ----------
    table : xarray.Dataset
        See `sldvexp.sweep.collect.collect`.
    keys : sequence of str
        What was swept.
    rank : str
        Headline to rank by; empty chooses one.
    report : Report or None
        Makes the page.

    Raises
    ------
    UserError
        After all is written, if no run has what to rank by.
    """
    by, mistake = "", None
    try:
        by = ranking.ranked_by(table, rank)
    except UserError as error:  # told when the results are safe
        by, mistake = ranking.ranked_by(table), error
    table.attrs |= {"keys": list(keys), "ranked_by": by}
    there = [_from(folder, str(run)) for run in table[ranking.FOLDER].values.ravel()]
    table[ranking.FOLDER].values = np.reshape(there, table[ranking.FOLDER].shape)
    dataset.save_table(table, folder / SWEEP_FILE)
    ranking.write_csv(table, keys, folder / TABLE_FILE)
    rows, path = ranking.rows(table, keys, by), folder / SWEEP_FILE
    pages = []
    if report:
        if report.each_run:
            _pages_of_runs(report, [folder / r for row in rows if (r := row[ranking.FOLDER])])
        with doing(f"making the page of {path}"):
            pages = attempt(lambda: report.of_sweep(path, rows), path)
    print_ranking(table, keys, by, [path, folder / TABLE_FILE, *pages])
    if mistake:
        raise mistake


def print_ranking(table: xr.Dataset, keys: Sequence[str], by: str, files: Sequence[Path]) -> None:
    """Print the table of the runs, the best first, and then some files.

    Parameters
    ----------
    table : xarray.Dataset
        See `sldvexp.sweep.collect.collect`.
    keys : sequence of str
        What sets the runs apart.
    by : str
        Headline to rank by; empty for none.
    """
    console = Console()
    if not console.is_terminal:
        console = Console(width=max(console.width, NARROWEST))
    rows, unit = ranking.rows(table, keys, by), ranking.units(table, by)
    console.print(ranking.terminal_table(rows, keys, by, unit, console.width))
    for file in files:
        console.print(str(file), soft_wrap=True, highlight=False)


def _pages_of_runs(report: Report, runs: Sequence[Path]) -> None:
    """Make the pages that runs do not have yet: of those that were done before it was wanted."""
    for path in (run / RUN_FILE for run in runs):
        page = path.with_name(REPORT_FILE)
        made = page.is_file() and page.stat().st_mtime >= path.stat().st_mtime
        if path.is_file() and not made:
            with doing(f"making the page of {path}"):
                attempt(partial(report.of_run, path), path)


def _from(folder: Path, run: str) -> str:
    """Say where a run's folder is as seen from the sweep's, so that both can be moved."""
    if not run:
        return ""
    there = Path(run).resolve()
    try:
        return Path(os.path.relpath(there, folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return there.as_posix()
