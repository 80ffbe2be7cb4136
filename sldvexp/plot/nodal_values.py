"""Nodal values with their bounds (Figures 5.9 to 5.11 and 5.13)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sldvexp.dataset import RunData, Source
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.layer import PLACE, VolumeLayer, field_unavailable_because, layer_of
from sldvexp.plot.paper import broken
from sldvexp.plot.selection import require
from sldvexp.typing import Array, IndexArray

PARTS: dict[str, Any] = {"real": np.real, "imaginary": style.imaginary}


@style.styled
def nodal(
    source: Source | RunData,
    frequency: float | None = None,
    depth: float | None = None,
    name: str | None = None,
    component: str | None = None,
    nodes: str | Sequence[int] = "line",
) -> Figure:
    """Draw velocities of nodes with bounds, real and imaginary part, a row for each component.

    Parameters
    ----------
    frequency : float, Hz, optional
        Without it the one of the largest velocity.
    depth : float, m, optional
        Of the layer; without it the given surface.
    name : str, optional
        ``field``, or one of those it is compared with.
    component : str, optional
        Only this one.
    nodes : str or sequence of int
        ``line``: those along the layer's longer side through its largest velocity. ``all``: all of
        the layer, by number. Numbers of nodes: these, of any layer.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> corner = np.array([[0, 0], [0.1, 0], [0, 0.1], [0.1, 0.1]])
    >>> place = np.array([[x, y, z] for z in (0.0, 0.01) for x, y in corner])
    >>> prisms = [[0, 1, 2, 4, 5, 6], [1, 3, 2, 5, 7, 6]]
    >>> depth = group("volume", {}, depth=[0.0, 0.01])
    >>> solved = group("field", {}, velocity=place + 0j, position=place, element=prisms,
    ...                confidence=0.1 * place, observable=np.ones((8, 3), int))
    >>> nodal({"volume": depth, "field": solved}, nodes="all", component="x").axes[0].get_ylabel()
    'x, mm/s'
    """
    run = RunData.from_source(source)
    require("nodal", field_unavailable_because(run))
    layer = layer_of(run, "nodal", frequency, depth, name)
    own, place, label = _chosen(layer, nodes)
    components = [component] if component else layer.components
    if component and component not in layer.components:
        raise UserError(
            f"plot: nodal: there is no component {component}, only {', '.join(layer.components)}"
        )
    title = style.joined(f"Nodal velocities {layer.where}", layer.frequency, layer.bound_name)
    columns = 1 if style.narrow() else 2
    ratio = 0.45
    titles = [f"{one}: {part} part" for one in components for part in PARTS]
    room: dict[str, Any] = {"right": 0.15, "between": style.LOW}
    shared: dict[str, Any] = {"sharex": True, "sharey": False if columns == 1 else "row"}
    rows = 2 * len(components) // columns
    made, axes = style.sheet(rows, columns, ratio, title, titles, **room, **shared)
    factor, unit = style.prefixed(
        np.concatenate([layer.values("velocity", c)[own] for c in components]), style.SPEED
    )
    panels = axes.reshape(len(components), 2)
    for row, one in zip(panels, components, strict=True):
        for axis, (part, take) in zip(row, PARTS.items(), strict=True):
            _values(axis, layer, own, place, one, part, take, factor)
            axis.set_ylabel(f"{one}, {unit}")
            axis.label_outer()
        style.alike(row)
    for axis in axes[-1]:
        axis.set_xlabel(broken(label, style.inches() / columns))
    if layer.truth:
        style.legend(made, *axes[:, 0])
    return made


def _chosen(layer: VolumeLayer, nodes: str | Sequence[int]) -> tuple[IndexArray, Array, str]:
    """Choose nodes of the layer, where they are drawn, and what that axis is called."""
    if isinstance(nodes, str) and nodes not in ("line", "all"):
        raise UserError(f"plot: nodal: nodes is line, all or numbers, not {nodes}")
    if nodes == "line":
        own, along = line_nodes(layer)
        return own, PLACE.factor * along, _line_label(layer, own)
    wanted = layer.node if isinstance(nodes, str) else np.asarray(nodes, int)
    own = np.flatnonzero(np.isin(layer.node, wanted))
    if not len(own):
        raise UserError(
            f"plot: nodal: nodes {layer.where} have the numbers {layer.node[0]} to "
            f"{layer.node[-1]}; choose some of them, or another depth"
        )
    return own, layer.node[own].astype(float), "node"


def line_nodes(layer: VolumeLayer) -> tuple[IndexArray, Array]:
    """Find nodes along the layer's longer side through its largest velocity, and their place, m."""
    flat = layer.place
    longer = int(np.ptp(flat, axis=0).argmax())
    size = np.nansum(np.abs(layer.group["velocity"].values) ** 2, axis=-1)
    peak = flat[int(size.argmax())]
    # nodes of one row of a grid are within rounding; of a free mesh, within half its pitch
    pitch = np.sqrt(np.prod(np.ptp(flat, axis=0)) / len(flat))
    aside = np.abs(flat[:, 1 - longer] - peak[1 - longer])
    exact = np.flatnonzero(aside < 1e-6 * pitch)
    own = exact if len(exact) > 2 else np.flatnonzero(aside < 0.5 * pitch)
    own = own[np.argsort(flat[own, longer])]
    return own, flat[own, longer]


def _line_label(layer: VolumeLayer, own: IndexArray) -> str:
    flat = layer.place[own]
    longer = int(np.ptp(flat, axis=0).argmax())
    unit = PLACE.shown_unit
    beside = PLACE.factor * float(np.median(flat[:, 1 - longer]))
    across = layer.labels[1 - longer]
    return f"{PLACE.titled(layer.labels[longer])} (at {across} = {beside:.1f} {unit})"


def part_bound(group: xr.Dataset, component: str, part: str, own: IndexArray) -> Array | None:
    """Take half-widths of the intervals of one part, else of the larger, else standard errors."""
    if "confidence_by_part" in group and part in group["part"].values:
        return np.asarray(
            group["confidence_by_part"].sel(part=part, component=component).values[own]
        )
    for name in ("confidence", "velocity_std"):
        if name in group:
            return np.asarray(group[name].sel(component=component).values[own])
    return None


def _truth(layer: VolumeLayer) -> str:
    """Name the line of the truth: `VolumeLayer.truth` may lack components, and why."""
    lacking = [c for c in layer.components if c not in layer.truth]
    if not lacking:
        return "truth"
    change = f"{' and '.join(lacking)} change{'s' * (len(lacking) == 1)} through the thickness"
    return f"truth ({', '.join(layer.truth)} only: {change})"


def _values(
    axes: Axes,
    layer: VolumeLayer,
    own: IndexArray,
    place: Array,
    component: str,
    part: str,
    take: Any,
    factor: float,
) -> None:
    velocity = layer.values("velocity", component)[own]
    bound = part_bound(layer.group, component, part, own)
    many = len(own) > 150
    axes.axhline(0.0, color=style.COLOURS[-1], linewidth=0.7)
    if component in layer.truth:
        truth = factor * take(layer.truth[component][own])
        axes.plot(place, truth, "-", color=style.COLOURS[2], linewidth=1.0, label=_truth(layer))
    axes.errorbar(
        place,
        factor * take(velocity),
        None if bound is None else factor * bound,
        fmt="o",
        color=style.COLOURS[1],
        markersize=1.5 if many else 3.0,
        capsize=0 if many else 2,
        linewidth=0.5 if many else 1.0,
        label=f"velocity ± {layer.bound_name}",
    )
    if not np.isfinite(velocity).any():
        style.not_determined(axes)
