"""All numbers, findings and notes of a finished run on the terminal, for `sldvexp show <run>`."""

from __future__ import annotations

from pathlib import Path

from sldvexp import dataset
from sldvexp.config import registry
from sldvexp.config.paths import RUN_FILE
from sldvexp.dataset import RunData
from sldvexp.errors import UserError
from sldvexp.report import closing_table


def print_details(given: Path) -> None:
    """Print them, and then the run's files.

    Parameters
    ----------
    given : Path
        A ``run.nc`` or the folder of one.

    Raises
    ------
    UserError
        If there is no run, or its file cannot be read.
    """
    path = given / RUN_FILE if given.is_dir() else given
    if not path.is_file():
        raise UserError(f"{given}: has no {RUN_FILE}; give a finished run, or its folder")
    registry.load_installed()  # their plugins are told about in their own words
    with dataset.load(path) as tree:
        others = sorted(p for p in path.parent.iterdir() if p.is_file() and not _hidden(p, path))
        closing_table(RunData.from_source(tree), [path, *others])


def _hidden(file: Path, run: Path) -> bool:
    """Tell whether a file of a run's folder is none that a person reads."""
    return file == run or file.name.startswith(".") or file.suffix in (".log", ".lock", ".json")
