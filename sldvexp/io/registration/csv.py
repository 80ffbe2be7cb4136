"""Registration data as CSV: a header whose names carry the units, then one line a point.

::

    view,point,x_inch,y_inch,z_inch,up_down_deg,left_right_deg

Lengths may be in m, cm, mm, inch or ft, angles in rad or deg; up_down_dac and left_right_dac hold
DAC steps. The column view may be left out; the one view is then named like the file. Lines that
start with ``#`` are comments, and the first of those that are written here has a checksum of
the others. A distance guess has no place here and is not written.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.io.registration.table import RegistrationTable
from sldvexp.io.tables import (
    AXES,
    TextTable,
    first_time,
    read_table,
    stated_or_given,
    whole_number,
    write_table,
)
from sldvexp.laser import MIRRORS
from sldvexp.units import AngleUnit, LengthUnit, decimal_in

DAC = "dac"

NEEDED = (
    "point, x_U, y_U, z_U and up_down_V, left_right_V "
    f"with U one of {', '.join(LengthUnit.__members__)} and V one of rad, deg, dac"
)


def read(path: Path, unit: LengthUnit | None = None) -> list[RegistrationTable]:
    """Read every view of a file; see `sldvexp.io.registration.read`."""
    table = read_table(path)
    columns, length, angle = _layout(table, unit)
    names = table.column("view") if "view" in table.header else [path.stem] * len(table.rows)
    line_of: dict[str, dict[int, int]] = {}
    for i, (name, cell) in enumerate(zip(names, table.column("point"), strict=True)):
        where = table.where(i)
        if not name:
            raise UserError(f"{where}: the view has no name")
        point = whole_number(cell, "the point number", where)
        first_time(line_of.setdefault(name, {}), point, table.lines[1 + i], where)
    if not line_of:
        raise UserError(f"{path}: has a header but no points")
    points = [f" of point {int(cell)}" for cell in table.column("point")]
    values = {array: table.numbers(own, points) for array, own in columns.items()}
    values["object_point"] = values["object_point"] * length.value
    if angle:
        values["angle"] = values["angle"] * angle.value
    rows = {name: [i for i, n in enumerate(names) if n == name] for name in line_of}
    return [
        RegistrationTable(
            name=name,
            number=np.array(list(numbers), np.int64),
            object_point=values["object_point"][rows[name]],
            angle=values["angle"][rows[name]] if angle else None,
            dac=values["dac"][rows[name]] if "dac" in values else None,
            unit=length,
            source=str(path),
        )
        for name, numbers in line_of.items()
    ]


def write(path: Path, tables: Sequence[RegistrationTable]) -> None:
    """Write views one below the other, in the unit of the first; see
    `sldvexp.io.registration.write`.

    Angles go out in degrees, DAC steps as they are; all views must have the same of the two.
    """
    unit = tables[0].unit
    kinds = [kind for kind in ("angle", "dac") if getattr(tables[0], kind) is not None]
    for table in tables:
        if [kind for kind in ("angle", "dac") if getattr(table, kind) is not None] != kinds:
            raise UserError(
                f"views {tables[0].name} and {table.name} cannot share a .csv file: "
                "one has angles or DAC steps that the other lacks"
            )
        if table.name.startswith("#"):
            raise UserError(f"view {table.name} would be a comment in a .csv file; rename it")
    header = ["view", "point", *(f"{axis}_{unit.name}" for axis in AXES)]
    header += [f"{m}_{'deg' if kind == 'angle' else DAC}" for kind in kinds for m in MIRRORS]
    write_table(path, header, (row for table in tables for row in _rows(table, unit)))


def _rows(table: RegistrationTable, unit: LengthUnit) -> Iterator[list[object]]:
    """Write the cells of each point."""
    for i, point in enumerate(table.number):
        cells = [decimal_in(unit, v) for v in table.object_point[i].tolist()]
        if table.angle is not None:
            cells += [decimal_in(AngleUnit.deg, v) for v in table.angle[i].tolist()]
        if table.dac is not None:
            cells += [repr(v) for v in table.dac[i].tolist()]
        yield [table.name, point, *cells]


def _layout(
    table: TextTable, given: LengthUnit | None
) -> tuple[dict[str, list[str]], LengthUnit, AngleUnit | None]:
    """Find the columns of each array, and the units of lengths and angles, in the header."""
    _check_names(table)
    needed = f"there are {', '.join(table.header) or 'none'}; needed are {NEEDED}"
    table.require(["point"], needed)
    length = table.unit_of(AXES, LengthUnit.__members__)
    columns = {"object_point": [f"{axis}_{length}" if length else axis for axis in AXES]}
    table.require(columns["object_point"], needed)
    angle = table.unit_of(MIRRORS, AngleUnit.__members__)
    for array, unit in (("angle", angle), ("dac", table.unit_of(MIRRORS, [DAC]))):
        if unit:
            columns[array] = [f"{mirror}_{unit}" for mirror in MIRRORS]
            table.require(columns[array], needed)
    if len(columns) == 1:
        table.require([f"{mirror}_deg" for mirror in MIRRORS], needed)
    how = "it to the columns' names, as in x_inch,"
    stated = LengthUnit[length] if length else None
    known = stated_or_given(stated, given, str(table.path), how)
    return columns, known, AngleUnit[angle] if angle else None


def _check_names(table: TextTable) -> None:
    """Complain about a column that is unknown or stands twice."""
    known = {"view", "point", *AXES}
    known |= {f"{axis}_{unit}" for axis in AXES for unit in LengthUnit.__members__}
    known |= {f"{mirror}_{unit}" for mirror in MIRRORS for unit in (*AngleUnit.__members__, DAC)}
    for column in table.header:
        if column not in known:
            close = difflib.get_close_matches(column, known, n=1)
            guess = f"did you mean {close[0]}? " if close else ""
            raise UserError(
                f"{table.path}: unknown column {column!r}; {guess}Valid: view, {NEEDED}"
            )
        if table.header.count(column) > 1:
            raise UserError(f"{table.path}: the column {column} stands twice")
