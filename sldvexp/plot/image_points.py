"""Image points of the calibration object: bitangents, residuals of the pose, repeatability."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sldvexp.dataset import AXES, VARIABLES, RunData, Source
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.plot import as_seen, style
from sldvexp.plot.circle_edges import ACROSS_AND_UP, COLUMNS, DAC, fitted, panels_of_views, ratio_of
from sldvexp.plot.paper import broken
from sldvexp.plot.selection import one_of, require

NO_POINTS = (
    "the run has no image points of the object (group registration); they come from pose=bitangent "
    "or registration data"
)
NO_PAIRS = "the image points are not four for each pair of circles, as pose=bitangent makes them"
NO_RESIDUALS = (
    "the run has no residuals of a pose (group pose, variable residual or residual_rms); choose a "
    "pose that is adjusted, as pose=bitangent"
)
NO_REPEATS = (
    "the run does not repeat a pose's image points (a check=repeatability with its registration); "
    "see experiment=dissertation/repeatability"
)

POSE = VARIABLES["pose"]
MIRRORS = {name: name.replace("_", "-") for name in reversed(AXES["mirror"])}
#: Height of the panel of all views, inch.
PANEL = 2.0


def unavailable_because(run: RunData) -> str:
    """Explain why no bitangent points can be shown; empty if they can."""
    if not run.has("registration", "dac"):
        return NO_POINTS
    scanned = run.below("edge", "dac")
    return "" if scanned and run.groups["registration"].sizes["point"] % 4 == 0 else NO_PAIRS


def residuals_unavailable_because(run: RunData) -> str:
    """Explain why no residuals can be shown; empty if they can."""
    return "" if run.has("pose", "residual") or run.has("pose", "residual_rms") else NO_RESIDUALS


def repeats_unavailable_because(run: RunData) -> str:
    """Explain why no repeatability can be shown; empty if it can."""
    found = run.below("examined", "dac_std") and run.has("registration", "dac")
    return "" if found else NO_REPEATS


@style.styled
def bitangents(source: Source | RunData, view: str | None = None) -> Figure:
    """Draw bitangent points, their tangents and the ellipses that they touch, view by view.

    Parameters
    ----------
    view : str, optional
        Only this one.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> points = {"view": ["front"], "point": [1, 2, 3, 4]}
    >>> registration = group("registration", points, dac=[[[0, 0], [0, 9], [5, 9], [5, 0]]])
    >>> edge = group("edge", {}, dac=[[5.0, 1.0]])  # of another view, whose points are not drawn
    >>> bitangents({"registration": registration, "edge/left": edge}).axes[0].get_title()
    'view front'
    """
    run = RunData.from_source(source)
    require("bitangents", unavailable_because(run))
    group = run.groups["registration"]
    views = [str(v) for v in group["view"].values]
    if view is not None:
        views = [one_of(view, views, "bitangents", "view")]
    ratio = ratio_of([group["dac"].sel(view=name).values for name in views])
    titles = [f"view {name}" for name in views]
    made, axes = panels_of_views(ratio, "Bitangent points of the circles", titles, 2.6)
    for axis, name in zip(axes.ravel(), views, strict=False):
        _touching(axis, run, name)
    style.outer_labels(axes, len(views), *ACROSS_AND_UP)
    style.legend(made, axes[0, 0])
    return made


def _touching(axes: Axes, run: RunData, view: str) -> None:
    """Draw the ellipses of one view, and the tangents from point to point."""
    points = run.groups["registration"].sel(view=view)
    if f"edge/{view}" in run.groups:
        for _, _, _, curve in fitted(run, view).values():
            axes.plot(curve[:, 1], curve[:, 0], color=style.COLOURS[1], label="ellipse")
    dac = points["dac"].values
    for four in dac.reshape(-1, 4, 2):
        for ends in (four[[0, 2]], four[[1, 3]]):
            axes.plot(ends[:, 1], ends[:, 0], "--", color=style.COLOURS[-1], label="bitangent")
    axes.plot(dac[:, 1], dac[:, 0], "o", color=style.COLOURS[3], label="bitangent point")
    ways = as_seen.ways_of(run)
    _number(axes, dac, points["point"].values, ways)
    axes.margins(0.12)
    axes.set_aspect("equal", adjustable="datalim")
    as_seen.turn(axes, ways)


def _number(axes: Axes, dac: np.ndarray, numbers: np.ndarray, ways: tuple[int, int]) -> None:
    """Write a point's number beside it, on the side away from the middle of its neighbours."""
    for k, (place, number) in enumerate(zip(dac, numbers, strict=True)):
        near = np.argsort(np.linalg.norm(dac - place, axis=1))[1:4]
        away = place - dac[near].mean(axis=0)
        away = (away * ways)[::-1] * (-1, 1) / (np.linalg.norm(away) or 1.0)  # right and up
        axes.annotate(
            str(number),
            place[::-1],
            xytext=tuple(8.5 * away),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize="small",
            gid=f"point-{k}",
        )


