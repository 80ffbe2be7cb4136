"""Lines of a text table of points: which are its rows, and that none of them is lost.

Rows are the lines with as many cells as most lines of numbers have, and words where those do. A
cell that is empty, a dash or NaN makes its row one of a point that was not measured. Between rows
may stand blank lines, comments, and what stood above the table already, as on each page; a line
above that states a frequency may come again with another, which begins a block of rows of that
frequency. Below the last row may stand text. Everything else that holds numbers is refused by its
line: a row that is not understood is no row that is not there.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from sldvexp.errors import UserError
from sldvexp.files import read_text, require_file
from sldvexp.importers.scan_table import (
    LEAST_COLUMNS,
    NUMBER,
    ScanTable,
    column_names,
    fields,
    frequencies_in,
    number,
    of_frequencies,
)
from sldvexp.io.tables import MISSING, require_decimals
from sldvexp.typing import Array

DELIMITERS = ("\t", ";", ",", None)
COMMENTS = ("#", "%", "//", "!")
#: Numbers that make a line look like a row.
LEAST_NUMBERS = 3
DIGITS = re.compile(r"[0-9]+([.,][0-9]+)?")


def read_table(path: Path) -> ScanTable:
    """Read the longest table of numbers in a text file, with names and units above it.

    Columns are between tabs, semicolons, commas or blanks, whichever makes the longest table; the
    decimal mark is a point or a comma.

    Raises
    ------
    UserError
        If the file is missing or no text, or has no table, or one that mixes decimal marks, or a
        line that may be a row and cannot be read as one.
    """
    require_file(path)
    lines = read_text(path).splitlines()
    delimiter, shape, count = max((_shape(lines, d) for d in DELIMITERS), key=lambda s: s[2])
    if not count:
        raise UserError(
            f"{path}: has no table of numbers with at least {LEAST_COLUMNS} columns, as number, x, "
            "y, z and velocity"
        )
    return _Reader(path, lines, delimiter, shape).table()


#: True for each column of a table that has numbers, and False where words are.
Shape = tuple[bool, ...]


def _shape(lines: list[str], delimiter: str | None) -> tuple[str | None, Shape, int]:
    """Find which columns of most lines hold numbers, and how many such lines there are."""
    cells = (fields(line, delimiter) for line in lines)
    shapes = Counter(tuple(map(_is_number, c)) for c in cells if len(c) >= LEAST_COLUMNS)
    tables = {s: n for s, n in shapes.items() if sum(s) >= LEAST_COLUMNS and 2 * sum(s) > len(s)}
    shape, count = max(tables.items(), key=lambda s: (s[1], sum(s[0])), default=((), 0))
    return delimiter, shape, count


def _is_number(cell: str) -> bool:
    return NUMBER.fullmatch(cell) is not None


def _template(line: str) -> str:
    """Reduce a line to what is the same on every page and in every block."""
    return " ".join(DIGITS.sub("#", line).split())


@dataclass
class _Reader:
    """Walk through the lines of one file."""

    path: Path
    lines: list[str]
    delimiter: str | None
    shape: Shape
    rows: list[list[str]] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    frequency: list[float] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.shape)

    def table(self) -> ScanTable:
        """Read all rows, and what is said of them."""
        full = [i for i, line in enumerate(self.lines) if self._is_row(self._cells(line))]
        begin, last = full[0], full[-1]
        above = self.lines[:begin]
        self._check_above(above)
        known: dict[str, list[str]] = {}
        for line in filter(str.strip, above):
            known.setdefault(_template(line), []).append(line)
        now = np.nan
        for i in range(begin, len(self.lines)):
            cells = self._cells(self.lines[i])
            if self._is_row(cells):
                self.rows.append(cells)
                self.numbers.append(i + 1)
                self.frequency.append(now)
            else:
                now = self._between(i, cells, known, now, i > last)
        names, units = column_names(above, self.delimiter, self.width)
        return ScanTable(
            self.path,
            self._values(),
            self.numbers,
            names,
            units,
            "\n".join(above),
            self.delimiter,
            [str(i + 1) for i in range(self.width)],
            self._blocks(),
            ", ".join(f"{count} {what}" for what, count in self.counts.items()),
        )

    def _cells(self, line: str) -> list[str]:
        """Split a line, with the cells that are empty at the end of a row."""
        cells = fields(line, self.delimiter)
        empty = line.count(self.delimiter) + 1 - len(cells) if self.delimiter else 0
        return cells + [""] * min(empty, self.width - len(cells))

    def _is_row(self, cells: Sequence[str]) -> bool:
        """Tell whether cells are numbers, or say that there is none."""
        if len(cells) != self.width or sum(map(_is_number, cells)) < LEAST_NUMBERS:
            return False
        return not self._odd(cells)

    def _odd(self, cells: Sequence[str]) -> list[int]:
        """Find cells that are neither a number nor say that there is none, where numbers are."""
        return [
            k
            for k, (cell, numeric) in enumerate(zip(cells, self.shape, strict=True))
            if numeric and not _is_number(cell) and cell.lower() not in MISSING
        ]

    def _is_alike(self, cells: Sequence[str]) -> bool:
        """Tell whether a line that is none looks like a row: it has numbers as rows have."""
        count = sum(map(_is_number, cells))
        return count >= LEAST_NUMBERS and 2 * count >= min(sum(self.shape), len(cells))

    def _check_above(self, above: list[str]) -> None:
        """Refuse a first row that cannot be read and so seems to be a heading."""
        below = [i for i, line in enumerate(above) if line.strip()][-2:]
        for i in below:
            cells = self._cells(above[i])
            if len(cells) >= LEAST_COLUMNS and self._is_alike(cells) and not of_frequencies(cells):
                self._wrong(i, cells)

    def _between(
        self, i: int, cells: list[str], known: dict[str, list[str]], now: float, below: bool
    ) -> float:
        """Read a line that is no row; give the frequency of the rows that follow."""
        line = self.lines[i]
        if not any(cells):
            self._count("blank lines", below)
            return now
        if _template(line) in known:
            return self._heading(i, known[_template(line)], now, below)
        comment = line.strip(' "').startswith(COMMENTS)
        inner = self._cells(line.strip(' "').lstrip("#%/! ")) if comment else cells
        if self._is_alike(inner) or _is_number(cells[0]):
            self._wrong(i, inner if comment else cells)
        if frequencies_in(line) and not below:
            raise self._error(i, "states a frequency, as no line above the table does")
        if not comment and not below:
            raise self._error(i, "stands between rows of the table and is not understood")
        self.counts["comments" if comment else "lines below"] += 1
        return now

    def _heading(self, i: int, before: list[str], now: float, below: bool) -> float:
        """Read a line that stood above the table with perhaps other numbers."""
        first, stated = frequencies_in("\n".join(before)), frequencies_in(self.lines[i])
        if stated != first and (below or len(first) != 1 or len(stated) != 1):
            rows = ", but no rows follow" if below else ", and not one as above the table"
            raise self._error(i, f"states frequencies{rows}")
        self._count("repeated headings", below)
        if len(stated) != 1:
            return now
        if np.isnan(now):
            self.frequency = first * len(self.frequency)
        return stated[0]

    def _count(self, what: str, below: bool) -> None:
        if not below:
            self.counts[what] += 1

    def _wrong(self, i: int, cells: list[str]) -> NoReturn:
        """Refuse a line that looks like a row."""
        odd = self._odd(cells) if len(cells) == self.width else []
        if odd:
            raise UserError(
                f"{self.path}, line {i + 1}: looks like a row of the table, but column "
                f"{odd[0] + 1} is {cells[odd[0]]!r}, which is no number; correct it, or leave the "
                "cell empty if there is none"
            )
        few = "is a comment"
        if len(cells) != self.width:
            few = f"has {len(cells)} cells and not {self.width}"
        raise self._error(i, f"looks like a row of the table but {few}")

    def _error(self, i: int, message: str) -> UserError:
        shown = " ".join(self.lines[i].split())
        shown = shown if len(shown) < 60 else f"{shown[:57]}..."
        return UserError(
            f"{self.path}, line {i + 1}: {shown!r} {message}; correct the line, or delete it if it "
            "is none of the table"
        )

    def _values(self) -> Array:
        """Convert the rows; NaN where there is no number."""
        marks: dict[str, int] = {}
        for line, row in zip(self.numbers, self.rows, strict=True):
            for cell in filter(_is_number, row):
                for mark in set(".,") & set(cell):
                    marks.setdefault(mark, line)
        if len(marks) > 1:
            raise UserError(
                f"{self.path}, line {max(marks.values())}: decimal points and commas are mixed"
            )
        if "," in marks:
            require_decimals((c for row in self.rows for c in row if "," in c), self.path)
        values = np.array(
            [
                [
                    number(c) if n and _is_number(c) else np.nan
                    for c, n in zip(row, self.shape, strict=True)
                ]
                for row in self.rows
            ]
        )
        if np.isinf(values).any():
            place = int(np.argwhere(np.isinf(values))[0, 0])
            raise UserError(
                f"{self.path}, line {self.numbers[place]}: has a number that is too large"
            )
        return values

    def _blocks(self) -> Array | None:
        """Give the frequencies of the rows, if there are blocks of several."""
        found = np.array(self.frequency)
        return found if len(np.unique(found)) > 1 else None
