"""`export=ugrid`: a field, or a surface of points, as netCDF by the conventions CF and UGRID."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.export.base import VelocityExport
from sldvexp.export.velocities import (
    PrismMesh,
    bounds_of,
    describe,
    frequencies_of,
    is_local,
    mesh_of,
    velocities_of,
)
from sldvexp.lazy import xarray as xr
from sldvexp.writing import whole_or_nothing

NODE, FACE, LAYER = "mesh_node", "mesh_face", "layer_depth"
#: Which mesh a variable belongs to, and where on it.
AT_NODES = {"mesh": "mesh", "location": "node", "coordinates": "mesh_node_x mesh_node_y"}


@register("export", "ugrid")
@dataclass
class Ugrid(VelocityExport):
    """A layered mesh of triangles with the field at its nodes, for readers of CF and UGRID.

    The surface is a two-dimensional UGRID mesh, and ``layer_depth`` counts its copies along the
    normals. As CF knows no complex numbers, each component has a variable for its real and one for
    its imaginary part, as in ``velocity_x_real(frequency, layer_depth, mesh_node)``, next to
    ``velocity_x_std``, ``velocity_x_confidence`` and ``velocity_x_observable``.
    """

    suffix = ".ugrid.nc"

    def write(self, run: RunData, path: Path) -> None:
        """Write the dataset.

        Raises
        ------
        UserError
            If there is neither a field nor a surface that joins points.
        """
        found = ugrid_dataset(run)
        with whole_or_nothing(path) as beside:
            found.to_netcdf(beside, engine="netcdf4", encoding=_encoding_of(found))


def ugrid_dataset(run: RunData) -> xr.Dataset:
    """Put the field onto a layered two-dimensional mesh."""
    velocities, mesh = velocities_of(run), mesh_of(run, "ugrid")
    if not len(mesh.triangles):
        raise UserError(
            "export=ugrid needs triangles between the points, which their file does not give, and "
            "which only points in a plane tell; vtu, csv, mat and uff hold points alone"
        )
    position = mesh.position.reshape(len(mesh.depth), mesh.surface_nodes, 3)
    surface = position[int(np.abs(mesh.depth).argmin())]
    variables: dict[str, Any] = {
        "mesh": ((), np.int32(0), _topology()),
        "mesh_face_nodes": (
            (FACE, "mesh_face_corner"),
            mesh.triangles.astype(np.int32),
            {
                "cf_role": "face_node_connectivity",
                "long_name": "nodes of each triangle, counter-clockwise seen from outside",
                "start_index": np.int32(0),
            },
        ),
        LAYER: (LAYER, mesh.depth, {"units": "m", "long_name": "depth along the normals"}),
    }
    for axis, values in zip("xyz", np.moveaxis(position, -1, 0), strict=True):
        told = {"units": "m", "long_name": f"{axis} of the nodes of the given surface"}
        if axis != "z":
            told["standard_name"] = f"projection_{axis}_coordinate"
        variables[f"mesh_node_{axis}"] = (NODE, surface[:, "xyz".index(axis)], told)
        told = {"units": "m", "long_name": f"{axis} of the node", **AT_NODES}
        variables[f"position_{axis}"] = ((LAYER, NODE), values, told)
    if (frequency := frequencies_of(velocities)) is not None:
        told = {"units": "Hz", "long_name": "frequency"}
        variables["frequency"] = ("frequency", frequency, told)
    variables |= _velocities(velocities, mesh)
    if is_local(velocities):
        frame = mesh.frame[: mesh.surface_nodes]
        for i, component in enumerate(velocities["component"].values):
            for k, axis in enumerate("xyz"):
                told = {"units": "1", "long_name": f"{axis} of the unit vector {component}"}
                variables[f"{component}_{axis}"] = (NODE, frame[:, i, k], {**told, **AT_NODES})
    return xr.Dataset(variables, attrs=_attributes(run))


def _encoding_of(found: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Give a fill value to variables that may have gaps, and to no others."""
    filled = [n for n in found if str(n).startswith("velocity_") and found[n].dtype.kind == "f"]
    return {
        str(name): {"_FillValue": np.nan, "zlib": True} if name in filled else {"_FillValue": None}
        for name in found.variables
    }


def _topology() -> dict[str, Any]:
    """Describe the mesh as UGRID does."""
    return {
        "cf_role": "mesh_topology",
        "long_name": "triangles of one layer",
        "topology_dimension": np.int32(2),
        "node_coordinates": "mesh_node_x mesh_node_y",
        "face_node_connectivity": "mesh_face_nodes",
        "face_dimension": FACE,
    }


def _velocities(velocities: xr.Dataset, mesh: PrismMesh) -> dict[str, Any]:
    """Make real and imaginary parts, bounds and flags of each component."""
    known = "frequency" in velocities.coords
    layers = (len(mesh.depth), mesh.surface_nodes)
    spectral = ("frequency", LAYER, NODE) if known else (LAYER, NODE)

    def entry(values: NDArray, told: str, **others: Any) -> tuple[Any, NDArray, dict[str, Any]]:
        ordered = np.moveaxis(values, -1, 0).reshape(-1, *layers)
        attributes = {"units": "m s-1", "long_name": told, **others, **AT_NODES}
        return spectral, ordered if known else ordered[0], attributes

    told = {"velocity_std": "standard error", "confidence": "half-width of the interval"}
    found: dict[str, Any] = {}
    for i, c in enumerate(velocities["component"].values):
        bounds = {
            f"velocity_{c}_{name.removeprefix('velocity_')}": entry(
                bound[:, i], f"{told[name]} of each part of the velocity along {c}"
            )
            for name, bound in bounds_of(velocities).items()
        }
        flag = f"velocity_{c}_observable"
        beside = " ".join([*bounds, flag])
        velocity = velocities["velocity"].values[:, i]
        for part, name in ((velocity.real, "real"), (velocity.imag, "imag")):
            whole = "imaginary" if name == "imag" else name
            about = f"{whole} part of the velocity along {c}"
            found[f"velocity_{c}_{name}"] = entry(part, about, ancillary_variables=beside)
        flags = velocities["observable"].values[:, i].astype(np.int8).reshape(layers)
        meaning = {
            "long_name": f"whether the views determine the velocity along {c}",
            "flag_values": np.array([0, 1], np.int8),
            "flag_meanings": "not_determined determined",
        }
        found |= {**bounds, flag: ((LAYER, NODE), flags, {**meaning, **AT_NODES})}
    return found


def _attributes(run: RunData) -> dict[str, str]:
    """Say conventions, and which run it was, as CF does."""
    about = describe(run)
    return {
        "Conventions": "CF-1.11 UGRID-1.0",
        "title": "vibration velocity field",
        "source": "scanning laser Doppler vibrometer, several views",
        "history": f"{about.get('end_time', '')} written by sldvexp".strip(),
        **{k: v for k, v in about.items() if k != "title"},
    }