@style.styled
def pose_residuals(source: Source | RunData) -> Figure:
    """Draw what the poses leave at the image points; by view, if that is all there is.

    Error bars are the standard deviation of a mirror reading, s.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> pose = group("pose", {"view": ["front", "left"]}, residual_rms=[0.2, 0.3], s=[0.25, 0.35])
    >>> pose_residuals({"pose": pose}).axes[0].get_ylabel()
    'DAC steps'
    """
    run = RunData.from_source(source)
    require("pose_residuals", residuals_unavailable_because(run))
    pose = run.groups["pose"]
    return _by_point(pose) if "residual" in pose else _by_view(pose)


def _by_point(pose: xr.Dataset) -> Figure:
    """Draw residuals of both mirrors, a panel for each view."""
    names = [str(v) for v in pose["view"].values]
    columns = style.fitting(min(len(names), COLUMNS), 2.1)
    rows = -(-len(names) // columns)
    made = style.figure(0.8 + 1.7 * rows, "Residuals of the pose: observed minus predicted")
    axes = made.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    numbers = np.arange(pose.sizes["point"]) + 1
    labels = pose["point"].values if "point" in pose.coords else numbers
    for axis, name in zip(axes.ravel(), names, strict=False):
        one = pose.sel(view=name)
        s = float(one["s"]) if "s" in one else np.nan
        axis.axhline(0.0, color=style.COLOURS[-1], linewidth=0.8)
        for (mirror, text), look, shift in zip(
            MIRRORS.items(), style.looks(2), (-0.12, 0.12), strict=True
        ):
            values = one["residual"].sel(mirror=mirror).values
            look["linestyle"] = "none"
            error = None if np.isnan(s) else np.full(len(values), s)
            axis.errorbar(numbers + shift, values, error, label=text, **look)
        rms = float(one["residual_rms"]) if "residual_rms" in one else np.nan
        told = f"view {name}: r.m.s. {rms:.3g}, s {s:.3g} steps"
        axis.set_title(broken(told, 0.8 * style.inches() / columns))
        axis.xaxis.set_major_locator(style.whole_numbers())
        if not np.array_equal(labels, numbers) and len(labels) <= 30:
            axis.set_xticks(numbers, [str(n) for n in labels])
    for axis in axes.ravel()[len(names) :]:
        axis.remove()
    style.outer_labels(axes, len(names), "point", POSE["residual"].titled())
    style.legend_below(made, axes[0, 0])
    return made


def _by_view(pose: xr.Dataset) -> Figure:
    """Draw root mean square residual of each view, where no points are known."""
    names = [str(v) for v in pose["view"].values]
    ratio = PANEL / (style.inches() - style.LEFT)
    # no panel has a title, for which a sheet has room
    above = -style.LOW
    made, ((axes,),) = style.sheet(1, 1, ratio, "Residuals of the poses by view", above=above)
    place = np.arange(len(names))
    known = {"residual_rms": "r.m.s. residual", "s": "s, of a mirror reading"}
    for (key, text), look, aside in zip(known.items(), style.looks(2), (-0.1, 0.1), strict=True):
        if key in pose:
            look["linestyle"] = "none"
            values = pose[key].values
            # the relative standard error of a standard deviation with so many degrees of freedom
            error = values / np.sqrt(2.0 * pose["dof"].values) if "dof" in pose else None
            axes.errorbar(place + aside, values, error, label=text, markersize=6, **look)
    style.set_numbers(axes.xaxis, place, names)
    axes.set(xlabel="view", ylabel=POSE["s"].shown_unit)
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.1)
    style.legend(made, axes)
    return made


