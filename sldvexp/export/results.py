"""A run's velocities as exports take them: every dimension there, units and conventions known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.dataset import CONVENTIONS
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, BoolArray, ComplexArray, IntArray

WORLD = ("x", "y", "z")
#: Groups of a run that velocities and their places come from.
GROUPS = ("field", "volume", "point", "line_of_sight")
#: Attributes of a run that an export repeats.
TOLD = (*CONVENTIONS, "title", "config_sha256", "end_time")


@dataclass(frozen=True, eq=False)
class PrismMesh:
    """The volume that a field is given over.

    Attributes
    ----------
    position : ndarray, shape (node, 3), m
        In the world, layer by layer.
    prisms : ndarray of int, shape (prism, 6)
        Nodes from 0, three of the lower layer and the three above them.
    triangles : ndarray of int, shape (triangle, 3)
        Nodes of the lowest layer, counter-clockwise seen from where the normals point.
    depth : ndarray, shape (layer,), m
        Of the layers along the normals, ascending; 0 is the given surface.
    frame : ndarray, shape (node, 3, 3)
        Unit rows t1, t2, n in the world's axes.
    """

    position: Array
    prisms: IntArray
    triangles: IntArray
    depth: Array
    frame: Array

    @property
    def surface_nodes(self) -> int:
        """Nodes of one layer."""
        return len(self.position) // len(self.depth)

    @property
    def surface_triangles(self) -> IntArray:
        """The triangles of the layer that is nearest to the given surface."""
        return self.triangles + self.surface_nodes * int(np.abs(self.depth).argmin())


@dataclass(frozen=True, eq=False)
class Results:
    """Velocities at the nodes of a field, or at points.

    Attributes
    ----------
    names : tuple of str
        Of the nodes or points; numbers from 1 if they have none.
    components : tuple of str
        x, y, z, or t1, t2, n of each node's own frame.
    frequency : ndarray, shape (frequency,), Hz, optional
        None if the run does not know it; then there is one.
    velocity : ndarray of complex, shape (node, component, frequency), m/s
        NaN where the views do not determine the component.
    std, confidence : ndarray, shape (node, component, frequency), m/s, optional
        Standard error and half-width of the interval, of real and imaginary part each.
    observable : ndarray of bool, shape (node, component)
    mesh : PrismMesh, optional
        None if the velocities are those of points.
    position : ndarray, shape (node, 3), m, optional
        In the world; None if the run does not know it.
    about : dict of str to str
        Conventions, confidence level, and which run it was.
    """

    names: tuple[str, ...]
    components: tuple[str, ...]
    frequency: Array | None
    velocity: ComplexArray
    std: Array | None
    confidence: Array | None
    observable: BoolArray
    mesh: PrismMesh | None
    position: Array | None
    about: dict[str, str]

    @property
    def local(self) -> bool:
        """Whether the components are those of each node's own frame."""
        return self.components != WORLD

    @property
    def bounds(self) -> dict[str, Array]:
        """The bounds that are known, by name."""
        named = {"velocity_std": self.std, "confidence": self.confidence}
        return {name: array for name, array in named.items() if array is not None}

    @property
    def strongest(self) -> int:
        """Index of the frequency with the largest root mean square velocity."""
        return int(np.nansum(np.abs(self.velocity) ** 2, axis=(0, 1)).argmax())

    def needed_mesh(self, format_name: str) -> PrismMesh:
        """The mesh.

        Raises
        ------
        UserError
            If there is none.
        """
        if self.mesh is None:
            raise UserError(
                f"export={format_name} needs a field over a volume, and this run has velocities at "
                "points only; csv, mat and uff hold those"
            )
        return self.mesh

    def in_world(self, mesh: PrismMesh) -> ComplexArray:
        """Velocity along x, y, z, shape (node, 3, frequency), m/s."""
        if not self.local:
            return self.velocity
        return np.einsum("nca,ncf->naf", mesh.frame, self.velocity)


def results_of(tree: Mapping[str, xr.Dataset], attributes: Mapping[Any, Any]) -> Results:
    """The velocities of a run: those of the field if there is one, else those at points.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        Groups by their path.
    attributes : mapping
        Of the tree's root.

    Raises
    ------
    UserError
        If there are none.
    """
    is_field = {"field", "volume"} <= set(tree)
    if not is_field and "point" not in tree:
        raise UserError(
            "the run has no velocities to export; choose a reconstruction, for example "
            "with experiment=plate or experiment=point"
        )
    group = tree["field" if is_field else "point"]
    dims = ("node" if is_field else "point", "component", "frequency")

    def array(name: str, count: int = 3) -> Any:
        if name not in group:
            return None
        found = group[name]
        missing = [d for d in dims[:count] if d not in found.dims]
        return found.expand_dims(missing).transpose(*dims[:count]).values

    velocity = array("velocity")
    point = group.coords.get("point")
    mesh = _mesh(tree["volume"]) if is_field else None
    known = {**CONVENTIONS, **attributes, "confidence_level": group.attrs["confidence_level"]}
    return Results(
        tuple(map(str, point.values)) if point is not None and point.ndim else _numbers(velocity),
        tuple(map(str, group["component"].values)),
        np.atleast_1d(group["frequency"].values) if "frequency" in group.coords else None,
        velocity.astype(complex),
        array("velocity_std"),
        array("confidence"),
        array("observable", 2) != 0,
        mesh,
        mesh.position if mesh else _places(tree, group),
        {k: str(known[k]) for k in (*TOLD, "confidence_level") if k in known},
    )


def _numbers(velocity: NDArray) -> tuple[str, ...]:
    return tuple(str(i) for i in range(1, len(velocity) + 1))


def _places(tree: Mapping[str, xr.Dataset], points: xr.Dataset) -> Array | None:
    """Where the points lie, shape (point, 3), m, if what was measured tells it."""
    measured = tree.get("line_of_sight")
    if measured is None or "position" not in measured:
        return None
    return np.asarray(measured["position"].sel(point=points["point"]).values)


def _mesh(volume: xr.Dataset) -> PrismMesh:
    prisms, depth = volume["element"].values.astype(np.int64), volume["depth"].values
    count = len(prisms) // (len(depth) - 1)
    frame = np.tile(volume["frame"].values, (len(depth), 1, 1))
    return PrismMesh(volume["position"].values, prisms, prisms[:count, :3], depth, frame)
