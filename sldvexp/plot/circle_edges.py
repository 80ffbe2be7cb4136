"""Edge points of the calibration object's circles, and the ellipses through them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sldvexp.dataset import VARIABLES, RunData, Source
from sldvexp.geometry import ConicFit
from sldvexp.geometry.conic import boundary
from sldvexp.image import dac_from_pinhole, fit_circle, pinhole_edges
from sldvexp.plot import as_seen, style
from sldvexp.plot.selection import one_of, require
from sldvexp.session.circles import edges_of
from sldvexp.typing import Array

NO_EDGES = (
    "the run has no edges of circles (groups edge/<view>); they come from a scan of a calibration "
    "object, as in experiment=dissertation/automated_pose"
)

#: Readings of the mirrors, and the axes of a picture by them.
DAC = VARIABLES["edge"]["dac"]
ACROSS_AND_UP = style.mirror_labels(DAC)

#: Views beside each other.
COLUMNS = 3

#: Degrees around a circle from its number to the next circle's.
TURN_BESIDE = 450.0

TURN = np.linspace(0.0, 2.0 * np.pi, 181)


def unavailable_because(run: RunData) -> str:
    """Explain why no edges can be shown; empty if they can."""
    return "" if run.below("edge", "dac", "circle") else NO_EDGES


@style.styled
def edges(source: Source | RunData, view: str | None = None) -> Figure:
    """Draw edge points of all circles, a panel for each view (Figure 4.22, seen by the beam).

    Parameters
    ----------
    view : str, optional
        Only this one.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> dac = [[100, 80], [120, 100], [100, 120], [80, 100]]
    >>> edge = group("edge", {}, dac=dac, dac_std=np.full(4, 0.1), circle=np.ones(4, int))
    >>> edges({"edge/front": edge}).axes[0].get_title()
    'view front: 4 edges ± 0.1 steps (median)'
    """
    run = RunData.from_source(source)
    require("edges", unavailable_because(run))
    views = run.below("edge", "dac", "circle")
    if view is not None:
        view = one_of(view, views, "edges", "view")
        views = {view: views[view]}
    ratio = ratio_of([group["dac"].values for group in views.values()])
    titles = [_edges_told(name, group) for name, group in views.items()]
    steps = np.concatenate([group["dac"].values[:, 0] for group in views.values()])
    more = max(style.long(f"{step:.0f}", style.LABEL) for step in (steps.min(), steps.max()))
    more = max(more - style.long("0000", style.LABEL), 0.0)
    made, axes = panels_of_views(ratio, "Edge points of the circles", titles, more=more)
    for axis, (name, group) in zip(axes.ravel(), views.items(), strict=False):
        numbers = sorted((number, centre) for centre, number in circle_numbers(run, name).items())
        for (number, centre), look in zip(numbers, style.looks(len(numbers)), strict=True):
            up_down, left_right = group["dac"].values[group["circle"].values == centre].T
            look |= {"linestyle": "none", "markersize": 2, "markeredgewidth": 0.5}
            axis.plot(left_right, up_down, label=str(number), fillstyle="none", **look)
        axis.set_aspect("equal", adjustable="datalim")
        as_seen.turn(axis, as_seen.ways_of(run))
    style.outer_labels(axes, len(views), *ACROSS_AND_UP)
    style.legend(made, *axes.ravel()[: len(views)], title="circle", markerscale=2)
    return made


def ratio_of(dac: Sequence[Array]) -> float:
    """Tell how high a typical view's DAC steps, (n, 2), are over how wide, within limits."""
    high, wide = np.array([np.ptp(steps, axis=0) for steps in dac]).T
    return float(np.clip(np.median(high / np.maximum(wide, 1)), 0.5, 1.2))


def _edges_told(name: str, group: Any) -> str:
    error = float(np.nanmedian(group["dac_std"])) if np.isfinite(group["dac_std"]).any() else 0.0
    known = f" ± {error:.2g} steps (median)" if error > 0 else ""
    return f"view {name}: {len(group['circle'])} edges{known}"


