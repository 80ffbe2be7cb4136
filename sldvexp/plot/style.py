"""How figures look: light, and told apart without colour (markers, line styles, hatching)."""

from __future__ import annotations

import functools
import io
import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any, ParamSpec

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.container import Container
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from sldvexp.dataset import AXES, VARIABLES, Variable
from sldvexp.typing import Array

P = ParamSpec("P")

#: Colours of Okabe and Ito, which the colour-blind tell apart, in an order in which neighbours
#: differ in lightness too.
COLOURS = ("#000000", "#0072B2", "#E69F00", "#D55E00", "#56B4E9", "#009E73", "#CC79A7", "#8A8A8A")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
LINES = ("-", "--", "-.", ":")
HATCHES = ("", "///", "...", "\\\\\\", "xxx", "+++", "ooo", "---")

#: Perceptually uniform: sizes, values with a sign (dark is below zero), and phases (cyclic).
SIZE_MAP, SIGN_MAP, PHASE_MAP = "viridis", "cividis", "twilight_shifted"

#: Velocities and what is of their kind, whose unit gets the prefix that suits their size.
VELOCITY = VARIABLES["field"]["velocity"]
SPEED = VELOCITY.units
#: Phases, as the noted ones of edges.
PHASE = VARIABLES["edge"]["phase"].titled("phase")

#: Behind what a map does not tell.
UNKNOWN = {"facecolor": "#ffffff", "hatch": "////", "edgecolor": "#bbbbbb"}

SETTINGS: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "axes.titley": 1.0,  # nothing above the axes has to be made room for, which takes long
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
    "lines.linewidth": 1.2,
    "lines.markersize": 4.0,
    "errorbar.capsize": 2.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "figure.facecolor": "#ffffff",
    "figure.titlesize": 10.0,
    "hatch.linewidth": 0.6,
    "svg.hashsalt": "sldvexp",
    "svg.fonttype": "none",
    "figure.dpi": 110.0,
    "savefig.dpi": 150.0,
}


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorate a figure to be drawn in this style, whatever the user's own is."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(SETTINGS)
            return draw(*args, **kwargs)

    return drawn


def figure(width: float, height: float, title: str = "") -> Figure:
    """Make an empty figure that keeps its labels apart and inside; sizes in inch.

    It belongs to no window, so that none has to be closed; a notebook shows it all the same.
    """
    layout = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06)
    made: Figure = _picture()(figsize=(width, height), layout=layout)
    if title:
        made.suptitle(title)
    return made


@functools.cache
def _picture() -> type[Figure]:
    """Make a figure that a notebook can show without pyplot, and that keeps its style."""

    class Picture(Figure):
        def draw(self, renderer: Any) -> None:
            # what is arranged as it is drawn, such as ticks, is of this style too
            with matplotlib.rc_context(SETTINGS):
                super().draw(renderer)

        def _repr_png_(self) -> bytes:
            image = io.BytesIO()
            FigureCanvasAgg(self).print_png(image)
            return image.getvalue()

    return Picture


def not_determined(axes: Axes) -> None:
    """Say in an empty panel why it is empty."""
    note = {"facecolor": "#ffffff", "edgecolor": "none"}
    where: dict[str, Any] = {"transform": axes.transAxes, "ha": "center", "va": "center"}
    axes.text(0.5, 0.5, "not determined", bbox=note, **where)


def looks(number: int) -> Iterator[dict[str, Any]]:
    """Give colour, marker and line style to so many curves, no two alike."""
    cycle = zip(
        itertools.cycle(COLOURS), itertools.cycle(MARKERS), itertools.cycle(LINES), strict=False
    )
    for colour, marker, line in itertools.islice(cycle, number):
        yield {"color": colour, "marker": marker, "linestyle": line}


def imaginary(values: NDArray) -> Array:
    """Take the imaginary part; NaN of what is not determined, which may be stored as 0."""
    return np.where(np.isnan(values), np.nan, np.imag(values))


def prefixed(values: ArrayLike, unit: str) -> tuple[float, str]:
    """Choose factor and prefixed unit that make the largest of some values a handy number.

    Parameters
    ----------
    values : array_like
        In the unit without prefix; not finite ones do not count.
    unit : str
        Such as ``m/s``.

    Examples
    --------
    >>> prefixed([0.02, 0.001], "m/s")
    (1000.0, 'mm/s')
    """
    size = np.abs(np.asarray(values)).ravel()
    size = size[np.isfinite(size)]
    largest = float(size.max()) if size.size else 0.0
    if largest == 0.0:
        return 1.0, unit
    third = min(max(math.floor(math.log10(largest) / 3 + 1e-9), -4), 2)
    prefix = {-4: "p", -3: "n", -2: "µ", -1: "m", 0: "", 1: "k", 2: "M"}[third]
    return 10.0 ** (-3 * third), prefix + unit


def hatched(axes: Axes) -> None:
    """Hatch what a map leaves free, and draw no grid over it."""
    axes.grid(False)
    axes.margins(0)
    axes.patch.set(**UNKNOWN)


def joined(*parts: str) -> str:
    """Join the parts of a title that are not empty."""
    return ", ".join(part for part in parts if part)


