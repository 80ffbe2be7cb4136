"""The table in a text file of any language: its numbers, and what its columns are by their unit."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.instrument.motion_units import motion_of
from sldvexp.instrument.pointwise import Quantity

DELIMITERS = ("\t", ";", ",", None)
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
#: The unit at the end of a column's name, in brackets.
IN_BRACKETS = re.compile(r"[\[(]\s*(?P<unit>[^\[\]]+?)\s*[\])]\s*$")
HERTZ = re.compile(r"(?<![\d.,])(?P<number>\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*(?P<kilo>k?)Hz\b")
ANGLES = {"deg": np.pi / 180, "°": np.pi / 180, "grad": np.pi / 180, "rad": 1.0}
LEAST_COLUMNS = 4


@dataclass(frozen=True, eq=False)
class Table:
    """The numbers of a table and where they stand.

    Parameters
    ----------
    path : Path
    values : ndarray, shape (row, column)
    line : list of int
        Number of each row's line.
    names, units : list of str
        Of the columns; empty where there are none.
    before : str
        The text above.
    """

    path: Path
    values: NDArray[np.float64]
    line: list[int]
    names: list[str]
    units: list[str]
    before: str

    def wrong(self, message: str, row: int | None = None) -> UserError:
        """The error of the table, or of one of its rows."""
        return UserError(f"{self.path}, line {self.line[row or 0]}: {message}")

    def roles(self, given: dict[str, int]) -> dict[str, int]:
        """Column of each role, as given or recognised by units and places.

        Raises
        ------
        UserError
            If there are no coordinates, or values of more than one kind.
        """
        columns = self.values.shape[1]
        for role, column in given.items():
            if column > columns:
                raise self.wrong(f"instrument.columns.{role} is {column}, but there are {columns}")
        if given:
            return {role: column - 1 for role, column in given.items()}
        found = self._coordinates()
        first, last = found["x"], found["z"]
        values: list[int] = []
        for i, unit in enumerate(self.units):
            whole = not unit and (self.values[:, i] == np.round(self.values[:, i])).all()
            if first <= i <= last:
                continue
            if unit.lower() in ("hz", "khz"):
                found["frequency"] = i
            elif unit.lower() in ANGLES:
                found["phase"] = i
            elif motion_of(unit):
                values.append(i)
            elif unit.lower().startswith("db"):
                raise self.wrong(f"column {i + 1} is in {unit}; export linear values")
            elif whole:
                found.setdefault("index" if i < first else "status", i)
        return found | self._values(values, "phase" in found)

    def _coordinates(self) -> dict[str, int]:
        """The first three columns in a row that are in one unit of length."""
        units = [u if _is_length(u) else "" for u in self.units]
        for i in range(len(units) - 2):
            if units[i] and units[i] == units[i + 1] == units[i + 2]:
                return {"x": i, "y": i + 1, "z": i + 2}
        raise self.wrong(
            "there are no three columns of coordinates with a unit of length in the line above; "
            "say which columns are what with instrument.columns={x: 2, y: 3, z: 4, ...}"
        )

    def _values(self, columns: list[int], phase: bool) -> dict[str, int]:
        """Real and imaginary part, magnitude with its phase, or a real value."""
        if len(columns) == 1:
            return {"magnitude" if phase else "real": columns[0]}
        if len(columns) == 2 and not phase and self.units[columns[0]] == self.units[columns[1]]:
            return {"real": columns[0], "imag": columns[1]}
        names = ", ".join(f"{i + 1} ({self.names[i]})" for i in columns) or "none"
        raise self.wrong(
            f"the columns of velocities are {names}; needed is one, or two of real and imaginary "
            "part; say which with instrument.columns={real: 5, imag: 6, ...}"
        )


def read_table(path: Path) -> Table:
    """The longest table of numbers in a text file, with the line of names and units above it.

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
    rows = [_fields(line, delimiter) for line in lines[begin:end]]
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
    return Table(path, values, list(range(begin + 1, end + 1)), names, units, before)


def _text(path: Path) -> str:
    """The text of a file in UTF-8, UTF-16 or Latin-1."""
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


def _fields(line: str, delimiter: str | None) -> list[str]:
    fields = [field.strip().strip('"') for field in line.split(delimiter)]
    while len(fields) > 1 and not fields[-1]:  # a delimiter at the end of the line
        fields.pop()
    return fields


def _longest(lines: list[str], delimiter: str | None) -> tuple[int, int, str | None]:
    """First and last but one line of the longest run with as many numbers each."""
    best, begin, width = (0, 0, delimiter), 0, 0
    for i, line in enumerate(lines):
        fields = _fields(line, delimiter)
        numbers = all(NUMBER.fullmatch(f) and not (delimiter == "," and "," in f) for f in fields)
        if not numbers or len(fields) < LEAST_COLUMNS:
            width = 0
        else:
            if len(fields) != width:
                begin, width = i, len(fields)
            if i + 1 - begin > best[1] - best[0]:
                best = (begin, i + 1, delimiter)
    return best


def _header(above: list[str], delimiter: str | None, columns: int) -> tuple[list[str], list[str]]:
    """Names and units of the columns from the one or two lines above the table."""
    found: list[list[str]] = []
    for line in reversed([line for line in above if line.strip()][-2:]):
        fields = _fields(line, delimiter)
        fields += [""] * (columns - len(fields)) if len(fields) < columns else []
        if len(fields) != columns:
            break
        found.insert(0, fields)
    names = [" ".join(parts).strip() for parts in zip(*found, strict=True)] or [""] * columns
    units = []
    for i, name in enumerate(names):
        match = IN_BRACKETS.search(name)
        last = found[-1][i] if found else ""
        alone = last if motion_of(last) or last.lower() in (*ANGLES, "hz", "khz") else ""
        units.append(match["unit"] if match else alone)
    return names, units


def _is_length(unit: str) -> bool:
    motion = motion_of(unit)
    return motion is not None and motion.quantity is Quantity.displacement and not motion.rest


def frequencies_in(text: str) -> list[float]:
    """Numbers that a text states in Hz, each once."""
    found = [
        float(m["number"].replace(",", ".")) * (1000.0 if m["kilo"] else 1.0)
        for m in HERTZ.finditer(text)
    ]
    return list(dict.fromkeys(found))
