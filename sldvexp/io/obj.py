"""Geometry of Wavefront OBJ files: vertices and faces, whatever else is in them.

Corners of a face may have textures and normals behind slashes, which are left out, and may count
back from the last vertex so far with negative numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.files import read_text, require_file
from sldvexp.io.tables import number
from sldvexp.typing import Array, IntArray

#: Statements of elements that are no faces, whose vertices belong to no surface.
OTHERS = ("l", "p")


def read_obj(path: Path) -> tuple[Array, dict[str, list[IntArray]]]:
    r"""Read vertices, and the corners of faces and of other elements, from 0.

    Returns
    -------
    position : ndarray, shape (vertex, 3)
        In the file's unit.
    cells : dict of str to list of ndarray
        By `triangle`, `quad` and `other`.

    Raises
    ------
    UserError
        If a line is not what OBJ has there, names no vertex, or has a face of more corners.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "one.obj")
    >>> _ = path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf -3/1 -2/1 -1/1\n")
    >>> read_obj(path)[1]["triangle"]
    [array([0, 1, 2])]
    """
    require_file(path)
    vertices: list[list[float]] = []
    cells: dict[str, list[IntArray]] = {"triangle": [], "quad": [], "other": []}
    for line, words in _statements(read_text(path)):
        where = f"{path}, line {line}"
        if words[0] == "v":
            if len(words) < 4:
                raise UserError(f"{where}: a vertex needs x, y and z")
            vertices.append([number(w, "a coordinate", where) for w in words[1:4]])
        elif words[0] in ("f", *OTHERS):
            corners = np.array([_corner(w, len(vertices), where) for w in words[1:]], np.int64)
            if words[0] == "f" and len(corners) not in (3, 4):
                raise UserError(
                    f"{where}: the face has {len(corners)} corners; cut such faces into triangles "
                    "in the program that wrote the file"
                )
            kind = {3: "triangle", 4: "quad"}[len(corners)] if words[0] == "f" else "other"
            cells[kind].append(corners)
    return np.array(vertices, float).reshape(-1, 3), cells


def _statements(text: str) -> Iterator[tuple[int, list[str]]]:
    """Split text into statements, each the line that it begins on and its words.

    A backslash at the end of a line lets a statement go on in the next one.
    """
    begin, whole = 1, ""
    for line, part in enumerate(text.splitlines(), 1):
        whole += part.removesuffix("\\") + " "
        if part.endswith("\\"):
            continue
        if words := whole.partition("#")[0].split():
            yield begin, words
        begin, whole = line + 1, ""
    if words := whole.partition("#")[0].split():
        yield begin, words


def _corner(word: str, vertices: int, where: str) -> int:
    """Find the vertex of a corner, from 0."""
    text = word.partition("/")[0]
    try:
        index = int(text)
    except ValueError:
        raise UserError(f"{where}: {word!r} names no vertex") from None
    place = index - 1 if index > 0 else vertices + index
    if index == 0 or not 0 <= place < vertices:
        raise UserError(f"{where}: there is no vertex {index}, but {vertices} so far")
    return place
