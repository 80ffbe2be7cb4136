"""The deflection shape that turns and moves: what its script draws, as small as can be."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from sldvexp.dataset import VARIABLES
from sldvexp.geometry import FewerNodes, fewer_nodes, joined_points
from sldvexp.lazy import xarray as xr
from sldvexp.plot import moving_look, style
from sldvexp.plot.shape import normals
from sldvexp.report.html import packing

FIELD = VARIABLES["field"]
#: Numbers are rounded beyond so many bytes; of more frequencies than fit, the strongest are kept.
MOST_BYTES = 1_900_000
#: Of a surface of more nodes some are drawn for all.
MOST_NODES = 20_000
BYTES_A_NUMBER = 4 * 4 / 3
#: Of its depth, by which a layer may be off the surface's normals.
ALONG = 1e-6
#: Real part, imaginary part and bound of each component.
PARTS = 3
#: Numbers of a node that colours by strain need: three complex components, extension and stress.
COLOURINGS = 3 * 2 + 2
#: Colours of sizes, of numbers with a sign and of angles, in so many steps.
MAPS = {"size": style.SIZE_MAP, "sign": style.SIGN_MAP, "phase": style.PHASE_MAP}
STEPS = 64
#: What moving pictures and the page have in common, and how numbers are packed.
LOOK = {
    "azimuth": moving_look.AZIMUTH,
    "elevation": moving_look.ELEVATION,
    "seconds": moving_look.SECONDS_A_TURN,
    "share": moving_look.MOVING_SHARE,
    "pale": moving_look.PALE,
    "paleness": moving_look.PALENESS,
    "none": packing.NONE,
}
#: What is largest of a cycle, with its name and unit.
LARGEST = (
    ("principal_strain", "largest extension", "strain"),
    ("von_mises", "von Mises stress", VARIABLES["strain"]["von_mises"].units),
)


def shape_of(
    field: xr.Dataset,
    volume: xr.Dataset,
    strain: xr.Dataset | None = None,
    pose: xr.Dataset | None = None,
    taken: int = 0,
) -> dict[str, Any] | None:
    """Prepare the layers of a field for the page's script, the given surface first.

    Parameters
    ----------
    field, volume : xarray.Dataset
        The groups.
    strain : xarray.Dataset, optional
        That of the surface, for colours.
    pose : xarray.Dataset, optional
        From where it was seen.
    taken : int
        Bytes that another shape of the page takes of the room for both.

    Returns
    -------
    dict or None
        Positions (``length_unit``) and triangles; for each of ``frequencies`` and ``components``
        real part, imaginary part and bound (``velocity_unit``) at every node; the components'
        directions, at every node or the same for all, and the surface's normal. Arrays are
        base64 of little-endian float32 and uint16, colour maps of red, green and blue bytes.
        Of a surface with more than `MOST_NODES` some nodes stand for all, see ``few``.
        None if it has no triangles.
    """
    nodes, triangles, _ = surface_layer(volume)
    if not len(triangles):
        return None
    components = [str(c) for c in field["component"].values]
    if strain is not None and strain.sizes["place"] != len(nodes):
        strain = None
    few = fewer_nodes(field["position"].values[nodes], triangles, MOST_NODES)
    on_surface = field.isel(node=nodes).rename(node="point")
    data = _drawn(
        on_surface.isel(point=few.kept),
        on_surface["position"].values[few.kept],
        triangles=few.triangles,
        normal=_of_nodes(_directions(["n"], volume), few.kept),
        directions=_of_nodes(_directions(components, volume), few.kept),
        strain=None if strain is None else strain.isel(place=few.kept),
        pose=pose,
        layers=[
            (depth, first, group.isel(point=few.kept))
            for depth, first, group in _other_layers(field, volume, nodes)
        ],
        most=MOST_BYTES - taken,
        first=int(nodes[0]),
    )
    return data | _few(few, on_surface)


def shape_of_points(
    point: xr.Dataset, line_of_sight: xr.Dataset, pose: xr.Dataset | None = None
) -> dict[str, Any] | None:
    """Prepare velocities of points, and triangles and lines between them, for the script.

    Parameters
    ----------
    point, line_of_sight : xarray.Dataset
        The groups.
    pose : xarray.Dataset, optional
        From where they were seen.

    Returns
    -------
    dict or None
        As of `shape_of`, with ``lines`` and the points' ``names``.
    """
    position, triangles, lines = joined_points(line_of_sight)
    few = fewer_nodes(position, triangles, MOST_NODES)
    data = _drawn(
        point.isel(point=few.kept),
        position[few.kept],
        triangles=few.triangles,
        normal=normals(position, triangles)[None, few.kept],
        directions=np.eye(3)[: point.sizes["component"], None],
        pose=pose,
    )
    names = [str(name) for name in line_of_sight["point"].values[few.kept]]
    return data | {"lines": _integers(few.joined(lines)), "names": names} | _few(few, point)


def _of_nodes(vectors: NDArray, kept: NDArray) -> NDArray:
    """Take vectors, shape (component, node or 1, axis), of some nodes."""
    return vectors if vectors.shape[1] == 1 else vectors[:, kept]


def _few(few: FewerNodes, group: xr.Dataset) -> dict[str, Any]:
    """Tell which nodes are drawn for how many, and how far others are from those drawn for them."""
    if len(few.kept) == len(few.stands_in):
        return {"few": None}
    velocity, _ = _values(group)
    off = np.abs(velocity - velocity[..., few.kept[few.stands_in]])
    speed, unit = _scale(np.nanmax(np.abs(velocity), initial=0.0), FIELD["velocity"].units)
    return {
        "few": {
            "nodes": few.kept.tolist(),
            "of": len(few.stands_in),
            "off": f"{speed * np.nanmax(off, initial=0.0):.2g} {unit}",
        }
    }


def stands_of(pose: xr.Dataset, position: NDArray, length: float = 1.0) -> list[dict[str, Any]]:
    """Find where the instrument stood and looked, and from where each view sees an object.

    Parameters
    ----------
    pose : xarray.Dataset
        The group.
    position : (n, 3) array
        Of the object, m.
    length : float
        What origins are multiplied by.

    Returns
    -------
    list of dict
        ``name``, ``origin``, the direction ``axis`` of the instrument, and its ``azimuth`` and
        ``elevation`` (degrees) about the object's middle; views of unknown pose are left out.
    """
    middle = (np.nanmin(position, axis=0) + np.nanmax(position, axis=0)) / 2
    found = []
    for view in pose["view"].values:
        one = pose.sel(view=view)
        origin, axis = one["origin"].values, one["rotation"].values[2]
        x, y, z = origin - middle
        angles = np.degrees([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
        if np.isfinite([*angles, *axis]).all():
            found.append(
                {
                    "name": str(view),
                    "origin": (length * origin).tolist(),
                    "axis": axis.tolist(),
                    "azimuth": float(angles[0]),
                    "elevation": float(angles[1]),
                }
            )
    return found


def _other_layers(
    field: xr.Dataset, volume: xr.Dataset, surface: NDArray
) -> list[tuple[float, int, xr.Dataset]]:
    """Find the other layers, if they are the surface moved along its normals.

    Returns
    -------
    list of (depth, first node, field)
    """
    found = []
    normal = _directions(["n"], volume)[0]
    place, at = field["position"].values, volume["node_layer"].values
    given = int(at[surface[0]])
    for layer, depth in enumerate(volume["depth"].values):
        nodes = np.flatnonzero(at == layer)
        if layer == given or len(nodes) != len(surface):
            continue
        off = float(depth - volume["depth"].values[given])
        away = place[nodes] - place[surface] - off * normal
        if np.abs(away).max() < ALONG * abs(off):
            own = field.isel(node=nodes).rename(node="point")
            found.append((off, int(nodes[0]), own))
    return found


def _drawn(
    group: xr.Dataset,
    position: NDArray,
    triangles: NDArray,
    normal: NDArray,
    directions: NDArray,
    strain: xr.Dataset | None = None,
    pose: xr.Dataset | None = None,
    layers: Sequence[tuple[float, int, xr.Dataset]] = (),
    most: int | None = None,
    first: int = 0,
) -> dict[str, Any]:
    """Pack velocities of points with their bounds, and how they are drawn.

    Nodes are numbered as in the volume, from `first` on.
    """
    velocity, bound = _values(group)
    length, length_unit = _scale(np.ptp(position, axis=0).max(), FIELD["position"].units)
    speed, speed_unit = _scale(np.nanmax(np.abs(velocity), initial=0.0), FIELD["velocity"].units)
    most = MOST_BYTES if most is None else most
    chosen, numbers = _numbers(speed * velocity, speed * bound, strain, most)
    room = most - size_of(numbers)
    numbers["layers"] = list(_packed(layers, chosen, length, length_unit, speed, room))
    dims = "frequency" in group.dims
    return {
        "components": [str(c) for c in group["component"].values],
        "frequencies": group["frequency"].values[chosen].tolist() if dims else [None],
        "strongest": int(np.argmax(_sizes(velocity[chosen]))),
        "left_out": len(velocity) - len(chosen),
        "first": first,
        "length_unit": length_unit,
        "velocity_unit": speed_unit,
        "level": f"{float(group.attrs.get('confidence_level', 0.95)):.0%}",
        "position": packing.floats(length * position),
        "triangles": _integers(triangles),
        "normal": packing.floats(normal),
        "directions": packing.floats(directions),
        "stands": [] if pose is None else stands_of(pose, position, length),
        "maps": {name: _colours(of) for name, of in MAPS.items()},
        "look": LOOK,
    } | numbers


def surface_values(
    field: xr.Dataset, volume: xr.Dataset, frequencies: Sequence[Any]
) -> tuple[NDArray, NDArray, NDArray]:
    """Take positions, velocities and the components' directions on the given surface.

    Returns
    -------
    position : (node, axis) array, m
    velocity : (frequency, component, node) array, m/s
        At the given frequencies.
    directions : (component, node or 1, axis) array
    """
    nodes, *_ = surface_layer(volume)
    velocity, _ = _values(field.isel(node=nodes).rename(node="point"))
    if "frequency" in field.dims:
        velocity = velocity[np.isin(field["frequency"].values, frequencies)]
    components = [str(c) for c in field["component"].values]
    return field["position"].values[nodes], velocity, _directions(components, volume)


def _values(group: xr.Dataset) -> tuple[NDArray, NDArray]:
    """Take velocities and bounds, shape (frequency, component, point)."""
    dims = ["frequency"] if "frequency" in group.dims else []
    whole = group[["velocity", "confidence"]].transpose(*dims, "component", "point")
    if not dims:
        whole = whole.expand_dims("frequency")
    return whole["velocity"].values, whole["confidence"].values


def _packed(
    layers: Sequence[tuple[float, int, xr.Dataset]],
    frequencies: NDArray,
    length: float,
    length_unit: str,
    speed: float,
    room: int,
) -> Iterator[dict[str, Any]]:
    """Round the other layers, if there is room for all of them."""
    packed = []
    for depth, first, group in layers:
        velocity, bound = (speed * part[frequencies] for part in _values(group))
        text = f"{abs(length * depth):.3g} {length_unit} {'above' if depth > 0 else 'below'}"
        own = {"text": text, "depth": length * depth, "first": first}
        own |= _written(velocity, bound, rounded=True)
        room -= size_of(own)
        if room < 0:
            return
        packed.append(own)
    yield from packed


def _numbers(
    velocity: NDArray, bound: NDArray, strain: xr.Dataset | None, most: int
) -> tuple[NDArray, dict[str, Any]]:
    """Write all numbers exactly if there is room, else rounded ones of the frequencies that fit."""
    more = 0 if strain is None else COLOURINGS * velocity.shape[-1]
    each = BYTES_A_NUMBER * (PARTS * velocity[0].size + more)
    rounded = each * len(velocity) > most
    strongest = np.argsort(-_sizes(velocity), kind="stable")
    count = len(strongest)
    while True:
        chosen = np.sort(strongest[:count])
        own = _written(velocity[chosen], bound[chosen], rounded)
        own["colourings"] = [] if strain is None else list(_colourings(strain, chosen, rounded))
        room = most / size_of(own)
        if room >= 1 or count == 1:
            return chosen, own
        count = max(1, min(count - 1, int(room * count)))


def _written(velocity: NDArray, bound: NDArray, rounded: bool) -> dict[str, Any]:
    if rounded:
        return {"rounded": True, **packing.velocities(velocity, bound)}
    parts = {"real": velocity.real, "imaginary": velocity.imag, "bound": bound}
    return {"rounded": False} | {name: packing.floats(part) for name, part in parts.items()}


def size_of(data: dict[str, Any]) -> int:
    """Count the bytes of the numbers that are written."""
    return sum(map(len, _texts(data)))


def _texts(own: dict[str, Any]) -> Iterator[str]:
    for value in own.values():
        if isinstance(value, str):
            yield value
        elif isinstance(value, list):
            yield from (text for one in value if isinstance(one, dict) for text in _texts(one))


def _colourings(
    strain: xr.Dataset, frequencies: NDArray, rounded: bool
) -> Iterator[dict[str, Any]]:
    """Pack strains as colours: components as they change, then what is largest of a cycle.

    The velocity is drawn as if it were the displacement, whose strain is a quarter of a period
    earlier than that of the displacement itself; so it is what the drawn surface has.
    """
    whole = strain["strain"].transpose("frequency", "strain_component", "place").values
    for name, own in zip(
        strain["strain_component"].values, np.moveaxis(1j * whole[frequencies], 1, 0), strict=True
    ):
        yield _colouring(f"strain e_{name} now", f"e_{name} now", own, "strain", rounded)
    for name, title, unit in LARGEST:
        if name in strain:
            values = strain[name]
            values = values.isel(principal=0) if "principal" in values.dims else values
            own = values.transpose("frequency", "place").values[frequencies]
            yield _colouring(title, title, own, unit, rounded)


def _colouring(text: str, title: str, values: NDArray, unit: str, rounded: bool) -> dict[str, Any]:
    """Pack values of nodes by frequency, shape (frequency, node); complex ones change."""
    factor, unit = _scale(np.nanmax(np.abs(values), initial=0.0), unit)
    parts = {"real": values.real}
    if np.iscomplexobj(values):
        parts["imaginary"] = values.imag
    found: dict[str, Any] = {"text": text, "title": title, "unit": unit}
    if not rounded:
        return found | {name: packing.floats(factor * part) for name, part in parts.items()}
    step = packing.shades(factor * values)
    found["finest"] = step.tolist()
    return found | {n: packing.whole(factor * part / step[:, None]) for n, part in parts.items()}


def surface_layer(volume: xr.Dataset) -> tuple[NDArray, NDArray, float]:
    """Find the layer next to the given surface.

    Returns
    -------
    nodes : (n,) array
        Of the volume.
    triangles : (m, 3) array
        Indices into `nodes`.
    depth : float
        m.
    """
    layer = int(np.argmin(np.abs(volume["depth"].values)))
    node_layer, prisms = volume["node_layer"].values, volume["element"].values
    nodes = np.flatnonzero(node_layer == layer)
    lower, upper = prisms[:, :3], prisms[:, 3:]
    triangles = lower[node_layer[lower[:, 0]] == layer]
    if not len(triangles):
        triangles = upper[node_layer[upper[:, 0]] == layer]
    return nodes, np.searchsorted(nodes, triangles), float(volume["depth"].values[layer])


def _sizes(velocity: NDArray) -> NDArray:
    """Find the largest velocity at each frequency."""
    largest: NDArray = np.nanmax(np.abs(velocity), axis=(1, 2), initial=0.0)
    return largest


def _directions(components: list[str], volume: xr.Dataset) -> NDArray:
    """Take unit vectors (component, node, axis); those of the world are the same at each node."""
    axes = list(volume["axis"].values)
    if set(components) <= set(axes):
        unit = np.eye(3)[[axes.index(c) for c in components]]
        return unit[:, None]
    frame = volume["frame"].sel(local_axis=components)
    return frame.transpose("local_axis", "surface_node", "axis").values


def _scale(largest: float, unit: str) -> tuple[float, str]:
    """Choose factor and unit that make a size easy to read."""
    for factor, prefix in ((1e-6, "M"), (1e-3, "k"), (1.0, ""), (1e3, "m"), (1e6, "µ")):
        if largest * factor >= 1:
            return factor, prefix + unit
    return 1e9, f"n{unit}"


def _colours(name: str) -> str:
    """Take a map's colours at equal steps, three bytes each."""
    colours = colormaps[name](np.linspace(0, 1, STEPS), bytes=True)[:, :3]
    return base64.b64encode(colours.tobytes()).decode()


def _integers(values: NDArray) -> str:
    return base64.b64encode(np.ascontiguousarray(values, "<u2").tobytes()).decode()
