"""One layer of a field's volume, as a plane map and with its nodes' values.

A layer that is flat is seen along two axes of the world. One that bends in one direction is rolled
out, so that lengths on the map are those on the surface: the place along its axis stays, and across
it stands the length of the arc. Another is seen along two axes too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from sldvexp.dataset import VARIABLES, RunData
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.plot.selection import at_frequency, one_of
from sldvexp.typing import Array, ComplexArray, IndexArray

AXES = "xyz"
#: Of nodes and points, as figures show it.
PLACE = VARIABLES["field"]["position"]

#: Height of the true surface over a layer, in layer spacings, that makes no difference.
IN_LAYER = 0.02

#: Deviation of unit normals from one another up to which a surface is flat, and share of the
#: second singular value of normals up to which they lie in a plane.
FLAT, BENT = 1e-6, 1e-3

NO_FIELD = (
    "the run has no velocity field (group field); choose a volume and a reconstruction, as in "
    "experiment=plate"
)


@dataclass(frozen=True, eq=False)
class VolumeLayer:
    """A layer of the volume at one frequency.

    Parameters
    ----------
    group : Dataset
        The field at the layer's nodes and one frequency.
    node : ndarray of int, shape (n,)
        Which nodes of the field they are.
    position : ndarray, shape (n, 3), m
    triangle : ndarray of int, shape (triangle, 3)
        By the layer's own nodes.
    plane : tuple of (int, int)
        The two axes of the world along which the layer is seen best.
    place : ndarray, shape (n, 2), m
        On the map.
    labels : tuple of (str, str)
        Names of the map's axes, without unit.
    depth : float, m
    frequency : str
        Such as ``197 Hz``.
    truth : dict of str to ndarray of complex, shape (n,), m/s
        In a virtual lab, of the components that can be compared with this layer: all if the true
        surface lies in it, only that along the normal if it lies elsewhere in the volume, since
        tangential motion changes through the thickness. NaN beside the real surface.
    """

    group: xr.Dataset
    node: IndexArray
    position: Array
    triangle: IndexArray
    plane: tuple[int, int]
    place: Array
    labels: tuple[str, str]
    depth: float
    frequency: str
    truth: dict[str, ComplexArray]

    @property
    def components(self) -> list[str]:
        """Names of the velocity's components."""
        return [str(c) for c in self.group["component"].values]

    @property
    def where(self) -> str:
        """Which layer it is."""
        return (
            "at the surface"
            if self.depth == 0
            else f"at {PLACE.factor * self.depth:+.3g} {PLACE.shown_unit} from the surface"
        )

    def values(self, name: str, component: str) -> NDArray:
        """Take a variable of one component at the nodes, shape (n,)."""
        values: NDArray = self.group[name].sel(component=component).values
        return values

    def bound(self, component: str) -> Array:
        """Take half-widths of the velocity's interval, shape (n,), m/s; NaN if there is none."""
        name = "confidence" if "confidence" in self.group else "velocity_std"
        if name not in self.group:
            return np.full(len(self.node), np.nan)
        return np.asarray(self.values(name, component), float)

    @property
    def bound_name(self) -> str:
        """What `bound` is."""
        if "confidence" in self.group:
            return f"{self.group.attrs.get('confidence_level', 0.95):.0%} bound"
        return "standard error"

    def mesh(self) -> Triangulation:
        """Make the layer's triangles in its plane, in the shown unit."""
        x, y = PLACE.factor * self.place.T
        return Triangulation(x, y, self.triangle)

    def label(self, axes: Axes) -> None:
        """Name the axes of a map of this layer."""
        first, second = map(PLACE.titled, self.labels)
        axes.set(xlabel=first, ylabel=second)
        axes.set_aspect("equal")

    @property
    def ratio(self) -> float:
        """Height of a map over its width, within limits."""
        wide, high = np.ptp(self.place, axis=0)
        return float(min(max(high / wide, 0.2), 1.6)) if wide > 0 else 1.0


def field_unavailable_because(run: RunData) -> str:
    """Explain why no field can be shown; empty if one can."""
    return "" if run.fields() else NO_FIELD


