"""Registration data as CSV: a header whose names carry the units, then one line a point.

::

    view,point,x_inch,y_inch,z_inch,up_down_deg,left_right_deg

Lengths may be in m, cm, mm, inch or ft, angles in rad or deg; up_down_dac and left_right_dac hold
DAC steps. The column view may be left out; the one view is then named like the file. Lines that
start with ``#`` are comments. A distance guess has no place here and is not written.
"""

from __future__ import annotations

import csv
import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.io.registration.table import RegistrationTable
from sldvexp.io.text_fields import (
    csv_lines,
    first_time,
    number,
    stated_or_given,
    unit_of_columns,
    whole_number,
)
from sldvexp.laser.two_mirror import MIRRORS
from sldvexp.units import AngleUnit, LengthUnit, decimal_in

AXES = ("x", "y", "z")
DAC = "dac"

NEEDED = (
    "point, x_U, y_U, z_U and up_down_V, left_right_V "
    f"with U one of {', '.join(LengthUnit.__members__)} and V one of rad, deg, dac"
)


@dataclass
class _View:
    """Points of one view so far, and the lines they stood on."""

    line_of: dict[int, int] = field(default_factory=dict)
    rows: list[dict[str, list[float]]] = field(default_factory=list)


@dataclass
class _Layout:
    """What the header says: which columns hold which array, and in which units."""

    columns: dict[str, list[str]]
    length: LengthUnit
    angle: AngleUnit | None


def read(path: Path, unit: LengthUnit | None = None) -> list[RegistrationTable]:
    """Every view of a file; see `sldvexp.io.registration.read`."""
    lines = csv_lines(path)
    _, header = next(lines, (0, []))
    layout = _layout(header, unit, str(path))
    views: dict[str, _View] = {}
    for line, cells in lines:
        where = f"{path}, line {line}"
        if len(cells) != len(header):
            raise UserError(f"{where}: has {len(cells)} values under {len(header)} columns")
        row = dict(zip(header, cells, strict=True))
        name = row.get("view", path.stem)
        if not name:
            raise UserError(f"{where}: the view has no name")
        view = views.setdefault(name, _View())
        point = whole_number(row["point"], "the point number", where)
        first_time(view.line_of, point, line, where)
        view.rows.append(
            {
                array: [number(row[c], f"{c} of point {point}", where) for c in columns]
                for array, columns in layout.columns.items()
            }
        )
    if not views:
        raise UserError(f"{path}: has a header but no points")
    return [_table(name, view, layout, str(path)) for name, view in views.items()]


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
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for table in tables:
            for i, point in enumerate(table.number):
                cells = [decimal_in(unit, v) for v in table.object_point[i].tolist()]
                if table.angle is not None:
                    cells += [decimal_in(AngleUnit.deg, v) for v in table.angle[i].tolist()]
                if table.dac is not None:
                    cells += [repr(v) for v in table.dac[i].tolist()]
                writer.writerow([table.name, point, *cells])


def _layout(header: list[str], given: LengthUnit | None, where: str) -> _Layout:
    _check_names(header, where)
    _require(["point"], header, where)
    length = unit_of_columns(AXES, tuple(LengthUnit.__members__), header, where)
    columns = {"object_point": [f"{axis}_{length}" if length else axis for axis in AXES]}
    _require(columns["object_point"], header, where)
    angle = unit_of_columns(MIRRORS, tuple(AngleUnit.__members__), header, where)
    for array, unit in (("angle", angle), ("dac", unit_of_columns(MIRRORS, (DAC,), header, where))):
        if unit:
            columns[array] = [f"{mirror}_{unit}" for mirror in MIRRORS]
            _require(columns[array], header, where)
    if len(columns) == 1:
        _require([f"{mirror}_deg" for mirror in MIRRORS], header, where)
    how = "it to the columns' names, as in x_inch,"
    stated = LengthUnit[length] if length else None
    return _Layout(
        columns,
        length=stated_or_given(stated, given, where, how),
        angle=AngleUnit[angle] if angle else None,
    )


def _check_names(header: list[str], where: str) -> None:
    known = {"view", "point", *AXES}
    known |= {f"{axis}_{unit}" for axis in AXES for unit in LengthUnit.__members__}
    known |= {f"{mirror}_{unit}" for mirror in MIRRORS for unit in (*AngleUnit.__members__, DAC)}
    for column in header:
        if column not in known:
            close = difflib.get_close_matches(column, known, n=1)
            guess = f"did you mean {close[0]}? " if close else ""
            raise UserError(f"{where}: unknown column {column!r}; {guess}Valid: view, {NEEDED}")
        if header.count(column) > 1:
            raise UserError(f"{where}: the column {column} stands twice")


def _require(columns: Sequence[str], header: list[str], where: str) -> None:
    for column in columns:
        if column not in header:
            there = ", ".join(header) or "none"
            raise UserError(
                f"{where}: the column {column} is missing; there are {there}; needed are {NEEDED}"
            )


def _table(name: str, view: _View, layout: _Layout, source: str) -> RegistrationTable:
    arrays = {a: np.array([row[a] for row in view.rows]) for a in layout.columns}
    angle = layout.angle
    return RegistrationTable(
        name=name,
        number=np.array(list(view.line_of), np.int64),
        object_point=arrays["object_point"] * layout.length.value,
        angle=arrays["angle"] * angle.value if angle else None,
        dac=arrays.get("dac"),
        unit=layout.length,
        source=source,
    )
