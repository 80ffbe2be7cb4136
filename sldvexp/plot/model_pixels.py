"""Modes of a finite element model with the measured ones over them, and what is left of these.

Above, lines of equal motion of the model and the pixels that were measured, in the same colours;
below, measured minus the model's: nothing but noise of a right model.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from sldvexp.dataset import VARIABLES, RunData, Source
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.selection import require
from sldvexp.typing import Array

PLACE = VARIABLES["model/shape"]["position"]
NO_MODEL = "the run has no finite element model (group model); choose model=file"
#: Modes that are drawn, and lines of equal motion from the least to the largest.
MOST, LINES = 5, 9
#: Size of a pixel, points squared.
PIXEL = 2.0


def unavailable_because(run: RunData) -> str:
    """Say why a run has no model to be drawn; empty if it has one."""
    return "" if run.has("model/shape", "shape") and _pixels(run) else NO_MODEL


@style.styled
def model_shapes(source: Source | RunData) -> Figure:
    """Draw the modes of a finite element model with the measured ones over them.

    The phase is that of the model's scale. The first five modes that have a partner are drawn.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> corner = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0]])
    >>> shape = np.arange(9.0).reshape(3, 3, 1)
    >>> nodes = group("model/shape", {"shape_mode": [1]}, position=corner, shape=shape,
    ...               triangle=[[0, 1, 2]])
    >>> seen = group("model/image", {"paired_mode": [1]}, position=corner,
    ...              velocity=corner[:, :1] + 0j, residual=1e-3 * corner[:, 1:2] + 0j)
    >>> pairs = group("model", {"mode": [1]}, pair=[1], measured_frequency=[198.9])
    >>> run = {"model": pairs, "model/shape": nodes, "model/image/front": seen}
    >>> [axes.get_title() for axes in model_shapes(run).axes[:2]]
    ['198.9 Hz', 'left over']
    """
    run = RunData.from_source(source)
    require("model_shapes", unavailable_because(run))
    views, model, nodes = _pixels(run), run.groups["model"], run.groups["model/shape"]
    modes = [int(m) for m in views[0]["paired_mode"].values][:MOST]
    plane = np.sort(np.argsort(np.ptp(nodes["position"].values, axis=0))[1:])
    across = int(np.setdiff1d(np.arange(3), plane)[0])
    x, y = PLACE.factor * nodes["position"].values[:, plane].T
    mesh = Triangulation(x, y, nodes["triangle"].values)
    ratio = float(np.ptp(mesh.y) / np.ptp(mesh.x))
    hertz = [float(model["measured_frequency"].sel(mode=m)) for m in modes]
    titles = [f"{f:.4g} Hz" for f in hertz] + ["left over"] * len(modes)
    below = {"below": style.SCALE_BELOW, "sharex": True, "sharey": True}
    made, axes = style.sheet(2, len(modes), ratio, "Measured pixels on the model", titles, **below)
    place = PLACE.factor * np.concatenate([v["position"].values for v in views])[:, plane]
    own, left = (_in_phase(views, name)[:, : len(modes)] for name in ("velocity", "residual"))
    for k, mode in enumerate(modes):
        shape = nodes["shape"].sel(shape_mode=int(model["pair"].sel(mode=mode))).values[:, across]
        axes[0, k].tricontour(mesh, shape, LINES, colors="0.4", linewidths=0.5, zorder=0)
        for row, values in ((0, own[:, k] + left[:, k]), (1, left[:, k])):
            ends = np.abs(values).max() or 1.0
            look = {"cmap": style.SIGN_MAP, "vmin": -1, "vmax": 1, "rasterized": True}
            drawn = axes[row, k].scatter(*place.T, PIXEL, values / ends, linewidths=0, **look)
            style.ends_of(axes[row, k], mesh.x, mesh.y)
    style.scale_below(axes, drawn, "part of the largest")
    style.inner_ticks(axes)
    for one in axes.ravel():
        labels = [f"{'xyz'[i]}, {PLACE.shown_unit}" for i in plane]
        one.set(xlabel=labels[0], ylabel=labels[1])
        one.set_aspect("equal")
        one.xaxis.set_major_locator(style.ticks(2))
        one.label_outer()
    return made


def _pixels(run: RunData) -> list[xr.Dataset]:
    """List the views' pixels that see the model."""
    return [g for name, g in run.groups.items() if name.startswith("model/image/")]


def _in_phase(views: list[xr.Dataset], name: str) -> Array:
    """Turn values of all views to the phase of the model's scale, shape (pixel, mode)."""
    velocity = np.concatenate([v["velocity"].values for v in views])
    values = np.concatenate([v[name].values for v in views])
    largest = velocity[np.abs(velocity).argmax(axis=0), np.arange(velocity.shape[1])]
    return np.asarray((values * np.conj(largest) / np.abs(largest)).real)
