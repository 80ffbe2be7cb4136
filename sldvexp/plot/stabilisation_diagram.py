"""Poles of all orders with the modes that they made, over what was measured and what is left."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sldvexp.dataset import FREQUENCY, RunData, Source
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.selection import require
from sldvexp.typing import Array

NO_MODES = "the run has no modes (group modes); choose modal=own, as in experiment=plate_modes"
NEEDED = ("candidate_frequency", "candidate_order", "candidate_stable", "candidate_mode")

#: Poles by what became of them: label, look, and how the mode's number and stability tell them.
POLES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("pole of one order", {"marker": "x", "color": style.COLOURS[-1], "markersize": 2.5}),
    ("stable pole of no mode", {"marker": "o", "color": style.COLOURS[4], "markersize": 2.5}),
    ("pole of a mode", {"marker": "o", "color": style.COLOURS[1], "markersize": 3.2}),
)
#: Root mean squares over all pixels by what they are of, with their look.
CURVES: dict[str, tuple[str, dict[str, Any]]] = {
    "measured_rms": ("measured", {"color": style.COLOURS[0], "linewidth": 1.4}),
    "synthesis_rms": ("sum of the modes", {"color": style.COLOURS[2], "linestyle": "--"}),
    "residual_rms": ("left over", {"color": style.COLOURS[3], "linewidth": 0.8}),
    "noise_rms": ("stated noise", {"color": style.COLOURS[-1], "linestyle": ":"}),
}
LINE: dict[str, Any] = {"color": style.COLOURS[5], "linewidth": 0.7}
#: Inches of the figure's width for the number of a mode.
NUMBER = 0.3


def unavailable_because(run: RunData) -> str:
    """Explain why no poles can be shown; empty if they can."""
    return "" if run.has("modes", "natural_frequency", *NEEDED) else NO_MODES


@style.styled
def stabilisation(source: Source | RunData) -> Figure:
    """Draw poles by order over the frequency, and below them the spectra that modes explain.

    Lines through both stand at the natural frequencies, numbered as in the table. Below, the root
    mean square over all pixels: measured, synthesised of the modes, and what is left, which is as
    the stated noise where nothing is missing.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> line, poles = [90.0, 100.0, 110.0], [100.0, 100.1]
    >>> found = group("modes", {"mode": [1]}, natural_frequency=[100.0], damping_ratio=[0.01],
    ...               candidate_order=[2, 3], candidate_frequency=poles, candidate_mode=[0, 1],
    ...               candidate_stable=[0, 1], line_frequency=line, measured_rms=[0.1, 1.0, 0.1])
    >>> stabilisation({"modes": found}).axes[0].get_ylabel()
    'order of the fit'
    """
    run = RunData.from_source(source)
    require("stabilisation", unavailable_because(run))
    modes = run.groups["modes"]
    count = modes.sizes["mode"]
    title = f"Stabilisation of {count} mode{'s' * (count != 1)}"
    spectra = [name for name in CURVES if name in modes]
    rows = 1 + bool(spectra)
    made = style.figure(0.7 + 1.9 * rows, title)
    axes = made.subplots(rows, 1, squeeze=False, sharex=True)[:, 0]
    _poles(axes[0], modes)
    if spectra:
        _spectra(axes[1], modes, spectra)
    axes[-1].set_xlabel(FREQUENCY.titled())
    axes[-1].xaxis.set_major_locator(style.ticks(8))
    for axis in axes:
        for hertz in modes["natural_frequency"].values:
            axis.axvline(hertz, zorder=0, **LINE)
    _number_modes(axes[0], modes)
    style.legend_below(made, *axes)
    return made


def _poles(axes: Axes, modes: xr.Dataset) -> None:
    """Draw every pole by its order, told apart by what became of it."""
    hertz, order = (modes[f"candidate_{name}"].values for name in ("frequency", "order"))
    of_mode = modes["candidate_mode"].values > 0
    stable = modes["candidate_stable"].values > 0
    kinds = (~stable & ~of_mode, stable & ~of_mode, of_mode)
    for (label, look), here in zip(POLES, kinds, strict=True):
        if here.any():
            axes.plot(hertz[here], order[here], linestyle="none", label=label, **look)
    axes.set_ylabel("order of the fit")
    axes.yaxis.set_major_locator(style.whole_numbers())
    if "line_frequency" in modes:
        band = modes["line_frequency"].values
        axes.set_xlim(band.min(), band.max())


def _spectra(axes: Axes, modes: xr.Dataset, names: list[str]) -> None:
    """Draw root mean squares over the frequency, joined where lines are neighbours."""
    hertz: Array = modes["line_frequency"].values
    factor, unit = style.prefixed(modes[names[0]].values, style.SPEED)
    every = []
    for name in names:
        label, look = CURVES[name]
        values = factor * modes[name].values
        every.append(values[values > 0])
        for part in style.runs_of(hertz):
            mark: Any = {"marker": "."} if part.stop - part.start == 1 else {}
            axes.plot(hertz[part], values[part], label=label, **look, **mark)
    axes.set_ylabel(f"r.m.s. velocity, {unit}")
    moving = np.concatenate(every)
    if moving.size:
        axes.set_yscale("log")
        ends = 0.7 * moving.min(), 1.5 * moving.max()
        axes.set_ylim(*ends)
        style.decades(axes.yaxis, *ends)


def _number_modes(axes: Axes, modes: xr.Dataset) -> None:
    """Write the numbers of the modes above their lines; those too close for it have one text."""
    low, high = axes.get_xlim()
    room = NUMBER * (high - low) / style.inches()
    where: dict[str, Any] = {"xycoords": axes.get_xaxis_transform(), "ha": "center", "va": "bottom"}
    numbers, natural = modes["mode"].values, modes["natural_frequency"].values
    parted = np.flatnonzero(np.diff(natural) > room) + 1
    for own, hertz in zip(np.split(numbers, parted), np.split(natural, parted), strict=True):
        if own.size:
            text = str(own[0]) if own.size == 1 else f"{own[0]}\u2013{own[-1]}"
            axes.annotate(text, (hertz.mean(), 1.01), color=LINE["color"], **where)
