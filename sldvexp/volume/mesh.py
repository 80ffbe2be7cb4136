"""`volume=mesh`: a triangulated surface from a mesh file of another program.

Universal files are read here, all other formats by meshio. A volume needs triangles: quadrilaterals
are cut along their shorter diagonal, which gives the better shaped pair, and nodes that belong to
other cells only (lines along edges, insides of higher elements) are left out.
"""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.io.universal_mesh import SUFFIXES, read_universal
from sldvexp.typing import Array, IntArray
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
        Universal files (``.uff``, ``.unv``) need no meshio.
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
        return read_mesh(locate(self.path), self.unit.value, self.flip)


#: Corners of meshio's surface cells; nodes beyond them are inside of edges and faces.
TRIANGLES = ("triangle", "triangle6", "triangle7")
QUADRILATERALS = ("quad", "quad8", "quad9")


def read_mesh(path: Path, unit: float, flip: bool) -> TriangulatedSurface:
    """Read the triangles of a mesh file, quadrilaterals cut along their shorter diagonal.

    Cells of other dimensions, such as the lines along an edge, are left out, and with them nodes
    that no surface cell names at all if another cell does: they are of those cells.

    Parameters
    ----------
    unit : float
        One unit of the file's coordinates in m.
    flip : bool
        Whether to turn the triangles over.

    Raises
    ------
    UserError
        If meshio is not installed or cannot read the file, or there are no surface cells.
    """
    if path.suffix.lower() in SUFFIXES:
        return _of_universal_file(path, unit, flip)
    mesh = _read(path)
    position = np.asarray(mesh.points, float) * unit
    if position.shape[1] == 2:
        position = np.column_stack([position, np.zeros(len(position))])
    found = [block.data[:, :3] for block in mesh.cells if block.type in TRIANGLES]
    quadrilaterals = [block.data[:, :4] for block in mesh.cells if block.type in QUADRILATERALS]
    found += [_halves(position, quadrilateral) for quadrilateral in quadrilaterals]
    triangles = np.concatenate([np.empty((0, 3), np.int64), *found]).astype(np.int64)
    if not len(triangles):
        kinds = ", ".join(sorted({block.type for block in mesh.cells})) or "no cells"
        raise UserError(f"{path}: has {kinds}, but neither triangles nor quadrilaterals")
    if flip:
        triangles = triangles[:, ::-1]
    return _without_others(TriangulatedSurface(position, triangles, None, str(path)), mesh)


def _of_universal_file(path: Path, unit: float, flip: bool) -> TriangulatedSurface:
    """Read the surface of a universal file, without nodes that no surface element names."""
    position, corners, quadrilaterals, label = read_universal(path, unit)
    triangles = np.concatenate([corners, _halves(position, quadrilaterals)])
    if not len(triangles):
        raise UserError(f"{path}: has neither triangles nor quadrilaterals (data set 2412)")
    used, renumbered = np.unique(triangles, return_inverse=True)
    triangles = renumbered.reshape(-1, 3)
    triangles = triangles[:, ::-1] if flip else triangles
    return TriangulatedSurface(position[used], triangles, None, str(path), label[used])


def _read(path: Path) -> Any:
    """Read the file with meshio."""
    try:
        import meshio
    except ImportError:
        raise UserError(
            "volume=mesh needs the package meshio; install it with: pip install 'sldvexp[mesh]'"
        ) from None
    require_file(path)
    said = io.StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(said):
            return meshio.read(path)
    except (Exception, SystemExit) as error:  # each of its many readers fails in its own way
        told = said.getvalue() or (str(error) if isinstance(error, Exception) else "")
        why = " ".join(told.split()) or type(error).__name__
        raise UserError(f"{path}: is not a mesh that can be read: {why}") from None


def _halves(position: Array, quadrilateral: IntArray) -> IntArray:
    """Cut each quadrilateral into two triangles of its side, shape (2 quadrilaterals, 3)."""
    a, b, c, d = quadrilateral.T
    first = np.linalg.norm(position[a] - position[c], axis=1)
    second = np.linalg.norm(position[b] - position[d], axis=1)
    along_first = np.stack([a, b, c, a, c, d], axis=-1)
    along_second = np.stack([a, b, d, b, c, d], axis=-1)
    # Equal diagonals, as of rectangles, are told apart by no rounding.
    return np.where((first <= second * (1 + 1e-9))[:, None], along_first, along_second).reshape(
        -1, 3
    )


def _without_others(surface: TriangulatedSurface, mesh: Any) -> TriangulatedSurface:
    """Leave out nodes that only other cells, or the insides of the surface's edges, have."""
    nodes = len(surface.position)
    of_surface, of_cells = np.zeros(nodes, bool), np.zeros(nodes, bool)
    of_surface[surface.triangles.ravel()] = True
    for block in mesh.cells:
        of_cells[np.asarray(block.data).ravel()] = True
    keep = of_surface | ~of_cells
    renumbered = np.cumsum(keep) - 1
    return replace(
        surface,
        position=surface.position[keep],
        triangles=renumbered[surface.triangles],
        number=np.flatnonzero(keep),
    )
