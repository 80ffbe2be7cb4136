"""`export=ugrid`: a field as netCDF by the conventions CF and UGRID."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sldvexp.config.registry import register
from sldvexp.export.base import Export
from sldvexp.export.results import Results
from sldvexp.export.ugrid_dataset import encoding_of, ugrid_dataset
from sldvexp.files import whole_or_nothing


@register("export", "ugrid")
@dataclass
class Ugrid(Export):
    """A layered mesh of triangles with the field at its nodes, for readers of CF and UGRID.

    The surface is a two-dimensional UGRID mesh, and ``layer_depth`` counts its copies along the
    normals. As CF knows no complex numbers, each component has a variable for its real and one for
    its imaginary part, as in ``velocity_x_real(frequency, layer_depth, mesh_node)``, next to
    ``velocity_x_std``, ``velocity_x_confidence`` and ``velocity_x_observable``.
    """

    suffix = ".ugrid.nc"

    def write(self, results: Results, path: Path) -> None:
        """Write the dataset.

        Raises
        ------
        UserError
            If there is no field.
        """
        found = ugrid_dataset(results, results.needed_mesh("ugrid"))
        with whole_or_nothing(path) as beside:
            found.to_netcdf(beside, engine="netcdf4", encoding=encoding_of(found))
