"""All of a run or a sweep on the terminal, for `sldvexp show <folder>`.

Of a finished run its numbers, findings and notes; of one that failed or was cut off why it ended,
what it has and how it goes on; of a sweep the table of its runs.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sldvexp import dataset
from sldvexp.cli.layout import wrapped
from sldvexp.config import registry
from sldvexp.config.paths import JOURNAL, RUN_FILE
from sldvexp.dataset import RunData
from sldvexp.errors import UserError
from sldvexp.files import read_text
from sldvexp.report import REPORT_FILE, closing_table
from sldvexp.session.journal import lines_kept
from sldvexp.sweep import record
from sldvexp.sweep.collect import collect
from sldvexp.sweep.ranking import ranked_by
from sldvexp.sweep.summary import SWEEP_FILE, print_ranking

#: Folder of Hydra in that of every run, and the log beside it.
HYDRA_FOLDER, LOG_FILE = ".hydra", "sldvexp.log"
#: Last word of the command in a log.
LAST_WORD = re.compile(r"^\[[^]]*\]\[sldvexp\.cli\.command\]\[\w+\] - (.*)$", re.MULTILINE)


def print_details(given: Path) -> None:
    """Print them, and then the files.

    Parameters
    ----------
    given : Path
        A ``run.nc`` or a ``sweep.nc``, or the folder of one.

    Raises
    ------
    UserError
        If there is no run and no sweep, or its file cannot be read.
    """
    path = given / RUN_FILE if given.is_dir() else given
    if path.is_file() and path.name != SWEEP_FILE:
        registry.load_installed()  # their plugins are told about in their own words
        with dataset.load(path) as tree:
            closing_table(RunData.from_source(tree), [path, *_files(path.parent, path)])
        return
    folder = path.parent
    if (folder / SWEEP_FILE).is_file():
        table = dataset.load_table(folder / SWEEP_FILE)
        keys = [str(key) for key in np.atleast_1d(table.attrs.get("keys", []))]
        print_ranking(table, keys, str(table.attrs.get("ranked_by", "")), _files(folder))
    elif given.is_dir() and (runs := _runs_below(folder)):
        table = collect(["name"], [[run.name] for run in runs], runs)
        print_ranking(table, ["name"], ranked_by(table), _files(folder))
    elif given.is_dir() and (folder / HYDRA_FOLDER).is_dir():
        print("\n".join(unfinished_lines(folder)))
    else:
        raise UserError(f"{given}: has no {RUN_FILE}; give a run, a sweep, or the folder of one")


def unfinished_lines(folder: Path) -> Iterator[str]:
    """Yield what there is of a run without a dataset."""
    why = record.read(folder).reason or _last_word(folder)
    yield from wrapped(f"not finished: {why or 'the run was cut off, or is still at work'}", 0, 4)
    kept = lines_kept(folder / JOURNAL)
    views = ", ".join(f"{count} lines of view {view}" for view, count in kept.items())
    yield f"scanned: {views or 'nothing'}"
    files = [file.name for file in _files(folder)]
    yield f"files: {', '.join([*files, LOG_FILE])} in {folder}"
    page = f"; or open {folder / REPORT_FILE}" if REPORT_FILE in files else ""
    yield f"next: sldvexp resume={shlex.quote(str(folder))} goes on{page}"


def _last_word(folder: Path) -> str:
    """Find the sentence with which the command ended."""
    log = folder / LOG_FILE
    found = LAST_WORD.findall(read_text(log)) if log.is_file() else []
    return str(found[-1]) if found else ""


def _runs_below(folder: Path) -> list[Path]:
    """List the runs of a sweep that is not done, by their names."""
    return sorted(path.parent for path in folder.glob(f"*/{HYDRA_FOLDER}") if path.is_dir())


def _files(folder: Path, run: Path | None = None) -> list[Path]:
    """List files of a folder that a person reads, but for that of the run itself."""
    every = (p for p in folder.iterdir() if p.is_file() and p != run)
    hidden = (".log", ".lock", ".json")
    return sorted(p for p in every if not p.name.startswith(".") and p.suffix not in hidden)
