"""Line-of-sight velocities as a long CSV table, one row a view (and point, and frequency)."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.errors import UserError, nearest
from sldvexp.files import read_text
from sldvexp.io.velocities.table import OWN, FileLayout, LineOfSight
from sldvexp.lazy import pandas as pd
from sldvexp.typing import IndexArray
from sldvexp.units import VelocityUnit

REQUIRED = ("view", "dx", "dy", "dz", "real")
OPTIONAL = ("point", "frequency", "imag", "std")
#: Columns that tell rows apart.
AXES = ("view", "point", "frequency")
#: What others put between columns.
OTHER_DELIMITERS = {";": "semicolons", "\t": "tabs"}
#: Least values, and what is said of smaller ones.
LEAST = {
    "frequency": (0.0, "must be a finite number of zero or more"),
    "std": (np.finfo(float).tiny, "must be a positive number"),
}


def read(path: Path, unit: VelocityUnit, layout: FileLayout = OWN) -> LineOfSight:
    """Read ``view,dx,dy,dz,frequency,real,imag`` with optional ``point`` and ``std``.

    Parameters
    ----------
    path : Path
    unit : VelocityUnit
        Of the columns ``real``, ``imag`` and ``std``.
    layout : FileLayout
        Its mapping renames columns.

    Returns
    -------
    LineOfSight
        Real if there is no column ``imag``. Views, points and frequencies keep the file's order.

    Raises
    ------
    UserError
        If the file is no such table: columns, numbers, missing or repeated combinations.
    """
    table = _table(path, layout)
    labels, shape, where = _cells(table, path)

    def cube(column: str) -> np.ndarray:
        values = np.empty(len(table))
        values[where] = table[column].to_numpy()
        return values.reshape(shape)

    velocity = cube("real") + 1j * cube("imag") if "imag" in table else cube("real")
    cosines = np.stack([cube(c) for c in ("dx", "dy", "dz")], axis=-1)
    moved = np.argwhere((cosines != cosines[:, :, :1]).any(axis=(2, 3)))
    if len(moved):
        raise UserError(
            f"{path}: the direction of view {labels[0][moved[0, 0]]} differs between frequencies; "
            "give directions that belong to one point as points of their own"
        )
    return LineOfSight(
        source=str(path),
        view=[str(v) for v in labels[0]],
        point=[str(p) for p in labels[1]] if "point" in table else None,
        frequency=np.array(labels[2], float) if "frequency" in table else None,
        direction_cosines=cosines[:, :, 0],
        velocity=velocity * unit.value,
        std=cube("std") * unit.value if "std" in table else None,
    )


def _cells(table: pd.DataFrame, path: Path) -> tuple[list[list[Any]], tuple[int, ...], IndexArray]:
    """Labels along `AXES`, how many there are of each, and the cell of every row.

    Raises
    ------
    UserError
        If a combination is there twice, or is missing.
    """
    key = [c for c in AXES if c in table]
    doubled = table[table.duplicated(key)]
    if len(doubled):
        raise UserError(
            f"{path}, line {doubled.index[0]}: {_at(doubled.iloc[0], key)} is given twice"
        )
    labels = [list(dict.fromkeys(table[c])) if c in key else [None] for c in AXES]
    shape = tuple(len(axis) for axis in labels)
    position = [
        table[c].map({v: i for i, v in enumerate(axis)}).to_numpy()
        if c in key
        else np.zeros(len(table), int)
        for c, axis in zip(AXES, labels, strict=True)
    ]
    where = np.ravel_multi_index(position, shape)
    if len(table) != np.prod(shape):
        gap = np.setdiff1d(np.arange(np.prod(shape)), where)[0]
        at = zip(AXES, labels, np.unravel_index(gap, shape), strict=True)
        lost = ", ".join(f"{c} {axis[i]}" for c, axis, i in at if c in key)
        raise UserError(f"{path}: there is no row for {lost}")
    return labels, shape, where


def _table(path: Path, layout: FileLayout) -> pd.DataFrame:
    """The checked columns, numbers as numbers, with the file's line numbers as index."""
    text = read_text(path)
    lines = [i for i, line in enumerate(text.splitlines(), 1) if line.split("#")[0].strip()]
    if not lines:
        raise UserError(f"{path}: is empty; needed are the columns {', '.join(REQUIRED)}")
    _require_commas(text.splitlines()[lines[0] - 1], path, lines[0])
    try:
        table = pd.read_csv(
            io.StringIO(text), dtype=str, comment="#", skipinitialspace=True, keep_default_na=False
        )
    except pd.errors.ParserError:
        raise _uneven(text, lines, path) from None
    if not isinstance(table.index, pd.RangeIndex):  # pandas takes what is too much for labels
        raise _uneven(text, lines, path)
    table.index = pd.Index(lines[1 : 1 + len(table)])
    layout.require(table.columns, path)
    table = table.rename(columns=dict(layout.mapping))
    _check_columns(table, path)
    for column in table.columns:
        if column in ("view", "point"):
            table[column] = table[column].str.strip()
            good = table[column] != ""
            right = "must be a name"
        else:
            numbers = pd.to_numeric(table[column], errors="coerce")
            good = np.isfinite(numbers)
            right = "must be a finite number"
            if column in LEAST:
                good &= numbers >= LEAST[column][0]
                right = LEAST[column][1]
        if not good.all():
            line, wrong = table.index[~good][0], table[column][~good].iloc[0]
            raise UserError(f"{path}, line {line}: {column} {right}, not {wrong!r}")
        if column not in ("view", "point"):
            table[column] = numbers
    return table


def _require_commas(header: str, path: Path, line: int) -> None:
    """Complain about columns that something else separates: then commas may be decimal marks."""
    found = next((name for mark, name in OTHER_DELIMITERS.items() if mark in header), None)
    if found and "," not in header:
        raise UserError(
            f"{path}, line {line}: {found} are between the columns; write commas there, and "
            "decimal points in the numbers"
        )


def _check_columns(table: pd.DataFrame, path: Path) -> None:
    """Complain about columns that are unknown or missing, and a table of nothing else."""
    known = REQUIRED + OPTIONAL
    for column in table.columns:
        if column not in known:
            raise UserError(f"{path}: unknown column {column!r}; {nearest(column, known)}")
    for column in REQUIRED:
        if column not in table:
            raise UserError(
                f"{path}: the column {column} is missing; needed are {', '.join(REQUIRED)}"
            )
    if table.empty:
        raise UserError(f"{path}: the table has no rows")


def _uneven(text: str, lines: list[int], path: Path) -> UserError:
    """What to say of a table that is none: the first row that is too long, or an open quote."""
    rows = [text.splitlines()[line - 1].split(",") for line in lines]
    for line, row in zip(lines, rows, strict=True):
        if len(row) > len(rows[0]):
            return UserError(
                f"{path}, line {line}: has {len(row)} values under {len(rows[0])} columns"
            )
    return UserError(f"{path}: is not a CSV table; is a quotation mark left open?")


def _at(row: pd.Series, key: list[str]) -> str:
    """``view 2, frequency 450`` for a row."""
    return ", ".join(f"{c} {row[c]}" for c in key)