@style.styled
def repeatability(source: Source | RunData) -> Figure:
    """Draw how repeated image points scatter, of both mirrors (Figures 4.25 to 4.27).

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> dac = np.array([[[10, 20], [30, 40]], [[12, 20], [30, 41]]])
    >>> points = group("registration", {"view": ["1", "2"], "point": [1, 2]}, dac=dac)
    >>> std = dac.std(axis=0, ddof=1)
    >>> found = group("examined/repeatability", {"point": [1, 2]}, dac_std=std, largest=std.max())
    >>> figure = repeatability({"registration": points, "examined/again": found})
    >>> figure.axes[2].get_ylabel().split()
    ['standard', 'deviation,', 'DAC', 'steps']
    """
    run = RunData.from_source(source)
    require("repeatability", repeats_unavailable_because(run))
    group = run.groups["registration"]
    examined = next(iter(run.below("examined", "dac_std").values()))
    names = [str(v) for v in group["view"].values]
    numbers = np.arange(group.sizes["point"]) + 1
    made = style.figure(6.6, f"Image points of {len(names)} repeated scans of one pose")
    axes = made.subplots(3, 1, sharex=True)
    for axis, (mirror, text) in zip(axes, MIRRORS.items(), strict=False):
        dac = group["dac"].sel(mirror=mirror)
        away = dac - dac.mean("view")
        axis.axhline(0.0, color=style.COLOURS[-1], linewidth=0.8)
        shift = np.linspace(-0.3, 0.3, len(names))
        for name, look, aside in zip(names, style.looks(len(names)), shift, strict=True):
            look["linestyle"] = "none"
            told = name if "scan" in name else f"scan {name}"
            axis.plot(numbers + aside, away.sel(view=name).values, label=told, **look)
        axis.set_ylabel(broken(DAC.titled(f"{text} minus mean"), 1.4))
    _scatter(axes[2], examined, len(names), numbers)
    every = 2 if style.narrow() and len(numbers) > 9 else 1
    labels = [str(n) for n in group["point"].values]
    axes[2].set_xticks(numbers[::every], labels[::every])
    axes[2].set_xlabel("point")
    style.legend_below(made, axes[0], axes[2])
    return made


def _scatter(axes: Axes, examined: xr.Dataset, repeats: int, numbers: np.ndarray) -> None:
    """Draw standard deviations, with the 95 % intervals that chi square gives them."""
    dof = repeats - 1
    low, high = np.sqrt(dof / scipy.special.chdtri(dof, [0.025, 0.975]))
    for (mirror, text), look, shift in zip(
        MIRRORS.items(), style.looks(2), (-0.12, 0.12), strict=True
    ):
        std = examined["dac_std"].sel(mirror=mirror).values
        look["linestyle"] = "none"
        error = np.stack([std * (1.0 - low), std * (high - 1.0)])
        axes.errorbar(numbers + shift, std, error, label=f"{text}, 95% interval", **look)
    axes.set_ylabel(broken(DAC.titled("standard deviation"), 1.4))
    axes.set_ylim(bottom=0.0)
