"""The runs of a sweep side by side."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from sldvexp.dataset import RunData, Source
from sldvexp.dataset.run_data import ABOUT
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.paper import long
from sldvexp.plot.selection import require

NO_SWEEP = "this is no sweep (a dataset sweep.nc with state and headline results of its runs)"
NO_RESULT = "no run of the sweep has a result that can be compared"

#: Round a run that did not meet what was expected of it.
RING: dict[str, Any] = {
    **{"linestyle": "none", "marker": "o", "markersize": 10.0},
    **{"markerfacecolor": "none", "markeredgecolor": "#000000"},
}
MISSED = "missed an expectation"
#: More curves in a panel than this cannot be told apart, nor more panels be read.
MOST = 12


#: Inches that the name of an axis may be long.
LONGEST = 1.4


class Panel(NamedTuple):
    """One panel: its title, the name of its axis, and numbers over the swept keys."""

    title: str
    label: str
    values: xr.DataArray
    error: xr.DataArray | None


def unavailable_because(run: RunData) -> str:
    """Explain why no sweep can be shown; empty if one can."""
    if not run.has("", "state"):
        return NO_SWEEP
    return "" if _results(run.groups[""]) else NO_RESULT


@style.styled
def sweep(source: Source | RunData, quantity: str | None = None) -> Figure:
    """Draw a headline result of all runs by the first swept key; the others tell curves apart.

    Parameters
    ----------
    source : Dataset or others
        A sweep's dataset, see `sldvexp.dataset.run_data.shown`.
    quantity : str, optional
        Such as ``point.velocity_std``; without it what the sweep is ranked by.

    Returns
    -------
    matplotlib.figure.Figure
        With a panel for each component of the result, r.m.s. over its frequencies.

    Examples
    --------
    >>> import xarray as xr
    >>> state, sse = ("seed", ["done", "done"]), ("seed", [1.0, 1.5])
    >>> table = xr.Dataset({"point.sse": sse, "state": state}, {"seed": [1, 2]})
    >>> sweep(table, "point.sse").get_suptitle()
    'point.sse of 2 runs'
    """
    run = RunData.from_source(source)
    require("sweep", unavailable_because(run))
    table = run.groups[""]
    results = _results(table)
    if quantity is None:
        ranked = str(table.attrs.get("ranked_by", ""))
        quantity = ranked if ranked in results else results[0]
    if quantity not in results:
        raise UserError(f"plot: sweep: there is no result {quantity}; {nearest(quantity, results)}")
    keys = [str(d) for d in table["state"].dims]
    panels = _panels(table, quantity, keys)
    empty = int(_empty(table[quantity], keys).sum())
    title = f"{quantity} of {table['state'].size} runs"
    title += f" ({empty} without a result)" if empty else ""
    made = style.figure(1.1 + 1.7 * len(panels), title)
    axes = made.subplots(len(panels), 1, squeeze=False, sharex=True)[:, 0]
    for axis, panel in zip(axes, panels, strict=True):
        _curves(axis, panel, keys, table["state"] == "missed")
        axis.set_title(panel.title)
        axis.set_ylabel(_in_lines(panel.label))
    axes[-1].set_xlabel(keys[0])
    if axes[0].get_legend_handles_labels()[1]:
        style.legend_below(made, axes[0], title=", ".join(keys[1:]), columns=3)
    return made


def _in_lines(label: str) -> str:
    """Break a long name behind its last point, so that it is no longer than its panel."""
    head, point, tail = label.rpartition(".")
    return f"{head}{point}\n{tail}" if long(label, style.LABEL) > LONGEST else label


def _empty(result: xr.DataArray, keys: list[str]) -> xr.DataArray:
    """Find runs that have no number of a result."""
    known = xr.apply_ufunc(np.isfinite, result)
    return ~known.any([d for d in known.dims if d not in keys])


def _results(table: xr.Dataset) -> list[str]:
    """Find names of results with at least one number."""
    return [
        str(name)
        for name, variable in table.data_vars.items()
        if name not in ABOUT
        and variable.dtype.kind in "fciub"
        and np.isfinite(np.abs(variable.values)).any()
    ]


def shown_unit(result: xr.DataArray) -> tuple[float, str]:
    """Choose factor and unit in which a result of a sweep is shown.

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> shown_unit(xr.DataArray([3e-4, 5e-5], attrs={"units": "m/s"}))
    (1000000.0, 'µm/s')
    """
    unit = str(result.attrs.get("units", "1"))
    return style.prefixed(result.values, unit) if unit in ("m/s", "m", "rad") else (1.0, unit)


def _panels(table: xr.Dataset, quantity: str, keys: list[str]) -> list[Panel]:
    """Make a panel for each entry along the result's first dimension, r.m.s. over the others."""
    result = table[quantity]
    name = f"{quantity}_std"
    # not table.get: with a coordinate pose, pose.s_std would be looked for as its attribute
    error = table[name] if name in table.variables else None
    factor, unit = shown_unit(result)
    if np.iscomplexobj(result.values):
        result = abs(result)
    first, *others = [d for d in result.dims if d not in keys] or [None]
    over = ""
    if others:
        result = (result**2).mean(others) ** 0.5
        error, over = None, f"r.m.s. over {' and '.join(map(str, others))}"
    label = quantity if unit == "1" else f"{quantity}, {unit}"
    if first is None:
        return [Panel("", label, factor * result, None if error is None else factor * error)]
    panels = []
    for i in range(min(result.sizes[first], MOST)):
        entry = result[first].values[i] if first in result.coords else i
        own_error = None if error is None else factor * error.isel({first: i})
        title = style.joined(f"{first} {entry}", over)
        panels.append(Panel(title, label, factor * result.isel({first: i}), own_error))
    return panels


def _curves(axes: Any, panel: Panel, keys: list[str], missed: xr.DataArray) -> None:
    """Draw a curve for each combination of the other keys; runs that missed have a ring."""
    values, (along, *others) = panel.values, keys
    ticks = values[along].values if along in values.coords else np.arange(values.sizes[along])
    numbers = np.issubdtype(ticks.dtype, np.number) and len(ticks) > 1
    place = ticks.astype(float) if numbers else np.arange(len(ticks), dtype=float)
    combinations = list(np.ndindex(*(values.sizes[d] for d in others)))[:MOST]
    aside = 0.0 if numbers or len(combinations) == 1 else 0.3
    shifts = np.linspace(-aside, aside, len(combinations))
    looks = style.looks(len(combinations))
    for index, look, shift in zip(combinations, looks, shifts, strict=True):
        where = dict(zip(others, index, strict=True))
        error = None if panel.error is None else panel.error.isel(where).values
        look |= {} if numbers else {"linestyle": "none"}
        label = ", ".join(str(values[d].values[i]) for d, i in where.items())
        own = values.isel(where).values
        axes.errorbar(place + shift, own, error, label=label, **look)
        ringed = missed.isel(where).values & np.isfinite(own)
        if ringed.any():
            axes.plot((place + shift)[ringed], own[ringed], label=MISSED, **RING)
    if ticks.dtype.kind in "iu" and len(ticks) > 1:
        axes.xaxis.set_major_locator(style.whole_numbers())
    if not numbers:
        axes.set_xticks(place, [str(t) for t in ticks])
        axes.margins(x=0.15)
    if np.nanmin(values.values, initial=np.inf) >= 0:
        axes.set_ylim(0.0, 1.15 * max(axes.get_ylim()[1], np.finfo(float).tiny))
