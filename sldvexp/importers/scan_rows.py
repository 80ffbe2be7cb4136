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
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from sldvexp.errors import UserError
from sldvexp.files import read_text, require_file
from sldvexp.importers.scan_frequency import stated_in
from sldvexp.importers.scan_table import (
    COMMENTS,
    IN_BRACKETS,
    LEAST_COLUMNS,
    NUMBER,
    ScanTable,
    column_names,
    fields,
    meaning,
    number,
    of_frequencies,
    uncommented,
    unit_above,
)
from sldvexp.io.tables import DELIMITERS, MISSING, require_decimals
from sldvexp.typing import Array

#: Numbers that make a line look like a row.
LEAST_NUMBERS = 3
#: Columns of a table at most.
MOST_COLUMNS = 100_000
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
    for i, line in enumerate(lines):
        if max(map(line.count, "\t;, ")) > MOST_COLUMNS:
            raise UserError(f"{path}, line {i + 1}: has more than {MOST_COLUMNS} columns")
    most = DelimiterChoice(None, (), 0, [])
    for delimiter in (*DELIMITERS, None):  # None for blanks
        most = max(most, _shape(lines, delimiter), key=lambda choice: choice.rows)
        if 2 * most.rows > len(lines):
            break
    if not most.rows:
        raise UserError(
            f"{path}: has no table of numbers with at least {LEAST_COLUMNS} columns, as number, x, "
            "y, z and velocity"
        )
    return _Reader(path, lines, most.delimiter, most.shape, most.parsed).table()


#: True for each cell of a line, or column of a table, that is a number.
Shape = tuple[bool, ...]
#: Cells of a line, and which of them are numbers.
Parsed = tuple[list[str], Shape]


class DelimiterChoice(NamedTuple):
    """Delimiter with the shape that most lines have, and how many do."""

    delimiter: str | None
    shape: Shape
    rows: int
    parsed: list[Parsed]


def _shape(lines: list[str], delimiter: str | None) -> DelimiterChoice:
    """Find which columns of most lines hold numbers, and how many such lines there are."""
    parsed = [_parse(fields(line, delimiter)) for line in lines]
    shapes = Counter(flags for _, flags in parsed if len(flags) >= LEAST_COLUMNS)
    tables = {s: n for s, n in shapes.items() if sum(s) >= LEAST_COLUMNS and 2 * sum(s) > len(s)}
    shape, count = max(tables.items(), key=lambda s: (s[1], sum(s[0])), default=((), 0))
    return DelimiterChoice(delimiter, shape, count, parsed)


def _parse(cells: list[str]) -> Parsed:
    return cells, tuple(map(_is_number, cells))


@lru_cache(maxsize=2**14)  # a table has each coordinate many times
def _is_number(cell: str) -> bool:
    return NUMBER.fullmatch(cell) is not None


def _template(line: str) -> str:
    """Reduce a line to what is the same on every page and in every block."""
    return " ".join(DIGITS.sub("#", line).split())


def _plain(name: str) -> str:
    """Leave out the unit of a column's name."""
    return IN_BRACKETS.sub("", name).strip()


def _same(one: str, two: str) -> bool:
    """Tell whether two units of a column have one meaning."""
    if one == two:
        return True
    labels = [meaning(unit) for unit in (one, two)]
    bare = [label and replace(label, text="") for label in labels]
    return None not in bare and bare[0] == bare[1]


