"""`sldvexp plot <run.nc or folder> [names...]`: figures of a run as PNG and SVG."""

from __future__ import annotations

from pathlib import Path

from sldvexp import dataset
from sldvexp.config.paths import RUN_FILE
from sldvexp.dataset import RunData
from sldvexp.errors import UserError, nearest
from sldvexp.plot import FIGURES, figures_of, save
from sldvexp.plot.selection import require
from sldvexp.writing import require_no_link, require_no_links

#: Files that figures can be made of, and the folder beside them that the figures go to.
SWEEP_FILE = "sweep.nc"
FOLDER = "figures"


def run(words: list[str], config_dir: str | None) -> int:
    """Save all figures that a run or a sweep can show, or those that are named.

    Raises
    ------
    UserError
        If there is no run, a figure of that name, or its data.
    """
    if not words:
        raise UserError(
            "command line: plot takes a run.nc or the folder of a run or a sweep, and which "
            f"figures if not all: {', '.join(FIGURES)}"
        )
    path, names = _file(Path(words[0])), words[1:]
    for name in names:
        if name not in FIGURES:
            raise UserError(f"command line: there is no figure {name}; {nearest(name, FIGURES)}")
    seen = _opened(path)
    known = figures_of(seen)
    for name in names:
        require(name, FIGURES[name].unavailable_because(seen))
    if not known:
        raise UserError(f"{path}: has nothing that a figure could show")
    require_no_link(path.parent / FOLDER)
    require_no_links(path.parent / FOLDER)
    for name in names or known:
        for file in save(known[name](), path.parent / FOLDER / name):
            print(file)
    return 0


def _file(path: Path) -> Path:
    """Find the file of a run or a sweep, from it or its folder."""
    if not path.is_dir():
        return path
    found = [path / name for name in (RUN_FILE, SWEEP_FILE) if (path / name).is_file()]
    if not found:
        raise UserError(f"{path}: has neither {RUN_FILE} nor {SWEEP_FILE}; give a finished run")
    return found[0]


def _opened(path: Path) -> RunData:
    """Open the groups of a run's file; of one without groups, the dataset of a sweep."""
    tree = dataset.load(path)
    if not tree.children:
        return RunData.from_source(tree.to_dataset())
    return RunData.from_source(tree)
