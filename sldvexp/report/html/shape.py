"""The deflection shape that turns and moves: what its script draws, as small as can be."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from sldvexp.dataset import VARIABLES
from sldvexp.geometry import joined_points
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.shape import normals

FIELD = VARIABLES["field"]
#: Frequencies are left out beyond so many bytes, the strongest are kept.
MOST_BYTES = 1_200_000
#: A surface of more nodes is nothing for a browser.
MOST_NODES = 40_000
BYTES_A_NUMBER = 4 * 4 / 3
#: Real part, imaginary part and bound of each component.
PARTS = 3
#: Numbers of a node that colours by strain need: three complex components, extension and stress.
COLOURINGS = 3 * 2 + 2
#: Colours of sizes, of numbers with a sign and of angles, in so many steps.
MAPS = {"size": style.SIZE_MAP, "sign": style.SIGN_MAP, "phase": style.PHASE_MAP}
STEPS = 64
#: What is largest of a cycle, with its name and unit.
LARGEST = (
    ("principal_strain", "largest extension", "strain"),
    ("von_mises", "von Mises stress", VARIABLES["strain"]["von_mises"].units),
)


def shape_of(
    field: xr.Dataset, volume: xr.Dataset, strain: xr.Dataset | None = None
) -> dict[str, Any] | None:
    """Prepare one layer of a field for the page's script.

    Parameters
    ----------
    field, volume : xarray.Dataset
        The groups.
    strain : xarray.Dataset, optional
        That of the surface, for colours.

    Returns
    -------
    dict or None
        Positions (``length_unit``) and triangles; for each of ``frequencies`` and ``components``
        real part, imaginary part and bound (``velocity_unit``) at every node; the components'
        directions, at every node or the same for all, and the surface's normal. Arrays are
        base64 of little-endian float32 and uint16, colour maps of red, green and blue bytes.
        None if the surface has too many nodes to be drawn.
    """
    nodes, triangles, _ = surface_layer(volume)
    if len(nodes) > MOST_NODES or not len(triangles):
        return None
    components = [str(c) for c in field["component"].values]
    count = len(nodes)
    return _drawn(
        field.isel(node=nodes).rename(node="point"),
        field["position"].values[nodes],
        triangles=triangles,
        normal=_directions(["n"], volume),
        directions=_directions(components, volume),
        strain=strain if strain is not None and strain.sizes["place"] == count else None,
    )


def shape_of_points(point: xr.Dataset, line_of_sight: xr.Dataset) -> dict[str, Any] | None:
    """Prepare velocities of points, and triangles and lines between them, for the script.

    Parameters
    ----------
    point, line_of_sight : xarray.Dataset
        The groups.

    Returns
    -------
    dict or None
        As of `shape_of`, with ``lines`` and the points' ``names``. None if there are too many
        points to be drawn.
    """
    position, triangles, lines = joined_points(line_of_sight)
    if len(position) > MOST_NODES:
        return None
    data = _drawn(
        point,
        position,
        triangles=triangles,
        normal=normals(position, triangles)[None],
        directions=np.eye(3)[: point.sizes["component"], None],
    )
    names = [str(name) for name in line_of_sight["point"].values]
    return data | {"lines": _integers(lines), "names": names}


def _drawn(
    group: xr.Dataset,
    position: NDArray,
    triangles: NDArray,
    normal: NDArray,
    directions: NDArray,
    strain: xr.Dataset | None = None,
) -> dict[str, Any]:
    """Pack velocities of points with their bounds, and how they are drawn."""
    dims = ["frequency"] if "frequency" in group.dims else []
    whole = group[["velocity", "confidence"]].transpose(*dims, "component", "point")
    velocity, bound = whole["velocity"].values, whole["confidence"].values
    hertz: list[float | None] = [None]
    chosen = np.array([0])
    if dims:
        chosen = _strongest(velocity, 0 if strain is None else COLOURINGS * len(position))
        velocity, bound = velocity[chosen], bound[chosen]
        hertz = [float(f) for f in group["frequency"].values[chosen]]
    length, length_unit = _scale(np.ptp(position, axis=0).max(), FIELD["position"].units)
    speed, speed_unit = _scale(np.nanmax(np.abs(velocity), initial=0.0), FIELD["velocity"].units)
    return {
        "components": [str(c) for c in group["component"].values],
        "frequencies": hertz,
        "strongest": int(np.argmax(_sizes(velocity))) if dims else 0,
        "left_out": int(group.sizes.get("frequency", 1) - len(hertz)),
        "length_unit": length_unit,
        "velocity_unit": speed_unit,
        "level": f"{float(group.attrs.get('confidence_level', 0.95)):.0%}",
        "position": _floats(length * position),
        "triangles": _integers(triangles),
        "normal": _floats(normal),
        "directions": _floats(directions),
        "real": _floats(speed * velocity.real),
        "imaginary": _floats(speed * velocity.imag),
        "bound": _floats(speed * bound),
        "maps": {name: _colours(of) for name, of in MAPS.items()},
        "colourings": [] if strain is None else list(_colourings(strain, chosen)),
    }


def _colourings(strain: xr.Dataset, frequencies: NDArray) -> Iterator[dict[str, Any]]:
    """Pack strains as colours: components as they change, then what is largest of a cycle.

    The velocity is drawn as if it were the displacement, whose strain is a quarter of a period
    earlier than that of the displacement itself; so it is what the drawn surface has.
    """
    whole = strain["strain"].transpose("frequency", "strain_component", "place").values
    for name, own in zip(
        strain["strain_component"].values, np.moveaxis(1j * whole[frequencies], 1, 0), strict=True
    ):
        yield _colouring(f"strain e_{name} now", f"e_{name} now", own, "strain")
    for name, title, unit in LARGEST:
        if name in strain:
            values = strain[name]
            values = values.isel(principal=0) if "principal" in values.dims else values
            own = values.transpose("frequency", "place").values[frequencies]
            yield _colouring(title, title, own, unit)


def _colouring(text: str, title: str, values: NDArray, unit: str) -> dict[str, Any]:
    """Pack values of nodes by frequency, shape (frequency, node); complex ones change."""
    factor, unit = _scale(np.nanmax(np.abs(values), initial=0.0), unit)
    found = {"text": text, "title": title, "unit": unit, "real": _floats(factor * values.real)}
    return found | ({"imaginary": _floats(factor * values.imag)} if np.iscomplexobj(values) else {})


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


def _strongest(velocity: NDArray, more: int) -> NDArray:
    """Find indices of the frequencies of the largest velocities, as many as there is room for.

    Parameters
    ----------
    more : int
        Numbers that every frequency has beside those of the velocity.
    """
    count = int(MOST_BYTES / (BYTES_A_NUMBER * (PARTS * velocity[0].size + more)))
    return np.sort(np.argsort(-_sizes(velocity), kind="stable")[: max(1, count)])


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


def _floats(values: NDArray) -> str:
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()


def _colours(name: str) -> str:
    """Take a map's colours at equal steps, three bytes each."""
    colours = colormaps[name](np.linspace(0, 1, STEPS), bytes=True)[:, :3]
    return base64.b64encode(colours.tobytes()).decode()


def _integers(values: NDArray) -> str:
    return base64.b64encode(np.ascontiguousarray(values, "<u2").tobytes()).decode()
