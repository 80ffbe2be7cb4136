"""The volume with the places around it, and as every view sees it (Figures 5.5 and 5.6)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import NDArray

from sldvexp.dataset import VARIABLES, RunData, Source
from sldvexp.geometry import rim
from sldvexp.lazy import xarray as xr
from sldvexp.plot import as_seen, style
from sldvexp.plot.selection import require
from sldvexp.typing import Array, IndexArray

NO_VOLUME = (
    "the run has no volume with poses around it (groups volume and pose); choose volume=grid, as "
    "in experiment=plate"
)

NO_POSE = "the run has no poses (group pose); see experiment=pose"

#: Length of the drawn axis of an instrument, as a fraction of its distance from the volume.
AXIS_LENGTH = 0.25

#: Width of the scene, and its height where it is above, over the width of the sheet.
SCENE, SCENE_ABOVE = 0.42, 0.75

#: Fewer pixels or nodes than this are drawn as larger spots.
FEW = 500

#: Panels of views beside each other.
COLUMNS = 3


def unavailable_because(run: RunData) -> str:
    """Explain why no volume can be shown; empty if it can."""
    known = run.has("volume", "position", "element") and run.has("pose", "origin", "rotation")
    return "" if known else NO_VOLUME


@style.styled
def volume(source: Source | RunData) -> Figure:
    """Draw the volume among the instrument's places, and its nodes in every view's image.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> corner = np.array([[0, 0], [0.1, 0], [0, 0.1], [0.1, 0.1]])
    >>> place = np.array([[x, y, z] for z in (1.5, 1.51) for x, y in corner])
    >>> prisms = [[0, 1, 2, 4, 5, 6], [1, 3, 2, 5, 7, 6]]
    >>> block = group("volume", {}, position=place, element=prisms, depth=[0.0, 0.01])
    >>> pose = group("pose", {"view": ["front"]}, origin=np.zeros((1, 3)), rotation=[np.eye(3)])
    >>> volume({"volume": block, "pose": pose}).get_suptitle()
    'Volume of 8 nodes, 2 prisms, 2 layers from 0 to 10 mm'
    """
    run = RunData.from_source(source)
    require("volume", unavailable_because(run))
    pose, group = run.groups["pose"], run.groups["volume"]
    names = [str(v) for v in pose["view"].values]
    middle, ends = _surface(group), outline(group)
    made, axes, scene = _panels(names, _title(group))
    _scene(scene, run, names)
    spot = 1.0 if len(middle) > FEW else 2.0
    for axis, name in zip(axes.ravel(), names, strict=False):
        up_down, left_right = np.degrees(seen(pose.sel(view=name), group["position"].values)).T
        if run.has(f"image/{name}", "angle"):
            pixel = np.degrees(run.groups[f"image/{name}"]["angle"].values)
            # wider than nodes, which may lie on them
            size = spot if len(pixel) > FEW else 4 * spot
            look = {"color": "#bbbbbb", "markersize": size, "rasterized": True}
            axis.plot(pixel[:, 1], pixel[:, 0], ".", label="pixel", **look)
        look = {"color": style.COLOURS[1], "markersize": spot, "rasterized": True}
        axis.plot(left_right[middle], up_down[middle], ".", label="node of the surface", **look)
        look = {"color": style.COLOURS[3], "linewidth": 0.8}
        edges = _apart(np.stack([left_right, up_down], axis=1)[ends])
        axis.plot(*edges.T, label="edge of the volume", **look)
        axis.set_aspect("equal", adjustable="datalim")
        as_seen.turn(axis)
        for own in (axis.xaxis, axis.yaxis):
            own.set_major_locator(style.ticks(3))
    style.outer_labels(axes, len(names), *style.mirror_labels(VARIABLES["image"]["angle"]))
    style.legend(made, scene, axes[0, 0])
    handles: Any = made.legends[0].legend_handles
    for shown in handles:
        shown.set_markersize(4.0)
    return made


def _panels(names: list[str], title: str) -> tuple[Figure, NDArray[Any], Any]:
    """Make panels of the views beside the scene, or below it on a narrow sheet."""
    narrow, width = style.narrow(), style.inches()
    columns = min(len(names), 2 if narrow else COLUMNS)
    rows = -(-len(names) // columns)
    titles = [f"view {name}" for name in names]
    before = 0.0 if narrow else SCENE * width
    above = SCENE_ABOVE * width if narrow else 0.0
    ratio = 0.95 if narrow else 1.2 if rows > 1 else 1.6
    room: dict[str, Any] = {"beside": style.NUMBERS, "right": 0.15, "before": before}
    made, axes = style.sheet(rows, columns, ratio, title, titles, above=above, **room)
    for axis in axes.ravel()[len(names) :]:
        axis.remove()
    high = made.get_figheight()
    if narrow:
        foot = 1 - (above + 0.3) / high
        box = (0.0, foot, 1.0, above / high)
    else:
        foot = 0.5 * style.BOTTOM / high
        box = (0.0, foot, SCENE, 1.0 - 0.6 * style.TOP / high - foot)
    return made, axes, made.add_axes(box, projection="3d")


def stands_unavailable_because(run: RunData) -> str:
    """Explain why no stands can be shown; empty if they can."""
    if not run.has("pose", "origin", "rotation"):
        return NO_POSE
    return "" if unavailable_because(run) else "the figure volume has the instrument's places"


@style.styled
def stands(source: Source | RunData) -> Figure:
    """Draw where the instrument stood and the way it looked, of a run without a volume.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> pose = group("pose", {"view": ["front"]}, origin=np.zeros((1, 3)), rotation=[np.eye(3)])
    >>> stands({"pose": pose}).get_suptitle()
    'Where the instrument stood'
    """
    run = RunData.from_source(source)
    require("stands", stands_unavailable_because(run))
    names = [str(v) for v in run.groups["pose"]["view"].values]
    width = style.inches()
    made = style.figure((0.8 if style.narrow() else 0.55) * width, "Where the instrument stood")
    made.set_layout_engine("none")
    axes: Any = made.add_axes((0.05, 0.02, 0.9, 0.88), projection="3d")
    _scene(axes, run, names)
    style.legend(made, axes)
    return made


def _surface(group: xr.Dataset) -> IndexArray:
    """Find nodes of the layer nearest to the given surface."""
    depth = group["depth"].values if "depth" in group else np.zeros(1)
    per_layer = group.sizes["node"] // len(depth)
    return np.arange(per_layer) + int(np.abs(depth).argmin()) * per_layer


def _title(group: xr.Dataset) -> str:
    length = VARIABLES["volume"]["depth"]
    depth = length.factor * group["depth"].values if "depth" in group else np.zeros(1)
    layers = (
        f"{len(depth)} layers from {depth.min():g} to {depth.max():g} {length.shown_unit}".replace(
            "-", "−"
        )
    )
    return f"Volume of {group.sizes['node']} nodes, {group.sizes['element']} prisms, {layers}"


def seen(pose: xr.Dataset, position: Array) -> Array:
    """Compute mirror angles that reach points from a view, (n, 2), rad (Eqs 4.2 and 4.3)."""
    x, y, z = pose["rotation"].values @ (position - pose["origin"].values).T
    offset = float(pose.attrs.get("mirror_offset", 0.0))
    return np.stack([np.arctan2(y, z), np.arctan2(x, np.hypot(y, z) + offset)], axis=1)


def _scene(axes: Axes3D, run: RunData, names: list[str]) -> None:
    """Draw the world with the volume's outline, the object's points, the instrument's places."""
    pose = run.groups["pose"]
    points = object_points(run)
    middle = points.mean(axis=0) if len(points) else np.zeros(3)
    if run.has("volume", "position", "element"):
        group = run.groups["volume"]
        position = group["position"].values
        middle = position.mean(axis=0)
        edges = _apart(position[outline(group)])
        axes.plot(*edges.T, color=style.COLOURS[1], linewidth=0.6, label="volume")
    if len(points):
        axes.plot(*points.T, "x", color=style.COLOURS[3], markersize=4, label="object's points")
    places = pose.sel(view=names)
    origins, optical = places["origin"].values, places["rotation"].values[:, 2]
    far = AXIS_LENGTH * np.linalg.norm(middle - origins, axis=1, keepdims=True)
    axes.plot(*origins.T, "D", color=style.COLOURS[0], label="instrument")
    ways = _apart(np.stack([origins, origins + far * optical], axis=1))
    axes.plot(*ways.T, color=style.COLOURS[0], label="its axis")
    away = _apart(np.stack([origins, np.broadcast_to(middle, origins.shape)], axis=1))
    axes.plot(*away.T, ":", color=style.COLOURS[-1], linewidth=0.7)
    for name, origin in zip(names, origins, strict=True):
        # aside of its axis, and of the numbers at the right
        side = "top" if origin[1] < middle[1] else "bottom"
        # spaces that a picture as SVG keeps
        axes.text(*origin, f"{name}\N{NO-BREAK SPACE}\N{NO-BREAK SPACE}", ha="right", va=side)
    length = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
    axes.set_box_aspect(length, zoom=0.8)
    axes.tick_params(pad=-1)
    for axis, name, own in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", length, strict=True):
        axis.set_major_locator(style.ticks(1 if own < 0.6 * length.max() else 3))
        axis.set_label_text(f"{name}, {VARIABLES['pose']['origin'].units}")
    # the height of most worlds is y; looked at from beside the instruments
    axes.view_init(elev=20, azim=-60, vertical_axis="y")


