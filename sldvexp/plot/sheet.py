"""Maps in rows and columns, whose places are known beforehand.

Their labels are of known lengths; to find room for them anew would take longer than to draw them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.plot import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Inches for the names and numbers of axes at the left and below, and for titles.
LEFT, BOTTOM, TOP, BETWEEN = 0.82, 0.55, 0.6, 0.5
#: Inches above everything.
EDGE = 0.08
#: Inches of a scale across, and from the map to it.
SCALE, AWAY = 0.13, 0.1
#: Inches for a scale with its numbers and unit.
SCALE_BESIDE, SCALE_BELOW = 0.95, 0.7


def sheet(
    rows: int,
    columns: int,
    width: float,
    ratio: float,
    title: str,
    beside: float = 0.3,
    below: float = 0.0,
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
    **shared
        Which axes are shared, as of ``Figure.subplots``.

    Returns
    -------
    figure : matplotlib.figure.Figure
    axes : ndarray of Axes, shape (rows, columns)
    """
    wide = (width - LEFT) / columns - beside
    high = ratio * wide
    height = TOP + rows * high + (rows - 1) * BETWEEN + BOTTOM + below
    made = style.figure(width, height)
    made.set_layout_engine("none")
    made.suptitle(title, y=1 - EDGE / height)
    where = {"left": LEFT / width, "right": 1 - beside / width, "wspace": beside / wide}
    where |= {"bottom": (BOTTOM + below) / height, "top": 1 - TOP / height}
    where["hspace"] = BETWEEN / high
    return made, made.subplots(rows, columns, squeeze=False, gridspec_kw=where, **shared)


def scale_beside(axes: Any, mapped: Any, label: str) -> Any:
    """The scale of a map, or of several above each other, at the right."""
    made, box = _around(axes)
    width = made.get_figwidth()
    place = (box[2] + AWAY / width, box[1], SCALE / width, box[3] - box[1])
    return _scale(made, place, mapped, label, "vertical")


def scale_below(axes: Any, mapped: Any, label: str) -> Any:
    """The scale of several maps above each other, below their labels."""
    made, box = _around(axes)
    height = made.get_figheight()
    place = (box[0], box[1] - (BOTTOM + AWAY + SCALE) / height, box[2] - box[0], SCALE / height)
    return _scale(made, place, mapped, label, "horizontal")


def _around(axes: Any) -> tuple[Figure, list[float]]:
    """The figure, and left, bottom, right and top of some panels in it."""
    every = np.ravel(np.array(axes, object))
    boxes = np.array([one.get_position().extents for one in every])
    return every[0].figure, [*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0)]


def _scale(made: Figure, place: Any, mapped: Any, label: str, orientation: str) -> Any:
    axes = made.add_axes(place, label="<colorbar>")
    scale: Any = made.colorbar(mapped, cax=axes, label=label, orientation=orientation)
    scale.outline.set_linewidth(0.5)
    return scale


def in_turns(scale: Any) -> None:
    """Numbers at the scale of phases."""
    scale.set_ticks([-np.pi, 0.0, np.pi], labels=["−π", "0", "π"])
