"""The volume as a group of a run's dataset: a UGRID mesh of prisms."""

from __future__ import annotations

import numpy as np

from sldvexp import dataset
from sldvexp.lazy import xarray as xr
from sldvexp.volume.prisms import Prisms
from sldvexp.volume.samples import SampleRule

#: UGRID's numbers of the shapes that a volume can have.
SHAPES = ("tetrahedron", "pyramid", "wedge", "hexahedron")

LOCAL_AXES = ("t1", "t2", "n")


def volume_to_dataset(prisms: Prisms, rule: SampleRule) -> xr.Dataset:
    """The group ``volume``: nodes, prisms, frames, and the samples' parameters.

    Parameters
    ----------
    prisms : Prisms
    rule : SampleRule

    Returns
    -------
    xarray.Dataset
        A fully three-dimensional mesh topology of UGRID 1.0, indices from 0; attributes say how
        many nodes, prisms and samples there are.
    """
    element = prisms.element.astype(np.int32)
    x, y, z = prisms.position.T
    group = dataset.group(
        "volume",
        {"parameter": ["xi1", "xi2", "xi3", "zeta"], "local_axis": list(LOCAL_AXES)},
        mesh=np.int32(0),
        position=prisms.position,
        node_x=x,
        node_y=y,
        node_z=z,
        node_layer=prisms.layer.astype(np.int32),
        element=element,
        element_shape=np.full(len(element), SHAPES.index("wedge"), np.int8),
        depth=prisms.depth,
        frame=prisms.frame,
        sample_parameter=rule.parameter,
    )
    group["mesh"].attrs |= {
        "cf_role": "mesh_topology",
        "topology_dimension": 3,
        "node_coordinates": "node_x node_y node_z",
        "volume_node_connectivity": "element",
        "volume_dimension": "element",
        "volume_shape_type": "element_shape",
    }
    group["element"].attrs |= {"cf_role": "volume_node_connectivity", "start_index": 0}
    group["element_shape"].attrs |= {
        "cf_role": "volume_shape_type",
        "flag_values": np.arange(len(SHAPES), dtype=np.int8),
        "flag_meanings": " ".join(SHAPES),
    }
    for name in ("position", "node_layer"):
        group[name].attrs |= {"mesh": "mesh", "location": "node"}
    group.attrs |= {
        "Conventions": "CF-1.11 UGRID-1.0",
        "nodes": prisms.nodes,
        "surface_nodes": prisms.surface_nodes,
        "triangles": len(prisms.triangles),
        "elements": len(element),
        "samples": len(element) * rule.points,
    }
    return group
