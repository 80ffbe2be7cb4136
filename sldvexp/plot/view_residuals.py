"""What a field leaves of every view's velocities (Figure 5.12, Table 5.8)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sldvexp.dataset import FREQUENCY, VARIABLES, RunData, Source
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.selection import require

NO_RESIDUALS = (
    "the run has no residuals of a field by view (group field, variable residual_std_by_view); "
    "choose a volume and a reconstruction, as in experiment=plate"
)

NAME = "residual_std_by_view"
RESIDUAL = VARIABLES["field"][NAME]

#: More frequencies than this are drawn as curves.
FEW = 4
#: Height of a panel, inch.
PANEL = 1.5


def unavailable_because(run: RunData) -> str:
    """Explain why no residuals can be shown; empty if they can."""
    return "" if _of(run) else NO_RESIDUALS


@style.styled
def residuals(source: Source | RunData) -> Figure:
    """Draw the r.m.s. residual of every view, for the field and those it is compared with.

    Bars by view, hatched by field, for a few frequencies; curves over the frequency for many.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> place = np.zeros((6, 3))
    >>> rms = [1e-4, 2e-4]
    >>> solved = group("field", {"view": ["front", "left"]}, velocity=place, position=place,
    ...                element=[[0, 1, 2, 3, 4, 5]], residual_std_by_view=rms)
    >>> residuals({"field": solved}).axes[0].get_ylabel()
    'r.m.s. residual, µm/s'
    """
    run = RunData.from_source(source)
    require("residuals", unavailable_because(run))
    found = _of(run)
    first = next(iter(found.values()))
    count = first.sizes.get("frequency", 1)
    many = count > FEW
    rows = len(found) if many else count
    named = many or "frequency" in first.coords
    ratio = PANEL / (style.inches() - style.LEFT)
    room: dict[str, Any] = {"between": style.LOW if named else style.LOW / 2, "sharex": True}
    made, panels = style.sheet(rows, 1, ratio, "Residuals by view", **room)
    axes = panels[:, 0]
    every = np.concatenate([f.values.ravel() for f in found.values()])
    factor, unit = style.prefixed(every, style.SPEED)
    if many:
        for axis, (name, array) in zip(axes, found.items(), strict=True):
            _curves(axis, array, factor)
            axis.set_ylabel(f"{RESIDUAL.label}, {unit}")
            axis.set_title(name)
    else:
        for k, axis in enumerate(axes):
            here = {n: v.isel(frequency=k, missing_dims="ignore") for n, v in found.items()}
            _bars(axis, here, factor)
            axis.set_ylabel(f"{RESIDUAL.label}, {unit}")
            if "frequency" in first.coords:
                axis.set_title(f"{float(first['frequency'][k]):g} {FREQUENCY.units}")
    axes[-1].set_xlabel(FREQUENCY.titled() if many else "view")
    if many or len(found) > 1:
        style.legend(made, axes[0], title="view" if many else "field")
    return made


def _of(run: RunData) -> dict[str, xr.DataArray]:
    return {k: g[NAME] for k, g in run.fields().items() if NAME in g}


def _bars(axes: Axes, found: dict[str, xr.DataArray], factor: float) -> None:
    """Draw a bar for each view and field; a field that leaves a view out has none there."""
    names = list(dict.fromkeys(str(v) for f in found.values() for v in f["view"].values))
    width = 0.8 / len(found)
    for k, (name, array) in enumerate(found.items()):
        place = [
            names.index(str(v)) + (k - (len(found) - 1) / 2) * width for v in array["view"].values
        ]
        axes.bar(
            place,
            factor * array.values,
            0.9 * width,
            color="#ffffff" if k % 2 else "#d9e6f2",
            edgecolor="#333333",
            hatch=style.HATCHES[k % len(style.HATCHES)],
            linewidth=0.8,
            label=name,
        )
    style.set_numbers(axes.xaxis, np.arange(len(names)), names)
    axes.grid(False, axis="x")


def _curves(axes: Axes, array: xr.DataArray, factor: float) -> None:
    """Draw a curve for each view over the frequency."""
    hertz = array["frequency"].values
    for name, look in zip(array["view"].values, style.looks(array.sizes["view"]), strict=True):
        values = factor * array.sel(view=name).values
        for run in style.runs_of(np.asarray(hertz, float)):
            every = max(1, len(hertz) // 12)
            axes.plot(hertz[run], values[run], label=str(name), markevery=every, **look)
