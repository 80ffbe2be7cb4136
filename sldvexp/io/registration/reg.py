"""The ``.reg`` format of Figure 4.28: keywords, then one line a point.

::

    NUMREG 16
    UNITS inch
    DISTGUESS 67
    REGPOINT number x y z up_down left_right

Lengths are in UNITS, angles in degrees. Keywords may be in any case, ``#`` starts a comment; the
last line of those that are written here is one, with a checksum of the others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError, nearest
from sldvexp.files import read_text, with_check_line
from sldvexp.io.registration.table import RegistrationTable
from sldvexp.io.tables import first_time, number, stated_or_given, whole_number
from sldvexp.units import AngleUnit, LengthUnit, decimal_in, unit_named

KEYWORDS = ("NUMREG", "UNITS", "DISTGUESS", "REGPOINT")

COLUMNS = ("x", "y", "z", "up_down", "left_right")


@dataclass
class _Content:
    """Statements of a file's lines so far."""

    header: dict[str, str] = field(default_factory=dict)
    line_of: dict[int, int] = field(default_factory=dict)
    rows: list[list[float]] = field(default_factory=list)


def read(path: Path, unit: LengthUnit | None = None) -> list[RegistrationTable]:
    """Read the one view of a file, named like the file; see `sldvexp.io.registration.read`."""
    content = _Content()
    for line, text in enumerate(read_text(path).splitlines(), start=1):
        words = text.partition("#")[0].split()
        if words:
            _read_line(content, words, line, f"{path}, line {line}")
    _require_count(content, path)
    name = content.header.get("UNITS")
    stated = unit_named(LengthUnit, name, str(path)) if name else None
    unit = stated_or_given(stated, unit, str(path), "a line UNITS")
    rows = np.array(content.rows)
    guess = content.header.get("DISTGUESS")
    return [
        RegistrationTable(
            name=path.stem,
            number=np.array(list(content.line_of), np.int64),
            object_point=rows[:, :3] * unit.value,
            angle=rows[:, 3:] * AngleUnit.deg.value,
            distance_guess=None if guess is None else float(guess) * unit.value,
            unit=unit,
            source=str(path),
        )
    ]


def write(path: Path, tables: Sequence[RegistrationTable]) -> None:
    """Write the one view that the format can hold; see `sldvexp.io.registration.write`."""
    if len(tables) != 1:
        raise UserError(
            f"a .reg file holds one view, not {len(tables)}; write .csv or .nc, or a file a view"
        )
    (table,) = tables
    if table.angle is None:
        raise UserError(
            f"a .reg file holds angles, and view {table.name} has DAC steps only; write .csv or .nc"
        )
    lines = [f"NUMREG {len(table.number)}", f"UNITS {table.unit.name}"]
    if table.distance_guess is not None:
        lines.append(f"DISTGUESS {decimal_in(table.unit, table.distance_guess)}")
    for n, point, angle in zip(
        table.number, table.object_point.tolist(), table.angle.tolist(), strict=True
    ):
        numbers = [decimal_in(table.unit, v) for v in point]
        numbers += [decimal_in(AngleUnit.deg, v) for v in angle]
        lines.append(f"REGPOINT {n} {' '.join(numbers)}")
    path.write_text(with_check_line("\n".join(lines) + "\n", last=True), encoding="utf-8")


def _read_line(content: _Content, words: list[str], line: int, where: str) -> None:
    """Read one line: a keyword and its values."""
    keyword, values = words[0].upper(), words[1:]
    if keyword not in KEYWORDS:
        raise UserError(f"{where}: unknown keyword {words[0]!r}; {nearest(keyword, KEYWORDS)}")
    if keyword == "REGPOINT":
        _read_point(content, values, line, where)
        return
    if keyword in content.header:
        raise UserError(f"{where}: {keyword} stands twice")
    if len(values) != 1:
        raise UserError(f"{where}: {keyword} needs one value, not {len(values)}")
    if keyword == "NUMREG":
        whole_number(values[0], keyword, where)
    elif keyword == "UNITS":
        unit_named(LengthUnit, values[0], where)
    elif number(values[0], keyword, where) <= 0:
        raise UserError(f"{where}: {keyword} must be a positive distance, not {values[0]}")
    content.header[keyword] = values[0]


def _read_point(content: _Content, values: list[str], line: int, where: str) -> None:
    """Read the values of a REGPOINT."""
    if len(values) != 1 + len(COLUMNS):
        raise UserError(
            f"{where}: REGPOINT needs a point number, {', '.join(COLUMNS)}, "
            f"but has {len(values)} values"
        )
    point = whole_number(values[0], "the point number", where)
    first_time(content.line_of, point, line, where)
    row = [
        number(value, f"{column} of point {point}", where)
        for column, value in zip(COLUMNS, values[1:], strict=True)
    ]
    for column, angle in zip(COLUMNS[3:], row[3:], strict=True):
        if abs(angle) >= math.degrees(math.pi / 2):
            raise UserError(
                f"{where}: {column} of point {point} must be below 90 deg, not {angle:g} "
                "(are these DAC steps?)"
            )
    content.rows.append(row)


def _require_count(content: _Content, path: Path) -> None:
    """Refuse a truncated file, which NUMREG is there to show."""
    stated, found = content.header.get("NUMREG"), len(content.rows)
    if stated is None:
        raise UserError(f"{path}: NUMREG, the number of points, is missing")
    if int(stated) != found:
        first = range(1, min(int(stated), found + 1) + 1)  # one of so many is missing, if any is
        absent = [n for n in first if n not in content.line_of]
        hint = f" (point {absent[0]} is missing)" if absent else ""
        raise UserError(
            f"{path}: NUMREG promises {stated} points but {found} REGPOINT lines follow{hint}"
        )
    if not found:
        raise UserError(f"{path}: has no REGPOINT line")
