"""Tables of numbers in text files of any language, their columns recognised by unit and place.

The longest run of lines with as many numbers each is the table, whatever stands between them; the
line above it has names, of which only the units are understood. Where columns have a frequency
each, they are put below one another, so that every table has a row for each point and frequency.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.importers.conventions import Quantity, motion_of
from sldvexp.typing import Array

DELIMITERS = ("\t", ";", ",", None)
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
#: The unit at the end of a column's name, in brackets.
IN_BRACKETS = re.compile(r"[\[(]\s*(?P<unit>[^\[\]]+?)\s*[\])]\s*$")
HERTZ = re.compile(r"(?<![\d.,])(?P<number>\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*(?P<kilo>k?)Hz\b")
#: A frequency in a column's name, as ``@ 100 Hz`` or ``(0,1 kHz)``.
FREQUENCY = re.compile(rf"[@(\[]?\s*{HERTZ.pattern}\s*[)\]]?")
ANGLES = {"deg": np.pi / 180, "°": np.pi / 180, "grad": np.pi / 180, "rad": 1.0}
LEAST_COLUMNS = 4


@dataclass(frozen=True, eq=False)
class ScanTable:
    """Numbers of a table and where they stand.

    Parameters
    ----------
    values : ndarray, shape (row, column)
    line : list of int
        Number of each row's line.
    names, units : list of str
        Of the columns; empty where there are none.
    before : str
        The text above.
    delimiter : str or None
        Between columns; None for blanks.
    place : list of str
        Numbers, from 1, of the file's columns that each column was made of.
    """

    path: Path
    values: Array
    line: list[int]
    names: list[str]
    units: list[str]
    before: str
    delimiter: str | None
    place: list[str]

    def wrong(self, message: str, row: int | None = None) -> UserError:
        """Word the error of the table, or of one of its rows."""
        return UserError(f"{self.path}, line {self.line[row or 0]}: {message}")

    def roles(self, given: dict[str, int]) -> dict[str, int]:
        """Find the column of each role, as given or recognised by units and places.

        Raises
        ------
        UserError
            If there are no coordinates, or values of more than one kind.
        """
        if given:
            return self.checked(given)
        found = self.places()
        values = [i for i, u in enumerate(self.units) if motion_of(u) and i not in found.values()]
        phase = [i for i, unit in enumerate(self.units) if unit.lower() in ANGLES]
        return found | ({"phase": phase[-1]} if phase else {}) | self._values(values, bool(phase))

    def checked(self, given: dict[str, int]) -> dict[str, int]:
        """Check the columns that are given, and count them from 0."""
        columns = self.values.shape[1]
        for role, column in given.items():
            if column > columns:
                raise self.wrong(f"instrument.columns.{role} is {column}, but there are {columns}")
        return {role: column - 1 for role, column in given.items()}

    def places(self) -> dict[str, int]:
        """Recognise the column of each role but the values' by units and places."""
        found = self._coordinates()
        first, last = found["x"], found["z"]
        for i, unit in enumerate(self.units):
            whole = not unit and (self.values[:, i] == np.round(self.values[:, i])).all()
            if first <= i <= last:
                continue
            if unit.lower() in ("hz", "khz"):
                found["frequency"] = i
            elif unit.lower().startswith("db"):
                raise self.wrong(f"column {i + 1} is in {unit}; export linear values")
            elif whole:
                found.setdefault("index" if i < first else "status", i)
        return found

    def listed(self, columns: list[int]) -> str:
        """List columns with their names, for a message."""
        return ", ".join(f"{i + 1} ({self.names[i]})" for i in columns) or "none"

    def _coordinates(self) -> dict[str, int]:
        """Find the first three columns in a row that are in one unit of length."""
        units = [u if _is_length(u) else "" for u in self.units]
        for i in range(len(units) - 2):
            if units[i] and units[i] == units[i + 1] == units[i + 2]:
                return {"x": i, "y": i + 1, "z": i + 2}
        if self.units and self.units[0].lower() in ("hz", "khz"):
            raise self.wrong(
                "its rows are frequencies and its columns points, which leaves these without "
                "coordinates; export a table with a row for each point, or a universal file"
            )
        raise self.wrong(
            "there are no three columns of coordinates with a unit of length in the line above; "
            "say which columns are what with instrument.columns={x: 2, y: 3, z: 4, ...}"
        )

    def _values(self, columns: list[int], phase: bool) -> dict[str, int]:
        """Tell real and imaginary part, magnitude with its phase, or a real value."""
        if len(columns) == 1:
            return {"magnitude" if phase else "real": columns[0]}
        if len(columns) == 2 and not phase and self.units[columns[0]] == self.units[columns[1]]:
            return {"real": columns[0], "imag": columns[1]}
        raise self.wrong(
            f"the columns of velocities are {self.listed(columns)}; needed is one, or two of real "
            "and imaginary part; say which with instrument.columns={real: 5, imag: 6, ...}"
        )


