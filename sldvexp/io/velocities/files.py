"""Line-of-sight velocities in files: their one reader, by the file's ending, and tables of text.

A table is long, one row a view (and point, and frequency), and so may come in any order; rows are
put into their cells of an array (view, point, frequency), each of which must be there once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.errors import UserError, nearest
from sldvexp.files import require_file
from sldvexp.io.questions import Questions
from sldvexp.io.tables import AXES, COORDINATES, MISSING, TextTable, read_table
from sldvexp.io.velocities.arrays import read_matlab, read_netcdf
from sldvexp.io.velocities.attributes import require_length
from sldvexp.io.velocities.headings import (
    HeadingUnits,
    read_headings,
    require_bracket_understood,
)
from sldvexp.io.velocities.table import (
    IGNORED,
    ORDER,
    OWN,
    REMEDY,
    UNSTATED_FREQUENCY,
    UNSTATED_LENGTH,
    UNSTATED_VELOCITY,
    FileLayout,
    LineOfSight,
)
from sldvexp.io.velocities.texts import compare_texts
from sldvexp.lazy import pandas as pd
from sldvexp.typing import Array, IndexArray
from sldvexp.units import LengthUnit, VelocityUnit

REQUIRED = ("view", "dx", "dy", "dz", "real")
OPTIONAL = ("point", "frequency", "imag", "std", *AXES)
#: Columns of coordinates with their unit.
WITH_UNIT = tuple(f"{axis}_{unit}" for axis in AXES for unit in LengthUnit.__members__)
#: How many times as many cells as rows there may be, the others being missing.
MOST_GAPS = 10
#: Columns of text.
NAMES = ("view", "point")
#: Columns whose cells may be empty at points that were not measured.
VALUES = ("real", "imag", "std")
#: Least values, and what is said of smaller ones.
LEAST = {
    "frequency": (0.0, "must be a finite number of zero or more"),
    "std": (np.finfo(float).tiny, "must be a positive number"),
}


def read(path: Path, unit: VelocityUnit | None, layout: FileLayout = OWN) -> LineOfSight:
    r"""Read a file of velocities.

    Parameters
    ----------
    path : Path
        ``.csv``, ``.nc`` or ``.mat``.
    unit : VelocityUnit or None
        Of the file's velocities; None if it is left to the file, and m/s if this says nothing.
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
    found = READERS[path.suffix.lower()](path, unit, layout)
    return replace(found, ignored=tuple(layout.ignored))


def read_csv(path: Path, unit: VelocityUnit | None, layout: FileLayout = OWN) -> LineOfSight:
    """Read ``view,dx,dy,dz,frequency,real,imag`` with optional ``point``, ``x,y,z`` and ``std``.

    Velocities are real if there is no column ``imag``. Views, points and frequencies keep the
    file's order. Coordinates may state their unit, as ``x_mm``, and so may headings that the layout
    maps to others.
    """
    questions = Questions()
    table, units = _table(path, unit, layout, questions)
    factor = units.velocity or UNSTATED_VELOCITY.value
    hertz = units.frequency or UNSTATED_FREQUENCY
    columns, keys = _columns(table, layout, questions)
    labels, shape, where = _cells(table, keys, layout, questions)
    texts = ((f", line {line}", text) for line, text in table.comments)
    odd = compare_texts(texts, unit, units, layout, path, questions)
    questions.done()

    def cube(column: str) -> Array:
        cells = np.full(np.prod(shape), np.nan)
        cells[where] = columns[column]
        return cells.reshape(shape)

    velocity = cube("real") + 1j * cube("imag") if "imag" in columns else cube("real")
    std = cube("std") if "std" in columns else None
    missing = np.isnan(velocity) if std is None else np.isnan(velocity) | np.isnan(std)
    cosines = np.stack([cube(c) for c in ("dx", "dy", "dz")], axis=-1)
    first = _first(cosines, 2)
    moved = np.argwhere((abs(cosines - first[:, :, None]) > 0).any(axis=(2, 3)))
    if len(moved):
        raise UserError(
            f"{path}: the direction of view {labels[0][moved[0, 0]]} differs between frequencies; "
            "give directions that belong to one point as points of their own"
        )
    position = _position(table, cube, labels[1], layout, units)
    points = labels[1] if "point" in keys else None
    return LineOfSight(
        source=str(path),
        view=labels[0],
        point=["1"] if points is None and position is not None else points,
        frequency=hertz * np.array(labels[2], float) if "frequency" in columns else None,
        direction_cosines=first,
        velocity=np.where(missing, np.nan, velocity) * factor,
        std=None if std is None else np.where(missing, np.nan, std) * factor,
        missing=missing if missing.any() else None,
        position=position,
        amplitude=units.amplitude,
        odd=odd,
    )


