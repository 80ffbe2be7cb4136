"""Velocities of a run as exports take them: every dimension there, units and conventions known.

All formats write the same few things: one dataset over place, component and frequency, whether it
comes from a field or from points, the prisms below a field, and what the numbers mean.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.dataset import CONVENTIONS
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.geometry import joined_points
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, ComplexArray, IntArray

WORLD = ("x", "y", "z")
#: Mode shapes and their strains.
MODAL = ("modes/field", "modes/strain")
#: Groups of a run that velocities, their places, and what follows from them come from.
GROUPS = ("field", "volume", "point", "line_of_sight", "strain", "modes", *MODAL)
#: Attributes of a run that an export repeats.
TOLD = (*CONVENTIONS, "title", "config_sha256", "end_time")
DIMENSIONS = ("place", "component", "frequency")
#: Bounds of the velocities, as far as a run has them.
BOUNDS = ("velocity_std", "confidence")


def velocities_of(run: RunData) -> xr.Dataset:
    """Take the velocities of a run: those of the field if there is one, else those at points.

    Returns
    -------
    xarray.Dataset
        ``velocity (place, component, frequency)``, complex and NaN where it is not determined,
        and as far as they are known ``velocity_std`` and ``confidence``, m/s, of real and
        imaginary part each; ``observable (place, component)``. The coordinates are ``place``,
        names of nodes or points, or numbers from 1, ``component``, and ``frequency`` unless the
        run does not know the one that there is.

    Raises
    ------
    UserError
        If there are none.

    Examples
    --------
    >>> vector = xr.Dataset(coords={"component": ["x", "y", "z"]})
    >>> vector["velocity"] = "component", [1e-3, 0.0, 2e-3j]
    >>> vector["observable"] = "component", [1, 1, 1]
    >>> run = RunData({"point": vector})
    >>> dict(velocities_of(run).sizes)
    {'place': 1, 'component': 3, 'frequency': 1}
    """
    over_volume = is_field(run)
    if not over_volume and not run.has("point"):
        raise UserError(
            "the run has no velocities to export; choose a reconstruction, for example "
            "with experiment=plate or experiment=point"
        )
    group = run.groups["field" if over_volume else "point"]
    own = ("node" if over_volume else "point", "component", "frequency")

    def values(name: str, count: int = 3) -> NDArray:
        missing = [d for d in own[:count] if d not in group[name].dims]
        return group[name].expand_dims(missing).transpose(*own[:count]).values

    variables = {n: (DIMENSIONS, values(n)) for n in BOUNDS if n in group}
    velocity = values("velocity").astype(complex)
    names = [str(i) for i in range(1, len(velocity) + 1)]
    if "point" in group.coords and group["point"].ndim:
        names = [str(label) for label in group["point"].values]
    coords: dict[str, Any] = {"place": names, "component": [*map(str, group["component"].values)]}
    if "frequency" in group.coords:
        coords["frequency"] = np.atleast_1d(group["frequency"].values)
    return xr.Dataset(
        {
            "velocity": (DIMENSIONS, velocity),
            **variables,
            "observable": (DIMENSIONS[:2], values("observable", 2) != 0),
        },
        coords,
    )


def with_modes(run: RunData) -> RunData:
    """Put mode shapes in the place of the velocities at the lines, and their strains likewise.

    Raises
    ------
    UserError
        If the run has no mode shapes.

    Examples
    --------
    >>> empty = xr.Dataset()
    >>> list(with_modes(RunData({"modes/field": empty, "point": empty, "volume": empty})).groups)
    ['volume', 'field']
    """
    if not run.has(MODAL[0]):
        raise UserError(
            "the run has no mode shapes to export; choose modal=own and a reconstruction, as in "
            "experiment=plate_modes"
        )
    lines = ("field", "strain", "point", "line_of_sight", *MODAL)
    groups = {name: group for name, group in run.groups.items() if name not in lines}
    groups |= {n.removeprefix("modes/"): run.groups[n] for n in MODAL if n in run.groups}
    return replace(run, groups=groups)


def is_field(run: RunData) -> bool:
    """Tell whether the velocities are those of a field over a volume, and not at points."""
    return run.has("field") and run.has("volume")


def is_local(velocities: xr.Dataset) -> bool:
    """Tell whether the components are those of each node's own frame."""
    return tuple(velocities["component"].values) != WORLD


