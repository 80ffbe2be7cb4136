"""Tables of numbers in text files of any language, their columns recognised by unit and place.

The line above a table has names: their units tell coordinates, values and phases, their words in
common languages which value is which part; where there are no such words, and where a column is
not understood, the user is asked. Where columns, or blocks of rows, have a frequency each, they are
put below one another, so that every table has a row for each point and frequency.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.typing import Array
from sldvexp.unit_labels import SpectralForm, UnitLabel, UnitNotUnderstoodError, read_unit

NUMBER = re.compile(r"[+\-\u2212]?([0-9]+([.,][0-9]*)?|[.,][0-9]+)([eEdD][+\-\u2212]?[0-9]+)?")
#: The unit at the end of a column's name, in brackets.
IN_BRACKETS = re.compile(r"[\[(]\s*(?P<unit>[^\[\]]+?)\s*[\])]\s*$")
#: A number without a sign, in the middle of text.
DECIMAL = r"\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?"
HERTZ = re.compile(rf"(?<![\d.,])(?P<number>{DECIMAL})\s*(?P<kilo>k?)Hz\b")
#: A frequency in a column's name, as ``@ 100 Hz`` or ``(0,1 kHz)``.
FREQUENCY = re.compile(rf"[@(\[]?\s*{HERTZ.pattern}\s*[)\]]?")
#: Names of one degree and one radian in other languages than English.
ANGLES = dict.fromkeys(("degré", "degrés", "gradi", "grado", "grados", "graus"), "deg")
ANGLES |= dict.fromkeys(("radiant", "radianti", "radianes", "radianos", "radians"), "rad")
#: What the words of a column's name begin with, and whole words, by the role that they tell.
STEMS = {
    "real": ("real", "réel", "reel", "reell", "実部", "实部", "действ"),
    "imag": ("imag", "immag", "虚部", "мним"),
    "magnitude": ("magn", "ampl", "ampiez", "betrag", "modul", "módul", "振幅", "амплит"),
    "phase": ("phas", "fase", "winkel", "angle", "angol", "ángul", "位相", "相位", "фаз"),
    "none": ("coher", "kohär", "kohaer", "cohér", "coer", "コヒーレンス"),
}
WORDS = {
    "real": ("re",),
    "imag": ("im",),
    "magnitude": ("mag", "amp", "abs", "mod"),
    "phase": ("arg", "ang", "ph", "phi", "φ", "ϕ", "∠"),
    "none": ("coh", "γ²", "γ2"),
}
LEAST_COLUMNS = 4
COMMENTS = ("#", "%", "//", "!")


class ColumnsNotUnderstoodError(UserError):
    """Columns of which nobody says what they are; `instrument.columns` would."""


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
    block : ndarray or None, shape (row,), Hz
        Frequencies of blocks of rows; None unless there are several.
    told : str
        Which other lines there were, for the record.
    words : dict of int to list of str
        Cells of columns that hold words, whose values are NaN.
    said : list of (int, str)
        Other lines with their numbers, but those of the columns' names.
    """

    path: Path
    values: Array
    line: list[int]
    names: list[str]
    units: list[str]
    before: str
    delimiter: str | None
    place: list[str]
    block: Array | None = None
    told: str = ""
    words: dict[int, list[str]] = field(default_factory=dict)
    said: list[tuple[int, str]] = field(default_factory=list)

    def wrong(self, message: str, row: int | None = None) -> UserError:
        """Word the error of the table, or of one of its rows."""
        return UserError(f"{self.path}, line {self.line[row or 0]}: {message}")

    def asked(self, message: str) -> ColumnsNotUnderstoodError:
        """Word the question which columns are what."""
        return ColumnsNotUnderstoodError(f"{self.path}, line {self.line[0]}: {message}")

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
        values = [i for i, u in enumerate(self.units) if is_motion(u) and i not in found.values()]
        angles = [i for i, unit in enumerate(self.units) if is_angle(unit)]
        self.require_understood([*found.values(), *values, *angles])
        return found | self.parts([*values, *angles])

    def require_understood(self, columns: list[int]) -> None:
        """Refuse columns that nobody says anything of, but these, and those of no interest."""
        for i, name in enumerate(self.names):
            if i not in columns and said_by(name) != "none":
                raise self.asked(
                    f"the column {self.listed([i])} is not understood{_why(self.units[i])}; "
                    f"{HOW}, which leaves the others out"
                )

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
            if is_frequency(unit):
                found.setdefault("frequency", i)
            elif "db" in unit.lower():
                raise self.wrong(f"column {i + 1} is in {unit}; export linear values")
            elif i in self.words and i > last and not unit:
                found.setdefault("status", i)
            elif i in self.words and not unit and self._names_points(i):
                found.setdefault("index", i)
            elif whole and said_by(self.names[i]) is None:
                found.setdefault("index" if i < first else "status", i)
        return found

    def _names_points(self, column: int) -> bool:
        """Tell whether words differ from row to row, or are the same at all frequencies."""
        times = set(Counter(self.words[column]).values())
        return times == {1} or (len(times) == 1 and any(map(is_frequency, self.units)))

    def listed(self, columns: list[int]) -> str:
        """List columns with their names, for a message."""
        return ", ".join(f"{i + 1} ({self.names[i]})" for i in columns) or "none"

    def _coordinates(self) -> dict[str, int]:
        """Find the first three columns in a row that are in one unit of length."""
        units = [u if is_length(u) else "" for u in self.units]
        for i in range(len(units) - 2):
            if units[i] and units[i] == units[i + 1] == units[i + 2]:
                return {"x": i, "y": i + 1, "z": i + 2}
        if self.units and is_frequency(self.units[0]):
            raise self.wrong(
                "its rows are frequencies and its columns points, which leaves these without "
                "coordinates; export a table with a row for each point, or a universal file"
            )
        raise self.asked(
            "there are no three columns of coordinates with a unit of length in the line above; "
            f"{HOW}"
        )

    def parts(self, columns: list[int]) -> dict[str, int]:
        """Tell which columns of values are which part: of one frequency, by units and names.

        Raises
        ------
        UserError
            If they are not a real value, real and imaginary part, or magnitude and phase, or do not
            say which is which.
        """
        angles = [i for i in columns if is_angle(self.units[i])]
        values = [i for i in columns if i not in angles]
        said = [said_by(self.names[i]) for i in values]
        if len(values) == 1 and len(angles) == 1 and said[0] in (None, "magnitude"):
            return {"magnitude": values[0], "phase": angles[0]}
        if len(values) == 1 and not angles and said[0] in (None, "real"):
            return {"real": values[0]}
        alike = len(values) == 2 and not angles and self.units[values[0]] == self.units[values[1]]
        if alike and tuple(said) in PAIRS:
            real, imag = values if "imag" in said[1:] or said[0] == "real" else values[::-1]
            return {"real": real, "imag": imag}
        raise self.asked(f"the columns of values are {self.listed(columns)}; {NEEDED}; {HOW}")