def _first(values: Array, axis: int) -> Array:
    """Take the first entry along an axis whose last-axis numbers are all there."""
    known = np.isfinite(values).all(axis=-1, keepdims=True).argmax(axis=axis, keepdims=True)
    return np.asarray(np.take_along_axis(values, known, axis).squeeze(axis))


def _position(
    table: TextTable,
    cube: Callable[[str], Array],
    labels: list[Any],
    layout: FileLayout,
    units: HeadingUnits,
) -> Array | None:
    """Find the points' coordinates, shape (point, 3), m; None if there are none.

    Raises
    ------
    UserError
        If an axis is missing, units are mixed, or a point stands at two places.
    """
    stated = table.unit_of(AXES, LengthUnit.__members__)
    columns = [f"{axis}_{stated}" if stated else axis for axis in AXES]
    if not set(columns) & set(table.header):
        return None
    table.require(columns, f"needed are {', '.join(AXES)} or {COORDINATES}, or none of them")
    own = np.moveaxis(np.stack([cube(c) for c in columns], axis=-1), 1, 0)
    own = own.reshape(len(own), -1, 3)
    found = _first(own, 1)
    apart = np.argwhere((abs(own - found[:, None]) > 0).any(axis=(1, 2)))
    if len(apart):
        name = labels[apart[0, 0]]
        which = "the point" if name is None else f"point {name}"
        raise UserError(
            f"{table.path}: {which} has more than one position; each point needs one, and points "
            "of their own need a column point"
        )
    if stated:
        said = f"{table.path}: the columns {', '.join(columns)} state {stated}"
        require_length(LengthUnit[stated], layout.length, said)
        return found * LengthUnit[stated].value
    return found * (units.length or (layout.length or UNSTATED_LENGTH).value)


def _cells(
    table: TextTable,
    keys: dict[str, tuple[IndexArray, list[Any]]],
    layout: FileLayout,
    questions: Questions,
) -> tuple[list[list[Any]], tuple[int, ...], IndexArray]:
    """Find the labels along `ORDER`, how many there are of each, and the cell of every row.

    Raises
    ------
    UserError
        If a combination is there twice; if it is missing and none may be, that is asked about.
    """
    labels: list[list[Any]] = [[None] for _ in ORDER]
    position: list[IndexArray] = [np.zeros(len(table.rows), int) for _ in ORDER]
    for k, c in enumerate(ORDER):
        if c in keys:
            position[k], labels[k] = keys[c]
    shape = tuple(len(axis) for axis in labels)
    where = np.ravel_multi_index(position, shape)

    def told(at: Iterable[int]) -> str:
        """Name a cell, ``view 2, frequency 450``, as the first row of each label has it."""
        rows = (
            (c, int(np.argmax(keys[c][0] == i)))
            for c, i in zip(ORDER, at, strict=True)
            if c in keys
        )
        return ", ".join(f"{c} {table.column(c)[row]}" for c, row in rows)

    cells, first = np.unique(where, return_index=True)
    if len(cells) < len(where):
        row = int(np.setdiff1d(np.arange(len(where)), first)[0])
        raise UserError(f"{table.where(row)}: {told(p[row] for p in position)} is given twice")
    whole = math.prod(shape)
    if len(cells) < whole and not layout.gaps:
        jump = np.flatnonzero(cells != np.arange(len(cells)))
        gap = int(jump[0]) if len(jump) else len(cells)
        lost = told(int(i) for i in np.unravel_index(gap, shape))
        others = f" and {more} others" if (more := whole - len(cells) - 1) else ""
        _ask_incomplete(f"{table.path}: there is no row for {lost}{others}", table.path, questions)
    if whole > MOST_GAPS * len(cells):
        questions.done()
        counts = ", ".join(f"{len(a)} {c}" for c, a in zip(ORDER, labels, strict=True) if c in keys)
        raise UserError(
            f"{table.path}: has {len(cells)} of {whole} combinations of {counts}; each view needs "
            "rows of the same points and frequencies"
        )
    return labels, shape, where


