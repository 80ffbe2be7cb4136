"""Velocity images: all views, and one view before and after the phase correction."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sldvexp.dataset import VARIABLES, RunData, Source
from sldvexp.lazy import xarray as xr
from sldvexp.plot import as_seen, style
from sldvexp.plot.selection import at_frequency, one_of, require
from sldvexp.typing import BoolArray, ComplexArray

NO_IMAGE = (
    "the run has no velocity image (groups image/<view>); choose a scan of pixels, as in "
    "experiment=dissertation/velocity_image"
)
NO_RAW = "the run's images have no uncorrected phasors (variable uncorrected)"

#: Standard deviations that a velocity must have for its phase to say anything.
CERTAIN = 3.0

#: What is drawn of an image, column by column.
PARTS = ("real part", "imaginary part", "magnitude", "phase")


def unavailable_because(run: RunData) -> str:
    """Explain why no image can be shown; empty if one can."""
    return "" if run.below("image", "velocity", "dac") else NO_IMAGE


def raw_unavailable_because(run: RunData) -> str:
    """Explain why no image before the correction can be shown; empty if one can."""
    return unavailable_because(run) or ("" if run.below("image", "uncorrected") else NO_RAW)


@style.styled
def images(
    source: Source | RunData, view: str | None = None, frequency: float | None = None
) -> Figure:
    """Draw the complex velocity of the pixels as seen from the instrument, a row for each view.

    Flagged pixels are hatched, and phases where the velocity is less than `CERTAIN` of its standard
    deviations.

    Parameters
    ----------
    view : str, optional
        Only this one.
    frequency : float, Hz, optional
        Without it the one of the largest velocity in the first of them.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> dac = np.array([[i, j] for i in range(3) for j in range(4)])
    >>> velocity = 0.01 * np.exp(0.1j * dac[:, 1])
    >>> image = group("image", {}, velocity=velocity, dac=dac)
    >>> images({"image/front": image}).axes[0].get_title()
    'real part'
    """
    run = RunData.from_source(source)
    require("images", unavailable_because(run))
    views = run.below("image", "velocity", "dac")
    if view is not None:
        view = one_of(view, views, "images", "view")
        views = {view: views[view]}
    first, hertz = at_frequency(next(iter(views.values())), "images", frequency)
    if frequency is None and "frequency" in first.coords:
        frequency = float(first["frequency"])
    rows = {f"view {k}": at_frequency(g, "images", frequency)[0] for k, g in views.items()}
    velocities = {name: group["velocity"].values for name, group in rows.items()}
    title = style.joined("Velocity images", hertz)
    return _rows(rows, velocities, title, as_seen.ways_of(run))


@style.styled
def phase_correction(
    source: Source | RunData, view: str | None = None, frequency: float | None = None
) -> Figure:
    """Draw one view's image before and after the phase correction (Figures 3.4 to 3.7).

    Parameters
    ----------
    view : str, optional
        Without it the first.
    frequency : float, Hz, optional
        Without it the one of the largest velocity.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> dac = np.array([[i, j] for i in range(3) for j in range(4)])
    >>> velocity = 0.01 * np.exp(0.1j * dac[:, 1])
    >>> image = group("image", {}, velocity=velocity, uncorrected=velocity * 1j, dac=dac)
    >>> phase_correction({"image/front": image}).axes[0].get_title()
    'real part'
    """
    run = RunData.from_source(source)
    require("phase_correction", raw_unavailable_because(run))
    views = run.below("image", "velocity", "uncorrected", "dac")
    view = one_of(view, views, "phase_correction", "view")
    group, hertz = at_frequency(views[view], "phase_correction", frequency)
    values = {"raw": group["uncorrected"].values, "corrected": group["velocity"].values}
    title = style.joined(f"Phase correction of the view {view}", hertz)
    return _rows(dict.fromkeys(values, group), values, title, as_seen.ways_of(run))


def _rows(
    groups: dict[str, xr.Dataset],
    velocities: dict[str, ComplexArray],
    title: str,
    ways: tuple[int, int],
) -> Figure:
    """Draw a row of four maps for each image, with a common scale for each column."""
    extents = np.array([np.ptp(group["dac"].values, axis=0) for group in groups.values()])
    tall = np.clip(extents[:, 0] / np.maximum(extents[:, 1], 1), 0.25, 1.6).tolist()
    farthest = max(float(np.abs(group["dac"].values).max()) for group in groups.values())
    told = ["×: flagged pixel"] * any(not _good(group).all() for group in groups.values())
    if all("velocity_std" in group for group in groups.values()):
        told.append(f"phase hatched: below {CERTAIN:g} standard deviations")
    title = f"{title} ({'; '.join(told)})" if told else title
    room: dict[str, Any] = {"below": style.SCALE_BELOW, "beside": 0.12, "between": 0.27}
    room |= {"left": style.LEFT + (0.32 if style.narrow() else 0.2)}
    shared: dict[str, Any] = {"sharex": "row", "sharey": "row"}
    made, axes = style.sheet(len(groups), len(PARTS), tall, title, PARTS, **room, **shared)
    largest = max(np.abs(v[_good(groups[k])]).max(initial=0.0) for k, v in velocities.items())
    factor, unit = style.prefixed(largest, style.SPEED)
    across, up = style.mirror_labels(VARIABLES["image"]["dac"])
    mapped = {}
    for column, part in zip(axes.T, PARTS, strict=True):
        for axis, (name, group) in zip(column, groups.items(), strict=True):
            mapped[part] = _part(
                axis, group, velocities[name], part, factor, factor * largest or 1.0
            )
            axis.xaxis.set_major_locator(style.ticks(2))
            axis.yaxis.set_major_locator(style.ticks(3))
            style.thousands(axis.xaxis, farthest)
            axis.set_aspect("equal")
            as_seen.turn(axis, ways)
            axis.tick_params(labelleft=part == PARTS[0])
    for axis, name in zip(axes[:, 0], groups, strict=True):
        axis.set_ylabel(name)
    style.up_beside(made, axes[:, 0], up)
    parts = "" if style.narrow() else "real and imaginary part, "
    style.scale_below(axes[:, :2], mapped["real part"], f"{parts}{unit}")
    style.scale_below(axes[:, 2], mapped["magnitude"], unit)
    style.in_turns(style.scale_below(axes[:, 3], mapped["phase"], style.PHASE))
    style.across_below(made, axes[-1], across)
    return made


def _good(group: xr.Dataset) -> BoolArray:
    """Find pixels that nothing is wrong with."""
    if "flags" not in group:
        return np.ones(group.sizes["pixel"], bool)
    return group["flags"].values == 0


def _part(
    axes: Axes, group: xr.Dataset, velocity: ComplexArray, part: str, factor: float, limit: float
) -> Any:
    """Draw one map of an image, in the unit that the factor makes."""
    style.hatched(axes)
    take: dict[str, Any] = {"real part": np.real, "imaginary part": np.imag, "magnitude": np.abs}
    values = take.get(part, _degrees)(factor * velocity)
    good = _good(group)
    if part == "phase" and "velocity_std" in group:
        good = good & (np.abs(velocity) > CERTAIN * group["velocity_std"].values)
    low, high, colours = {
        "magnitude": (0.0, limit, style.SIZE_MAP),
        "phase": (-180.0, 180.0, style.PHASE_MAP),
    }.get(part, (-limit, limit, style.SIGN_MAP))
    up_down, left_right = group["dac"].values[~_good(group)].T
    look = {"cmap": style.colour_map(colours), "norm": Normalize(low, high)}
    mapped = _pixels(axes, group, values, good, look)
    if len(up_down):
        axes.plot(left_right, up_down, "x", color="#000000", markersize=2.5, label="flagged")
    return mapped


def _degrees(values: ComplexArray) -> NDArray:
    """Take phases, deg."""
    phases: NDArray = np.degrees(np.angle(values))
    return phases


def _even(steps: NDArray) -> bool:
    """Tell whether DAC steps are those of an even grid, but for their rounding, along every row."""
    even = np.linspace(steps[0, 0], steps[0, -1], steps.shape[1])
    return bool((np.abs(steps - even) <= 1.0).all())


def _ends(steps: NDArray) -> tuple[float, float]:
    """Tell where the first pixel of a line begins and the last one ends."""
    half = 0.5 * (steps[-1] - steps[0]) / (len(steps) - 1)
    return steps[0] - half, steps[-1] + half


def _pixels(
    axes: Axes, group: xr.Dataset, values: NDArray, good: BoolArray, look: dict[str, Any]
) -> Any:
    """Draw good pixels as quadrilaterals around their DAC steps, or dots if on no grid."""
    up_down, left_right = group["dac"].values.T
    shape = tuple(int(n) for n in np.atleast_1d(group.attrs.get("shape", ())))
    if len(shape) == 2 and shape[0] * shape[1] == len(values) and min(shape) > 1:
        grid = np.ma.masked_invalid(np.where(good, values, np.nan).reshape(shape))
        across, up = left_right.reshape(shape), up_down.reshape(shape)
        if _even(across) and _even(up.T):
            extent = *_ends(across[0]), *_ends(up[:, 0])
            return style.cells(axes, grid, extent, **look)
        axes.margins(0)
        return axes.pcolormesh(across, up, grid, shading="nearest", rasterized=True, **look)
    axes.margins(0.05)
    axes.patch.set(hatch=None, facecolor="#eeeeee")
    return axes.scatter(
        left_right[good],
        up_down[good],
        c=values[good],
        s=12,
        linewidths=0.3,
        edgecolors="#555555",
        **look,
    )