def object_points(run: RunData) -> Array:
    """Find the points of the calibration object, (n, 3), m; of points of the structure without."""
    for group, name in (("target", "position"), ("registration", "object_point")):
        if run.has(group, name):
            found = np.asarray(run.groups[group][name].values, float).reshape(-1, 3)
            return found[np.isfinite(found).all(axis=1)]
    if run.has("line_of_sight", "position"):
        return np.asarray(run.groups["line_of_sight"]["position"].values, float).reshape(-1, 3)
    return np.empty((0, 3))


def _apart(edges: Array) -> Array:
    """Join edges, (edge, 2, axis), to one line that is broken between them, (n, axis)."""
    gap = np.full((len(edges), 1, edges.shape[2]), np.nan)
    return np.concatenate([edges, gap], axis=1).reshape(-1, edges.shape[2])


def outline(group: xr.Dataset) -> IndexArray:
    """Find edges of the surface's rim, on the first and last layer and between, (edge, 2)."""
    element = group["element"].values.astype(np.intp)
    depths = group.sizes.get("layer", 2)
    nodes = group.sizes["node"]
    per_layer = nodes // depths
    triangle = element[(element[:, :3] < per_layer).all(axis=1), :3]
    edge = rim(triangle)
    last = nodes - per_layer
    corner = _corners(group["position"].values[:per_layer], edge)
    through = np.stack([corner, corner + last], axis=1)
    return np.concatenate([edge, edge + last, through])


def _corners(position: Array, rim: IndexArray) -> IndexArray:
    """Find nodes at which the rim turns by more than 30 deg."""
    found = []
    for node in np.unique(rim):
        own = rim[(rim == node).any(axis=1)]
        ends = np.where(own[:, 0] == node, own[:, 1], own[:, 0])
        if len(ends) == 2:
            way = position[ends] - position[node]
            way /= np.linalg.norm(way, axis=1, keepdims=True)
            if way[0] @ way[1] > -np.cos(np.radians(30.0)):
                found.append(node)
    return np.array(found, dtype=np.intp)
