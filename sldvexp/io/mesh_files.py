"""Surface meshes in files: universal files, OBJ, and all that meshio reads.

Triangles are taken as they are, quadrilaterals are cut along their shorter diagonal, and of
elements of second order the corners are used. Cells of other dimensions, such as the lines along
an edge, are left out, and with them nodes that no surface cell names if another cell does. STL has
no nodes, but each triangle's corners on their own: those that are nearly equal are one node.
"""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sldvexp.errors import UserError
from sldvexp.files import read_bytes
from sldvexp.io.obj import read_obj
from sldvexp.io.uff import UniversalGeometry, universal_file
from sldvexp.lazy import scipy
from sldvexp.typing import Array, IntArray
from sldvexp.unit_labels import same_unit

SUFFIXES = (".uff", ".unv", ".uf", ".bunv")
#: Way to a surface from a file that has none.
WAY_ON = (
    "write shell elements of the surface into it, as mesh programs do of the faces of solids, or "
    "write the surface's nodes as a table x_m,y_m,z_m for volume=points, which connects them"
)
#: Corners of meshio's surface cells; nodes beyond them are inside of edges and faces.
TRIANGLES = ("triangle", "triangle6", "triangle7")
QUADRILATERALS = ("quad", "quad8", "quad9")
#: Corners in an STL file within this part of its extent are one node, its digits being seven.
MERGED = 1e-5
#: They are so at most within this part of the shortest side.
OF_SIDE = 0.1


class MeshSurface(NamedTuple):
    """Surface of a mesh file.

    Parameters
    ----------
    position : ndarray, shape (node, 3), m
    triangles : ndarray of int, shape (triangle, 3)
        Indices of nodes.
    number : ndarray of int, shape (node,)
        What the file calls each node: its label in a universal file, else its place from 0.
    told : str
        What was merged within which tolerance; empty if nothing was.
    """

    position: Array
    triangles: IntArray
    number: IntArray
    told: str = ""


def read_mesh(path: Path, unit: float, flip: bool) -> MeshSurface:
    r"""Read the triangles of a mesh file.

    Parameters
    ----------
    unit : float
        One unit of the file's coordinates in m.
    flip : bool
        Whether to turn the triangles over.

    Raises
    ------
    UserError
        If meshio is needed and not installed, the file cannot be read or states another unit, or
        there are no surface cells.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "square.obj")
    >>> corners = ("v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "f 1 2 3 4")
    >>> _ = path.write_text("\n".join(corners))
    >>> read_mesh(path, 1e-3, flip=False).triangles.tolist()
    [[0, 1, 2], [0, 2, 3]]
    """
    suffix = path.suffix.lower()
    if suffix in SUFFIXES:
        found = _of_universal_file(path, unit)
    elif suffix == ".obj":
        found = _of_obj(path, unit)
    else:
        found = _of_meshio(path, unit)
    if suffix == ".stl":
        found = _merged(found)
    return found._replace(triangles=found.triangles[:, ::-1]) if flip else found