def read_table(path: Path) -> ScanTable:
    """Read the longest table of numbers in a text file, with names and units above it.

    Columns are between tabs, semicolons, commas or blanks, whichever makes the longest table; the
    decimal mark is a point or a comma.

    Raises
    ------
    UserError
        If the file is missing or no text, or has no table, or one that mixes decimal marks.
    """
    lines = _text(path).splitlines()
    best = max((_longest(lines, d) for d in DELIMITERS), key=lambda run: run[1] - run[0])
    begin, end, delimiter = best
    if begin == end:
        raise UserError(
            f"{path}: has no table of numbers with at least {LEAST_COLUMNS} columns, as number, x, "
            "y, z and velocity"
        )
    rows = [fields(line, delimiter) for line in lines[begin:end]]
    marks = {m for row in rows for cell in row for m in ".," if m in cell}
    if len(marks) > 1:
        row = next(i for i, r in enumerate(rows) if {m for c in r for m in ".," if m in c} != {"."})
        raise UserError(f"{path}, line {begin + row + 1}: decimal points and commas are mixed")
    values = np.array([[float(cell.replace(",", ".")) for cell in row] for row in rows])
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values))[0, 0])
        raise UserError(f"{path}, line {begin + row + 1}: has a number that is too large")
    names, units = _header(lines[:begin], delimiter, values.shape[1])
    before = "\n".join(lines[:begin])
    place = [str(i + 1) for i in range(len(names))]
    numbers = list(range(begin + 1, end + 1))
    return ScanTable(path, values, numbers, names, units, before, delimiter, place)