def panels_of_views(
    ratio: float,
    title: str,
    titles: Sequence[str],
    least: float = 1.6,
    more: float = 0.0,
    **shared: Any,
) -> tuple[Figure, NDArray[Any]]:
    """Make a sheet with a titled panel for each view, at least so many inches wide.

    Parameters
    ----------
    more : float, inch
        Room for numbers at the left of panels beyond that of four digits.
    """
    number = len(titles)
    columns = style.fitting(min(number, COLUMNS), least)
    beside, left = style.NUMBERS + more, style.LEFT + more
    room: dict[str, Any] = {"beside": beside, "left": left, "right": 0.15, **shared}
    made, axes = style.sheet(-(-number // columns), columns, ratio, title, titles, **room)
    for axis in axes.ravel()[number:]:
        axis.remove()
    return made, axes


@style.styled
def conics(source: Source | RunData, view: str | None = None) -> Figure:
    """Draw ellipses through one view's edges, and their residuals (Figures 4.23 and 4.24).

    They are fitted where the image of a circle is an ellipse (`sldvexp.image.pinhole`) if the run
    tells its laser, otherwise in DAC steps.

    Parameters
    ----------
    view : str, optional
        Without it the first.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> turn, one = np.linspace(0.0, 6.0, 12), np.ones(12)
    >>> out = np.column_stack([np.sin(turn), np.cos(turn)])
    >>> edge = group("edge", {}, dac=100 + 20 * out, dac_std=0.1 * one, direction=out,
    ...              width=2 * one, phase=0 * one, circle=one.astype(int))
    >>> edge.attrs["summary"] = "circle 1: 12 edges"
    >>> conics({"edge/front": edge}).axes[1].get_title()
    'χ² 0, 7 dof'
    """
    run = RunData.from_source(source)
    require("conics", unavailable_because(run))
    view = one_of(view, run.below("edge", "dac", "circle"), "conics", "view")
    fits = fitted(run, view)
    columns = style.fitting(len(fits), 1.5)
    blocks = -(-len(fits) // columns)
    high = 0.7 + 3.7 * blocks
    made = style.figure(high, f"Ellipses through the edges of view {view}")
    ratios = [1.2, 1.0] * blocks
    grid = made.subplots(2 * blocks, columns, squeeze=False, height_ratios=ratios)
    above, below = grid[::2].ravel(), grid[1::2].ravel()
    for upper, lower, (number, fit) in zip(above, below, fits.items(), strict=False):
        _ellipse(upper, fit[2], fit[3], fit[0])
        as_seen.turn(upper, as_seen.ways_of(run))
        upper.set_title(f"circle {number}")
        _residuals(lower, fit[1], fit[0])
    for axis in (*above[len(fits) :], *below[len(fits) :]):
        axis.remove()
    for axis in grid[::2, 0]:
        axis.set_ylabel(ACROSS_AND_UP[1])
    for axis in grid[1::2, 0]:
        axis.set_ylabel(DAC.titled("distance"))
    style.alike(below[: len(fits)])
    style.legend_below(made, *above[: len(fits)], *below[: len(fits)])
    return made


@style.styled
def conic_residuals(source: Source | RunData) -> Figure:
    """Draw distances of all edges from the ellipses through them, view by view (Figure 4.24).

    Beside a circle's number stand its edges in the order of their direction from its centre as
    seen, from -180 to 180 deg, 0 to the right, 90 up, as `conics` shows them of one view.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> turn, one = np.linspace(0.0, 6.0, 12), np.ones(12)
    >>> out = np.column_stack([np.sin(turn), np.cos(turn)])
    >>> edge = group("edge", {}, dac=100 + 20 * out, dac_std=0.1 * one, direction=out,
    ...              width=2 * one, phase=0 * one, circle=one.astype(int))
    >>> edge.attrs["summary"] = "circle 1: 12 edges"
    >>> conic_residuals({"edge/front": edge}).axes[0].get_title()
    'view front: χ² 0 of 7 degrees of freedom'
    """
    run = RunData.from_source(source)
    require("conic_residuals", unavailable_because(run))
    views = run.below("edge", "dac", "circle")
    shared = {"sharex": True, "sharey": True}
    title = "Edges around every circle: distances from the ellipse"
    found = {name: fitted(run, name) for name in views}
    titles = [f"view {name}: {_fits_told(fits)}" for name, fits in found.items()]
    made, axes = panels_of_views(0.62, title, titles, **shared)
    for axis, fits in zip(axes.ravel(), found.values(), strict=False):
        axis.axhline(0.0, color=style.COLOURS[-1], linewidth=0.8)
        for number, (fit, turn, _, _) in fits.items():
            _distances(axis, number + turn / TURN_BESIDE, fit, {"capsize": 0, "elinewidth": 0.6})
        axis.set_xticks(list(fits))
    style.outer_labels(axes, len(views), "circle", DAC.titled("distance"))
    style.legend(made, *axes.ravel()[: len(views)])
    return made


def _fits_told(fits: dict[int, tuple[ConicFit, Array, Array, Array]]) -> str:
    square, dof = (sum(getattr(f[0], n) for f in fits.values()) for n in ("chi_square", "dof"))
    return f"χ² {square:.0f} of {dof} degrees of freedom"


def fitted(run: RunData, view: str) -> dict[int, tuple[ConicFit, Array, Array, Array]]:
    """Find each circle's fit, the edges' turn around it as seen, the edges and the curve, steps."""
    laser, ways, numbers = as_seen.laser_of(run), as_seen.ways_of(run), circle_numbers(run, view)
    found = {}
    for centre, edge in enumerate(edges_of(run.groups[f"edge/{view}"]), 1):
        fit, moved = fit_circle(pinhole_edges(laser, edge) if laser else edge)
        curve = boundary(fit.ellipse.parameters, TURN)[0]
        away = moved.position - fit.ellipse.centre
        turn = as_seen.from_the_right(away, ways)
        curve = dac_from_pinhole(laser, curve) if laser else curve
        points = dac_from_pinhole(laser, moved.position) if laser else moved.position
        found[numbers[centre]] = (fit, turn, points, curve)
    return dict(sorted(found.items()))


def circle_numbers(run: RunData, view: str) -> dict[int, int]:
    """Tell the number of the circle that each rough centre of a view showed.

    That of the rough centre where the pose of the view, which tells it, is not known.
    """
    centres = np.unique(run.groups[f"edge/{view}"]["circle"].values).tolist()
    numbers = {int(k): int(k) for k in centres}
    if run.has("pose", "rough_centre") and view in run.groups["pose"]["view"].values:
        shown = run.groups["pose"]["rough_centre"].sel(view=view)
        numbers |= {int(k): int(n) for n, k in zip(shown["circle"], shown, strict=True)}
    return numbers


def _ellipse(axes: Axes, points: Array, curve: Array, fit: ConicFit) -> None:
    axes.plot(curve[:, 1], curve[:, 0], color=style.COLOURS[1], label="ellipse")
    for used, marker, name in ((True, "o", "edge"), (False, "x", "outlier")):
        some = points[fit.used == used]
        if len(some):
            look: dict[str, Any] = {"color": style.COLOURS[0], "markersize": 3, "fillstyle": "none"}
            axes.plot(some[:, 1], some[:, 0], marker, label=name, **look)
    axes.set_aspect("equal")
    axes.set_xlabel(ACROSS_AND_UP[0])
    axes.xaxis.set_major_locator(style.ticks(3))


def _distances(axes: Axes, place: Array, fit: ConicFit, look: dict[str, Any]) -> None:
    """Draw distances of edges from their ellipse, with their standard errors."""
    own_look: dict[str, Any] = {
        "color": style.COLOURS[0],
        "ecolor": style.COLOURS[-1],
        "markersize": 3,
    }
    for used, marker, name in ((True, "o", "edge"), (False, "x", "outlier")):
        own = fit.used == used
        if own.any():
            values = place[own], fit.residual[own], fit.residual_std[own]
            label = f"{name} ± standard error"
            axes.errorbar(*values, fmt=marker, label=label, **(own_look | look))


def _residuals(axes: Axes, turn: Array, fit: ConicFit) -> None:
    axes.axhline(0.0, color=style.COLOURS[-1], linewidth=0.8)
    _distances(axes, turn, fit, {})
    axes.set_title(f"χ² {fit.chi_square:.0f}, {fit.dof} dof")
    axes.set(xlabel="direction, deg", xticks=[-180, 0, 180])