def _merged(found: MeshSurface) -> MeshSurface:
    """Make nodes of corners that are nearly equal."""
    position, triangles = found.position, found.triangles
    sides = position[triangles] - position[np.roll(triangles, 1, axis=1)]
    length = np.linalg.norm(sides, axis=2)
    extent = float(np.linalg.norm(np.ptp(position, axis=0)))
    sides_of_length = length[length > MERGED * extent]
    tolerance = min(MERGED * extent, OF_SIDE * float(sides_of_length.min(initial=np.inf)))
    if not np.isfinite(position).all() or not tolerance:
        return found
    pairs = scipy.spatial.KDTree(position).query_pairs(tolerance, output_type="ndarray")
    if not len(pairs):
        return found
    graph = scipy.sparse.coo_array(
        (np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(len(position),) * 2
    )
    count, node = scipy.sparse.csgraph.connected_components(graph, directed=False)
    first = np.full(count, len(position))
    np.minimum.at(first, node, np.arange(len(position)))
    order = np.argsort(first)
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    corners = rank[node][triangles]
    flat = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    told = f"{len(position)} corners within {tolerance:.2g} m of one another are {count} nodes" + (
        f", and {int(flat.sum())} triangles without sides are left out" if flat.any() else ""
    )
    kept = first[order]
    return MeshSurface(position[kept], corners[~flat], found.number[kept], told)


def _of_universal_file(path: Path, unit: float) -> MeshSurface:
    """Read the surface of a universal file, without nodes that no surface element names."""
    with universal_file(path) as file:
        geometry, units = file.geometry, file.units
    if geometry is None:
        raise UserError(f"{path}: has no geometry (data set 15 or 2411), but {file.contents}")
    if units is not None and not same_unit(units.length, unit):
        raise UserError(
            f"{path}: states coordinates in units of {units.length:g} m, the configuration "
            f"volume.unit in units of {unit:g} m; they must agree"
        )
    position = np.asarray(geometry.position * unit)
    triangles = np.concatenate([geometry.triangles, _halves(position, geometry.quadrilaterals)])
    if not len(triangles):
        raise UserError(
            f"{path}: has neither triangles nor quadrilaterals (data set 2412), but "
            f"{_other_cells(geometry)}; {WAY_ON}"
        )
    used, renumbered = np.unique(triangles, return_inverse=True)
    return MeshSurface(position[used], renumbered.reshape(-1, 3), geometry.label[used])


def _of_obj(path: Path, unit: float) -> MeshSurface:
    """Read the faces of an OBJ file."""
    position, cells = read_obj(path)
    blocks = [("triangle", np.array(cells["triangle"], np.int64).reshape(-1, 3))]
    blocks += [("quad", np.array(cells["quad"], np.int64).reshape(-1, 4))]
    blocks += [("other", corners) for corners in cells["other"]]
    return _of_cells(path, position * unit, blocks)


def _other_cells(geometry: UniversalGeometry) -> str:
    """Name what a geometry has instead of a surface."""
    found = f"{len(geometry.label)} nodes"
    found += f", {geometry.solids} solid elements" if geometry.solids else ""
    return found + (f" and {len(geometry.lines)} lines" if geometry.lines else "")


def _of_meshio(path: Path, unit: float) -> MeshSurface:
    """Read the surface cells of a file that meshio knows."""
    mesh = read_with_meshio(path, "volume=mesh")
    position = np.asarray(mesh.points, float) * unit
    if position.ndim != 2 or position.shape[1] not in (2, 3):
        raise UserError(f"{path}: has no nodes")
    if any(np.any((block.data < 0) | (block.data >= len(position))) for block in mesh.cells):
        raise UserError(f"{path}: has a cell with a corner that is not among its nodes")
    if position.shape[1] == 2:
        position = np.column_stack([position, np.zeros(len(position))])
    return _of_cells(path, position, [(block.type, block.data) for block in mesh.cells])


def _of_cells(path: Path, position: Array, blocks: list[tuple[str, IntArray]]) -> MeshSurface:
    """Make triangles of the surface cells among blocks of cells of one kind."""
    found = [data[:, :3] for kind, data in blocks if kind in TRIANGLES]
    found += [_halves(position, data[:, :4]) for kind, data in blocks if kind in QUADRILATERALS]
    triangles = np.concatenate([np.empty((0, 3), np.int64), *found]).astype(np.int64)
    if not len(triangles):
        kinds = ", ".join(sorted({kind for kind, data in blocks if len(data)})) or "no cells"
        raise UserError(f"{path}: has {kinds}, but neither triangles nor quadrilaterals")
    of_surface, of_cells = np.zeros(len(position), bool), np.zeros(len(position), bool)
    of_surface[triangles.ravel()] = True
    for _, data in blocks:
        of_cells[np.asarray(data).ravel()] = True
    keep = of_surface | ~of_cells
    renumbered = np.cumsum(keep) - 1
    return MeshSurface(position[keep], renumbered[triangles], np.flatnonzero(keep))


def read_with_meshio(path: Path, needed_by: str) -> Any:
    """Read a mesh of any kind that meshio knows.

    Parameters
    ----------
    needed_by : str
        Setting that needs it, for the message if it is not installed.

    Raises
    ------
    UserError
        If meshio is not installed, or cannot read the file.

    Examples
    --------
    >>> read_with_meshio(Path("none.vtu"), "model=file")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    sldvexp.errors.UserError: none.vtu: there is no such file (looked from ...)
    """
    try:
        import meshio
    except ImportError:
        raise UserError(
            f"{needed_by} needs the package meshio; install it with: pip install 'sldvexp[mesh]'"
        ) from None
    read_bytes(path)  # its readers take whatever they are given, of any size
    said = io.StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(said):
            return meshio.read(path)
    except (Exception, SystemExit) as error:  # each of its many readers fails in its own way
        told = said.getvalue() or (str(error) if isinstance(error, Exception) else "")
        why = " ".join(told.split()) or type(error).__name__
        raise UserError(f"{path}: is not a mesh that can be read: {why}") from None


def _halves(position: Array, quadrilateral: IntArray) -> IntArray:
    """Cut each quadrilateral into two triangles of the same side, shape (2 quadrilaterals, 3)."""
    a, b, c, d = quadrilateral.T
    first = np.linalg.norm(position[a] - position[c], axis=1)
    second = np.linalg.norm(position[b] - position[d], axis=1)
    along_first = np.stack([a, b, c, a, c, d], axis=-1)
    along_second = np.stack([a, b, d, b, c, d], axis=-1)
    # Equal diagonals, as of rectangles, are told apart by no rounding.
    return np.where((first <= second * (1 + 1e-9))[:, None], along_first, along_second).reshape(
        -1, 3
    )
