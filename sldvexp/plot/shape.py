"""The velocity of a layer, or of many points, as a surface in space (Figure 5.14)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.figure import Figure

from sldvexp.dataset.run_data import RunData, Source, require, shown
from sldvexp.errors import UserError
from sldvexp.plot import sheet, style
from sldvexp.plot.layer import AXES, fields, layer_of
from sldvexp.plot.points_shape import NO_SHAPE, points_surface, points_unavailable_because
from sldvexp.typing import Array, ComplexArray


def unavailable_because(run: RunData) -> str:
    """Why no surface can be shown; empty if one can."""
    return "" if fields(run) or not points_unavailable_because(run) else NO_SHAPE


@style.styled
def surface(
    source: Source | RunData,
    frequency: float | None = None,
    depth: float | None = None,
    name: str | None = None,
    component: str | None = None,
) -> Figure:
    """One component of the velocity over the layer, at the moment when it is largest.

    Without a field, many points whose positions are known are drawn where their velocity, as a
    deflection, brings them; triangles and lines join them.

    Parameters
    ----------
    source : DataTree or others
        See `sldvexp.dataset.run_data.shown`.
    frequency : float, Hz, optional
        Without it the one of the largest velocity.
    depth : float, m, optional
        Of the layer; without it the given surface.
    name : str, optional
        ``field``, or one of those it is compared with.
    component : str, optional
        Without it the one that is largest.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    UserError
        If the run has no field and no points, or not this component, depth or field.
    """
    run = shown(source)
    require("surface", unavailable_because(run))
    if not fields(run):
        _only(component, run.groups["point"]["component"].values)
        if depth is not None or name is not None:
            raise UserError("plot: surface: points have no depth and no name, only a field has")
        return points_surface(run, frequency, component)
    layer = layer_of(run, "surface", frequency, depth, name)
    known = layer.components
    _only(component, known)
    if component is None:
        size = np.nansum(np.abs(layer.group["velocity"].values) ** 2, axis=0)
        component = known[int(size.argmax())]
    velocity = layer.values("velocity", component)
    moment, values = at_largest(velocity)
    factor, unit = style.prefixed(values, "m/s")
    mesh, fine = layer.mesh(), np.isfinite(values)
    title = style.joined(f"Velocity along {component} {layer.where}", layer.frequency, moment)
    made, axes, scale = sheet.scene(title)
    limit = float(np.nanmax(np.abs(factor * values))) or 1.0
    mapped = axes.plot_trisurf(
        mesh.x,
        mesh.y,
        np.where(fine, factor * values, 0.0),
        triangles=mesh.triangles[fine[mesh.triangles].all(axis=1)],
        cmap=style.SIGN_MAP,
        vmin=-limit,
        vmax=limit,
        edgecolor="#00000040",
        linewidth=0.2,
        antialiased=True,
    )
    mapped.set_rasterized(True)
    first, second = (AXES[i] for i in layer.plane)
    axes.set(xlabel=f"{first}, mm", ylabel=f"{second}, mm", zlabel=f"velocity, {unit}")
    wide, deep = np.ptp(mesh.x), np.ptp(mesh.y)
    axes.set_box_aspect((wide, deep, 0.5 * max(wide, deep)), zoom=1.0)
    bottom, top = axes.get_zlim()
    axes.set_zlim(min(bottom, 0.0), max(top, 0.0))  # where nothing moves is in the picture
    scale(mapped, unit)
    return made


def _only(component: str | None, known: Iterable[str]) -> None:
    if component is not None and component not in known:
        raise UserError(
            f"plot: surface: there is no component {component}, only {', '.join(known)}"
        )


def at_largest(velocity: ComplexArray) -> tuple[str, Array]:
    """Velocities at the moment of the largest one, which is then as positive as it gets."""
    largest = velocity[int(np.nanargmax(np.abs(velocity)))]
    phase = float(np.angle(largest))
    return f"ωt = {-phase:+.2f} rad", (velocity * np.exp(-1j * phase)).real
