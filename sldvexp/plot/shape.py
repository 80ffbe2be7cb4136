"""The velocity of a layer, or of many points, as a surface in space (Figure 5.14)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import NDArray

from sldvexp.dataset import RunData, Source
from sldvexp.errors import UserError
from sldvexp.geometry import FewerNodes, fewer_nodes, joined_points, rim, sides
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.layer import AXES, PLACE, VolumeLayer, layer_of
from sldvexp.plot.selection import at_frequency, require
from sldvexp.plot.triangle_map import VEIL
from sldvexp.typing import Array, BoolArray, ComplexArray, IntArray

NO_SHAPE = (
    "the run has no velocity field (group field), as in experiment=plate, and no velocities of "
    "points that are determined and whose positions are known, as in experiment=tutorial_points"
)
#: Largest deflection, as a share of the shape's diagonal.
DRAWN_SHARE = 0.12
#: Of more nodes some are drawn for all: a line of print shows no more.
DRAWN_NODES = 8_000
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

    The layer is drawn where the velocity, as a deflection, brings it, on its true shape and with
    equal scales along all axes; where the velocity is below its bound it is pale. Without a field,
    many points whose positions are known are drawn so; triangles and lines join them.

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
    'z, mm'
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
    velocity, bound = layer.values("velocity", component), layer.bound(component)
    moment, values = at_largest(velocity, velocity)
    factor, unit = style.prefixed(values, style.SPEED)
    way = _directions(run, layer, component)
    high = _height(values, bound)
    share = float(DRAWN_SHARE * np.linalg.norm(np.ptp(layer.position, axis=0)) / high)
    place = layer.position + share * np.nan_to_num(values)[:, None] * way
    faint = ~(np.abs(velocity) > np.nan_to_num(bound))
    fine = np.isfinite(values)[layer.triangle].all(axis=1)
    few = fewer_nodes(layer.position, layer.triangle[fine], DRAWN_NODES)
    title = style.joined(
        f"Velocity along {component} {layer.where}",
        layer.frequency,
        moment,
        _enlarged(layer.group, share),
        "pale: below its bound" if faint.any() else "",
        _drawn(few),
    )
    made, axes, scale = style.scene(title)
    both = PLACE.factor * layer.position, PLACE.factor * place
    drawn = _draw(axes, *both, few, NO_LINES, factor * values, faint, dots=False)
    scale(drawn, f"velocity along {component}, {unit}")
    return made


#: Pairs of points that are joined, where none are.
NO_LINES = np.empty((0, 2), np.intp)


def _directions(run: RunData, layer: VolumeLayer, component: str) -> Array:
    """Find the unit vector of a component at every node, shape (n, 3)."""
    if component in AXES:
        return np.tile(np.eye(3)[AXES.index(component)], (len(layer.node), 1))
    frame = run.groups["volume"]["frame"].values
    return np.asarray(frame[layer.node % len(frame), layer.components.index(component)], float)


def _height(values: Array, bound: Array) -> float:
    """Tell the velocity that is drawn at full height: noise is not.

    Where no velocity is as large as bounds are, that is the size of the bounds.
    """
    known = bound[np.isfinite(bound)]
    least = float(np.median(known)) if known.size else 0.0
    return max(float(np.nanmax(np.abs(values))), least) or 1.0


def _enlarged(group: xr.Dataset, share: float) -> str:
    """Tell by how much displacements are enlarged, if the frequency is known."""
    if "frequency" not in group.coords or not float(group["frequency"]) > 0:
        return ""
    # a velocity v is a displacement of v / (2 pi f)
    times = float(f"{share * 2 * np.pi * float(group['frequency']):.2g}")
    return f"displacements × {times:.0f}" if times >= 10 else f"displacements × {times:g}"


def _only(component: str | None, known: Iterable[str]) -> None:
    if component is not None and component not in known:
        raise UserError(
            f"plot: surface: there is no component {component}, only {', '.join(known)}"
        )


def at_largest(velocity: ComplexArray, of: ComplexArray) -> tuple[str, Array]:
    """Take velocities at the moment when the largest one of some is as positive as it gets."""
    phase = float(np.angle(of[int(np.nanargmax(np.abs(of)))]))
    return f"ωt = {round(-np.degrees(phase)):+d}°", (velocity * np.exp(-1j * phase)).real


def points_unavailable_because(run: RunData) -> bool:
    """Tell whether no points in space can be shown."""
    there = run.has("point", "velocity") and run.has("line_of_sight", "position")
    if not there or run.groups["point"].sizes.get("point", 1) < 2:
        return True
    return not np.isfinite(run.groups["point"]["velocity"].values).any()


def normals(position: Array, triangles: IntArray) -> Array:
    """Compute unit normals of a surface at its points, shape (point, 3).

    The mean of the triangles around a point by their areas; where there is none, the normal of the
    plane that is nearest to all points.
    """
    _, _, axes = np.linalg.svd(position - position.mean(axis=0), full_matrices=len(position) < 3)
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
    order = ("point", "component")
    velocity = group["velocity"].transpose(*order).values
    bound = group["confidence"].transpose(*order).values if "confidence" in group else None
    index = known.index(component) if component is not None else _largest(velocity)
    moment, now = at_largest(velocity, velocity[:, index])
    own_bound = np.full(len(now), np.nan) if bound is None else bound[:, index]
    size = max(np.linalg.norm(np.nan_to_num(now), axis=1).max(), _height(now[:, index], own_bound))
    share = float(DRAWN_SHARE * np.linalg.norm(np.ptp(position, axis=0)) / (size or 1.0))
    place = PLACE.factor * (position + share * np.nan_to_num(now))
    factor, unit = style.prefixed(now[:, index], style.SPEED)
    faint = np.zeros(len(now), bool)
    if bound is not None:
        faint = ~(np.abs(velocity[:, index]) > np.nan_to_num(own_bound))
    told = "pale: below its bound" if faint.any() else ""
    enlarged = _enlarged(group, share)
    few = fewer_nodes(position, triangles, DRAWN_NODES)
    of = f"Velocity of {len(place)} points"
    title = style.joined(of, hertz, moment, enlarged, told, _drawn(few))
    made, axes, scale = style.scene(title)
    rest = PLACE.factor * position
    dots = _draw(axes, rest, place, few, lines, factor * now[:, index], faint)
    scale(dots, f"velocity along {known[index]}, {unit}")
    return made


def _drawn(few: FewerNodes) -> str:
    """Tell how many nodes are drawn, if not all of them."""
    whole = len(few.kept) == len(few.stands_in)
    return "" if whole else f"drawn: {len(few.kept)} of {len(few.stands_in)} nodes"


def _largest(velocity: NDArray) -> int:
    return int(np.nansum(np.abs(velocity) ** 2, axis=0).argmax())


def _draw(
    axes: Any,
    rest: Array,
    place: Array,
    few: FewerNodes,
    lines: IntArray,
    values: Array,
    faint: BoolArray,
    dots: bool = True,
) -> Any:
    """Draw surface, lines and points, coloured by their values; grey lines where they rest.

    Colours of what is faint are mixed with white.
    """
    rest, place, values = (each[few.kept] for each in (rest, place, values))
    faint = faint[few.kept]
    triangles, lines = few.triangles, few.joined(lines)
    limit = float(np.nanmax(np.abs(values))) or 1.0
    mapped = ScalarMappable(Normalize(-limit, limit), style.SIGN_MAP)

    def colours(of: Array, pale: BoolArray) -> Array:
        found = np.asarray(mapped.to_rgba(of))
        found[pale, :3] += VEIL * (1 - found[pale, :3])
        return found

    if len(triangles):
        own = colours(values[triangles].mean(axis=1), faint[triangles].sum(axis=1) > 1)
        look: dict[str, Any] = {"edgecolor": "#00000030", "linewidth": 0.2, "facecolors": own}
        faces = Poly3DCollection(place[triangles], **look)
        faces.set_rasterized(True)
        axes.add_collection3d(faces)
    ends = lines if len(lines) else sides(triangles)
    at_rest = ends if dots else rim(triangles)
    if len(at_rest):
        axes.add_collection3d(Line3DCollection(rest[at_rest], colors="#999999", linewidths=0.7))
    if dots and len(ends):
        axes.add_collection3d(Line3DCollection(place[ends], colors="#000000", linewidths=0.6))
    if dots:
        found = np.isfinite(values)
        look = {"s": 14, "edgecolors": "#000000", "linewidths": 0.3, "depthshade": False}
        axes.scatter(*place[found].T, c=colours(values[found], faint[found]), **look)
        if not found.all():
            cross = {"marker": "x", "color": "#000000", "s": 16, "label": "not determined"}
            axes.scatter(*place[~found].T, **cross)
            axes.legend()
    both = np.concatenate([rest, place])
    middle, span = (both.min(axis=0) + both.max(axis=0)) / 2, np.ptp(both, axis=0)
    span = np.maximum(span, THINNEST * span.max())
    for name, centre, width in zip(AXES, middle, span, strict=True):
        axes.set(**{f"{name}lim": (centre - width / 2, centre + width / 2)})
        axes.set(**{f"{name}label": PLACE.titled(name)})
        axis = getattr(axes, f"{name}axis")
        most = (
            round(1 + 2 * width / span.max())
            if style.narrow()
            else round(2 + 3 * width / span.max())
        )
        axis.set_major_locator(style.ticks(most))
    axes.set_box_aspect(span, zoom=0.8 if style.narrow() else 1.05)
    axes.tick_params(pad=-1)
    for axis in (axes.xaxis, axes.yaxis):
        axis.labelpad = 6.0 if style.narrow() else 4.0
    return mapped
