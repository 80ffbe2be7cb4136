"""Tables of text with units in the header, as ``point,x_inch,y_inch,z_inch``: their one reader.

Cells are between commas, semicolons or tabs, whichever the header has, and numbers have a decimal
point or, in all of a table, a comma. Lines that start with ``#`` are comments, and every complaint
names the file, the line and the column. Rows are read with the module `csv` and not with pandas,
which tells neither on which line a row stands nor that it is too short, and gives columns of one
name others; of a table whose rows are all alike it reads the columns.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.files import read_text, require_file, with_check_line
from sldvexp.lazy import pandas as pd
from sldvexp.typing import Array, IndexArray, IntArray
from sldvexp.units import LengthUnit, Unit

AXES = ("x", "y", "z")
#: Cells that stand for a number which is not there, in small letters.
MISSING = {"", "-", "--", "---", "nan", "na", "n/a", "#n/a", "#nv", "null", "none", "*", "***"}
MISSING |= {"1.#qnan", "-1.#ind", "nan(ind)"}
#: Words that pandas takes for one and zero, where a column has nothing else.
WORDS = ("True", "TRUE", "true", "False", "FALSE", "false")
#: Cells that pandas shall take for no number; one more among numbers only costs time.
NO_NUMBERS = sorted({f(word) for word in MISSING for f in (str, str.upper, str.capitalize)})
NO_NUMBERS += ["NaN", *WORDS]
#: How the columns of coordinates are named, for messages.
COORDINATES = f"x_U, y_U, z_U with U one of {', '.join(LengthUnit.__members__)}"


class Labels(NamedTuple):
    """A column of text that says the same in many rows.

    Attributes
    ----------
    which : ndarray of int, shape (row,)
        Number of the text that each row has.
    texts : list of str
        Each once, as they come.
    """

    which: IndexArray
    texts: list[str]


class EvenRows(Sequence[tuple[str, ...]]):
    """Rows that have as many cells as there are columns, as their text.

    Cells of a million rows would take a gigabyte as texts of their own.

    Parameters
    ----------
    content : bytes
        ASCII: the header's line, and each row's with its end.
    delimiter : str
        Of the cells of a row.
    """

    def __init__(self, content: bytes, delimiter: str) -> None:
        self._content, self._delimiter = content, delimiter
        self._count = content.count(b"\n") - 1

    @cached_property
    def _ends(self) -> IndexArray:
        """Where the header's line and each row's end."""
        return np.flatnonzero(np.frombuffer(self._content, np.uint8) == ord("\n"))

    def column(self, k: int) -> list[str]:
        """Give the cells of a column."""
        cells: list[str] = self._read({k: object})[k].tolist()
        return cells

    def columns(self, labels: Sequence[int], numbers: Sequence[int]) -> tuple[list[Labels], Array]:
        """Read columns of labels, and others as numbers, shape (row, column), at once.

        Numbers are NaN where a cell is none. The text is taken apart once for all columns.
        """
        try:
            read = self._read({k: object for k in labels} | {k: float for k in numbers})
        except ValueError:  # a cell that is neither a number nor missing
            if not labels and len(numbers) == 1:
                return [], _floats(self.column(numbers[0]))[:, None]
            found = self.columns(labels, [])[0] if labels else []
            return found, np.concatenate([self.columns([], [k])[1] for k in numbers], axis=1)
        values: Array = read[list(numbers)].to_numpy(float, copy=True)
        for row, k in np.argwhere(np.isinf(values)).tolist():
            values[row, k] = _float(self[row][numbers[k]])  # inf is infinity, Infinity is none
        return [_labels(read[k].to_numpy()) for k in labels], values

    def _read(self, kinds: Mapping[int, Any]) -> pd.DataFrame:
        """Let pandas read columns as some kind each; it complains if there are no rows."""
        version = tuple(map(int, pd.__version__.split(".")[:2]))
        # the number nearest to the text, which later ones find and warn of the word for it
        nearest: dict[str, Any] = {"float_precision": "round_trip"} if version < (3, 1) else {}
        return pd.read_csv(
            io.BytesIO(self._content),
            sep=self._delimiter,
            header=None,
            skiprows=1,
            usecols=list(kinds),
            dtype=dict(kinds),
            na_values={k: NO_NUMBERS for k, kind in kinds.items() if kind is float},
            keep_default_na=False,
            **nearest,
        )

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, row: int) -> tuple[str, ...]: ...

    @overload
    def __getitem__(self, row: slice) -> list[tuple[str, ...]]: ...

    def __getitem__(self, row: int | slice) -> tuple[str, ...] | list[tuple[str, ...]]:
        if isinstance(row, slice):
            return [self[k] for k in range(*row.indices(len(self)))]
        k = range(len(self))[row]
        line = self._content[self._ends[k] + 1 : self._ends[k + 1]]
        return tuple(line.decode().split(self._delimiter))


def _labels(cells: NDArray[np.object_]) -> Labels:
    """Find which texts a column has."""
    which, texts = pd.factorize(cells)
    return Labels(which, texts.tolist())


@dataclass(frozen=True, eq=False)
class TextTable:
    """Named columns of text, and the lines that their rows stand on.

    Parameters
    ----------
    lines : list of int
        Of the header, if there is one, and of the rows.
    rows : sequence of tuple of str
        Cells without blanks around them, the numbers among them with decimal points.
    comments : list of (int, str)
        With the numbers of their lines.
    """

    path: Path
    header: list[str]
    lines: Sequence[int]
    rows: Sequence[tuple[str, ...]]
    comments: list[tuple[int, str]] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"<TextTable of {len(self.rows)} rows: {', '.join(self.header)}>"

    def without(self, names: Collection[str]) -> TextTable:
        """Leave columns out, of rows that have as many cells as there are columns."""
        if not names:
            return self
        kept = [k for k, name in enumerate(self.header) if name not in names]
        whole = len(self.header)
        rows = [tuple(r[k] for k in kept) if len(r) == whole else r for r in self.rows]
        return replace(self, header=[self.header[k] for k in kept], rows=rows)

    def where(self, row: int) -> str:
        """Name file and line of a row, for a message."""
        return f"{self.path}, line {self.lines[1 + row]}"

    def require(self, columns: Iterable[str], needed: str) -> None:
        """Complain about the first column that is missing; `needed` says which are needed.

        Raises
        ------
        UserError
            If one is missing.
        """
        for column in columns:
            if column not in self.header:
                raise UserError(f"{self.path}: the column {column} is missing; {needed}")

    def column(self, name: str) -> list[str]:
        """Give the cells of a column.

        Raises
        ------
        UserError
            If a row has more or fewer cells than there are columns.
        """
        k = self.header.index(name)
        if not self.rows:
            return []
        return self.rows.column(k) if isinstance(self.rows, EvenRows) else self._columns[k]

    @cached_property
    def _columns(self) -> list[list[str]]:
        count = len(self.header)
        for i in np.flatnonzero(np.fromiter(map(len, self.rows), int) != count).tolist():
            row = self.rows[i]
            if any("\n" in cell for cell in row):
                raise UserError(f"{self.path}: is not a CSV table; is a quotation mark left open?")
            raise UserError(f"{self.where(i)}: has {len(row)} values under {count} columns")
        cells = list(chain.from_iterable(self.rows))
        return [cells[k::count] for k in range(count)]

    def floats(self, names: Sequence[str]) -> Array:
        """Convert columns to numbers, shape (row, column); NaN where a cell is none."""
        return self.labels_and_floats([], names)[1]

    def labels_and_floats(
        self, labels: Sequence[str], numbers: Sequence[str]
    ) -> tuple[list[Labels], Array]:
        """Read columns of labels, and others as `floats` does, in one go.

        Raises
        ------
        UserError
            If a row has more or fewer cells than there are columns.
        """
        if isinstance(self.rows, EvenRows) and self.rows:
            at = self.header.index
            return self.rows.columns([*map(at, labels)], [*map(at, numbers)])
        values = np.array([_floats(self.column(name)) for name in numbers]).T
        return [_labels(np.array(self.column(name), object)) for name in labels], values

    def numbers(self, columns: Sequence[str], of: Sequence[str] = ()) -> Array:
        """Convert columns to finite numbers, in the file's units.

        Parameters
        ----------
        of : sequence of str, optional
            Text that is put behind a column's name in the complaint about a row.

        Returns
        -------
        ndarray, shape (row, column)

        Raises
        ------
        UserError
            If a cell is not a finite number.
        """
        values = self.floats(columns)
        if not np.isfinite(values).all():
            row, k = np.argwhere(~np.isfinite(values))[0]
            what = f"{columns[k]}{of[row] if of else ''}"
            number(self.column(columns[k])[row], what, self.where(row))  # tells what is wrong
        return values

    def unit_of(self, quantities: Sequence[str], units: Iterable[str]) -> str | None:
        """Find the one unit in which the header has any of these quantities, None if it has none.

        Raises
        ------
        UserError
            If there are several.
        """
        used = [u for u in units if any(f"{q}_{u}" in self.header for q in quantities)]
        if len(used) > 1:
            names = ", ".join(quantities)
            raise UserError(f"{self.path}: the columns {names} mix the units {' and '.join(used)}")
        return used[0] if used else None

    def quantity(self, names: Sequence[str], kind: type[Unit], needed: str) -> tuple[Array, Unit]:
        """Convert columns of one quantity to SI, by the unit that their names end with.

        Parameters
        ----------
        names : sequence of str
            Without unit, as x for ``x_mm``.
        kind : LengthUnit or AngleUnit
            Its first member is the unit of a complaint if there are no such columns.
        needed : str
            Which columns are needed, for that complaint.

        Returns
        -------
        values : ndarray, shape (row, name)
        unit : LengthUnit or AngleUnit
            Of the file.

        Raises
        ------
        UserError
            If a column is missing, units differ, or a cell is not a finite number.
        """
        unit = kind[self.unit_of(names, kind.__members__) or next(iter(kind.__members__))]
        columns = [f"{name}_{unit.name}" for name in names]
        self.require(columns, needed)
        return self.numbers(columns) * unit.value, unit


def read_table(path: Path, inline_comments: bool = False) -> TextTable:
    r"""Read a table of text; the first line that is neither blank nor a comment is its header.

    Parameters
    ----------
    inline_comments : bool
        Whether ``#`` begins a comment anywhere in a line, and not only at its start.

    Raises
    ------
    UserError
        If the file is missing, is not text or not CSV.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "points.csv")
    >>> _ = path.write_text("point,x_mm,y_mm,z_mm\n7,1000,0,500\n")
    >>> table = read_table(path)
    >>> table.column("point")
    ['7']
    >>> table.quantity(("x", "y", "z"), LengthUnit, "x_U, y_U, z_U")[0]
    array([[1. , 0. , 0.5]])
    """
    require_file(path)
    text = read_text(path)
    comments = [
        (i, line.partition("#")[2].strip())
        for i, line in enumerate(text.splitlines() if "#" in text else (), 1)
        if "#" in line and (inline_comments or line.strip(' "').startswith("#"))
    ]
    if inline_comments and comments:
        text = "\n".join(line.partition("#")[0] for line in text.splitlines())
    delimiter = _delimiter(text)
    if even := _even_rows(text, delimiter):
        table = TextTable(path, *even)
        decimal = delimiter != "," and "," in text
        return replace(table, rows=_with_points(table)) if decimal else table
    each = (f"{line}\n" for line in text.split("\n"))
    reader = csv.reader(each, delimiter=delimiter, skipinitialspace=True)
    lines: list[int] = []
    rows: list[tuple[str, ...]] = []  # tuples, which cost the collector of garbage nothing
    try:
        for cells in reader:
            if any(cells) and not cells[0].startswith("#"):
                lines.append(reader.line_num)
                rows.append(tuple(map(str.strip, cells)))
    except csv.Error as error:
        raise UserError(f"{path}, line {reader.line_num}: is not CSV: {error}") from None
    table = TextTable(path, list(rows[0]) if rows else [], lines, rows[1:], comments)
    return replace(table, rows=_with_points(table))


#: Delimiters of columns, those first that a decimal mark is not.
DELIMITERS = "\t;,"
NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?|[+-]?(inf|nan)", re.I)
#: Characters of finite numbers, which `float` reads as `NUMBER` tells if there are no others.
DIGITS_AND_SIGNS = b"0123456789+-.eE"
#: A number with a decimal comma.
WITH_COMMA = re.compile(r"[+-]?([0-9]+,[0-9]*|,[0-9]+)([eE][+-]?[0-9]+)?")


#: What a text has that must be read cell by cell: quotation, comments, blanks, empty lines.
UNEVEN = ('"', "#", " ", "\r", "\v", "\f", "\n\n")


def _even_rows(text: str, delimiter: str) -> tuple[list[str], range, EvenRows] | None:
    """Split a text at once whose lines have as many plain cells as the header.

    Returns
    -------
    tuple or None
        Header, numbers of the lines and rows; None of a text that is not so simple.
    """
    if "\r" in text:
        text = text.replace("\r\n", "\n")
    odd = [*UNEVEN, "\n" + delimiter, *("\t" if delimiter != "\t" else "")]
    if not text.isascii() or text.startswith((delimiter, "\n")) or any(o in text for o in odd):
        return None
    if not (text := text.removesuffix("\n")):
        return None
    header = text.partition("\n")[0].split(delimiter)
    content = f"{text}\n".encode()
    ends = (delimiter * (len(header) - 1) + "\n").encode()
    others = bytes({*range(128)} - {ord(delimiter), ord("\n")})
    rows = EvenRows(content, delimiter)
    if content.translate(None, others) != ends * (1 + len(rows)):
        return None
    return header, range(1, 2 + len(rows)), rows


def _delimiter(text: str) -> str:
    """Find the delimiter that the header has most of."""
    lines = (match[0].strip(" ") for match in re.finditer("[^\n]+", text))
    header = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    return max(DELIMITERS, key=header.count)


def _with_points(table: TextTable) -> Sequence[tuple[str, ...]]:
    """Write decimal points for the decimal commas of a table.

    Raises
    ------
    UserError
        If some numbers have a point and others a comma, so that one of them may part thousands.
    """
    commas = [
        i
        for i, row in enumerate(table.rows)
        if "," in "".join(row) and any(map(WITH_COMMA.fullmatch, row))
    ]
    if not commas:
        return table.rows
    for i, row in enumerate(table.rows):
        if any("." in cell and NUMBER.fullmatch(cell) for cell in row):
            raise UserError(
                f"{table.where(i)}: has a decimal point, but line {table.lines[1 + commas[0]]} a "
                "decimal comma; one of them is needed throughout"
            )
    require_decimals((c for row in table.rows for c in row if WITH_COMMA.fullmatch(c)), table.path)
    return [
        tuple(c.replace(",", ".") if WITH_COMMA.fullmatch(c) else c for c in row)
        for row in table.rows
    ]


#: A number whose comma may part thousands.
THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")


def require_decimals(cells: Iterable[str], path: Path) -> None:
    """Refuse commas in numbers if all of them may part thousands.

    Raises
    ------
    UserError
        If so.

    Examples
    --------
    >>> require_decimals(["1,234", "0,5"], Path("a.csv"))
    """
    commas = list(cells)
    if commas and all(map(THOUSANDS.fullmatch, commas)):
        plain = commas[0].replace(",", "")
        raise UserError(
            f"{path}: {commas[0]} may be {commas[0].replace(',', '.')} or {plain}; write decimal "
            "points, and nothing between thousands"
        )


def plain_cells(line: str) -> list[str]:
    """Split a line of numbers between blanks, commas or semicolons, with decimal points.

    Commas are decimal marks where blanks or semicolons part the numbers, and each has digits on
    both sides.

    Examples
    --------
    >>> plain_cells("1, 2.5, 3"), plain_cells("1,0; 2,5; 3")
    (['1', '2.5', '3'], ['1.0', '2.5', '3'])
    """
    parts = re.split(r"[;\s]+", line.strip(" ;\t"))
    decimal = len(parts) > 1 and all(re.fullmatch(r"[^,]+(,[0-9]+[^,]*)?", p) for p in parts)
    if decimal:
        return [part.replace(",", ".") for part in parts]
    return line.replace(",", " ").replace(";", " ").split()


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    r"""Write a table that `read_table` reads, with a check line before it.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "points.csv")
    >>> write_table(path, ["point", "x_m"], [[7, 0.5]])
    >>> read_table(path).rows
    [('7', '0.5')]
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    path.write_text(with_check_line(text.getvalue()), encoding="utf-8")


