"""Panels in rows and columns, whose places are known beforehand.

Their labels are of known lengths; to find room for them anew would take longer than to draw them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sldvexp.plot import style

#: Inches for the names and numbers of axes at the left and below, and for titles.
LEFT, BOTTOM, TOP, BETWEEN = 0.82, 0.55, 0.6, 0.5
#: An image whose values stay cells of one colour each, the first row below.
AS_IT_IS: Any = {"interpolation": "none", "origin": "lower"}
#: Cells of a scale.
COLOURS = 256
#: Inches of a figure in space across and high.
SCENE = 7.4, 4.6
#: Inches above everything.
EDGE = 0.08
#: Inches of a scale across, and from the map to it.
SCALE, AWAY = 0.13, 0.1
#: Inches for a scale with its numbers and unit.
SCALE_BESIDE, SCALE_BELOW = 0.95, 0.7
#: Inches for a legend below everything, and for numbers at the left of inner panels.
LEGEND_BELOW, NUMBERS = 0.35, 0.5


def sheet(
    rows: int,
    columns: int,
    width: float,
    ratio: float,
    title: str,
    beside: float = 0.3,
    below: float = 0.0,
    before: float = 0.0,
    right: float | None = None,
    **shared: Any,
) -> tuple[Figure, NDArray[Any]]:
    """A figure with panels of equal size.

    Parameters
    ----------
    rows, columns : int
    width : float, inch
        Of the figure.
    ratio : float
        Height of a panel over its width.
    title : str
    beside : float, inch
        At the right of every panel.
    below : float, inch
        Below all panels and their labels.
    before : float, inch
        At the left of all panels and their labels.
    right : float, inch, optional
        At the right of the last panel; without it as of every panel.
    **shared
        Which axes are shared, as of ``Figure.subplots``.

    Returns
    -------
    figure : matplotlib.figure.Figure
    axes : ndarray of Axes, shape (rows, columns)
    """
    left, right = before + LEFT, beside if right is None else right
    wide = (width - left - right + beside) / columns - beside
    high = ratio * wide
    height = TOP + rows * high + (rows - 1) * BETWEEN + BOTTOM + below
    made = style.figure(width, height)
    made.set_layout_engine("none")
    made.suptitle(title, y=1 - EDGE / height)
    where = {"left": left / width, "right": 1 - right / width, "wspace": beside / wide}
    where |= {"bottom": (BOTTOM + below) / height, "top": 1 - TOP / height}
    where["hspace"] = BETWEEN / high
    return made, made.subplots(rows, columns, squeeze=False, gridspec_kw=where, **shared)


def scene(title: str) -> tuple[Figure, Any, Callable[[Any, str], Any]]:
    """A figure with axes in space, and what draws a scale beside them.

    Returns
    -------
    made : matplotlib.figure.Figure
    axes : Axes3D
    scale : callable
        Takes what is coloured and the scale's label.
    """
    made = style.figure(*SCENE)
    made.set_layout_engine("none")
    made.suptitle(title, y=1 - EDGE / SCENE[1])
    axes = made.add_axes((0.0, 0.0, 0.87, 0.93), projection="3d")
    place = (1 - SCALE_BESIDE / SCENE[0], 0.25, SCALE / SCENE[0], 0.5)
    return made, axes, functools.partial(_scale, made, place, upright=True)


def legend(made: Figure, *axes: Any, title: str = "", **look: Any) -> None:
    """The legend of some panels below all of them, where `LEGEND_BELOW` was left free."""
    style.legend_below(made, *axes, title=title, loc="lower center", **look)


def scale_beside(axes: Any, mapped: Any, label: str) -> Any:
    """The scale of a map, or of several above each other, at the right."""
    made, box = _around(axes)
    width = made.get_figwidth()
    place = (box[2] + AWAY / width, box[1], SCALE / width, box[3] - box[1])
    return _scale(made, place, mapped, label, upright=True)


def scale_below(axes: Any, mapped: Any, label: str) -> Any:
    """The scale of several maps above each other, below their labels."""
    made, box = _around(axes)
    height = made.get_figheight()
    place = (box[0], box[1] - (BOTTOM + AWAY + SCALE) / height, box[2] - box[0], SCALE / height)
    return _scale(made, place, mapped, label, upright=False)


def _around(axes: Any) -> tuple[Figure, list[float]]:
    """The figure, and left, bottom, right and top of some panels in it."""
    every = np.ravel(np.array(axes, object))
    boxes = np.array([one.get_position().extents for one in every])
    return every[0].figure, [*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0)]


def _scale(made: Figure, place: Any, mapped: Any, label: str, upright: bool) -> Any:
    """The numbers' axis of a linear scale; one image of its colours, where a colorbar has many."""
    axes: Any = made.add_axes(place, label="<colorbar>")
    low, high = mapped.get_clim()
    colours = np.linspace(low, high, COLOURS)
    if upright:
        colours, extent, own, other = colours[:, None], (0, 1, low, high), axes.yaxis, axes.xaxis
        axes.yaxis.tick_right()
        axes.yaxis.set_label_position("right")
    else:
        colours, extent, own, other = colours[None], (low, high, 0, 1), axes.xaxis, axes.yaxis
    look = {"cmap": mapped.cmap, "vmin": low, "vmax": high}
    axes.imshow(colours, extent=extent, aspect="auto", **AS_IT_IS, **look)
    axes.spines[:].set(visible=True, linewidth=0.5)
    other.set_visible(False)
    axes.grid(False)
    own.set_label_text(label)
    return own


def in_turns(scale: Any) -> None:
    """Numbers at the scale of phases."""
    scale.set_ticks([-np.pi, 0.0, np.pi], labels=["−π", "0", "π"])
