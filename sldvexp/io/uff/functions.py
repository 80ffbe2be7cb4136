"""Functions of universal files: data set 58, with units (164) and scale of amplitudes (1858).

The header of a function is read at once, its values on demand, so that a file of thousands of
functions costs no more memory than the one that is looked at.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.io.uff.fortran import TextLines, columns, integers, number, table
from sldvexp.io.uff.source import ASCII_LINES, DataSet, Source, decoded, shown
from sldvexp.typing import Array
from sldvexp.unit_labels import SpectralForm, UnitNotUnderstoodError, read_unit, same_unit

#: Types of functions by their number in the file, as far as they are spoken of; and of those that
#: values at nodes, one data set a frequency, are put together to.
KINDS = {
    0: "general",
    1: "time response",
    2: "auto spectrum",
    3: "cross spectrum",
    4: "frequency response function",
    5: "transmissibility",
    6: "coherence",
    9: "power spectral density",
    12: "spectrum",
    (NODAL := 55): "nodal values (data sets 55, 2414)",
}
#: Types of values: (complex, double).
TYPES = {2: (False, False), 4: (False, True), 5: (True, False), 6: (True, True)}
DISPLACEMENT, VELOCITY, ACCELERATION = 8, 11, 12
#: Abscissae of functions by their type, and the numbers of these in the file.
ABSCISSAE = {1: "time"} | dict.fromkeys((2, 3, 4, 6, 9, 12), "frequency")
BY_ABSCISSA = {"time": 17, "frequency": 18, "revolutions": 19, "order": 20}
ANGULAR = ("rad/s", "rad/sec", "radian/s", "rads-1", "rads^-1")
#: Degrees of freedom by their number in the file.
DIRECTIONS = {0: "scalar"} | {
    sign * (3 * turned + k): f"{'+' if sign > 0 else '-'}{'R' * turned}{axis}"
    for sign in (1, -1)
    for turned in (0, 1)
    for k, axis in enumerate("XYZ", 1)
}
#: Sizes between which measured values are, in any unit.
SMALLEST, LARGEST = 1e-25, 1e13
#: Longest header, eleven lines of 80 columns and what others make of them.
LONGEST_HEADER = 1 << 14


class Axis(NamedTuple):
    """Meaning of one axis of a function.

    Parameters
    ----------
    kind : int
        The file's number of the quantity, as 11 for velocity; 0 and 1 say nothing.
    label, unit : str
        As somebody named them, in any language.
    """

    kind: int
    label: str
    unit: str


class Function(NamedTuple):
    """Header of a function.

    Parameters
    ----------
    text : tuple of str
        The five lines that identify it.
    kind : int
        Key of `KINDS`.
    node, direction : int
        Of the response; `direction` is a key of `DIRECTIONS`.
    size : int
        Number of values.
    first, step : float
        Of an even abscissa.
    abscissa, ordinate, reference : Axis
        `reference` is the denominator of the ordinate.
    """

    entry: DataSet
    text: tuple[str, ...]
    kind: int
    node: int
    direction: int
    reference_node: int
    reference_direction: int
    complex: bool
    double: bool
    even: bool
    size: int
    first: float
    step: float
    abscissa: Axis
    ordinate: Axis
    reference: Axis

    @property
    def dof(self) -> str:
        """The degree of freedom, as ``12+Z``, or ``12`` of a scalar."""
        return f"{self.node}{DIRECTIONS[self.direction] if self.direction else ''}"

    @property
    def reference_dof(self) -> str:
        """The reference's degree of freedom, likewise; a number no direction has is shown."""
        code = self.reference_direction
        return f"{self.reference_node}{DIRECTIONS.get(code, f'({code})') if code else ''}"