def read_points(path: Path) -> tuple[Array, IntArray]:
    r"""Read the coordinates of digitised points and the lines on which they stand.

    Parameters
    ----------
    path : Path
        Header with ``x_U,y_U,z_U``, U one unit of length.

    Returns
    -------
    position : ndarray, shape (point, 3), m
    line : ndarray of int, shape (point,)

    Raises
    ------
    UserError
        If the file is missing, mixes units, lacks a column, or has a line that is not numbers.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "points.csv")
    >>> _ = path.write_text("# digitised twice\nx_inch,y_inch,z_inch\n10,0,1\n")
    >>> read_points(path)
    (array([[0.254 , 0.    , 0.0254]]), array([3]))
    """
    table = read_table(path)
    position, _ = table.quantity(AXES, LengthUnit, f"needed are {COORDINATES}")
    return position, np.array(table.lines[1:], np.int64)


#: Of whole numbers at most, as 64 bits hold them.
DIGITS = 18


def number(text: str, what: str, where: str) -> float:
    """Convert text to a finite number.

    Raises
    ------
    UserError
        If the text is empty, not a number, infinite or NaN.
    """
    if not NUMBER.fullmatch(text):  # which float() sees in other text too, as 1_000
        raise UserError(f"{where}: {what} must be a number, not {text!r}")
    value = float(text)
    if not math.isfinite(value):
        raise UserError(f"{where}: {what} must be finite, not {text}")
    return value


