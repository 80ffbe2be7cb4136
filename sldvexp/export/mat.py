"""`export=mat`: a struct of arrays for MATLAB and Octave."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.export.base import VelocityExport
from sldvexp.export.strains import strain_of
from sldvexp.export.velocities import (
    bounds_of,
    describe,
    frequencies_of,
    is_field,
    mesh_of,
    velocities_of,
)
from sldvexp.lazy import scipy
from sldvexp.writing import whole_or_nothing


@register("export", "mat")
@dataclass
class Mat(VelocityExport):
    """A MATLAB v5 file with one struct, ``sldvexp``.

    ``velocity(node, component, frequency)`` is complex and in m/s, as is what bounds it;
    ``position(node, 1:3)`` and ``triangle(triangle, 1:3)``, nodes from 1, are there where places
    are known, ``element(element, 1:6)`` for a field.
    ``strain``, of a surface, has all variables of that group, by place, component and frequency.
    ``about`` has the conventions. What is not determined is NaN and has a zero in ``observable``.
    """

    suffix = ".mat"

    def write(self, run: RunData, path: Path) -> None:
        """Write the struct; a frequency that is not known is NaN."""
        found = velocities_of(run)
        frequency = frequencies_of(found)
        struct: dict[str, Any] = {
            "velocity": found["velocity"].values,
            **bounds_of(found),
            "observable": found["observable"].values,
            "frequency": np.array([np.nan]) if frequency is None else frequency,
            "component": found["component"].values.astype(object),
            "name": found["place"].values.astype(object),
            "units": {"velocity": "m/s", "frequency": "Hz", "position": "m"},
            "about": describe(run),
        }
        if is_field(run) or run.has("line_of_sight", "position"):
            mesh = mesh_of(run, "mat")
            struct |= {"position": mesh.position, "triangle": mesh.surface_triangles + 1}
        if is_field(run):
            struct |= {
                "element": mesh.prisms + 1,
                "depth": mesh.depth,
                "frame": mesh.frame,
            }
        if (strain := strain_of(run)) is not None:
            own = {str(name): values.values for name, values in strain.data_vars.items()}
            own["triangle"] = strain["triangle"].values + 1
            own["component"] = strain["strain_component"].values.astype(object)
            struct["strain"] = own
        with whole_or_nothing(path) as beside:
            scipy.io.savemat(beside, {"sldvexp": struct}, do_compression=True, oned_as="column")
