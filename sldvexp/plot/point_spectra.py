"""Velocities over the frequency, and of single points, with their bounds."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sldvexp.dataset import FREQUENCY, RunData, Source
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.layer import AXES, PLACE
from sldvexp.plot.selection import one_of, require
from sldvexp.typing import Array

NO_POINT = "the run has no velocity of a point (group point); see experiment=point"
NO_SPECTRUM = "the run has no velocity field at several frequencies; see experiment=plate_frf"

#: Fewer frequencies than this are drawn as single values.
MANY = 8

PARTS: dict[str, Any] = {"real": np.real, "imaginary": style.imaginary}


def unavailable_because(run: RunData) -> str:
    """Explain why no point can be shown; empty if one can."""
    return "" if _points(run) else NO_POINT


def spectrum_unavailable_because(run: RunData) -> str:
    """Explain why no spectrum of a field can be shown; empty if one can."""
    found = any(g.sizes.get("frequency", 1) > 1 for g in run.fields().values())
    return "" if found else NO_SPECTRUM


def _points(run: RunData) -> dict[str, xr.Dataset]:
    """Find velocities of points by method: ``point``, and those it is compared with."""
    own = {"point": run.groups["point"]} if run.has("point", "velocity", "component") else {}
    others = run.below("compare", "velocity", "velocity_std")
    return own | {k: g for k, g in others.items() if "node" not in g.dims}


def _name(one: xr.Dataset, number: int) -> str:
    """Name a point by its own name if it has one, else by its number."""
    return f"point {one['point'].item() if 'point' in one.coords else number}"


@style.styled
def point(source: Source | RunData, number: int | None = None) -> Figure:
    """Draw velocity of a point with its bounds, by component and method, or over many frequencies.

    Parameters
    ----------
    number : int, optional
        Which point, from 0, if the run has several; without it the one that moves most.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> velocity, std = [0.01, 0.002j, 0.02], [1e-4, 1e-4, 2e-4]
    >>> found = group("point", {}, velocity=velocity, velocity_std=std)
    >>> point({"point": found}).axes[0].get_ylabel()
    'real, mm/s'
    """
    run = RunData.from_source(source)
    require("point", unavailable_because(run))
    found = _points(run)
    title = "Velocity of the point"
    if "point" in next(iter(found.values()))["velocity"].dims:
        own = next(iter(found.values()))
        count = own.sizes["point"]
        if number is None:
            others = [d for d in own["velocity"].dims if d != "point"]
            number = int(np.nanargmax((abs(own["velocity"]) ** 2).sum(others).values))
        one_of(str(number), map(str, range(count)), "point", "point")
        found = {k: g.isel(point=number) for k, g in found.items()}
        title = f"Velocity of {_name(next(iter(found.values())), number)}"
    first = next(iter(found.values()))
    if first.sizes.get("frequency", 1) >= MANY:
        return _spectrum(first, title)
    return _methods(found, title)


@style.styled
def spectrum(source: Source | RunData, node: int | None = None, name: str | None = None) -> Figure:
    """Draw velocity of one node over the frequency with its bounds.

    Parameters
    ----------
    node : int, optional
        Without it that of the largest velocity.
    name : str, optional
        ``field``, or one of those it is compared with.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> place = np.zeros((6, 3))
    >>> velocity = 0.01 * np.ones((6, 3, 2)) * [1, 1j]
    >>> solved = group("field", {"frequency": [100.0, 200.0]}, velocity=velocity, position=place,
    ...                element=[[0, 1, 2, 3, 4, 5]])
    >>> spectrum({"field": solved}, node=0).axes[0].get_ylabel()
    'x, amplitude, mm/s'
    """
    run = RunData.from_source(source)
    require("spectrum", spectrum_unavailable_because(run))
    known = {k: g for k, g in run.fields().items() if g.sizes.get("frequency", 1) > 1}
    group = known[one_of(name, known, "spectrum", "field")]
    if node is None:
        largest = abs(group["velocity"]).max(["component", "frequency"])
        node = int(np.nan_to_num(largest.values).argmax())
    one_of(str(node), map(str, range(group.sizes["node"])), "spectrum", "node")
    place = PLACE.factor * group["position"].values[node]
    where = ", ".join(f"{a} {p:.1f}" for a, p in zip(AXES, place, strict=True))
    return _spectrum(group.isel(node=node), f"Velocity of node {node} ({where} {PLACE.shown_unit})")


def bound_of(group: xr.Dataset) -> tuple[xr.DataArray | None, str]:
    """Take half-widths of the intervals, else standard errors, and what to call them."""
    if "confidence" in group:
        return group["confidence"], f"{group.attrs.get('confidence_level', 0.95):.0%} bound"
    return group.get("velocity_std"), "standard error"


def _spectrum(group: xr.Dataset, title: str) -> Figure:
    """Draw size and phase of every component; a size below its bound has no phase."""
    names = [str(c) for c in group["component"].values]
    hertz = group["frequency"].values
    bound, meaning = bound_of(group)
    columns = 1 if style.narrow() else 2
    made = style.figure(0.7 + (2 / columns) * 1.3 * len(names), title)
    axes = made.subplots(2 * len(names) // columns, columns, squeeze=False, sharex=True)
    axes = axes.reshape(len(names), 2)
    factor, unit = style.prefixed(group["velocity"].values, style.SPEED)
    runs = style.runs_of(np.asarray(hertz, float))
    for (left, right), name in zip(axes, names, strict=True):
        velocity = group["velocity"].sel(component=name).values
        size, known = factor * np.abs(velocity), np.ones(len(hertz), bool)
        half = None if bound is None else factor * bound.sel(component=name).values
        _sizes(left, hertz, size, half, runs, f"± {meaning}")
        error = None
        if half is not None:
            known = size > half
            # a circle of the bound around the velocity is seen from zero under twice this angle
            error = np.degrees(np.arcsin(half[known] / size[known]))
        look = {"fmt": "o", "color": "#000000", "markersize": 1.8, "capsize": 0, "linewidth": 0.6}
        right.errorbar(hertz[known], np.degrees(np.angle(velocity[known])), error, **look)
        if not known.any():
            style.note(right, "not above its bound at any frequency")
        left.set_ylabel(f"{name}, amplitude, {unit}")
        right.set_ylabel(f"{name}, {style.PHASE}")
        right.set_ylim(-200.0, 200.0)
        right.set_yticks([-180.0, 0.0, 180.0], ["−180", "0", "180"])
    sizes = factor * np.abs(group["velocity"].values)
    moving = sizes[sizes > 0]  # none where nothing is determined, which no logarithm shows
    for left in axes[:, 0] if moving.size else ():
        left.set_yscale("log")
        ends = 0.5 * moving.min(), 3.0 * moving.max()
        left.set_ylim(*ends)
        style.decades(left.yaxis, *ends)
    for axis in axes[-1] if columns == 2 else axes[-1, 1:]:
        axis.set_xlabel(FREQUENCY.titled())
    for axis in axes.ravel():
        axis.margins(x=0.02)
    axes[0, 1].set_title("phase where the amplitude is above its bound")
    style.legend_below(made, axes[0, 0])
    return made


def _sizes(
    axes: Axes, hertz: Array, size: Array, half: Array | None, runs: list[slice], meaning: str
) -> None:
    """Draw sizes over the frequency, joined where lines are neighbours; else bars of bounds."""
    band: dict[str, Any] = {
        "color": style.COLOURS[4],
        "alpha": 0.5,
        "linewidth": 0,
    }
    dark = style.COLOURS[0]
    for run in runs:
        alone = run.stop - run.start == 1
        mark: Any = {"marker": "o", "linestyle": "none", "markersize": 2.5} if alone else {}
        if half is not None and alone:
            low = np.maximum(size[run] - half[run], 1e-3 * half[run])
            error = np.array([size[run] - low, half[run]])
            look: Any = {"fmt": "none", "ecolor": style.COLOURS[1], "elinewidth": 1.2}
            axes.errorbar(hertz[run], size[run], error, label=meaning, **look)
        elif half is not None:
            low = np.maximum(size[run] - half[run], 1e-3 * half[run])
            axes.fill_between(hertz[run], low, size[run] + half[run], label=meaning, **band)
        axes.plot(hertz[run], size[run], color=dark, linewidth=0.9, label="amplitude", **mark)


def _methods(found: dict[str, xr.Dataset], title: str) -> Figure:
    """Draw real and imaginary part by component and method, a row for each frequency."""
    first = next(iter(found.values()))
    hertz = first["frequency"].values if "frequency" in first.coords else [None]
    components = [str(c) for c in first["component"].values]
    meaning = bound_of(first)[1]
    made = style.figure(0.9 + 1.7 * len(hertz), f"{title}, {meaning}")
    axes = made.subplots(len(hertz), 2, squeeze=False, sharex=True)
    every = np.concatenate([g["velocity"].values.ravel() for g in found.values()])
    factor, unit = style.prefixed(every, style.SPEED)
    for k, (row, at) in enumerate(zip(axes, hertz, strict=True)):
        here = {n: g.isel(frequency=k) if "frequency" in g.dims else g for n, g in found.items()}
        for axis, (part, take) in zip(row, PARTS.items(), strict=True):
            _values(axis, here, components, take, factor)
            axis.set_ylabel(f"{part}, {unit}")
            axis.set_title("" if at is None else f"{at:g} {FREQUENCY.units}")
    for axis in axes[-1]:
        axis.set_xticks(np.arange(len(components)), components)
        axis.set_xlabel("component")
        axis.margins(x=0.1)
    if len(found) > 1:
        style.legend_below(made, axes[0, 0], title="method", columns=5)
    return made


def _values(
    axes: Axes, found: dict[str, xr.Dataset], components: list[str], take: Any, factor: float
) -> None:
    axes.axhline(0.0, color=style.COLOURS[-1], linewidth=0.7)
    shift = np.linspace(-0.3, 0.3, len(found)) if len(found) > 1 else np.zeros(1)
    for (name, group), look, aside in zip(
        found.items(), style.looks(len(found)), shift, strict=True
    ):
        own: NDArray = factor * take(group["velocity"].sel(component=components).values)
        bound = bound_of(group)[0]
        error = None if bound is None else factor * bound.sel(component=components).values
        look["linestyle"] = "none"
        axes.errorbar(np.arange(len(components)) + aside, own, error, label=name, **look)