NEEDED = (
    "needed is one, two in one unit that are named real and imaginary part, or a magnitude and a "
    "phase in deg or rad"
)
#: Without numbers, as an example that somebody copied would be a guess.
HOW = (
    "write the number of each into instrument.columns={index: , x: , y: , z: , real: , imag: }, "
    "without imag if there is none, or with magnitude and phase"
)


#: What the names of real and imaginary part say, in either order; one of them tells both.
PAIRS = [("real", "imag"), ("imag", "real"), ("real", None), (None, "imag")]
PAIRS += [("imag", None), (None, "real")]


def said_by(name: str) -> str | None:
    """Tell the role that a column's name says, in common languages; None if it says none.

    Examples
    --------
    >>> said_by("Realteil"), said_by("Im [m/s]"), said_by("|v|"), said_by("Ref")
    ('real', 'imag', 'magnitude', None)
    """
    bare = re.sub(r"(?<=[a-zà-ÿ])(?=[A-Z])", " ", IN_BRACKETS.sub("", FREQUENCY.sub("", name)))
    words = re.findall(r"[^\W\d_]+[²2]?|∠", bare.lower())
    found = [
        role
        for role, stems in STEMS.items()
        if any(w.startswith(stems) or w in WORDS[role] for w in words)
        or any(stem in bare for stem in stems if stem > "\u3000")  # scripts without blanks
    ]
    if not found and re.search(r"\|.+\|", bare):
        return "magnitude"
    # The amplitude's real part is a real part.
    return found[0] if found else None