def _text(path: Path) -> str:
    """Read the text of a file in UTF-8, UTF-16 or Latin-1."""
    require_file(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    utf_16 = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    for encoding in ("utf-16",) if utf_16 else ("utf-8-sig", "latin-1"):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise UserError(f"{path}: is not a text file")


def fields(line: str, delimiter: str | None) -> list[str]:
    """Split a line into cells up to the last that is not blank."""
    cells = [field.strip().strip('"') for field in line.split(delimiter)]
    while len(cells) > 1 and not cells[-1]:  # a delimiter at the end of the line
        cells.pop()
    return cells


def _longest(lines: list[str], delimiter: str | None) -> tuple[int, int, str | None]:
    """Find first and last but one line of the longest run with as many numbers each."""
    best, begin, width = (0, 0, delimiter), 0, 0
    for i, line in enumerate(lines):
        cells = fields(line, delimiter)
        numbers = all(NUMBER.fullmatch(c) and not (delimiter == "," and "," in c) for c in cells)
        if not numbers or len(cells) < LEAST_COLUMNS:
            width = 0
        else:
            if len(cells) != width:
                begin, width = i, len(cells)
            if i + 1 - begin > best[1] - best[0]:
                best = (begin, i + 1, delimiter)
    return best


def _header(above: list[str], delimiter: str | None, columns: int) -> tuple[list[str], list[str]]:
    """Read names and units of the columns from the one or two lines above the table."""
    found: list[list[str]] = []
    lines = [fields(line, delimiter) for line in above if line.strip()]
    for cells in reversed([cells for cells in lines if not of_frequencies(cells)][-2:]):
        cells += [""] * (columns - len(cells))
        if len(cells) != columns:
            break
        found.insert(0, cells)
    if not found:
        return [""] * columns, [""] * columns
    names = [" ".join(parts).strip() for parts in zip(*found, strict=True)]
    return names, [_unit(parts) for parts in zip(*found, strict=True)]


def of_frequencies(cells: list[str]) -> bool:
    """Tell whether a line holds bare numbers, of columns, behind a name with their unit Hz."""
    words = [cell for cell in cells if cell and not NUMBER.fullmatch(cell)]
    bare = sum(map(bool, cells)) - len(words)
    return bare > 1 and len(words) == 1 and "hz" in words[0].lower()


def _unit(cells: Sequence[str]) -> str:
    """Find the unit in the cells above a column: in brackets, or alone in the lowest."""
    for cell in reversed(cells):
        if match := IN_BRACKETS.search(FREQUENCY.sub("", cell)):
            return match["unit"]
    last = cells[-1]
    return last if motion_of(last) or last.lower() in (*ANGLES, "hz", "khz") else ""


def _is_length(unit: str) -> bool:
    """Tell whether a unit is one of length alone."""
    motion = motion_of(unit)
    return motion is not None and motion.quantity is Quantity.displacement and not motion.rest


def frequencies_in(text: str) -> list[float]:
    """Find the numbers that a text states in Hz, each once."""
    return list(dict.fromkeys(hertz(m) for m in HERTZ.finditer(text)))


def hertz(found: re.Match[str]) -> float:
    """Convert a match of `HERTZ` to Hz."""
    return float(found["number"].replace(",", ".")) * (1000.0 if found["kilo"] else 1.0)


#: Lines above the table in which the columns' frequencies may stand.
HEADINGS = 4
VALUES = ("real", "imag", "magnitude", "phase")


def by_rows(table: ScanTable, given: dict[str, int]) -> tuple[ScanTable, dict[str, int]]:
    """Put columns of values that have frequencies of their own into rows.

    The frequencies stand above the columns, in a line of their own or in the columns' names.

    Parameters
    ----------
    given : dict of str to int
        Columns that the user named, counted from 1; those of values of one frequency, which the
        others have at the same places.

    Returns
    -------
    table : ScanTable
        With a column ``frequency`` in Hz, or the same.
    roles : dict of str to int
        Of the new table's columns, counted from 1; `given` of the same table.

    Raises
    ------
    UserError
        If the columns of a frequency are not one value, two parts, or a magnitude and a phase.
    """
    named = table.checked(given)
    values = {role: i for role, i in named.items() if role in VALUES}
    roles = {r: i for r, i in named.items() if r not in values} if given else table.places()
    frequency = {} if "frequency" in roles else _frequencies(table, roles, bool(given))
    if len(set(frequency.values())) < 2 or not set(values.values()) <= set(frequency):
        return table, given
    groups = {f: [i for i, g in frequency.items() if g == f] for f in frequency.values()}
    if values:
        parts = _alike(table, groups, values, {frequency[i] for i in values.values()})
    else:
        parts = {f: _parts(table, f, columns) for f, columns in groups.items()}
    kinds = {f: [(role, table.units[i]) for role, i in p.items()] for f, p in parts.items()}
    first = next(iter(kinds))
    other = next((f for f in kinds if kinds[f] != kinds[first]), None)
    if other is not None:
        raise table.wrong(
            f"has the columns {table.listed(groups[first])} of {first:g} Hz but "
            f"{table.listed(groups[other])} of {other:g} Hz; all frequencies need the same columns "
            "in the same units"
        )
    return _stacked(table, roles, parts)


def _stacked(
    table: ScanTable, roles: dict[str, int], parts: dict[float, dict[str, int]]
) -> tuple[ScanTable, dict[str, int]]:
    """Put the rows of one frequency below those of another."""
    rows = len(table.values)
    index = roles.get("index")
    number = np.arange(1, rows + 1) if index is None else table.values[:, index]
    kept = [role for role in roles if role != "index"]
    names = ["index", *kept, "frequency", *next(iter(parts.values()))]
    blocks = [
        np.column_stack(
            [
                number,
                table.values[:, [roles[role] for role in kept]],
                np.full(rows, frequency),
                table.values[:, list(columns.values())],
            ]
        )
        for frequency, columns in parts.items()
    ]
    of_values = [[p[role] for p in parts.values()] for role in next(iter(parts.values()))]
    columns = [[] if index is None else [index], *([roles[role]] for role in kept), [], *of_values]
    units = [table.units[c[0]] if c else "" for c in columns]
    units[1 + len(kept)] = "Hz"
    long = replace(
        table,
        values=np.concatenate(blocks),
        line=table.line * len(blocks),
        names=names,
        units=units,
        place=[" ".join(str(i + 1) for i in c) or "heading" for c in columns],
    )
    return long, {role: i for i, role in enumerate(names, 1)}


def _parts(table: ScanTable, frequency: float, columns: list[int]) -> dict[str, int]:
    """Tell the roles of the columns of one frequency."""
    units = [table.units[i] for i in columns]
    angles = [unit.lower() in ANGLES for unit in units]
    if angles == [False]:
        return {"real": columns[0]}
    if angles == [False, True]:
        return {"magnitude": columns[0], "phase": columns[1]}
    if angles == [False, False] and units[0] == units[1] != "":
        return {"real": columns[0], "imag": columns[1]}
    raise table.wrong(
        f"the columns of {frequency:g} Hz are {table.listed(columns)}; needed is one, two in one "
        "unit (real and imaginary part), or a magnitude and a phase in deg or rad; say which, of "
        "one frequency, with instrument.columns={index: 1, x: 2, y: 3, z: 4, real: 5, imag: 6}"
    )


def _alike(
    table: ScanTable,
    groups: dict[float, list[int]],
    values: dict[str, int],
    frequencies: set[float],
) -> dict[float, dict[str, int]]:
    """Find columns of each frequency at the places of the named ones among those of theirs."""
    if len(frequencies) > 1:
        wanted = table.listed(list(values.values()))
        raise table.wrong(f"instrument.columns names {wanted} of different frequencies")
    place = {role: groups[next(iter(frequencies))].index(i) for role, i in values.items()}
    for f, columns in groups.items():
        if len(columns) <= max(place.values()):
            raise table.wrong(
                f"has only the columns {table.listed(columns)} of {f:g} Hz, fewer than of the "
                "frequency whose columns instrument.columns names"
            )
    return {f: {r: columns[k] for r, k in place.items()} for f, columns in groups.items()}


def _frequencies(table: ScanTable, roles: dict[str, int], named: bool) -> dict[int, float]:
    """Find the frequency in Hz of each column of values, by the nearest line that has one for each.

    Where the user named the others, `named`, values need no unit.
    """
    columns = [
        i
        for i, unit in enumerate(table.units)
        if i not in roles.values() and (named or motion_of(unit) or unit.lower() in ANGLES)
    ]
    above = [line for line in table.before.splitlines() if line.strip()]
    for line in reversed(above[-HEADINGS:]):
        found = _above(fields(line, table.delimiter), columns, table.values.shape[1])
        if found:
            return found
    return {}


def _above(cells: list[str], columns: list[int], width: int) -> dict[int, float]:
    """Read the columns' frequencies in one line of cells; empty unless there is one for each.

    A cell with a frequency also is of the blank ones behind it, as where cells were joined.
    """
    if not columns or not columns[0] < len(cells) <= width:
        return {}
    bare = of_frequencies(cells)
    factor = 1000.0 if bare and any("khz" in cell.lower() for cell in cells) else 1.0
    found: dict[int, float] = {}
    last: float | None = None
    for i in columns:
        cell = cells[i] if i < len(cells) else ""
        stated = [hertz(m) for m in HERTZ.finditer(cell)]
        if bare and NUMBER.fullmatch(cell):
            stated = [factor * float(cell.replace(",", "."))]
        if len(stated) > 1 or (cell and not stated) or (not cell and last is None):
            return {}
        last = stated[0] if stated else last
        found[i] = last  # type: ignore[assignment]
    return found
