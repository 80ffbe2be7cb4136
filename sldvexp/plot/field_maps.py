"""Maps of a velocity field on one layer: size, phase and bound of every component."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from sldvexp.dataset import RunData, Source
from sldvexp.plot import style
from sldvexp.plot.layer import VolumeLayer, field_unavailable_because, layer_of
from sldvexp.plot.selection import require


@style.styled
def field(
    source: Source | RunData,
    frequency: float | None = None,
    depth: float | None = None,
    name: str | None = None,
) -> Figure:
    """Draw size, phase and bound of every component of the velocity on one layer.

    Where a velocity is smaller than its bound its phase means nothing and is hatched.

    Parameters
    ----------
    frequency : float, Hz, optional
        Without it the one of the largest velocity.
    depth : float, m, optional
        Of the layer; without it the given surface.
    name : str, optional
        ``field``, or one of those it is compared with.

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
    >>> field({"volume": depth, "field": solved}).axes[0].get_title()
    'x: size'
    """
    run = RunData.from_source(source)
    require("field", field_unavailable_because(run))
    layer = layer_of(run, "field", frequency, depth, name)
    rows = len(layer.components)
    wide, high = (np.ptp(layer.position[:, i]) for i in layer.plane)
    ratio = min(max(high / wide, 0.35), 1.4)
    title = style.joined(f"Velocity {layer.where}", layer.frequency)
    shared = {"sharex": True, "sharey": True}
    made, axes = style.sheet(rows, 3, 10.5, ratio, title, style.SCALE_BESIDE, **shared)
    for row, component in zip(axes, layer.components, strict=True):
        _size(row[0], layer, component)
        phases = _phase(row[1], layer, component)
        _bound(row[2], layer, component)
    style.in_turns(style.scale_beside(axes[:, 1], phases, style.PHASE))
    for one in axes.ravel():
        layer.label(one)
        one.label_outer()
    return made


def _size(axes: Axes, layer: VolumeLayer, component: str) -> None:
    """Draw magnitudes; linear inside of an element, as the field is."""
    size = np.abs(layer.values("velocity", component))
    factor, unit = style.prefixed(size, style.SPEED)
    _map(axes, layer, factor * size, unit, 0.0, component)
    axes.set_title(f"{component}: size")


def _bound(axes: Axes, layer: VolumeLayer, component: str) -> None:
    """Draw half-widths of the intervals."""
    bound = layer.bound(component)
    factor, unit = style.prefixed(bound, style.SPEED)
    _map(axes, layer, factor * bound, unit, None, component)
    axes.set_title(f"{component}: {layer.bound_name}")


def _map(
    axes: Axes, layer: VolumeLayer, values: np.ndarray, unit: str, low: float | None, component: str
) -> None:
    style.hatched(axes)
    mesh, known = layer.mesh(), np.isfinite(values) & (layer.values("observable", component) != 0)
    if not known.any():
        axes.triplot(mesh, color="none")
        style.not_determined(axes)
        return
    mesh.set_mask(~known[mesh.triangles].all(axis=1))
    shown_values = np.where(known, values, values[known].mean())
    mapped = axes.tripcolor(
        mesh, shown_values, shading="gouraud", cmap=style.SIZE_MAP, vmin=low, rasterized=True
    )
    style.scale_beside(axes, mapped, unit)


def _phase(axes: Axes, layer: VolumeLayer, component: str) -> Any:
    """Draw phases of triangles, where they are larger than their bound."""
    style.hatched(axes)
    mesh, velocity = layer.mesh(), layer.values("velocity", component)
    mean = velocity[mesh.triangles].mean(axis=1)
    bound = np.nan_to_num(layer.bound(component))[mesh.triangles].mean(axis=1)
    known = np.abs(mean) > bound  # a NaN is not above anything
    axes.triplot(mesh, linestyle="none")  # as wide as the others, whatever is known
    if not known.any():
        known[0], mean[0] = True, np.nan
    mapped = axes.tripcolor(
        Triangulation(mesh.x, mesh.y, mesh.triangles[known]),
        facecolors=np.ma.masked_invalid(np.angle(mean[known])),
        cmap=style.PHASE_MAP,
        vmin=-np.pi,
        vmax=np.pi,
        rasterized=True,
    )
    axes.set_title(f"{component}: phase (hatched: below its bound)")
    return mapped
