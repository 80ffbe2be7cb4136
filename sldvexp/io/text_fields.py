"""Fields of a file to numbers and units, with complaints that name the file and the line."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from sldvexp.errors import UserError
from sldvexp.files import read_text
from sldvexp.units import LengthUnit


def number(text: str, what: str, where: str) -> float:
    """A finite number.

    Raises
    ------
    UserError
        If the text is empty, not a number, infinite or NaN.
    """
    try:
        value = float(text)
    except ValueError:
        raise UserError(f"{where}: {what} must be a number, not {text!r}") from None
    if not math.isfinite(value):
        raise UserError(f"{where}: {what} must be finite, not {text}")
    return value


def whole_number(text: str, what: str, where: str) -> int:
    """A whole number of zero or more.

    Raises
    ------
    UserError
        If the text is anything else.
    """
    if not (text.isascii() and text.isdigit()):
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
    """The unit of a file that states one, that was given one, or both alike.

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


def csv_lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and stripped cells of every line that is neither blank nor a comment."""
    reader = csv.reader(io.StringIO(read_text(path)), skipinitialspace=True)
    try:
        for cells in reader:
            if any(cells) and not cells[0].startswith("#"):
                yield reader.line_num, [cell.strip() for cell in cells]
    except csv.Error as error:
        raise UserError(f"{path}, line {reader.line_num}: is not CSV: {error}") from None


def unit_of_columns(
    quantities: Sequence[str], units: Sequence[str], header: list[str], where: str
) -> str | None:
    """The one unit in which the header has any of these quantities, None if it has none."""
    used = [u for u in units if any(f"{quantity}_{u}" in header for quantity in quantities)]
    if len(used) > 1:
        names = ", ".join(quantities)
        raise UserError(f"{where}: the columns {names} mix the units {' and '.join(used)}")
    return used[0] if used else None
