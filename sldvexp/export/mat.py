"""`export=mat`: a struct of arrays for MATLAB and Octave."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.config.registry import register
from sldvexp.export.base import Export
from sldvexp.export.results import Results
from sldvexp.files import whole_or_nothing
from sldvexp.lazy import scipy


@register("export", "mat")
@dataclass
class Mat(Export):
    """A MATLAB v5 file with one struct, ``sldvexp``.

    ``velocity(node, component, frequency)`` is complex and in m/s, as is what bounds it;
    ``position(node, 1:3)`` and ``element(element, 1:6)``, nodes from 1, are there for a field.
    ``about`` has the conventions. What is not determined is NaN and has a zero in ``observable``.
    """

    suffix = ".mat"

    def write(self, results: Results, path: Path) -> None:
        """Write the struct; a frequency that is not known is NaN."""
        unknown = np.array([np.nan])
        struct: dict[str, Any] = {
            "velocity": results.velocity,
            **results.bounds,
            "observable": results.observable,
            "frequency": unknown if results.frequency is None else results.frequency,
            "component": np.array(results.components, object),
            "name": np.array(results.names, object),
            "units": {"velocity": "m/s", "frequency": "Hz", "position": "m"},
            "about": results.about,
        }
        if (mesh := results.mesh) is not None:
            struct |= {
                "position": mesh.position,
                "element": mesh.prisms + 1,
                "triangle": mesh.surface_triangles + 1,
                "depth": mesh.depth,
                "frame": mesh.frame,
            }
        with whole_or_nothing(path) as beside:
            scipy.io.savemat(beside, {"sldvexp": struct}, do_compression=True, oned_as="column")
