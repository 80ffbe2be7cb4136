"""How figures look: light, and told apart without colour (markers, line styles, hatching)."""

from __future__ import annotations

import functools
import inspect
import io
import itertools
import math
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, Normalize
from matplotlib.container import Container
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import ArrayLike, NDArray

from sldvexp.dataset import AXES, VARIABLES, Variable
from sldvexp.plot.panel import SharedTickAxes
from sldvexp.plot.panel import set_numbers as set_numbers
from sldvexp.plot.paper import POINTS, Paper, Style, broken, on_paper, paper
from sldvexp.plot.paper import fitting as fitting
from sldvexp.plot.paper import inches as inches
from sldvexp.plot.paper import long as long
from sldvexp.plot.paper import narrow as narrow
from sldvexp.plot.paper import settings_kept as settings_kept
from sldvexp.typing import Array

#: Colours of Okabe and Ito, which the colour-blind tell apart, in an order in which neighbours
#: differ in lightness too.
COLOURS = ("#000000", "#0072B2", "#E69F00", "#D55E00", "#56B4E9", "#009E73", "#CC79A7", "#8A8A8A")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
LINES = ("-", "--", "-.", ":")
HATCHES = ("", "///", "...", "\\\\\\", "xxx", "+++", "ooo", "---")

#: Sizes, values with a sign (white where nothing moves), and phases (cyclic).
SIZE_MAP, SIGN_MAP, PHASE_MAP = "viridis", "RdBu_r", "twilight_shifted"

#: Velocities and what is of their kind, whose unit gets the prefix that suits their size.
VELOCITY = VARIABLES["field"]["velocity"]
SPEED = VELOCITY.units
#: Phases, as the noted ones of edges.
PHASE = VARIABLES["edge"]["phase"].titled("phase")

#: Behind what a map does not tell.
UNKNOWN = {"facecolor": "#ffffff", "hatch": "////", "edgecolor": "#bbbbbb"}


#: What every figure takes besides its own options.
OPTIONS = """
    width : float, m, optional
        Of the figure when it is printed; letters have their size there, and panels that do not fit
        beside each other stand below. Without it that of a page of two columns.
    style : str, Path or mapping, optional
        One's own look: a file of matplotlib's settings, a name of its styles, or settings.
"""


