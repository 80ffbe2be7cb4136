"""Where, and at which lines, a finite element model leaves more than noise: CoMAC, FRAC, CSAC.

Drawn is what a criterion is short of one, over what noise alone makes it short of: 1 where nothing
but noise is left over, at pixels that hardly move too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from sldvexp.dataset import FREQUENCY, VARIABLES, RunData, Source
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.selection import require
from sldvexp.typing import Array

PLACE = VARIABLES["model/image"]["position"]
NO_CRITERIA = "the run has no pixels that a finite element model was tested on; choose model=file"
#: Maps by the variable: their titles.
MAPS = {"comac": "1 − CoMAC", "frac": "1 − FRAC"}
#: Shortfalls over those of noise alone that the scale goes to, and a pixel's size, points squared.
LOW, HIGH, PIXEL = 1.0, 30.0, 2.0
TICKS = {1.0: "1", 3.0: "3", 10.0: "10", 30.0: "≥ 30"}


def unavailable_because(run: RunData) -> str:
    """Say why a run has no criteria to be drawn; empty if it has."""
    return "" if _pixels(run) else NO_CRITERIA


@style.styled
def model_criteria(source: Source | RunData) -> Figure:
    """Draw CoMAC and FRAC over the pixels of all views, and CSAC over the lines.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> corner = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0]])
    >>> seen = group("model/image", {"pixel": [0, 1, 2]}, position=corner, comac=[0.9, 0.99, 0.99],
    ...              comac_expected=[0.99, 0.99, 0.98])
    >>> [axes.get_title() for axes in model_criteria({"model/image/front": seen}).axes[:1]]
    ['1 − CoMAC']
    """
    run = RunData.from_source(source)
    require("model_criteria", unavailable_because(run))
    views = _pixels(run)
    maps = [name for name in MAPS if name in views[0]]
    lines = run.has("model", "csac", "csac_expected", "line_frequency")
    made = style.figure(2.4 + 1.9 * lines, "What the model leaves, over what noise leaves")
    places: list[Any] = [maps, ["csac"] * len(maps)] if lines else [maps]
    axes = made.subplot_mosaic(places)
    place = PLACE.factor * np.concatenate([v["position"].values for v in views])
    plane = np.sort(np.argsort(np.ptp(place, axis=0))[1:])
    for name in maps:
        ratio = np.concatenate([_ratio(v, name) for v in views])
        order = np.argsort(ratio)  # the worst on top
        look: dict[str, Any] = {
            "cmap": style.SIZE_MAP,
            "norm": LogNorm(LOW, HIGH),
            "rasterized": True,
        }
        x, y = place[order][:, plane].T
        drawn = axes[name].scatter(x, y, s=PIXEL, c=ratio[order], **look)
        labels = [f"{'xyz'[i]}, {PLACE.shown_unit}" for i in plane]
        axes[name].set(title=MAPS[name], xlabel=labels[0], ylabel=labels[1], aspect="equal")
    scale = made.colorbar(drawn, ax=[axes[name] for name in maps], label="times that of noise")
    scale.set_ticks(list(TICKS), labels=list(TICKS.values()))
    scale.minorticks_off()
    if lines:
        _over_lines(axes["csac"], run.groups["model"])
        style.legend_below(made, axes["csac"])
    return made


def _ratio(of: xr.Dataset, name: str) -> Array:
    """Compare what a criterion is short of one with what noise alone makes it short of."""
    short, noise = 1 - of[name].values, 1 - of[f"{name}_expected"].values
    return np.asarray(np.clip(short / np.where(noise > 0, noise, np.nan), LOW, HIGH))


def _over_lines(axes: Axes, model: xr.Dataset) -> None:
    """Draw CSAC over the frequency, beside that of noise alone."""
    hertz = model["line_frequency"].values
    curves: dict[str, tuple[str, dict[str, Any]]] = {
        "measured against the model": ("csac", {"color": style.COLOURS[3]}),
        "noise alone": ("csac_expected", {"color": style.COLOURS[-1], "linestyle": ":"}),
    }
    every = []
    for label, (name, look) in curves.items():
        short = 1 - model[name].values
        every.append(short[short > 0])
        for part in style.runs_of(hertz):
            axes.plot(hertz[part], short[part], label=label, **look)
    least = np.concatenate(every)
    if least.size:
        axes.set_yscale("log")
        ends = 0.7 * least.min(), 1.5 * least.max()
        axes.set_ylim(*ends)
        style.decades(axes.yaxis, *ends)
    axes.set(xlabel=FREQUENCY.titled(), ylabel="1 − CSAC")


def _pixels(run: RunData) -> list[xr.Dataset]:
    """List the views' pixels that see the model."""
    known = run.below("model/image", "position", "comac", "comac_expected")
    return list(known.values())