def frequencies_of(velocities: xr.Dataset) -> Array | None:
    """Give the frequencies, Hz; None if the run does not know the one that there is."""
    return velocities["frequency"].values if "frequency" in velocities.coords else None


def bounds_of(velocities: xr.Dataset) -> dict[str, Array]:
    """Give the bounds that are known, by name, shape (place, component, frequency), m/s."""
    return {name: velocities[name].values for name in BOUNDS if name in velocities}


def describe(run: RunData) -> dict[str, str]:
    """Say conventions, confidence level, and which run it was."""
    group = run.groups["field" if is_field(run) else "point"]
    known = {**CONVENTIONS, **run.attributes, "confidence_level": group.attrs["confidence_level"]}
    return {k: str(known[k]) for k in (*TOLD, "confidence_level") if k in known}


def positions_of(run: RunData) -> Array | None:
    """Give the places' positions in the world, shape (place, 3), m; None if they are unknown."""
    if is_field(run):
        return run.groups["volume"]["position"].values
    if not run.has("line_of_sight", "position"):
        return None
    measured = run.groups["line_of_sight"]["position"]
    return np.asarray(measured.sel(point=run.groups["point"]["point"]).values)


def mesh_of(run: RunData, format_name: str) -> PrismMesh:
    """Give the mesh below a field, or the points and what joins them.

    Raises
    ------
    UserError
        If the velocities are those of points without positions.
    """
    if not is_field(run):
        return _mesh_of_points(run, format_name)
    volume = run.groups["volume"]
    prisms, depth = volume["element"].values.astype(np.int64), volume["depth"].values
    count = len(prisms) // (len(depth) - 1)
    frame = np.tile(volume["frame"].values, (len(depth), 1, 1))
    return PrismMesh(volume["position"].values, prisms, prisms[:count, :3], depth, frame)


def _mesh_of_points(run: RunData, format_name: str) -> PrismMesh:
    """Make one layer of points, without prisms."""
    if not run.has("line_of_sight", "position"):
        raise UserError(
            f"export={format_name} needs a field over a volume or points with positions, and this "
            "run has velocities at points of which nobody says where they are; csv, mat and uff "
            "hold those"
        )
    position, triangles, lines = joined_points(run.groups["line_of_sight"])
    none = np.empty((0, 6), np.int64)
    frame = np.tile(np.eye(3), (len(position), 1, 1))
    return PrismMesh(position, none, triangles, np.zeros(1), frame, lines)


def velocity_in_world(velocities: xr.Dataset, mesh: PrismMesh) -> ComplexArray:
    """Turn velocities to x, y, z, shape (node, 3, frequency), m/s."""
    own = velocities["velocity"].values
    return np.einsum("nca,ncf->naf", mesh.frame, own) if is_local(velocities) else own


@dataclass(frozen=True, eq=False)
class PrismMesh:
    """Prisms of the volume that a field is given over, or points in one layer.

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
    lines : ndarray of int, shape (line, 2)
        Between points; none in a volume.
    """

    position: Array
    prisms: IntArray
    triangles: IntArray
    depth: Array
    frame: Array
    lines: IntArray = field(default_factory=lambda: np.empty((0, 2), np.int64))

    @property
    def cells(self) -> list[IntArray]:
        """Cells with their corners: prisms; of points triangles and lines, or else the points."""
        if len(self.prisms):
            return [self.prisms]
        joined = [cells for cells in (self.triangles, self.lines) if len(cells)]
        return joined or [np.arange(len(self.position))[:, None]]

    @property
    def surface_nodes(self) -> int:
        """Nodes of one layer."""
        return len(self.position) // len(self.depth)

    @property
    def surface_layer(self) -> IntArray:
        """Nodes of the layer that is nearest to the given surface."""
        first = self.surface_nodes * int(np.abs(self.depth).argmin())
        return first + np.arange(self.surface_nodes)

    @property
    def surface_triangles(self) -> IntArray:
        """The triangles of that layer."""
        return self.triangles + int(self.surface_layer[0])
