"""`sldvexp report <run or sweep>`: make the page of a run or of a sweep anew, from its dataset.

Also of a run that was interrupted or failed, from what is in its folder.
"""

from __future__ import annotations

import gc
from pathlib import Path

import numpy as np

from sldvexp import dataset
from sldvexp.config import registry
from sldvexp.config.paths import RUN_FILE
from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.progress import doing
from sldvexp.report.html import unfinished
from sldvexp.report.html.page import Html
from sldvexp.sweep import ranking
from sldvexp.sweep.summary import SWEEP_FILE


def run(words: list[str], config_dir: str | None) -> int:
    """Make the page and print where it lies.

    Raises
    ------
    UserError
        If there is no run and no sweep, or its file cannot be read.
    """
    if len(words) != 1:
        raise UserError(
            "command line: report takes one run.nc, or the folder of a run or of a sweep"
        )
    gc.enable()
    registry.load_installed()  # their plugins are told about in their own words
    given = Path(words[0])
    found = [given / SWEEP_FILE, given / RUN_FILE] if given.is_dir() else [given]
    path = next((file for file in found if file.is_file()), None)
    if path is None and given.is_dir() and not unfinished.unfinished_because(given):
        with doing(f"making the page of {given}"):
            page = Html().of_unfinished(given)
        print(page)
        return 0
    if path is None:
        for file in filter(Path.exists, found):
            require_file(file)  # it says what is there instead
        wanted = (
            f"neither {RUN_FILE} nor {SWEEP_FILE} is there" if given.is_dir() else "no such file"
        )
        raise UserError(f"{given}: {wanted}; give a run.nc, or the folder of a run or of a sweep")
    report = Html()
    with doing(f"making the page of {path}"):
        page = _of_sweep(report, path) if path.name == SWEEP_FILE else report.of_run(path)
    print(page)
    return 0


def _of_sweep(report: Html, path: Path) -> Path:
    """Make the page of a sweep, whose dataset ranks its runs."""
    table = dataset.load_table(path)
    try:
        keys = [str(key) for key in np.atleast_1d(table.attrs["keys"])]
        rows = ranking.rows(table, keys, str(table.attrs["ranked_by"]))
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: is not a sweep's dataset ({error})") from None
    return report.of_sweep(path, rows)