def number(cell: str) -> float:
    """Convert a cell that `NUMBER` matches."""
    try:
        return float(cell)
    except ValueError:  # with a comma, a minus of typographers, or an exponent of Fortran
        plain = cell.replace(",", ".").replace("\u2212", "-").lower().replace("d", "e")
        return float(plain)


def fields(line: str, delimiter: str | None) -> list[str]:
    """Split a line into cells up to the last that is not blank."""
    cells = [field.strip().strip('"') for field in line.split(delimiter)]
    while len(cells) > 1 and not cells[-1]:  # a delimiter at the end of the line
        cells.pop()
    return cells


def column_names(
    above: list[str], delimiter: str | None, columns: int
) -> tuple[list[str], list[str], list[int]]:
    """Read names and units of the columns from the one or two lines above the table.

    Returns
    -------
    names, units : list of str
    places : list of int
        Of these lines among those `above`.
    """
    lines = [(i, fields(line, delimiter)) for i, line in enumerate(above) if line.strip()]
    plain = [(i, cells) for i, cells in lines if not cells[0].startswith(COMMENTS)]
    bare = [(i, fields(uncommented(above[i]), delimiter)) for i, _ in lines]
    found = _heads(plain, delimiter, columns) or _heads(bare, delimiter, columns)
    if not found:
        return [""] * columns, [""] * columns, []
    above_columns = list(zip(*reversed(found.values()), strict=True))
    names = [" ".join(parts).strip() for parts in above_columns]
    return names, [unit_above(parts) for parts in above_columns], list(found)


def uncommented(line: str) -> str:
    """Leave out the mark of a comment at the beginning of a line."""
    bare = line.strip(' "')
    return bare.lstrip("#%/! ") if bare.startswith(COMMENTS) else line


def _heads(
    lines: list[tuple[int, list[str]]], delimiter: str | None, columns: int
) -> dict[int, list[str]]:
    """Find the one or two last lines that have as many cells as there are columns."""
    found: dict[int, list[str]] = {}
    for i, cells in reversed([own for own in lines if not of_frequencies(own[1])][-2:]):
        if found and (sum(map(bool, cells)) < 2 or (delimiter is None and len(cells) < columns)):
            break  # words of their own, of no column
        cells += [""] * (columns - len(cells))
        if len(cells) != columns:
            break
        found[i] = cells
    return found


def of_frequencies(cells: list[str]) -> bool:
    """Tell whether a line holds bare numbers behind a name with their unit Hz."""
    words = [cell for cell in cells if cell and not NUMBER.fullmatch(cell)]
    bare = sum(map(bool, cells)) - len(words)
    return bare > 0 and len(words) == 1 and "hz" in words[0].lower()


def unit_above(cells: Sequence[str]) -> str:
    """Find the unit in the cells above a column: in brackets, or alone in the lowest."""
    for cell in reversed(cells):
        if match := IN_BRACKETS.search(FREQUENCY.sub("", cell)):
            return match["unit"]
    last = cells[-1]
    return last if is_motion(last) or is_angle(last) or is_frequency(last) else ""


def meaning(unit: str) -> UnitLabel | None:
    """Understand a unit; None if it is not understood."""
    try:
        return read_unit(ANGLES.get(unit.strip(" .").lower(), unit))
    except UnitNotUnderstoodError:
        return None


def label_of_values(table: ScanTable, roles: dict[str, int]) -> str:
    """Give the label of the values' unit."""
    return table.units[roles.get("real", roles.get("magnitude", 0))]


