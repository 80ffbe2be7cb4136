"""Figures as files, the same bytes from the same data."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from sldvexp.errors import UserError
from sldvexp.files import whole_or_nothing
from sldvexp.plot.style import SETTINGS

#: Formats with what each would say of the moment and the program, which is left out.
FORMATS = {"png": {"Software": None}, "svg": {"Date": None, "Creator": None}}


def save(figure: Figure, path: str | Path, title: str = "") -> list[Path]:
    """Write a figure as PNG and SVG beside each other.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : str or Path
        Without suffix; its folder is made.
    title : str
        What the files say of themselves; without it the file's name.

    Returns
    -------
    list of Path
        The files, PNG first.

    Raises
    ------
    UserError
        If they cannot be written.
    """
    path = Path(path)
    files = [path.with_name(f"{path.name}.{suffix}") for suffix in FORMATS]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with matplotlib.rc_context(SETTINGS), _laid_out(figure):
            for file, (suffix, metadata) in zip(files, FORMATS.items(), strict=True):
                about = {**metadata, "Title": title or path.name}
                with whole_or_nothing(file) as beside:
                    figure.savefig(beside, format=suffix, metadata=about)
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror or error}") from None
    return files


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay the figure out once instead of anew for each file."""
    engine = figure.get_layout_engine()
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    try:
        yield
    finally:
        figure.set_layout_engine(engine)