def read_header(source: Source, entry: DataSet) -> Function:
    """Read the header of a function, and nothing beyond it.

    Raises
    ------
    UserError
        If it is cut off or one of its numbers is none.
    """
    stop = entry.data if entry.binary else min(entry.end, entry.first + LONGEST_HEADER)
    text = source.peek(entry.first, stop - entry.first)
    lines = text.splitlines(keepends=True)[:ASCII_LINES]
    starts = [entry.first]
    for line in lines:
        starts.append(starts[-1] + len(line))
    if len(lines) < ASCII_LINES or starts[-1] > entry.end:
        message = f"the header must have {ASCII_LINES} lines, not {len(lines)}"
        raise entry.wrong(source, max(starts[-1] - 1, entry.first), message)

    def bad(line: int, what: str) -> Exception:
        return entry.wrong(source, starts[line], f"{what}, not {shown(lines[line].strip())}")

    dof = _dof(lines[5])
    if dof is None:
        raise bad(5, "must hold the function's type and degrees of freedom in columns 1 to 80")
    shape = _shape(lines[6])
    if shape is None:
        raise bad(6, "must hold type, number and spacing of the values and the abscissa")
    type_, count, spacing, first, step = shape
    if type_ not in TYPES:
        raise bad(6, "the type of the values must be 2, 4, 5 or 6 (real or complex)")
    if spacing not in (0, 1):
        raise bad(6, "the spacing of the abscissa must be 0 (uneven) or 1 (even)")
    if count < 1:
        raise bad(6, "there must be at least one value")
    if spacing == 1 and not (np.isfinite([first, step]).all() and (step != 0 or count == 1)):
        raise bad(6, "the even abscissa must have a finite start and an increment other than 0")
    axes = []
    for i in range(7, 10):
        axis = _axis(lines[i])
        if axis is None:
            raise bad(i, "must begin with the number of a quantity")
        axes.append(axis)
    words = tuple(map(_word, lines[:5]))
    numbers = (dof[0], *dof[1:])
    return Function(entry, words, *numbers, *TYPES[type_], spacing == 1, count, first, step, *axes)


def bytes_needed(source: Source, entry: DataSet) -> list[int]:
    """Find possible lengths of the values of a 58b by the header alone."""
    function = read_header(source, entry)
    return [function.size * size for size in _bytes_a_value(function)]


def read_values(source: Source, function: Function) -> tuple[NDArray, NDArray]:
    """Read abscissa and ordinate of a function.

    Returns
    -------
    abscissa : ndarray of float64, shape (value,), Hz or s
    ordinate : ndarray of float64 or complex128, shape (value,)
        In the file's units.

    Raises
    ------
    UserError
        If there are fewer or more values than the header claims, or one is no finite number.
    """
    entry = function.entry
    per_value = 1 + function.complex + (not function.even)
    start = entry.data
    if entry.binary:
        found = _binary_values(source, function)
    else:
        start = _end_of_header(source, entry)
        if 2 * function.size * per_value > entry.end - start + 1:
            message = (
                f"the header claims {function.size} values, for which the {entry.end - start} "
                "bytes of this data set have no room"
            )
            raise entry.wrong(source, start, message)
        flat = table(source, entry, start, _widths(function), function.size * per_value)
        found = flat.reshape(function.size, per_value)
    if not np.isfinite(found).all():
        value = int(np.argwhere(~np.isfinite(found))[0, 0]) + 1
        raise entry.wrong(source, start, f"value {value} is not a finite number")
    if function.even:
        abscissa = function.first + function.step * np.arange(function.size)
    else:
        abscissa, found = np.ascontiguousarray(found[:, 0]), np.ascontiguousarray(found[:, 1:])
    ordinate = found.view(np.complex128) if function.complex else found
    return _abscissa_unit(source, function) * abscissa, ordinate.reshape(function.size)


def _abscissa_unit(source: Source, function: Function) -> float:
    """Find one unit of a function's abscissa in Hz, or of a time record's in s."""
    axis, wanted = function.abscissa, ABSCISSAE.get(function.kind)
    if wanted is None:
        return 1.0

    unit = "s" if wanted == "time" else "Hz"

    def wrong(what: str) -> UserError:
        message = f"its abscissa {what}; a {KINDS[function.kind]} must be of {wanted} in {unit}"
        return function.entry.wrong(source, function.entry.first, message)

    if axis.kind not in (0, 1, BY_ABSCISSA[wanted]):
        other = {number: name for name, number in BY_ABSCISSA.items()}.get(axis.kind)
        raise wrong(f"is of {other or f'the quantity {axis.kind}'}")
    if axis.unit in ("", unit):
        return 1.0
    if axis.unit.replace(" ", "").lower() in ANGULAR and wanted == "frequency":
        return 1 / (2 * np.pi)
    try:
        label = read_unit(axis.unit)
    except UnitNotUnderstoodError as error:
        raise wrong(f"is in a unit that is not understood, as {error}") from None
    if label.quantity != wanted or label.form is not SpectralForm.linear:
        raise wrong(f"is in {axis.unit}")
    return label.factor


