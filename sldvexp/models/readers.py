"""Finite element models in files: universal files, and all meshes that meshio reads.

A universal file has nodes (15, 2411), shell elements or faces (2412) and normal modes (55, 2414),
displacements with rotations or without. Meshes (VTU, VTK, BDF and others) have shapes as arrays at
their nodes, whose names say the frequency, as in ``mode 1 (197.05 Hz)``; or a second file of
normal modes goes with them, as with a BDF, which has none. Nodes in no surface element are left
out: the beam does not see them.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sldvexp.errors import UserError
from sldvexp.io import read_with_meshio
from sldvexp.io.uff import Nodal, UniversalFile, UniversalGeometry, universal_file, writer
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.typing import Array, IntArray
from sldvexp.unit_labels import same_unit

UNIVERSAL = (".uff", ".unv", ".uf", ".bunv")
#: Corners of meshio's surface cells.
TRIANGLES = ("triangle", "triangle6", "triangle7")
QUADRILATERALS = ("quad", "quad8", "quad9")
#: Frequency in the name of an array.
HERTZ = re.compile(r"([0-9]+(?:\.[0-9]*)?(?:[eE][+-]?\d+)?)\s*hz", re.IGNORECASE)
#: A shape without frequencies, what to do about it.
WAY_ON = "give them in Hz with model.frequencies=[...], one a shape"


class ModelMesh(NamedTuple):
    """Nodes and surface elements of a file.

    Parameters
    ----------
    position : ndarray, shape (node, 3), m
    triangles, quadrilaterals : ndarray of int
        Nodes from 0.
    label : ndarray of int, shape (node,)
        What the file calls each node.
    axes : ndarray, shape (node, 3, 3), optional
        Unit rows: directions along which values at the nodes are given, where not the file's own.
    """

    position: Array
    triangles: IntArray
    quadrilaterals: IntArray
    label: IntArray
    axes: Array | None = None


class ModelShapes(NamedTuple):
    """Mode shapes at the nodes of a mesh.

    Parameters
    ----------
    frequency : ndarray, shape (mode,), Hz
        NaN where the file does not say it.
    values : ndarray, shape (node, 3 or 6, mode)
        Displacements, and rotations if there are six.
    """

    frequency: Array
    values: Array


def read_model(
    path: Path, unit: float, shapes: Path | None, frequencies: list[float], containing: str
) -> FiniteElementModel:
    """Read a finite element model in its own axes.

    Parameters
    ----------
    unit : float
        One unit of the file's lengths in m.
    shapes : Path, optional
        Universal file with the normal modes, if they are in another one.
    frequencies : list of float, Hz
        Of the shapes, where the file has none.
    containing : str
        Text that the lines that identify a mode must have.

    Raises
    ------
    UserError
        If a file cannot be read, has no surface or no shapes, or says other units.

    Examples
    --------
    >>> import tempfile
    >>> from sldvexp.io.uff import writer
    >>> corner = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> bent = np.array([[0, 0, 0.0], [0, 0, 1], [0, 0, 0], [0, 0, 1]])
    >>> text = writer.units() + writer.nodes(corner, np.zeros(4, int))
    >>> text += writer.quadrilaterals(np.array([[0, 1, 2, 3]]))
    >>> path = Path(tempfile.mkdtemp(), "square.uff")
    >>> _ = path.write_text(text + writer.normal_mode(["twist", *4 * [""]], bent, 25.0, 1))
    >>> model = read_model(path, 1.0, None, [], "")
    >>> model.frequency.tolist(), model.quadrilaterals.tolist()
    ([25.0], [[0, 1, 2, 3]])
    """
    if path.suffix.lower() in UNIVERSAL:
        with universal_file(path) as file:
            mesh = _of_universal_file(path, file, unit)
            found = _modes(path, file, mesh, containing) if shapes is None else None
    else:
        mesh, arrays = _of_meshio(path, unit)
        found = _of_arrays(path, arrays, containing) if shapes is None else None
    if shapes is not None:
        with universal_file(shapes) as file:
            found = _modes(shapes, file, mesh, containing)
    if found is None:
        raise UserError(
            f"{path}: has nodes and elements but no mode shapes; name the universal file that has "
            "them (data set 55 or 2414) with model.shapes"
        )
    return _joined(path, mesh, found, unit, frequencies)


def _joined(
    path: Path, mesh: ModelMesh, found: ModelShapes, unit: float, frequencies: list[float]
) -> FiniteElementModel:
    """Make a model of the surface's nodes, in m, its modes in rising order."""
    frequency, count = found.frequency, found.values.shape[2]
    if frequencies:
        if len(frequencies) != count:
            raise UserError(f"{path}: has {count} shapes, not {len(frequencies)}; {WAY_ON}")
        frequency = np.array(frequencies, float)
    if np.isnan(frequency).any():
        raise UserError(f"{path}: its shapes have no frequencies; {WAY_ON}")
    corners = [mesh.triangles.ravel(), mesh.quadrilaterals.ravel()]
    used, renumbered = np.unique(np.concatenate(corners), return_inverse=True)
    first = len(corners[0])
    order = np.argsort(frequency, kind="stable")
    values = found.values[used][..., order]
    if mesh.axes is not None:
        axes = mesh.axes[used]
        parts = [values[:, i : i + 3] for i in range(0, values.shape[1], 3)]
        values = np.concatenate([np.einsum("nai,nam->nim", axes, p) for p in parts], axis=1)
    if np.isnan(values).any():
        node = mesh.label[used[np.argwhere(np.isnan(values))[0, 0]]]
        raise UserError(f"{path}: a mode shape has no value at the node {node}")
    return FiniteElementModel(
        mesh.position[used],
        renumbered[:first].reshape(-1, 3),
        renumbered[first:].reshape(-1, 4),
        frequency[order],
        unit * values[:, :3],
        values[:, 3:] if values.shape[1] == 6 else None,
        source=str(path),
    )


