"""VTK's XML files: an unstructured grid (VTU), and a collection of them (PVD)."""

from __future__ import annotations

import base64
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from sldvexp.typing import Array, IntArray

#: VTK's types of cells by their number of corners: vertex, line, triangle, wedge.
KINDS = {1: 1, 2: 3, 3: 5, 6: 13}
TYPES = {"f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}


def vtu(
    position: Array,
    cells: Sequence[IntArray],
    arrays: Mapping[str, NDArray],
    components: Mapping[str, Sequence[str]],
    time: float | None,
    comment: str,
    active: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Write the text of a VTU file.

    Parameters
    ----------
    position : ndarray, shape (node, 3), m
    cells : sequence of ndarray of int, shape (cell, corner)
        Nodes from 0: points, lines, triangles, and prisms as three nodes of one face and the three
        opposite them.
    arrays : mapping of str to ndarray, shape (node,) or (node, component)
        At the nodes.
    components : mapping of str to sequence of str
        Names of the components of an array, for those where they are not x, y, z.
    time : float, optional
        What the file is an instant of.
    comment : str
        At the file's head.
    active : mapping of str to str
        Names of the arrays that programs show at first, as ``Scalars`` and ``Vectors``.

    Examples
    --------
    >>> corners = np.eye(3)[[0, 1, 2, 0, 1, 2]] * [[1], [1], [1], [2], [2], [2]]
    >>> text = vtu(corners, [np.arange(6)[None]], {"depth": np.zeros(6)}, {}, None, "one prism")
    >>> text.splitlines()[4]
    '<Piece NumberOfPoints="6" NumberOfCells="1">'
    """
    # VTK finds the volumes of these prisms positive, although its manual turns them over.
    corners = np.array([own.shape[1] for own in cells for _ in own])
    instant = [] if time is None else [_array("TimeValue", np.array([time]), tuples=True)]
    lines = [
        *_head("UnstructuredGrid", comment),
        "<UnstructuredGrid>",
        *(["<FieldData>", *instant, "</FieldData>"] if instant else []),
        f'<Piece NumberOfPoints="{len(position)}" NumberOfCells="{len(corners)}">',
        "<PointData" + "".join(f" {k}={quoteattr(n)}" for k, n in active.items()) + ">",
        *(_array(name, values, components.get(name, ())) for name, values in arrays.items()),
        "</PointData>",
        "<Points>",
        _array("Points", position),
        "</Points>",
        "<Cells>",
        _array("connectivity", np.concatenate([own.ravel() for own in cells])),
        _array("offsets", np.cumsum(corners)),
        _array("types", np.array([KINDS[count] for count in corners], np.uint8)),
        "</Cells>",
        "</Piece>",
        "</UnstructuredGrid>",
        "</VTKFile>",
    ]
    return "\n".join(lines) + "\n"


def pvd(files: Mapping[float, Path], comment: str) -> str:
    """Write the text of a PVD file: other files by their time, named relative to it.

    Examples
    --------
    >>> pvd({0.5: Path("mine/half.vtu")}, "").splitlines()[4]
    '<DataSet timestep="0.5" part="0" file="mine/half.vtu"/>'
    """
    lines = [
        *_head("Collection", comment),
        "<Collection>",
        *(
            f'<DataSet timestep="{time!r}" part="0" file={quoteattr(file.as_posix())}/>'
            for time, file in files.items()
        ),
        "</Collection>",
        "</VTKFile>",
    ]
    return "\n".join(lines) + "\n"


def _head(kind: str, comment: str) -> Iterator[str]:
    """Write the beginning of a file."""
    yield '<?xml version="1.0"?>'
    told = "".join(c if c.isprintable() else " " for c in comment)
    yield f"<!-- {re.sub('-(?=-)', '- ', escape(told))} -->"  # two hyphens would end it
    yield (
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64" '
        'compressor="vtkZLibDataCompressor">'
    )


def _array(
    name: str, values: NDArray, components: Sequence[str] = (), *, tuples: bool = False
) -> str:
    """Write one array, compressed as a single block."""
    data = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    packed = zlib.compress(data.tobytes())
    header = np.array([1, data.nbytes, 0, len(packed)], "<u8")
    width = f' NumberOfComponents="{data.shape[1]}"' if data.ndim == 2 else ""
    named = "".join(f" ComponentName{i}={quoteattr(c)}" for i, c in enumerate(components))
    count = f' NumberOfTuples="{len(data)}"' if tuples else ""
    text = base64.b64encode(header.tobytes()) + base64.b64encode(packed)
    kind = TYPES[data.dtype.str[1:]]
    return (
        f'<DataArray type="{kind}" Name={quoteattr(name)}{width}{named}{count} '
        f'format="binary">{text.decode()}</DataArray>'
    )