def ticks(number: int) -> Any:
    """Set at most so many intervals between ticks."""
    return MaxNLocator(nbins=number)


def whole_numbers() -> Any:
    """Set ticks at whole numbers."""
    return MaxNLocator(integer=True)


def legend_below(made: Any, *axes: Any, title: str = "", columns: int = 9, **look: Any) -> None:
    """Make the legend of some panels below all of them, in which every name stands once.

    What has error bars or is a bar was measured, and stands before what it is compared with.
    """
    once: dict[str, Any] = {}
    for one in axes:
        handles, labels = one.get_legend_handles_labels()
        once |= dict(zip(labels, handles, strict=True))
    once = dict(sorted(once.items(), key=lambda named: not isinstance(named[1], Container)))
    look = {"loc": "outside lower center", "ncols": min(len(once), columns)} | look
    made.legend(once.values(), once.keys(), title=title or None, **look)


def mirror_labels(variable: Variable) -> tuple[str, str]:
    """Name the axes of a picture as the instrument sees it, across and up."""
    up_down, left_right = (variable.titled(n.replace("_", "-")) for n in AXES["mirror"])
    return left_right, up_down


def outer_labels(axes: NDArray[Any], used: int, x: str, y: str) -> None:
    """Name common axes at the left and at the lowest panel of every column."""
    rows, columns = axes.shape
    for row in range(rows):
        axes[row, 0].set_ylabel(y)
    for column in range(columns):
        lowest = max(r for r in range(rows) if r * columns + column < used)
        axes[lowest, column].set_xlabel(x)
        axes[lowest, column].tick_params(labelbottom=True)


#: Inches for the names and numbers of axes at the left and below, and for titles.
LEFT, BOTTOM, TOP, BETWEEN = 0.82, 0.55, 0.6, 0.5
#: An image whose values stay cells of one colour each, the first row below.
AS_IT_IS: Any = {"interpolation": "none", "origin": "lower"}
#: Cells of a scale.
SCALE_COLOURS = 256
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
    """Make a figure with panels of equal size.

    Parameters
    ----------
    width : float, inch
        Of the figure.
    ratio : float
        Height of a panel over its width.
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
    made = figure(width, height)
    made.set_layout_engine("none")
    made.suptitle(title, y=1 - EDGE / height)
    where = {"left": left / width, "right": 1 - right / width, "wspace": beside / wide}
    where |= {"bottom": (BOTTOM + below) / height, "top": 1 - TOP / height}
    where["hspace"] = BETWEEN / high
    return made, made.subplots(rows, columns, squeeze=False, gridspec_kw=where, **shared)


def scene(title: str) -> tuple[Figure, Any, Callable[[Any, str], Any]]:
    """Make a figure with axes in space, and what draws a scale beside them.

    Returns
    -------
    made : matplotlib.figure.Figure
    axes : Axes3D
    scale : callable
        Takes what is coloured and the scale's label.
    """
    made = figure(*SCENE)
    made.set_layout_engine("none")
    made.suptitle(title, y=1 - EDGE / SCENE[1])
    axes = made.add_axes((0.0, 0.0, 0.87, 0.93), projection="3d")
    place = (1 - SCALE_BESIDE / SCENE[0], 0.25, SCALE / SCENE[0], 0.5)
    return made, axes, functools.partial(_scale, made, place, upright=True)


def legend(made: Figure, *axes: Any, title: str = "", **look: Any) -> None:
    """Make the legend of some panels below all of them, where `LEGEND_BELOW` was left free."""
    legend_below(made, *axes, title=title, loc="lower center", **look)


def scale_beside(axes: Any, mapped: Any, label: str) -> Any:
    """Make the scale of a map, or of several above each other, at the right."""
    made, box = _around(axes)
    width = made.get_figwidth()
    place = (box[2] + AWAY / width, box[1], SCALE / width, box[3] - box[1])
    return _scale(made, place, mapped, label, upright=True)


def scale_below(axes: Any, mapped: Any, label: str) -> Any:
    """Make the scale of several maps above each other, below their labels."""
    made, box = _around(axes)
    height = made.get_figheight()
    place = (box[0], box[1] - (BOTTOM + AWAY + SCALE) / height, box[2] - box[0], SCALE / height)
    return _scale(made, place, mapped, label, upright=False)


def _around(axes: Any) -> tuple[Figure, list[float]]:
    """Find the figure, and left, bottom, right and top of some panels in it."""
    every = np.ravel(np.array(axes, object))
    boxes = np.array([one.get_position().extents for one in every])
    return every[0].figure, [*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0)]


def _scale(made: Figure, place: Any, mapped: Any, label: str, upright: bool) -> Any:
    """Make the axis of a linear scale; one image of its colours, where a colorbar has many."""
    axes: Any = made.add_axes(place, label="<colorbar>")
    low, high = mapped.get_clim()
    colours = np.linspace(low, high, SCALE_COLOURS)
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
    """Set numbers at the scale of phases."""
    scale.set_ticks([-np.pi, 0.0, np.pi], labels=["−π", "0", "π"])
