"""The velocity of a layer, or of many points, as a surface in space (Figure 5.14)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import NDArray

from sldvexp.dataset import RunData, Source
from sldvexp.errors import UserError
from sldvexp.geometry import joined_points
from sldvexp.plot import style
from sldvexp.plot.layer import AXES, PLACE, layer_of
from sldvexp.plot.selection import at_frequency, require
from sldvexp.typing import Array, ComplexArray, IntArray

NO_SHAPE = (
    "the run has no velocity field (group field), as in experiment=plate, and no velocities of "
    "points whose positions are known, as in experiment=tutorial_points"
)
#: Largest deflection, as a share of the shape's diagonal.
DRAWN_SHARE = 0.12
#: The shortest side of the drawn box, as a share of the longest.
THINNEST = 0.3


def unavailable_because(run: RunData) -> str:
    """Explain why no surface can be shown; empty if one can."""
    return "" if run.fields() or not points_unavailable_because(run) else NO_SHAPE


@style.styled
def surface(
    source: Source | RunData,
    frequency: float | None = None,
    depth: float | None = None,
    name: str | None = None,
    component: str | None = None,
) -> Figure:
    """Draw one component of the velocity over the layer, at the moment when it is largest.

    Without a field, many points whose positions are known are drawn where their velocity, as a
    deflection, brings them; triangles and lines join them.

    Parameters
    ----------
    frequency : float, Hz, optional
        Without it the one of the largest velocity.
    depth : float, m, optional
        Of the layer; without it the given surface.
    name : str, optional
        ``field``, or one of those it is compared with.
    component : str, optional
        Without it the one that is largest.

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
    >>> surface({"volume": depth, "field": solved}, component="x").axes[0].get_zlabel()
    'velocity, mm/s'
    """
    run = RunData.from_source(source)
    require("surface", unavailable_because(run))
    if not run.fields():
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
    moment, values = at_largest(velocity, velocity)
    factor, unit = style.prefixed(values, style.SPEED)
    mesh, fine = layer.mesh(), np.isfinite(values)
    title = style.joined(f"Velocity along {component} {layer.where}", layer.frequency, moment)
    made, axes, scale = style.scene(title)
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
    axes.set(xlabel=PLACE.titled(first), ylabel=PLACE.titled(second), zlabel=f"velocity, {unit}")
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


def at_largest(velocity: ComplexArray, of: ComplexArray) -> tuple[str, Array]:
    """Take velocities at the moment when the largest one of some is as positive as it gets."""
    phase = float(np.angle(of[int(np.nanargmax(np.abs(of)))]))
    return f"ωt = {-phase:+.2f} rad", (velocity * np.exp(-1j * phase)).real


def points_unavailable_because(run: RunData) -> bool:
    """Tell whether no points in space can be shown."""
    there = run.has("point", "velocity") and run.has("line_of_sight", "position")
    return not there or run.groups["point"].sizes.get("point", 1) < 2


def normals(position: Array, triangles: IntArray) -> Array:
    """Compute unit normals of a surface at its points, shape (point, 3).

    The mean of the triangles around a point by their areas; where there is none, the normal of the
    plane that is nearest to all points.
    """
    _, _, axes = np.linalg.svd(position - position.mean(axis=0))
    plane = axes[-1] * (1.0 if axes[-1][np.abs(axes[-1]).argmax()] > 0 else -1.0)
    first, second, third = position[triangles].transpose(1, 0, 2)
    doubled = np.cross(second - first, third - first)
    total = np.zeros_like(position)
    for corner in triangles.T:
        np.add.at(total, corner, doubled)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    known = length > 1e-9 * max(np.ptp(position, axis=0).max() ** 2, 1e-300)
    return np.where(known, total / np.where(known, length, 1.0), plane)


def points_surface(run: RunData, frequency: float | None, component: str | None) -> Figure:
    """Draw points where they are at the moment of the largest velocity, see `surface`.

    Parameters
    ----------
    frequency : float, Hz, optional
    component : str, optional
        That the colours tell; without it the largest one.
    """
    group, hertz = at_frequency(run.groups["point"], "surface", frequency)
    position, triangles, lines = joined_points(run.groups["line_of_sight"])
    known = [str(c) for c in group["component"].values]
    velocity = group["velocity"].transpose("point", "component").values
    index = known.index(component) if component is not None else _largest(velocity)
    moment, now = at_largest(velocity, velocity[:, index])
    size = np.linalg.norm(np.nan_to_num(now), axis=1).max()
    diagonal = np.linalg.norm(np.ptp(position, axis=0))
    place = PLACE.factor * (position + DRAWN_SHARE * diagonal / (size or 1.0) * np.nan_to_num(now))
    factor, unit = style.prefixed(now[:, index], style.SPEED)
    title = style.joined(f"Velocity of {len(place)} points", hertz, moment)
    made, axes, scale = style.scene(title)
    dots = _draw(axes, PLACE.factor * position, place, triangles, lines, factor * now[:, index])
    scale(dots, f"velocity along {known[index]}, {unit}")
    return made


def _largest(velocity: NDArray) -> int:
    return int(np.nansum(np.abs(velocity) ** 2, axis=0).argmax())


def _draw(
    axes: Any, rest: Array, place: Array, triangles: IntArray, lines: IntArray, values: Array
) -> Any:
    """Draw surface, lines and points, coloured by their values; grey lines where they rest."""
    limit = float(np.nanmax(np.abs(values))) or 1.0
    look = {"cmap": style.SIGN_MAP, "clim": (-limit, limit)}
    ends = lines if len(lines) else _sides(triangles)
    if len(triangles):
        faces = Poly3DCollection(place[triangles], edgecolor="#00000040", linewidth=0.2, **look)
        faces.set_array(values[triangles].mean(axis=1))
        faces.set_rasterized(True)
        axes.add_collection3d(faces)
    if len(ends):
        axes.add_collection3d(Line3DCollection(rest[ends], colors="#999999", linewidths=0.7))
        axes.add_collection3d(Line3DCollection(place[ends], colors="#000000", linewidths=0.6))
    found = np.isfinite(values)
    dots = axes.scatter(
        *place[found].T, c=values[found], s=14, edgecolors="#000000", linewidths=0.3, **look
    )
    if not found.all():
        axes.scatter(*place[~found].T, marker="x", color="#000000", s=16, label="not determined")
        axes.legend()
    both = np.concatenate([rest, place])
    middle, span = (both.min(axis=0) + both.max(axis=0)) / 2, np.ptp(both, axis=0)
    span = np.maximum(span, THINNEST * span.max())
    for name, centre, width in zip(AXES, middle, span, strict=True):
        axes.set(**{f"{name}lim": (centre - width / 2, centre + width / 2)})
        axes.set(**{f"{name}label": PLACE.titled(name)})
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(style.ticks(round(3 + 3 * width / span.max())))
    axes.set_box_aspect(span, zoom=0.85)
    return dots


def _sides(triangles: IntArray) -> IntArray:
    """Find the sides of triangles, each once."""
    every = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.unique(np.sort(every, axis=1), axis=0)