def motion_of(table: ScanTable, text: str) -> UnitLabel | None:
    """Understand the values' unit; None if it is none of a motion.

    Raises
    ------
    UserError
        If values are squares, or spectra over a frequency, which have no amplitude.
    """
    label = meaning(text)
    if label is None or not label.is_motion:
        return None
    if label.form is not SpectralForm.linear or label.product:
        raise table.wrong(
            f"its values are in {text}, which is no amplitude of a motion; export linear values, "
            "as in mm/s, or response functions"
        )
    return label


def _why(unit: str) -> str:
    """Say what is not understood of a unit."""
    try:
        return f": {read_unit(unit).quantity} is no motion" if unit else ""
    except UnitNotUnderstoodError as error:
        return f": {error}"


def is_motion(unit: str) -> bool:
    """Tell whether a unit is one of a displacement, velocity or acceleration."""
    return (label := meaning(unit)) is not None and label.is_motion


def is_angle(unit: str) -> bool:
    """Tell whether a unit is one of an angle."""
    return (label := meaning(unit)) is not None and label.quantity == "angle"


def is_frequency(unit: str) -> bool:
    """Tell whether a unit is one of a frequency."""
    return (label := meaning(unit)) is not None and label.quantity == "frequency"


def is_length(unit: str) -> bool:
    """Tell whether a unit is one of length alone."""
    label = meaning(unit)
    if label is None or label.amplitude is not None or label.form is not SpectralForm.linear:
        return False
    return label.quantity == "displacement" and not label.reference


def hertz(found: re.Match[str]) -> float:
    """Convert a match of `HERTZ` to Hz."""
    return number(found["number"]) * (1000.0 if found["kilo"] else 1.0)


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
    if table.block is not None:
        return _with_frequency(table, table.block, given)
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
        if not given:
            table.require_understood([*roles.values(), *frequency])
        parts = {f: _parts(table, f, columns) for f, columns in groups.items()}
    kinds = {f: [(role, table.units[i]) for role, i in p.items()] for f, p in parts.items()}
    first = next(iter(kinds))
    other = next((f for f in kinds if sorted(kinds[f]) != sorted(kinds[first])), None)
    if other is not None:
        raise table.wrong(
            f"has the columns {table.listed(groups[first])} of {first:g} Hz but "
            f"{table.listed(groups[other])} of {other:g} Hz; all frequencies need the same columns "
            "in the same units"
        )
    return _stacked(table, roles, parts)


def _with_frequency(
    table: ScanTable, block: Array, given: dict[str, int]
) -> tuple[ScanTable, dict[str, int]]:
    """Add the frequencies of blocks of rows as a column."""
    columns = table.values.shape[1]
    with_it = replace(
        table,
        values=np.column_stack([table.values, block]),
        names=[*table.names, "frequency"],
        units=[*table.units, "Hz"],
        place=[*table.place, "heading"],
        block=None,
    )
    return with_it, given | {"frequency": columns + 1} if given else given


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
        words={
            k: table.words[c[0]] * len(blocks)
            for k, c in enumerate(columns)
            if c and c[0] in table.words
        },
        place=[" ".join(str(i + 1) for i in c) or "heading" for c in columns],
    )
    return long, {role: i for i, role in enumerate(names, 1)}


def _parts(table: ScanTable, frequency: float, columns: list[int]) -> dict[str, int]:
    """Tell the roles of the columns of one frequency."""
    try:
        return table.parts(columns)
    except ColumnsNotUnderstoodError:
        raise table.asked(
            f"the columns of {frequency:g} Hz are {table.listed(columns)}; {NEEDED}; of one "
            f"frequency, {HOW}"
        ) from None


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
        if i not in roles.values() and (named or is_motion(unit) or is_angle(unit))
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
            stated = [factor * number(cell)]
        if len(stated) > 1 or (cell and not stated) or (not cell and last is None):
            return {}
        last = stated[0] if stated else last
        found[i] = last  # type: ignore[assignment]
    return found