def _of_universal_file(path: Path, file: UniversalFile, unit: float) -> ModelMesh:
    """Take nodes and elements of a universal file."""
    geometry = file.geometry
    if geometry is None:
        raise UserError(f"{path}: has no nodes (data set 15 or 2411), but {file.contents}")
    if file.units is not None and not same_unit(file.units.length, unit):
        raise UserError(
            f"{path}: states coordinates in units of {file.units.length:g} m, the configuration "
            f"model.unit in units of {unit:g} m; they must agree"
        )
    if not len(geometry.triangles) and not len(geometry.quadrilaterals):
        raise UserError(
            f"{path}: has {len(geometry.label)} nodes and {geometry.solids} solid elements, but no "
            "surface; write shell elements of the surface seen into it (data set 2412)"
        )
    return ModelMesh(
        unit * geometry.position,
        geometry.triangles,
        geometry.quadrilaterals,
        geometry.label,
        _axes(geometry),
    )


def _axes(geometry: UniversalGeometry) -> Array | None:
    """Find the directions of the nodes' values; None where they are the world's."""
    systems = geometry.system
    found = np.array([s.directions(p) for s, p in zip(systems, geometry.position, strict=True)])
    return None if np.array_equal(found, np.broadcast_to(np.eye(3), found.shape)) else found


def _modes(path: Path, file: UniversalFile, mesh: ModelMesh, containing: str) -> ModelShapes | None:
    """Take the normal modes of a universal file, at the nodes of a mesh."""
    modes = file.normal_modes(containing)
    if not modes:
        return None
    width = modes[0].values.shape[1]
    if any(mode.values.shape[1] != width for mode in modes):
        raise UserError(f"{path}: some modes have rotations and others not; they must be alike")
    values = np.stack([_at_nodes(mode, mesh.label) for mode in modes], axis=-1)
    frequency = np.array([mode.frequency for mode in modes])
    return ModelShapes(np.where(frequency > 0, frequency, np.nan), values)


def _at_nodes(mode: Nodal, label: IntArray) -> Array:
    """Find a mode's values at labelled nodes, NaN where it has none, shape (node, direction)."""
    place = np.minimum(np.searchsorted(mode.node, label), len(mode.node) - 1)
    known = mode.node[place] == label
    return np.where(known[:, None], mode.values[place], np.nan)


def _of_meshio(path: Path, unit: float) -> tuple[ModelMesh, dict[str, Any]]:
    """Take nodes, elements and arrays of a mesh that meshio reads."""
    mesh = read_with_meshio(path, "model=file")
    position = np.asarray(mesh.points, float) * unit
    if position.shape[1] == 2:
        position = np.column_stack([position, np.zeros(len(position))])
    triangles = [b.data[:, :3] for b in mesh.cells if b.type in TRIANGLES]
    quads = [b.data[:, :4] for b in mesh.cells if b.type in QUADRILATERALS]
    if not triangles and not quads:
        kinds = ", ".join(sorted({b.type for b in mesh.cells})) or "no cells"
        raise UserError(f"{path}: has {kinds}, but no triangles or quadrilaterals of a surface")
    label = getattr(mesh, "points_id", np.arange(1, len(position) + 1))
    return (
        ModelMesh(
            position,
            np.concatenate([np.empty((0, 3), np.int64), *triangles]).astype(np.int64),
            np.concatenate([np.empty((0, 4), np.int64), *quads]).astype(np.int64),
            np.asarray(label, np.int64),
        ),
        dict(mesh.point_data),
    )


def _of_arrays(path: Path, arrays: dict[str, Any], containing: str) -> ModelShapes | None:
    """Take arrays of three or six values a node for shapes."""
    some = {
        name: np.asarray(values, float)
        for name, values in arrays.items()
        if np.ndim(values) == 2 and np.shape(values)[1] in (3, 6) and containing in name
    }
    if not some:
        return None
    if len({values.shape for values in some.values()}) > 1:
        raise UserError(f"{path}: some shapes have rotations and others not; they must be alike")
    found = [HERTZ.search(name) for name in some]
    frequency = np.array([float(f[1]) if f else np.nan for f in found])
    return ModelShapes(frequency, np.stack(list(some.values()), axis=-1))


def universal_text(model: FiniteElementModel) -> str:
    """Write a model as a universal file: data sets 164, 2411, 2412 and 55, in m.

    Examples
    --------
    >>> corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> bent = np.array([0.0, 0, 1])[None, :, None] * np.array([0.0, 1, 2])[:, None, None]
    >>> one = FiniteElementModel(
    ...     corner, np.array([[0, 1, 2]]), np.empty((0, 4), int), np.array([25.0]), bent
    ... )
    >>> universal_text(one).count("    -1")
    8
    """
    parts = [writer.units(), writer.nodes(model.position, np.zeros(len(model.position), int))]
    if len(model.triangles):
        parts.append(writer.elements(np.empty((0, 6), int), model.triangles))
    if len(model.quadrilaterals):
        parts.append(writer.quadrilaterals(model.quadrilaterals))
    turns = [] if model.rotation is None else [model.rotation]
    values = np.concatenate([model.translation, *turns], axis=1)
    for k, frequency in enumerate(model.frequency):
        about = [f"normal mode {k + 1}", "", "", "", f"{frequency:.6g} Hz"]
        parts.append(writer.normal_mode(about, values[..., k], float(frequency), k + 1))
    return "".join(parts)