def _binary_values(source: Source, function: Function) -> Array:
    """Read the values of a 58b, shape (value, numbers of each)."""
    entry = function.entry
    assert entry.binary is not None
    have = entry.end - entry.data
    for size in _bytes_a_value(function):
        if size * function.size <= have < size * function.size + size:
            break
    else:
        message = (
            f"the header claims {function.size} values of {size} bytes, but there are {have} bytes"
        )
        raise entry.wrong(source, entry.data, message)
    y = f"{entry.binary.order}f{8 if function.double else 4}"
    numbers = 1 + function.complex
    x = [] if function.even else [("x", f"{entry.binary.order}f{size - numbers * int(y[-1])}")]
    raw = source.read_binary(entry.data, entry.data + size * function.size)
    records = np.frombuffer(raw, np.dtype([*x, ("y", y, (numbers,))]))
    _require_byte_order(source, entry, records)
    if function.even:
        return records["y"].astype(np.float64)
    return np.column_stack([records["x"].astype(np.float64), records["y"]])


def _require_byte_order(source: Source, entry: DataSet, records: NDArray) -> None:
    """Refuse values whose bytes stand in the other order than the file states.

    Exponents of numbers that are read in the wrong order are random: some of them are beyond
    anything physical. Zeros are zeros in both orders.
    """
    stated = _sizes(records)
    if _is_physical(stated) or entry.binary is None:
        return
    other = _sizes(records.view(records.dtype.newbyteorder()))
    names = {"<": ("least", 1), ">": ("most", 2)}
    first, _ = names[entry.binary.order]
    finite = stated[np.isfinite(stated)]
    message = f"in the order of bytes that its first line states, {first} significant one first, "
    message += f"values reach {finite.max():.2g}" if len(finite) else "values are no numbers"
    if _is_physical(other):
        right, number = names[">" if entry.binary.order == "<" else "<"]
        raise entry.wrong(
            source,
            entry.data,
            f"{message}; with the {right} significant one first they are {other.max():.2g} at "
            f"most, so that the number behind 58b must be {number}",
        )
    if not len(finite) or finite.max() > LARGEST:
        raise entry.wrong(source, entry.data, f"{message}, which nothing physical does")


def _sizes(records: NDArray) -> Array:
    """List the absolute values of all numbers of records."""
    with np.errstate(invalid="ignore"):
        columns = [records[name].astype(np.float64).ravel() for name in records.dtype.names or ()]
    return np.abs(np.concatenate(columns))


def _is_physical(sizes: Array) -> bool:
    """Tell whether all are zero or of a size that measured values may have."""
    return bool(((sizes == 0) | ((sizes > SMALLEST) & (sizes < LARGEST))).all())


def _bytes_a_value(function: Function) -> tuple[int, ...]:
    """Count the bytes of one value; the abscissa of double values is written single or double."""
    of_ordinate = (8 if function.double else 4) * (1 + function.complex)
    if function.even:
        return (of_ordinate,)
    return (of_ordinate + 4, of_ordinate + 8) if function.double else (of_ordinate + 4,)


def _widths(function: Function) -> list[int]:
    """Tell the widths of a line's values."""
    if not function.double:
        return [13] * 6
    if function.even:
        return [20] * 4
    return [13, 20, 20] if function.complex else [13, 20, 13, 20]


def _end_of_header(source: Source, entry: DataSet) -> int:
    """Find the byte after the header."""
    lines = source.peek(entry.first, min(entry.end - entry.first, LONGEST_HEADER))
    return entry.first + sum(map(len, lines.splitlines(keepends=True)[:ASCII_LINES]))


def _dof(line: bytes) -> tuple[int, int, int, int, int] | None:
    """Read type, response and reference, each node and direction: 2(I5,I10), 2(1X,A10,..)."""
    fields = [line[a:b].strip() for a, b in ((0, 5), (41, 51), (51, 55), (66, 76), (76, 80))]
    try:
        kind, node, direction, reference, reference_direction = (int(f or b"0") for f in fields)
    except ValueError:
        return None
    if not fields[0] or direction not in DIRECTIONS:
        return None
    return kind, node, direction, reference, reference_direction


@lru_cache(maxsize=64)  # functions of a file have most of these lines in common
def _shape(line: bytes) -> tuple[int, int, int, float, float] | None:
    """Read type, number and spacing of the values, start and increment of the abscissa."""
    for fields in ([line[i : i + 10] for i in (0, 10, 20)], line.split()[:3]):
        found = integers(b" ".join(fields), 80)
        if found is not None and len(found) == 3:
            break
    else:
        return None
    rest = columns(line[30:], 13)
    for reals in (rest[:2], line.split()[3:5]):
        try:
            first, step = (number(r) for r in reals)
        except ValueError:
            continue
        return found[0], found[1], found[2], first, step
    return None