def layer_of(
    run: RunData,
    figure: str,
    frequency: float | None = None,
    depth: float | None = None,
    name: str | None = None,
) -> VolumeLayer:
    """Make one layer of a field.

    Parameters
    ----------
    figure : str
        For messages.
    frequency : float, Hz, optional
        See `sldvexp.plot.selection.at_frequency`.
    depth : float, m, optional
        The layer nearest to it. Without it that nearest to the given surface.
    name : str, optional
        Of the field, as `RunData.fields` names it.

    Raises
    ------
    UserError
        If there is none of that name, depth or frequency.
    """
    known = run.fields()
    chosen = one_of(name, known, figure, "field")
    whole, hertz = at_frequency(known[chosen], figure, frequency)
    depths = run.groups["volume"]["depth"].values if run.has("volume", "depth") else np.zeros(1)
    wanted = 0.0 if depth is None else depth
    if not depths.min() - 1e-9 <= wanted <= depths.max() + 1e-9 and depth is not None:
        low, high = PLACE.factor * depths.min(), PLACE.factor * depths.max()
        raise UserError(
            f"plot: {figure}: the volume's layers lie from {low:g} to {high:g} {PLACE.shown_unit}; "
            f"{PLACE.factor * wanted:g} {PLACE.shown_unit} is outside of them"
        )
    index = int(np.abs(depths - wanted).argmin())
    position = whole["position"].values
    per_layer = len(position) // len(depths)
    node = np.arange(per_layer) + index * per_layer
    below = whole["element"].values[:, :3]
    here = position[node]
    # the two axes along which the layer is widest, in the world's order
    first, second = sorted(np.argsort(np.ptp(here, axis=0))[1:])
    plane = int(first), int(second)
    truth = _truth(run, whole, node, depths, plane) if chosen == "field" else {}
    frame = run.groups["volume"].get("frame") if "volume" in run.groups else None
    normals = None if frame is None else frame.values[node % len(frame), 2]
    place, labels = rolled_out(here, normals, plane)
    return VolumeLayer(
        whole.isel(node=node),
        node,
        here,
        below[(below < per_layer).all(axis=1)],
        plane,
        place,
        labels,
        float(depths[index]),
        hertz,
        truth,
    )


def rolled_out(
    position: Array, normals: Array | None, plane: tuple[int, int]
) -> tuple[Array, tuple[str, str]]:
    """Lay a surface into a plane.

    Parameters
    ----------
    position, normals : ndarray, shape (n, 3)
        None if the normals are not known.
    plane : tuple of (int, int)
        Axes of the world along which it is seen if it cannot be rolled out.

    Returns
    -------
    place : ndarray, shape (n, 2), m
    labels : tuple of (str, str)

    Examples
    --------
    >>> turn = np.linspace(-0.5, 0.5, 40)
    >>> normals = np.column_stack([np.sin(turn), 0 * turn, np.cos(turn)])
    >>> place, labels = rolled_out(2.0 * normals, normals, (0, 1))
    >>> labels, round(float(np.ptp(place[:, 0])), 4)
    (('arc', 'y'), 1.9999)
    """
    flat = position[:, plane], (AXES[plane[0]], AXES[plane[1]])
    if normals is None or np.ptp(normals, axis=0).max() <= FLAT:
        return flat
    _, size, ways = np.linalg.svd(normals, full_matrices=False)
    axis = ways[2] * np.sign(ways[2][np.abs(ways[2]).argmax()])
    named = int(np.abs(axis).argmax())
    if size[2] > BENT * size[1] or axis[named] < 1 - FLAT or named not in plane:
        return flat
    middle = normals.mean(axis=0)
    across = np.cross(axis, middle / np.linalg.norm(middle))
    across *= np.sign(across[np.abs(across).argmax()])
    # along the surface the normal turns one way, so that its direction orders the places
    turn = np.arctan2(normals @ across, normals @ middle / np.linalg.norm(middle))
    _, first, back = np.unique(turn.round(9), return_index=True, return_inverse=True)
    rim = position[first] - np.outer(position[first] @ axis, axis)
    steps = np.linalg.norm(np.diff(rim, axis=0), axis=1)
    arc = np.append(0.0, np.cumsum(steps))
    arc -= np.interp(0.0, turn[first], arc)
    arc = arc * np.sign((position @ across - (position @ across).mean()) @ turn or 1.0)
    place = np.empty((len(position), 2))
    own = plane.index(named)
    place[:, own], place[:, 1 - own] = position @ axis, arc[np.ravel(back)]
    labels = ["arc", "arc"]
    labels[own] = AXES[named]
    return place, (labels[0], labels[1])


def _truth(
    run: RunData,
    field: xr.Dataset,
    node: IndexArray,
    depths: Array,
    plane: tuple[int, int],
) -> dict[str, ComplexArray]:
    """Find true velocities at the nodes by component, as far as they are of this layer."""
    if not run.has("truth", "velocity", "height"):
        return {}
    truth = run.groups["truth"]
    if truth.sizes["node"] != field.sizes["node"]:
        return {}
    if "frequency" in truth.dims:
        truth = truth.sel(frequency=field["frequency"].item())
    velocity = truth["velocity"].transpose("node", "component").values[node]
    components = [str(c) for c in field["component"].values]
    normal = AXES[3 - sum(plane)]
    if "n" in components:
        frame = run.groups["volume"]["frame"].values
        velocity = np.einsum("nca,na->nc", frame[node % len(frame)], velocity)
        normal = "n"
    spacing = np.ptp(depths) / max(len(depths) - 1, 1)
    height = np.nanmax(np.abs(truth["height"].values[node]))
    inside = height <= IN_LAYER * spacing
    return {c: velocity[:, i] for i, c in enumerate(components) if inside or c == normal}
