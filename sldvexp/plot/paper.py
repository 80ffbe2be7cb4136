"""Sheet that figures are drawn for: its width, its letters, and a style of one's own.

A figure is drawn at the size at which it is printed, so that its letters have their size there;
what does not fit beside each other goes below. Assumed is the width of a journal's page of two
columns, until another is asked for.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib
import matplotlib.style
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

from sldvexp.errors import UserError

#: A file of matplotlib's settings, the name of one of its styles, or settings themselves.
Style: TypeAlias = "str | Path | Mapping[str, Any] | None"

INCH = 0.0254
#: Points of an inch.
POINTS = 72.0
#: Widths between which figures can be drawn, m.
NARROWEST, WIDEST = 0.06, 1.0
#: Inches below which panels of a figure go below each other.
NARROW = 5.0

SETTINGS: Any = {
    "font.family": "sans-serif",
    # what a reader of a picture with letters may have instead, with letters about as wide
    "font.sans-serif": ["DejaVu Sans", "Verdana", "sans-serif"],
    "text.parse_math": False,  # names of views and runs may have any signs, such as $
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "axes.titley": 1.0,  # nothing above the axes has to be made room for, which takes long
    "axes.titlepad": 4.0,
    "axes.labelpad": 3.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "axes.unicode_minus": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.5,
    "errorbar.capsize": 2.0,
    "legend.fontsize": 7.5,
    "legend.title_fontsize": 7.5,
    "legend.frameon": False,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "figure.facecolor": "#ffffff",
    "figure.titlesize": 8.5,
    "hatch.linewidth": 0.5,
    "svg.hashsalt": "sldvexp",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "figure.dpi": 110.0,
    "savefig.dpi": 300.0,
}


@dataclass(frozen=True)
class Paper:
    """A sheet.

    Attributes
    ----------
    width : float, m
    own : dict
        Settings of matplotlib that stand over those of this style.
    """

    width: float = 0.18
    own: Mapping[str, Any] = field(default_factory=dict)

    @property
    def settings(self) -> Any:
        """Settings of matplotlib that a figure is drawn and written with."""
        return {**SETTINGS, **self.own}


#: Settings of matplotlib are the whole process's, so that threads that draw take turns.
_TURN = threading.RLock()


@contextmanager
def settings_kept(settings: Any = None) -> Iterator[None]:
    """Draw with settings of matplotlib, or change them, while no other thread draws."""
    with _TURN, matplotlib.rc_context(settings):
        yield


_PAPER: ContextVar[Paper | None] = ContextVar("paper", default=None)


def paper() -> Paper:
    """Tell the sheet that is drawn on now."""
    return _PAPER.get() or Paper()


@contextmanager
def on_paper(width: float | None, style: Style) -> Iterator[None]:
    """Draw on a sheet of that width, m, in a style of one's own; what is None stays as it is."""
    if width is not None and not NARROWEST <= width <= WIDEST:
        raise UserError(
            f"plot: a figure is {1e3 * NARROWEST:g} to {1e3 * WIDEST:g} mm wide, and "
            f"{1e3 * width:g} mm is not"
        )
    now = paper()
    asked = Paper(now.width if width is None else width, {**now.own, **own_settings(style)})
    token = _PAPER.set(asked)
    try:
        with settings_kept():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(asked.settings)
            yield
    finally:
        _PAPER.reset(token)


def own_settings(style: Style) -> Any:
    """Read settings of matplotlib.

    Raises
    ------
    UserError
        If there is no such file or style, or it has what matplotlib does not know.

    Examples
    --------
    >>> own_settings({"font.size": 10})
    {'font.size': 10.0}
    """
    if style is None:
        return {}
    try:
        if isinstance(style, Mapping):
            return dict(matplotlib.RcParams(style))
        if str(style) in matplotlib.style.library:
            return dict(matplotlib.style.library[str(style)])
        return dict(matplotlib.rc_params_from_file(Path(style), use_default_template=False))
    except (OSError, ValueError, KeyError) as error:
        told = " ".join(str(error).split()) or type(error).__name__
        raise UserError(f"plot: style {style}: is no style of matplotlib: {told}") from None


def inches() -> float:
    """Tell how wide the sheet is, inch."""
    return paper().width / INCH


def narrow() -> bool:
    """Tell whether panels go below each other."""
    return inches() < NARROW


def fitting(wanted: int, least: float) -> int:
    """Count panels beside each other, of `wanted`, that have at least so many inches each."""
    return max(1, min(wanted, int(inches() / least)))


def long(text: str, size: float) -> float:
    """Measure a text at a size in points; inch. Letters that move closer together do not count.

    Examples
    --------
    >>> long("ii", 8.0) == 2 * long("i", 8.0)
    True
    """
    family = tuple(matplotlib.rcParams["font.family"])
    return sum(_wide(letter, family) for letter in text) * size / POINTS


@lru_cache(maxsize=4096)
def _wide(letter: str, family: tuple[str, ...]) -> float:
    """Measure a letter of size 1; to measure texts takes as long as to draw them."""
    font = FontProperties(family=list(family), size=1.0)
    return float(text_to_path.get_text_width_height_descent(letter, font, False)[0])


def broken(text: str, width: float, size: float | None = None) -> str:
    r"""Break a text at spaces into lines that are not wider than `width`, inch.

    Examples
    --------
    >>> broken("edges of the circle", 0.7)
    'edges of\nthe circle'
    """
    points = float(matplotlib.rcParams["font.size"]) if size is None else size
    lines: list[str] = [""]
    for word in re.split(r"(?<= )", text):
        if lines[-1] and long((lines[-1] + word).rstrip(), points) > width:
            lines.append("")
        lines[-1] += word
    return "\n".join(line.rstrip() for line in lines)
