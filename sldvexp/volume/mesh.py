"""`volume=mesh`: a triangulated surface from a mesh file of another program.

Universal files are read here, all other formats by meshio. A volume needs triangles: quadrilaterals
are cut along their shorter diagonal, which gives the better shaped pair, and nodes that belong to
other cells only (lines along edges, insides of higher elements) are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.io import read_mesh
from sldvexp.volume.base import Volume
from sldvexp.volume.surface import TriangulatedSurface


@register("volume", "mesh")
@dataclass
class MeshFile(Volume):
    """A surface mesh, plane or curved, from a file of any format that meshio reads.

    The coordinates are in `unit`; quadrilaterals are cut in two, of elements of second order
    the corners are used.

    Parameters
    ----------
    path : str
        ``.stl``, ``.obj``, ``.ply``, ``.vtk``, ``.vtu``, ``.msh``, ``.inp``, ``.bdf`` and others.
        Universal files (``.uff``, ``.unv``) and ``.obj`` need no meshio. Corners in an ``.stl``
        within 1e-5 of its extent are one node; the run's group ``volume`` says how many.
    flip : bool
        Whether the normals point to the other side of the triangles.
    """

    path: str = MISSING
    flip: bool = False

    def inputs(self) -> list[str]:
        """Name the mesh file."""
        return [self.path]

    def surface(self) -> TriangulatedSurface:
        """Read the mesh in its own axes."""
        path = locate(self.path)
        mesh = read_mesh(path, self.unit.value, self.flip)
        return TriangulatedSurface(
            mesh.position, mesh.triangles, None, str(path), mesh.number, told=mesh.told
        )