#: Held by whoever draws.
DRAWING = threading.RLock()


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Decorate a figure to be drawn in this style, whatever the user's own is.

    It then takes ``width`` and ``style`` too.
    """

    @functools.wraps(draw)
    def drawn(*args: Any, width: float | None = None, style: Style = None, **kwargs: Any) -> Figure:
        # Styles are the whole process's: threads that draw at once would have each other's.
        with DRAWING, on_paper(width, style):
            return draw(*args, **kwargs)

    own = inspect.signature(draw)
    only = inspect.Parameter.KEYWORD_ONLY
    more = [
        inspect.Parameter("width", only, default=None, annotation="float | None"),
        inspect.Parameter("style", only, default=None, annotation="Style"),
    ]
    drawn.__signature__ = own.replace(parameters=[*own.parameters.values(), *more])  # type: ignore[attr-defined]
    drawn.__doc__ = _with_options(draw.__doc__ or "")
    return drawn


def _with_options(told: str) -> str:
    """Add what every figure takes to the parameters of a docstring."""
    text = OPTIONS.strip("\n")
    if "    Parameters\n" not in told:
        text = f"Parameters\n    ----------\n{text}"
        start, mark, rest = told.partition("    Examples\n")
        return f"{start}    {text}\n\n{mark}{rest}"
    ends = re.search(r"\n\n    (?=Returns\n|Raises\n|Examples\n)", told)
    at = ends.start() if ends else len(told)
    return f"{told[:at]}\n{text}{told[at:]}"


def figure(height: float, title: str = "") -> Figure:
    """Make an empty figure as wide as the sheet, that keeps its labels apart; height in inch.

    It belongs to no window, so that none has to be closed; a notebook shows it all the same.
    """
    layout = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06)
    made: Figure = _picture()(figsize=(inches(), height), layout=layout)
    if title:
        made.suptitle(_heading(title))
    return made


def _heading(title: str) -> str:
    """Break the title of a whole figure into lines."""
    return broken(title, inches() - 4 * EDGE, matplotlib.rcParams["font.size"] * HEADING)


@functools.cache
def _picture() -> type[Figure]:
    """Make a figure that a notebook can show without pyplot, and that keeps its style."""

    class Picture(Figure):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            self.paper = paper()
            super().__init__(*args, **kwargs)

        def add_subplot(self, *args: Any, **kwargs: Any) -> Any:
            return super().add_subplot(*args, **_as_panel(kwargs))

        def add_axes(self, *args: Any, **kwargs: Any) -> Any:
            return super().add_axes(*args, **_as_panel(kwargs))

        def draw(self, renderer: Any) -> None:
            # what is arranged as it is drawn, such as ticks, is of this style too
            with settings_kept(self.paper.settings):
                super().draw(renderer)

        def _repr_png_(self) -> bytes:
            image = io.BytesIO()
            FigureCanvasAgg(self).print_png(image)
            return image.getvalue()

    return Picture


def _as_panel(kwargs: dict[str, Any]) -> dict[str, Any]:
    """Choose axes that are drawn fast, unless others are asked for."""
    return kwargs if kwargs.get("projection") else {"axes_class": SharedTickAxes, **kwargs}


def settings_of(made: Figure) -> Any:
    """Tell the settings of matplotlib that a figure was drawn with."""
    own: Paper = getattr(made, "paper", Paper())
    return own.settings


def note(axes: Axes, text: str) -> None:
    """Say in an empty panel why it is empty."""
    behind = {"facecolor": "#ffffff", "edgecolor": "none"}
    where: dict[str, Any] = {"transform": axes.transAxes, "ha": "center", "va": "center"}
    made: Any = axes.figure
    wide = axes.get_position().width * made.get_figwidth()
    axes.text(0.5, 0.5, broken(text, 0.9 * wide), bbox=behind, **where)


def not_determined(axes: Axes) -> None:
    """Say in an empty panel that nothing is determined."""
    note(axes, "not determined")


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
    axes.patch.set(**UNKNOWN)


def ends_of(axes: Axes, x: ArrayLike, y: ArrayLike) -> None:
    """Let a panel, and those that share its axes, end where what it shows does."""
    if axes.get_autoscalex_on():
        axes.set_xlim(np.min(x), np.max(x))
    if axes.get_autoscaley_on():
        axes.set_ylim(np.min(y), np.max(y))


def cells(
    axes: Axes, values: NDArray[Any], extent: tuple[float, float, float, float], **colours: Any
) -> Any:
    """Draw cells of one colour each, the first row below.

    Parameters
    ----------
    extent : tuple of float
        Left, right, bottom and top end.
    **colours
        ``cmap`` and ``norm``.
    """
    image = AxesImage(axes, interpolation="none", origin="lower", extent=extent, **colours)
    image.set_data(values)
    image.set_clip_path(axes.patch)
    axes.add_image(image)
    ends_of(axes, extent[:2], extent[2:])
    return image


def joined(*parts: str) -> str:
    """Join the parts of a title that are not empty."""
    return ", ".join(part for part in parts if part)


@functools.cache
def colour_map(name: str) -> Colormap:
    """Take a map of colours by its name; one for all figures, since each has to be worked out."""
    return matplotlib.colormaps[name]


def ticks(number: int, inside: bool = False) -> Any:
    """Set at most so many intervals between ticks; those inside have none at the very ends."""
    return MaxNLocator(nbins=number, prune="both" if inside else None)


def inner_ticks(panels: NDArray[Any]) -> None:
    """Set ticks of panels beside each other, whose numbers must not meet."""
    for axes in panels.ravel():
        axes.xaxis.set_major_locator(ticks(3 if narrow() else 6, inside=True))


def decades(axis: Any, low: float, high: float) -> None:
    """Set ticks of a logarithmic axis, with plain numbers."""
    few = high < 300 * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=8))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def thousands(axis: Any, largest: float) -> None:
    """Write numbers as thousands where five digits of panels side by side would meet."""
    if largest >= FIVE_DIGITS:
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v / 1000:g}k" if v else "0"))


def whole_numbers() -> Any:
    """Set ticks at whole numbers."""
    return MaxNLocator(integer=True)


def alike(panels: Iterable[Any]) -> None:
    """Give panels one range of values, that of all of them."""
    panels = list(panels)
    low, high = np.array([axes.get_ylim() for axes in panels]).T
    for axes in panels:
        axes.set_ylim(low.min(), high.max())


def legend_below(made: Figure, *axes: Any, title: str = "", columns: int = 9, **more: Any) -> Any:
    """Make the legend of some panels below all of them, in which every name stands once.

    What has error bars or is a bar was measured, and stands before what it is compared with.
    Entries beside each other are as many as fit.
    """
    once: dict[str, Any] = {}
    for one in axes:
        handles, labels = one.get_legend_handles_labels()
        once |= dict(zip(labels, handles, strict=True))
    once = dict(sorted(once.items(), key=lambda named: not isinstance(named[1], Container)))
    size = float(matplotlib.rcParams["legend.fontsize"])
    room = made.get_figwidth() - 4 * EDGE
    names = [broken(name, room - HANDLE * size / POINTS, size) for name in once]
    longest = max((long(line, size) for n in names for line in n.split("\n")), default=0.0)
    fit = max(1, int(room / (longest + HANDLE * size / POINTS)))
    look: dict[str, Any] = {"loc": "outside lower center", "ncols": min(len(once), columns, fit)}
    look |= more
    return made.legend(once.values(), names, title=title or None, **look)


def mirror_labels(variable: Variable) -> tuple[str, str]:
    """Name the axes of a picture as the instrument sees it, across and up."""
    up_down, left_right = (variable.titled(n.replace("_", "-")) for n in AXES["mirror"])
    return left_right, up_down


def across_below(made: Figure, row: NDArray[Any], label: str) -> None:
    """Name the common axis of a row of panels once, below its middle."""
    _, box = _around(row)
    foot = box[1] - TICKS / made.get_figheight()
    size = matplotlib.rcParams["axes.labelsize"]
    where: dict[str, Any] = {"ha": "center", "va": "top", "fontsize": size}
    made.text(0.5 * (box[0] + box[2]), foot, label, **where)


def up_beside(made: Figure, column: NDArray[Any], label: str) -> None:
    """Name the common axis of a column of panels once, beside its middle, at the left edge."""
    _, box = _around(column)
    room = (box[3] - box[1]) * made.get_figheight()
    size = float(matplotlib.rcParams["axes.labelsize"])
    where: dict[str, Any] = {"ha": "left", "va": "center", "rotation": 90, "fontsize": size}
    edge = EDGE / made.get_figwidth()
    made.text(edge, 0.5 * (box[1] + box[3]), broken(label, max(room, 0.8), size), **where)


def outer_labels(axes: NDArray[Any], used: int, x: str, y: str) -> None:
    """Name common axes at the left and at the lowest panel of every column."""
    rows, columns = axes.shape
    for row in range(rows):
        axes[row, 0].set_ylabel(y)
    for column in range(columns):
        lowest = max(r for r in range(rows) if r * columns + column < used)
        axes[lowest, column].set_xlabel(x)
        axes[lowest, column].tick_params(labelbottom=True)


#: Inches for the names and numbers of axes at the left and below, for titles, and between panels
#: with a title and numbers.
LEFT, BOTTOM, TOP, BETWEEN = 0.62, 0.46, 0.47, 0.45
#: Mirror readings from which numbers have five digits.
FIVE_DIGITS = 1e4
#: Inches between rows of panels with a title alone.
LOW = 0.24
#: Cells of a scale.
SCALE_COLOURS = 256
#: Inches for the numbers below a panel.
TICKS = 0.23
#: Inches above everything, and at the sides of a title.
EDGE = 0.06
#: Height of a line over its letters, and of the heading's letters over others.
LINE, HEADING = 1.25, 8.5 / 8.0
#: Points of the letters of axes' names.
LABEL = 8.0
#: Width of what stands before a name of a legend, over the size of its letters.
HANDLE = 5.0
#: Inches of a scale across, and from the map to it.
SCALE, AWAY = 0.11, 0.07
#: Inches for a scale with its numbers and unit.
SCALE_BESIDE, SCALE_BELOW = 0.72, 0.55
#: Inches for numbers at the left of inner panels.
NUMBERS = 0.42


def line_height() -> float:
    """Tell how high a line of text is, inch."""
    return LINE * float(matplotlib.rcParams["font.size"]) / POINTS


def sheet(
    rows: int,
    columns: int,
    ratio: float | Sequence[float],
    title: str,
    titles: Sequence[str] = (),
    beside: float = 0.18,
    below: float = 0.0,
    before: float = 0.0,
    above: float = 0.0,
    right: float | None = None,
    between: float = BETWEEN,
    left: float = LEFT,
    **shared: Any,
) -> tuple[Figure, NDArray[Any]]:
    """Make a figure with panels of equal width, and height in a row.

    Parameters
    ----------
    ratio : float, or sequence of float for each row
        Height of a panel over its width.
    titles : sequence of str
        Of the panels, row by row; room is made for all of their lines.
    beside : float, inch
        At the right of every panel.
    below, above : float, inch
        Below all panels and their labels, and between them and the figure's title.
    before : float, inch
        At the left of all panels and their labels.
    right : float, inch, optional
        At the right of the last panel; without it as of every panel.
    between : float, inch
        Between rows.
    left : float, inch
        For names and numbers at the left.
    **shared
        Which axes are shared, as of ``Figure.subplots``.

    Returns
    -------
    figure : matplotlib.figure.Figure
    axes : ndarray of Axes, shape (rows, columns)
    """
    width = inches()
    left, right = before + left, beside if right is None else right
    wide = (width - left - right + beside) / columns - beside
    high = wide * np.broadcast_to(ratio, rows)
    names = [broken(name, wide + min(beside, 0.3)) for name in titles]
    more = max((name.count("\n") for name in names), default=0) * line_height()
    heading = _heading(title)
    top = TOP + more + above + heading.count("\n") * HEADING * line_height()
    gap = between + more * (len(titles) > columns)
    height = top + float(high.sum()) + (rows - 1) * gap + BOTTOM + below
    made = figure(height)
    made.set_layout_engine("none")
    made.suptitle(heading, y=1 - EDGE / height, va="top")
    where = {"left": left / width, "right": 1 - right / width, "wspace": beside / wide}
    where |= {"bottom": (BOTTOM + below) / height, "top": 1 - top / height}
    where["hspace"] = gap / float(high.mean())
    if len(set(high.tolist())) > 1:
        where["height_ratios"] = high.tolist()
    axes = made.subplots(rows, columns, squeeze=False, gridspec_kw=where, **shared)
    for axis, name in zip(axes.ravel(), names, strict=False):
        axis.set_title(name)
    return made, axes


def widen_below(made: Figure, by: float) -> None:
    """Make a figure higher by so many inches at its foot."""
    width, height = made.get_size_inches()
    taller = height + by
    for axes in made.axes:
        x, y, wide, high = axes.get_position().bounds
        box = (x, (y * height + by) / taller, wide, high * height / taller)
        axes.set_position(box)
    made.set_size_inches(width, taller)
    heading = getattr(made, "_suptitle", None)
    if heading is not None:
        heading.set_y(1 - EDGE / taller)


def scene(title: str) -> tuple[Figure, Any, Callable[[Any, str], Any]]:
    """Make a figure with axes in space, and what draws a scale beside them.

    Returns
    -------
    made : matplotlib.figure.Figure
    axes : Axes3D
    scale : callable
        Takes what is coloured and the scale's label.
    """
    heading = _heading(title)
    above = EDGE + (1 + heading.count("\n")) * HEADING * line_height()
    width = inches()
    high = SCENE_RATIO * width + 0.3
    height = high + above
    made = figure(height)
    made.set_layout_engine("none")
    made.suptitle(heading, y=1 - EDGE / height, va="top")
    room = SCALE_BESIDE / width
    axes = made.add_axes((0.0, 0.0, 1 - room, high / height), projection="3d")
    place = (1 - room, 0.22, SCALE / width, 0.5)
    return made, axes, functools.partial(_scale, made, place, upright=True)


#: Height of a figure in space over its width.
SCENE_RATIO = 0.55


def legend(made: Figure, *axes: Any, title: str = "", **look: Any) -> None:
    """Make the legend of some panels below all of them, where the figure gets room for it."""
    shown = legend_below(made, *axes, title=title, **({"loc": "lower center"} | look))
    size = float(matplotlib.rcParams["legend.fontsize"])
    rows = -(-len(shown.get_texts()) // max(shown._ncols, 1))
    more = max((t.get_text().count("\n") for t in shown.get_texts()), default=0)
    widen_below(made, (rows + more + bool(title) + 0.8) * 1.35 * size / POINTS)


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


def upright_scale(made: Figure, place: Any, mapped: Any, label: str) -> Any:
    """Make a scale at a place of the figure: left, bottom, width and height of it."""
    return _scale(made, place, mapped, label, upright=True)


def _scale(made: Figure, place: Any, mapped: Any, label: str, upright: bool) -> Any:
    """Make the axis of a linear scale; one image of its colours, where a colorbar has many."""
    axes: Any = made.add_axes(place, label="<colorbar>", axes_class=SharedTickAxes)
    low, high = mapped.get_clim()
    colours = np.linspace(low, high, SCALE_COLOURS)
    if upright:
        colours, extent, own, other = colours[:, None], (0, 1, low, high), axes.yaxis, axes.xaxis
        axes.yaxis.tick_right()
        axes.yaxis.set_label_position("right")
    else:
        colours, extent, own, other = colours[None], (low, high, 0, 1), axes.xaxis, axes.yaxis
    cells(axes, colours, extent, cmap=mapped.cmap, norm=Normalize(low, high))
    axes.spines[:].set(visible=True, linewidth=0.5)
    other.set_visible(False)
    axes.grid(False)
    chosen = ticks(4 if upright else 2 if narrow() else 3)
    own.set_major_locator(chosen)
    own.set_label_text(label)
    if not upright and np.isclose(chosen.tick_values(low, high)[0], low):
        set_numbers(own, [t for t in chosen.tick_values(low, high) if t <= high])
        own.begins = True  # another scale ends there
    return own


def in_turns(scale: Any) -> None:
    """Set numbers at the scale of phases."""
    box = scale.axes.get_position()
    short = scale.axis_name == "x" and box.width * scale.figure.get_figwidth() < 0.75
    set_numbers(scale, [-180.0, 0.0, 180.0], ["−180", "" if short else "0", "180"])
    scale.begins = scale.ends = True  # the next scale begins where this one ends


def runs_of(hertz: Array, gap: float = 2.5, fewest: int = 8) -> list[slice]:
    """Find the runs of neighbouring frequencies; a curve between two far lines tells nothing.

    Parameters
    ----------
    hertz : ndarray, shape (n,), ascending
    gap : float
        A step so many times wider than one beside it parts two runs.
    fewest : int
        Fewer frequencies than this are lines, each for itself.

    Examples
    --------
    >>> runs_of(np.array([1.0, 2, 3, 4, 5, 6, 7, 50, 51, 52]))
    [slice(0, 7, None), slice(7, 10, None)]
    """
    if len(hertz) < fewest:
        return [slice(i, i + 1) for i in range(len(hertz))]
    step = np.diff(hertz)
    beside = np.fmin(np.append(step[1:], np.inf), np.append(np.inf, step[:-1]))
    ends = [0, *(np.flatnonzero(step > gap * beside) + 1), len(hertz)]
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]