@lru_cache(maxsize=64)
def _axis(line: bytes) -> Axis | None:
    """Read quantity, label and unit: I10, 3I5, 2(1X,A20); a blank line says nothing."""
    try:
        kind = int(line[:10].strip() or b"0")
    except ValueError:
        return None
    label, unit = (decoded(line[a:b]).strip() for a, b in ((25, 46), (46, 67)))
    return Axis(kind, *("" if t.upper() == "NONE" else t for t in (label, unit)))


@lru_cache(maxsize=64)
def _word(line: bytes) -> str:
    """Decode a line of text."""
    return decoded(line).strip()


#: Scale of amplitudes in data set 1858.
HALF_PEAK, PEAK, RMS = 1, 2, 3


@dataclass(frozen=True)
class Units:
    """Data set 164.

    Parameters
    ----------
    name : str
        Of the system of units.
    length : float
        One of the file's units of length in m.
    force : float
        One of the file's units of force in N; NaN if the factor says nothing.
    contradiction : str
        Sentence on a code or a name of units of other lengths than the factor; empty if they agree.
    """

    name: str
    length: float
    force: float = float("nan")
    contradiction: str = ""


#: Units of length, m, of the systems of units by their code; others are the user's own.
LENGTHS = {1: 1.0, 2: 0.3048, 3: 1.0, 4: 0.3048, 5: 1e-3, 6: 0.01, 7: 0.0254, 8: 1e-3, 10: 1e-3}
#: Names of such units.
NAMED = {
    1.0: r"m|met(?:er|re)s?",
    1e-3: r"mm|milli-?met(?:er|re)s?",
    0.01: r"cm|centi-?met(?:er|re)s?",
    0.0254: r"in|inch(?:es)?",
    0.3048: r"ft|foot|feet",
}


def _contradiction(place: str, code: int, name: str, length: float) -> str:
    """Tell if the code or the name of a system of units is of another length than the factor."""
    by_name = [one for one, words in NAMED.items() if re.search(rf"\b(?:{words})\b", name, re.I)]
    named = by_name[0] if len(by_name) == 1 else length
    for what, stated in (
        (f"the code {code}", LENGTHS.get(code, length)),
        (f"the name {name!r}", named),
    ):
        if not same_unit(stated, length):
            return (
                f"{place}: {what} is of units of {stated:g} m, but the factor of lengths of units "
                f"of {length:g} m"
            )
    return ""


def read_units(source: Source, entries: list[DataSet]) -> Units | None:
    """Read the file's units, None if it does not state them.

    Raises
    ------
    UserError
        If two data sets 164 contradict each other, or a factor is not a positive number.
    """
    found: Units | None = None
    for entry in (e for e in entries if e.kind == 164):
        lines = TextLines(source, entry)
        head = lines.next("the code of the units")
        factors = lines.numbers("the factors of the units", 1, 25, most=2)
        factor = factors[0]
        if not factor > 0:
            raise lines.wrong(f"the factor of lengths must be a positive number, not {factor:g}")
        force = 1.0 / factors[1] if len(factors) > 1 and factors[1] > 0 else float("nan")
        name, code = decoded(head[10:30]).strip(), (integers(head[:10], 10) or [0])[0]
        place = entry.at(source, entry.first)
        units = Units(name, 1.0 / factor, force, _contradiction(place, code, name, 1.0 / factor))
        if found is not None and found.length != units.length:
            raise lines.wrong(
                f"states one unit of length as {units.length:g} m, an earlier data set 164 as "
                f"{found.length:g} m; a file has one system of units"
            )
        same = found is None or found.force == units.force
        found = units if same else replace(units, force=float("nan"))
    return found


def read_amplitude(source: Source, entries: list[DataSet]) -> tuple[int, DataSet] | None:
    """Read the scale of amplitudes and where it is stated; None if it is unknown.

    Raises
    ------
    UserError
        If functions of the file differ in it.
    """
    found: tuple[int, DataSet] | None = None
    for entry in (e for e in entries if e.kind == 1858):
        lines = TextLines(source, entry)
        lines.next("the record's number")
        scale = lines.integers("window, weighting and scale of the amplitudes", 3, 6)[2]
        if scale not in (0, HALF_PEAK, PEAK, RMS):
            raise lines.wrong(f"the scale of amplitudes must be 0, 1, 2 or 3, not {scale}")
        if scale and found and found[0] != scale:
            raise lines.wrong(
                f"states the scale {scale} of amplitudes, data set {found[1].number} the scale "
                f"{found[0]}; functions of different scales must come in different files"
            )
        if scale:
            found = (scale, entry)
    return found
