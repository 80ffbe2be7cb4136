"""A field as a dataset that keeps the conventions CF and UGRID."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.export.results import PrismMesh, Results
from sldvexp.lazy import xarray as xr

NODE, FACE, LAYER = "mesh_node", "mesh_face", "layer_depth"
#: Which mesh a variable belongs to, and where on it.
AT_NODES = {"mesh": "mesh", "location": "node", "coordinates": "mesh_node_x mesh_node_y"}


def ugrid_dataset(results: Results, mesh: PrismMesh) -> xr.Dataset:
    """The field over a layered two-dimensional mesh.

    Parameters
    ----------
    results : Results
    mesh : PrismMesh

    Returns
    -------
    xarray.Dataset
    """
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
    if results.frequency is not None:
        told = {"units": "Hz", "long_name": "frequency"}
        variables["frequency"] = ("frequency", results.frequency, told)
    variables |= _velocities(results, mesh)
    if results.local:
        frame = mesh.frame[: mesh.surface_nodes]
        for i, component in enumerate(results.components):
            for k, axis in enumerate("xyz"):
                told = {"units": "1", "long_name": f"{axis} of the unit vector {component}"}
                variables[f"{component}_{axis}"] = (NODE, frame[:, i, k], {**told, **AT_NODES})
    return xr.Dataset(variables, attrs=_attributes(results))


def encoding_of(found: xr.Dataset) -> dict[str, dict[str, Any]]:
    """How the variables are stored: what may be missing has a fill value, nothing else has."""
    filled = [n for n in found if str(n).startswith("velocity_") and found[n].dtype.kind == "f"]
    return {
        str(name): {"_FillValue": np.nan, "zlib": True} if name in filled else {"_FillValue": None}
        for name in found.variables
    }


def _topology() -> dict[str, Any]:
    return {
        "cf_role": "mesh_topology",
        "long_name": "triangles of one layer",
        "topology_dimension": np.int32(2),
        "node_coordinates": "mesh_node_x mesh_node_y",
        "face_node_connectivity": "mesh_face_nodes",
        "face_dimension": FACE,
    }


def _velocities(results: Results, mesh: PrismMesh) -> dict[str, Any]:
    """Real and imaginary parts, bounds and flags of each component."""
    layers = (len(mesh.depth), mesh.surface_nodes)
    spectral = (LAYER, NODE) if results.frequency is None else ("frequency", LAYER, NODE)

    def entry(values: NDArray, told: str, **others: Any) -> tuple[Any, NDArray, dict[str, Any]]:
        ordered = np.moveaxis(values, -1, 0).reshape(-1, *layers)
        attributes = {"units": "m s-1", "long_name": told, **others, **AT_NODES}
        return spectral, ordered[0] if results.frequency is None else ordered, attributes

    told = {"velocity_std": "standard error", "confidence": "half-width of the interval"}
    found: dict[str, Any] = {}
    for i, c in enumerate(results.components):
        bounds = {
            f"velocity_{c}_{name.removeprefix('velocity_')}": entry(
                bound[:, i], f"{told[name]} of each part of the velocity along {c}"
            )
            for name, bound in results.bounds.items()
        }
        flag = f"velocity_{c}_observable"
        beside = " ".join([*bounds, flag])
        velocity = results.velocity[:, i]
        for part, name in ((velocity.real, "real"), (velocity.imag, "imag")):
            whole = "imaginary" if name == "imag" else name
            about = f"{whole} part of the velocity along {c}"
            found[f"velocity_{c}_{name}"] = entry(part, about, ancillary_variables=beside)
        flags = results.observable[:, i].astype(np.int8).reshape(layers)
        meaning = {
            "long_name": f"whether the views determine the velocity along {c}",
            "flag_values": np.array([0, 1], np.int8),
            "flag_meanings": "not_determined determined",
        }
        found |= {**bounds, flag: ((LAYER, NODE), flags, {**meaning, **AT_NODES})}
    return found


def _attributes(results: Results) -> dict[str, str]:
    return {
        "Conventions": "CF-1.11 UGRID-1.0",
        "title": "vibration velocity field",
        "source": "scanning laser Doppler vibrometer, several views",
        "history": f"{results.about.get('end_time', '')} written by sldvexp".strip(),
        **{k: v for k, v in results.about.items() if k != "title"},
    }