@dataclass
class _Reader:
    """Walk through the lines of one file."""

    path: Path
    lines: list[str]
    delimiter: str | None
    shape: Shape
    parsed: list[Parsed]
    rows: list[Parsed] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    frequency: list[float] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    said: list[tuple[int, str]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    units: list[str] = field(default_factory=list)

    def table(self) -> ScanTable:
        """Read all rows, and what is said of them."""
        parsed = [
            self._filled(*own, line) for own, line in zip(self.parsed, self.lines, strict=True)
        ]
        full = [self._is_row(*own) for own in parsed]
        begin, last = full.index(True), len(full) - full[::-1].index(True) - 1
        above = self.lines[:begin]
        self._check_above(parsed[:begin])
        self.names, self.units, named = column_names(above, self.delimiter, len(self.shape))
        known: dict[str, list[str]] = {}
        for line in filter(str.strip, above):
            known.setdefault(_template(line), []).append(line)
        now = np.nan
        for i in range(begin, len(self.lines)):
            if full[i]:
                self.rows.append(parsed[i])
                self.numbers.append(i + 1)
                self.frequency.append(now)
            else:
                now = self._between(i, parsed[i], known, now, i > last)
        head = [(i, line) for i, line in enumerate(above, 1) if line.strip() and i - 1 not in named]
        return ScanTable(
            self.path,
            self._values(),
            self.numbers,
            self.names,
            self.units,
            "\n".join(above),
            self.delimiter,
            [str(i + 1) for i in range(len(self.shape))],
            self._blocks(),
            ", ".join(f"{count} {what}" for what, count in self.counts.items()),
            {k: [c[k] for c, _ in self.rows] for k, own in enumerate(self.shape) if not own},
            [*head, *self.said],
        )

    def _filled(self, cells: list[str], flags: Shape, line: str) -> Parsed:
        """Give a line the cells that are empty at the end of a row."""
        lost = len(self.shape) - len(cells)
        if lost <= 0 or not self.delimiter:
            return cells, flags
        empty = min(line.count(self.delimiter) + 1 - len(cells), lost)
        return cells + [""] * empty, flags + (False,) * empty

    def _is_row(self, cells: Sequence[str], flags: Shape) -> bool:
        """Tell whether cells are numbers, or say that there is none."""
        if flags == self.shape:
            return True
        if len(cells) != len(self.shape) or sum(flags) < LEAST_NUMBERS:
            return False
        return not self._odd(cells, flags)

    def _odd(self, cells: Sequence[str], flags: Shape) -> list[int]:
        """Find cells that are neither a number nor say that there is none, where numbers are."""
        return [
            k
            for k, (cell, own, needed) in enumerate(zip(cells, flags, self.shape, strict=True))
            if needed and not own and cell.lower() not in MISSING
        ]

    def _is_alike(self, flags: Shape) -> bool:
        """Tell whether a line that is none looks like a row: it has numbers as rows have."""
        count = sum(flags)
        return count >= LEAST_NUMBERS and 2 * count >= min(sum(self.shape), len(flags))

    def _check_above(self, above: list[Parsed]) -> None:
        """Refuse a first row that cannot be read and so seems to be a heading."""
        written = [i for i, (cells, _) in enumerate(above) if any(cells)]
        for i in written[-2:]:
            cells, flags = above[i]
            alike = len(cells) >= LEAST_COLUMNS and self._is_alike(flags)
            if alike and not of_frequencies(cells):
                self._wrong(i, *above[i])

    def _between(
        self, i: int, parsed: Parsed, known: dict[str, list[str]], now: float, below: bool
    ) -> float:
        """Read a line that is no row; give the frequency of the rows that follow."""
        line = self.lines[i]
        if not any(parsed[0]):
            self._count("blank lines", below)
            return now
        if comment := line.strip(' "').startswith(COMMENTS):
            bare = uncommented(line)
            parsed = self._filled(*_parse(fields(bare, self.delimiter)), bare)
        self._require_same_head(i, parsed[0], known)
        if _template(line) in known:
            return self._heading(i, known[_template(line)], now, below)
        if self._is_alike(parsed[1]) or (parsed[1][0] and not comment):
            self._wrong(i, *parsed)
        if stated_in([line]).all and not below:
            raise self._error(i, "states a frequency, as no line above the table does")
        if not comment and not below:
            if len(parsed[0]) == len(self.shape):
                if [_plain(c) for c in parsed[0]] != [_plain(name) for name in self.names]:
                    raise self._second_head(i, parsed[0])
                self._count("repeated headings", below)
                return now
            raise self._error(i, "stands between rows of the table and is not understood")
        self.counts["comments" if comment else "lines below"] += 1
        self.said.append((i + 1, line))
        return now

    def _heading(self, i: int, before: list[str], now: float, below: bool) -> float:
        """Read a line that stood above the table with perhaps other numbers."""
        first = stated_in(before, self.delimiter)
        stated = stated_in(self.lines[i : i + 1], self.delimiter)
        changed = stated.all != first.all
        if changed and (below or first.one is None or stated.one is None):
            rows = (
                ", but no rows follow"
                if below
                else ", and not one as above the table, such as Frequency: 440 Hz"
            )
            raise self._error(i, f"states frequencies{rows}")
        self._count("repeated headings", below)
        if stated.one is None or first.one is None:
            return now
        if np.isnan(now):
            self.frequency = [first.one] * len(self.frequency)
        return stated.one

    def _require_same_head(self, i: int, cells: list[str], known: dict[str, list[str]]) -> None:
        """Refuse a second head of the columns whose units are not those of the first."""
        line = self.lines[i]
        if len(cells) != len(self.shape) or line in known.get(_template(line), ()):
            return
        for k, (cell, first) in enumerate(zip(cells, self.units, strict=True)):
            unit = unit_above([cell])
            if unit and not _same(unit, first):
                raise UserError(
                    f"{self.path}, line {i + 1}: is a second head, in which column {k + 1} is in "
                    f"{unit} and not in {first or 'no unit'} as in the first; bring the rows below "
                    "it into the units of the first, or into a file of their own"
                )

    def _second_head(self, i: int, cells: list[str]) -> UserError:
        """Word that a line has a cell for each column, but other words than the head above."""
        pairs = list(zip(cells, self.names, strict=True))
        k = next((k for k, own in enumerate(pairs) if _plain(own[0]) != _plain(own[1])), 0)
        cell, name = pairs[k]
        return UserError(
            f"{self.path}, line {i + 1}: looks like a second head, in which column {k + 1} is "
            f"{cell!r} and not {name!r} as in the first; if the rows below it are of other "
            "columns, bring them into the order of the first, or into a file of their own; if they "
            "are not, delete the line"
        )

    def _count(self, what: str, below: bool) -> None:
        if not below:
            self.counts[what] += 1

    def _wrong(self, i: int, cells: list[str], flags: Shape) -> NoReturn:
        """Refuse a line that looks like a row."""
        if len(cells) == len(self.shape) and (odd := self._odd(cells, flags)):
            raise UserError(
                f"{self.path}, line {i + 1}: looks like a row of the table, but column "
                f"{odd[0] + 1} is {cells[odd[0]]!r}, which is no number; correct it, or leave the "
                "cell empty if there is none"
            )
        few = "is a comment"
        if len(cells) != len(self.shape):
            few = f"has {len(cells)} cells and not {len(self.shape)}"
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
        for line, (cells, flags) in zip(self.numbers, self.rows, strict=True):
            for mark in ".,":
                if mark not in marks and any(
                    mark in c for c, own in zip(cells, flags, strict=True) if own
                ):
                    marks[mark] = line
        if len(marks) > 1:
            raise UserError(
                f"{self.path}, line {max(marks.values())}: decimal points and commas are mixed"
            )
        if "," in marks:
            numbers = (c for row in self.rows for c, own in zip(*row, strict=True) if own)
            require_decimals((c for c in numbers if "," in c), self.path)
        values = np.array(
            [
                [
                    number(c) if own and needed else np.nan
                    for c, own, needed in zip(*row, self.shape, strict=True)
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
