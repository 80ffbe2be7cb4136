"""Line-of-sight velocities in files: their one reader, by the file's ending, and tables of text.

A table is long, one row a view (and point, and frequency), and so may come in any order; rows are
put into their cells of an array (view, point, frequency), each of which must be there once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.errors import UserError, nearest
from sldvexp.files import require_file
from sldvexp.io.tables import TextTable, read_table
from sldvexp.io.velocities.arrays import read_matlab, read_netcdf
from sldvexp.io.velocities.table import ORDER, OWN, FileLayout, LineOfSight
from sldvexp.typing import Array, IndexArray
from sldvexp.units import VelocityUnit

REQUIRED = ("view", "dx", "dy", "dz", "real")
OPTIONAL = ("point", "frequency", "imag", "std")
#: Least values, and what is said of smaller ones.
LEAST = {
    "frequency": (0.0, "must be a finite number of zero or more"),
    "std": (np.finfo(float).tiny, "must be a positive number"),
}


def read(path: Path, unit: VelocityUnit, layout: FileLayout = OWN) -> LineOfSight:
    r"""Read a file of velocities.

    Parameters
    ----------
    path : Path
        ``.csv``, ``.nc`` or ``.mat``.
    unit : VelocityUnit
        Of the file's velocities.
    layout : FileLayout
        How the file differs from the program's own.

    Raises
    ------
    UserError
        If the file is missing, of an unknown kind, or not what its reader needs.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "head.csv")
    >>> _ = path.write_text("view,dx,dy,dz,real,imag\nfront,0,0,1,2,-1\n")
    >>> read(path, VelocityUnit.mm_per_s).velocity
    array([[[0.002-0.001j]]])
    """
    require_file(path)
    if path.suffix.lower() not in READERS:
        raise UserError(f"{path}: the ending must be one of {', '.join(READERS)}")
    return READERS[path.suffix.lower()](path, unit, layout)


def read_csv(path: Path, unit: VelocityUnit, layout: FileLayout = OWN) -> LineOfSight:
    """Read ``view,dx,dy,dz,frequency,real,imag`` with optional ``point`` and ``std``.

    Velocities are real if there is no column ``imag``. Views, points and frequencies keep the
    file's order.
    """
    table = _table(path, layout)
    columns = {c: _checked(table, c) for c in table.header}
    labels, shape, where = _cells(table, {c: columns[c] for c in ORDER if c in columns})

    def cube(column: str) -> Array:
        values = np.empty(len(table.rows))
        values[where] = columns[column]
        return values.reshape(shape)

    velocity = cube("real") + 1j * cube("imag") if "imag" in columns else cube("real")
    cosines = np.stack([cube(c) for c in ("dx", "dy", "dz")], axis=-1)
    moved = np.argwhere((cosines != cosines[:, :, :1]).any(axis=(2, 3)))
    if len(moved):
        raise UserError(
            f"{path}: the direction of view {labels[0][moved[0, 0]]} differs between frequencies; "
            "give directions that belong to one point as points of their own"
        )
    return LineOfSight(
        source=str(path),
        view=labels[0],
        point=labels[1] if "point" in columns else None,
        frequency=np.array(labels[2], float) if "frequency" in columns else None,
        direction_cosines=cosines[:, :, 0],
        velocity=velocity * unit.value,
        std=cube("std") * unit.value if "std" in columns else None,
    )


def _cells(
    table: TextTable, keys: dict[str, list[Any]]
) -> tuple[list[list[Any]], tuple[int, ...], IndexArray]:
    """Find the labels along `ORDER`, how many there are of each, and the cell of every row.

    Raises
    ------
    UserError
        If a combination is there twice, or is missing.
    """
    labels = [list(dict.fromkeys(keys.get(c, [None]))) for c in ORDER]
    shape = tuple(len(axis) for axis in labels)
    position = [np.zeros(len(table.rows), int) for _ in ORDER]
    for k, (c, axis) in enumerate(zip(ORDER, labels, strict=True)):
        if c in keys:
            place = {label: i for i, label in enumerate(axis)}
            position[k] = np.array([place[label] for label in keys[c]])
    where = np.ravel_multi_index(position, shape)

    def told(at: Iterable[int]) -> str:
        """Name a cell, ``view 2, frequency 450``, as the first row of each label has it."""
        own = ((c, axis[i]) for c, axis, i in zip(ORDER, labels, at, strict=True) if c in keys)
        return ", ".join(f"{c} {table.column(c)[keys[c].index(label)]}" for c, label in own)

    cells, first = np.unique(where, return_index=True)
    if len(cells) < len(where):
        row = int(np.setdiff1d(np.arange(len(where)), first)[0])
        raise UserError(f"{table.where(row)}: {told(p[row] for p in position)} is given twice")
    if len(cells) < np.prod(shape):
        gap = np.setdiff1d(np.arange(np.prod(shape)), cells)[0]
        lost = told(int(i) for i in np.unravel_index(gap, shape))
        raise UserError(f"{table.path}: there is no row for {lost}")
    return labels, shape, where


def _table(path: Path, layout: FileLayout) -> TextTable:
    """Read the text with the program's names of columns, and check these."""
    table = read_table(path, inline_comments=True)
    if not table.header:
        raise UserError(f"{path}: is empty; needed are the columns {', '.join(REQUIRED)}")
    layout.require(table.header, path)
    table = replace(table, header=[layout.mapping.get(c, c) for c in table.header])
    known = REQUIRED + OPTIONAL
    for column in table.header:
        if column not in known:
            raise UserError(f"{path}: unknown column {column!r}; {nearest(column, known)}")
        if table.header.count(column) > 1:
            raise UserError(f"{path}: the column {column} stands twice")
    table.require(REQUIRED, f"needed are {', '.join(REQUIRED)}")
    if not table.rows:
        raise UserError(f"{path}: the table has no rows")
    return table


def _checked(table: TextTable, column: str) -> list[Any]:
    """Read a column of names or of numbers.

    Raises
    ------
    UserError
        If a name is empty, or a number is not finite or too small.
    """
    cells = table.column(column)
    if column in ("view", "point"):
        bad, right = [not cell for cell in cells], "must be a name"
    else:
        least, right = LEAST.get(column, (-np.inf, "must be a finite number"))
        values = table.floats(column)
        bad = (~(np.isfinite(values) & (values >= least))).tolist()
    if True in bad:
        row = bad.index(True)
        raise UserError(f"{table.where(row)}: {column} {right}, not {cells[row]!r}")
    return cells if column in ("view", "point") else values.tolist()


READERS: dict[str, Callable[[Path, VelocityUnit, FileLayout], LineOfSight]] = {
    ".csv": read_csv,
    ".nc": read_netcdf,
    ".mat": read_matlab,
}