def whole_number(text: str, what: str, where: str) -> int:
    """Convert text to a whole number of zero or more.

    Raises
    ------
    UserError
        If the text is anything else.
    """
    if not (text.isascii() and text.isdigit() and len(text) <= DIGITS):
        raise UserError(f"{where}: {what} must be a whole number, not {text!r}")
    return int(text)


def first_time(seen: dict[int, int], point: int, line: int, where: str) -> None:
    """Note the line of a point number.

    Raises
    ------
    UserError
        If the number has been there before.
    """
    if point in seen:
        raise UserError(f"{where}: point number {point} stands on line {seen[point]} already")
    seen[point] = line


def stated_or_given(
    stated: LengthUnit | None, given: LengthUnit | None, where: str, how: str
) -> LengthUnit:
    """Choose the unit of a file that states one, that was given one, or both alike.

    Raises
    ------
    UserError
        If there is neither or they differ; `how` says how a file would state it.
    """
    unit = stated or given
    if unit is None:
        valid = ", ".join(LengthUnit.__members__)
        raise UserError(f"{where}: states no unit of length; add {how} with one of {valid}")
    if given not in (None, unit):
        raise UserError(f"{where}: is in {unit.name} but was to be read in {given.name}")
    return unit


def _float(text: str) -> float:
    """Convert text to a number, NaN if it is none."""
    return float(text) if NUMBER.fullmatch(text) else math.nan


def _floats(cells: Sequence[str]) -> Array:
    """Convert cells to numbers; NaN where one is none."""
    if not "".join(cells).encode().translate(None, DIGITS_AND_SIGNS):
        with suppress(ValueError):  # an empty cell, or more signs than a number has
            return np.fromiter(map(float, cells), float, len(cells))
    return np.array([_float(cell) for cell in cells], float)