def _table(
    path: Path, unit: VelocityUnit | None, layout: FileLayout, questions: Questions
) -> tuple[TextTable, HeadingUnits]:
    """Read the text with the program's names of columns, check these, and find their units."""
    table = read_table(path, inline_comments=True)
    if not table.header:
        raise UserError(f"{path}: is empty; needed are the columns {', '.join(REQUIRED)}")
    layout.require(table.header, path)
    table = table.without(layout.ignored)
    headings = {c: layout.mapping.get(c, c) for c in table.header}
    table = replace(table, header=[layout.mapping.get(c, c) for c in table.header])
    known = REQUIRED + OPTIONAL + WITH_UNIT
    unknown = [column for column in table.header if column not in known]
    if len(unknown) > 1:
        lost = [column for column in REQUIRED if column not in table.header]
        missing = f", and lacks {', '.join(lost)}" if lost else ""
        message = (
            f"{path}: has the unknown columns {', '.join(unknown)}{missing}; say which is what "
            f"with instrument.mapping={{{': , '.join(unknown)}: }}, {IGNORED} if a column is of no "
            f"use; Valid: {', '.join((*REQUIRED, *OPTIONAL, IGNORED))}"
        )
        questions.note(UserError(message), path)
        _ask_the_rest(table, headings, unknown, unit, layout, questions)
        questions.done()
    for column in table.header:
        if column in unknown:
            theirs = next(h for h, own in headings.items() if own == column)
            raise UserError(
                f"{path}: unknown column {column!r}; say what it is with instrument.mapping="
                f"{{{theirs}: }}, {IGNORED} if it is of no use; {nearest(column, known)}"
            )
        if table.header.count(column) > 1:
            raise UserError(f"{path}: the column {column} stands twice")
    table.require(REQUIRED, f"needed are {', '.join(REQUIRED)}")
    if not table.rows:
        raise UserError(f"{path}: the table has no rows")
    units = HeadingUnits()
    with questions.noting(path):
        units = read_headings(headings, unit, layout, path)
    return table, units


def _ask_the_rest(
    table: TextTable,
    headings: dict[str, str],
    unknown: list[str],
    unit: VelocityUnit | None,
    layout: FileLayout,
    questions: Questions,
) -> None:
    """Ask for what is open besides columns of which nobody says what they are."""
    with questions.noting(table.path):
        read_headings(headings, unit, layout, table.path)
    for column in unknown:
        with questions.noting(table.path, "unit"):
            require_bracket_understood(column, unit, layout, table.path)
    for column in () if layout.gaps else (*VALUES, *unknown):
        cells = table.column(column) if column in table.header else []
        empty = [cell.lower() in MISSING for cell in cells]
        if True in empty:
            at = table.where(empty.index(True))
            _ask_incomplete(f"{at}: {column} has no number", table.path, questions)


def _columns(
    table: TextTable, layout: FileLayout, questions: Questions
) -> tuple[dict[str, Array], dict[str, tuple[IndexArray, list[Any]]]]:
    """Read the columns of numbers, and of each of `ORDER` that there is which label rows have.

    Raises
    ------
    UserError
        If a name is empty; see also `_checked`.
    """
    names = [c for c in table.header if c in NAMES]
    numbers = [c for c in table.header if c not in NAMES]
    labels, values = table.labels_and_floats(names, numbers)
    keys: dict[str, tuple[IndexArray, list[Any]]] = dict(zip(names, labels, strict=True))
    columns = dict(zip(numbers, values.T, strict=True))
    for c in table.header:  # from left to right, as it is read
        if c in columns:
            columns[c] = _checked(table, c, columns[c], layout, questions)
        elif "" in keys[c][1]:
            row = int(np.argmax(keys[c][0] == keys[c][1].index("")))
            raise UserError(f"{table.where(row)}: {c} must be a name, not ''")
    if "frequency" in columns:
        index, once = pd.factorize(columns["frequency"])
        keys["frequency"] = index, list(once)
    return columns, keys


def _checked(
    table: TextTable, column: str, values: Array, layout: FileLayout, questions: Questions
) -> Array:
    """Check a column of numbers; NaN where a value is missing.

    Raises
    ------
    UserError
        If a number is not finite or too small; a missing value is asked about unless it may be
        missing.
    """
    least, right = LEAST.get(column, (-np.inf, "must be a finite number"))
    known = np.isfinite(values) & (values >= least)
    if known.all():
        return values
    cells = table.column(column)
    empty = [
        int(row)
        for row in np.flatnonzero(np.isnan(values))
        if column in VALUES and cells[row].lower() in MISSING
    ]
    known[empty] = True
    if empty and not layout.gaps:
        row = empty[0]
        message = f"{table.where(row)}: {column} {right}, not {cells[row]!r}"
        _ask_incomplete(message, table.path, questions)
    if not known.all():
        row = int(np.argmin(known))
        raise UserError(f"{table.where(row)}: {column} {right}, not {cells[row]!r}")
    return values


def _ask_incomplete(message: str, path: Path, questions: Questions) -> None:
    """Ask what becomes of missing values, once for a file."""
    if not questions.asked("incomplete"):
        questions.note(UserError(f"{message}; {REMEDY}"), path, "incomplete")


READERS: dict[str, Callable[[Path, VelocityUnit | None, FileLayout], LineOfSight]] = {
    ".csv": read_csv,
    ".nc": read_netcdf,
    ".mat": read_matlab,
}
