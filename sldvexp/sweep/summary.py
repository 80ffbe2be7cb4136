"""What a comparison of runs leaves: `sweep.nc`, `sweep.csv`, and a ranking on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import xarray as xr
from rich.console import Console

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.report.table import NARROWEST
from sldvexp.sweep import ranking

SWEEP_FILE, TABLE_FILE = "sweep.nc", "sweep.csv"


def write_summary(table: xr.Dataset, keys: Sequence[str], folder: Path, rank: str) -> None:
    """Write both files and print the ranking.

    Parameters
    ----------
    table : xarray.Dataset
        See `sldvexp.sweep.collect.collect`.
    keys : sequence of str
        What was swept.
    folder : Path
    rank : str
        Headline to rank by; empty chooses one.

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
    dataset.save_table(table, folder / SWEEP_FILE)
    ranking.write_csv(table, keys, folder / TABLE_FILE)
    console = Console()
    if not console.is_terminal:
        console = Console(width=max(console.width, NARROWEST))
    console.print(ranking.terminal_table(ranking.rows(table, keys, by), keys, by))
    for name in (SWEEP_FILE, TABLE_FILE):
        console.print(str(folder / name), soft_wrap=True, highlight=False)
    if mistake:
        raise mistake
