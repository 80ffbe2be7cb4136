"""`sldvexp plot <run.nc or folder> [names...]`: figures of a run as PNG, SVG and PDF."""

from __future__ import annotations

import re
from pathlib import Path

from sldvexp import dataset
from sldvexp.cli.help import COMMAND_HELP
from sldvexp.config.paths import RUN_FILE
from sldvexp.dataset import RunData
from sldvexp.errors import UserError, nearest
from sldvexp.plot import FIGURES, figures_of, save
from sldvexp.plot.catalogue import FORMATS, USUAL
from sldvexp.plot.selection import require
from sldvexp.progress import doing
from sldvexp.units import LengthUnit, unit_named
from sldvexp.writing import require_no_link, require_no_links

#: Files that figures can be made of, and the folder beside them that the figures go to.
SWEEP_FILE = "sweep.nc"
FOLDER = "figures"


#: Options of this command with what they take.
OPTIONS = COMMAND_HELP["plot"].options
#: A length with its unit.
LENGTH = re.compile(r"\s*([\d.]+)\s*([a-z]+)\s*")


def run(
    words: list[str],
    config_dir: str | None,
    width: str | None = None,
    format: str | None = None,
    dpi: str | None = None,
    style: str | None = None,
) -> int:
    """Save all figures that a run or a sweep can show, or those that are named.

    Raises
    ------
    UserError
        If there is no run, a figure of that name, or its data, or an option cannot be understood.
    """
    look = {"width": _length(width), "style": style}
    formats = USUAL if format is None else tuple(filter(None, format.split(",")))
    unknown = [f for f in formats if f not in FORMATS]
    if unknown or not formats:
        told = nearest("".join(unknown[:1]), FORMATS)
        raise UserError(f"command line: --format={format}: there is no such format; {told}")
    dots = _dots(dpi)
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
    wanted = names or list(known)
    for number, name in enumerate(wanted, 1):
        with doing(f"figure {number} of {len(wanted)}: {name}"):
            drawn = known[name](**look)
            files = save(drawn, path.parent / FOLDER / name, formats=formats, dpi=dots)
        for file in files:
            print(file, flush=True)
    return 0


def _length(text: str | None) -> float | None:
    """Read a width with its unit, m."""
    if text is None:
        return None
    found = LENGTH.fullmatch(text)
    try:
        return float(found[1]) * unit_named(LengthUnit, found[2], "--width").value  # type: ignore[index]
    except (TypeError, ValueError, UserError):
        raise UserError(
            f"command line: --width={text}: is no length; give a number with its unit, as 85mm"
        ) from None


def _dots(text: str | None) -> float | None:
    """Read dots per inch."""
    try:
        dots = None if text is None else float(text)
    except ValueError:
        dots = 0.0
    if dots is not None and not FEWEST_DOTS <= dots <= MOST_DOTS:
        raise UserError(
            f"command line: --dpi={text}: must be a number from {FEWEST_DOTS:g} to {MOST_DOTS:g}"
        )
    return dots


#: Dots per inch that a picture can have: more would not be told apart, and fill a disk.
FEWEST_DOTS, MOST_DOTS = 20.0, 2400.0


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
