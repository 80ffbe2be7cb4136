"""Numbers in the columns of Fortran formats, and lists of numbers as Fortran and others write."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sldvexp.io.uff.source import DataSet, Source, shown
from sldvexp.typing import Array

#: A number as Fortran writes it: ``1.5``, ``1.5E3``, ``1.5D+03``, and ``1.5-101``: an exponent
#: of three digits has no letter.
NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([EeDd][+-]?\d{1,3}|[+-]\d{3})?")
INTEGER = re.compile(rb"[+-]?\d+")
LONGEST_INTEGER = 12
#: Numbers to Python that are none to Fortran; the last is where two numbers touch.
NO_NUMBERS = re.compile(rb"_|[EeDd][+-]?\d{4}")


class TextLines:
    """Lines of a data set of text, with what is wrong in them."""

    def __init__(self, source: Source, entry: DataSet):
        self.source, self.entry = source, entry
        self.text = source.read(entry.first, entry.end).splitlines()
        self.at = 0

    def __bool__(self) -> bool:
        """Whether there are lines left."""
        return self.at < len(self.text)

    def next(self, what: str) -> bytes:
        """Read the next line."""
        if not self:
            raise self.wrong(f"ends before {what}", len(self.text) - 1)
        self.at += 1
        return self.text[self.at - 1]

    def integers(self, what: str, least: int, width: int = 10) -> list[int]:
        """Read the next line's integers in columns of `width`, at least so many."""
        line = self.next(what)
        found = integers(line, width)
        if found is None or len(found) < least:
            message = f"{what} must be {least} integers in columns of {width}, not {shown(line)}"
            raise self.wrong(message)
        return found

    def numbers(self, what: str, count: int, width: int, most: int = 0) -> list[float]:
        """Read the next line's numbers in columns of `width`, so many, or up to `most` if more."""
        line = self.next(what)
        found = numbers(line, width)
        if found is None or len(found) < count or not np.isfinite(found[:count]).all():
            message = f"{what} must be {count} numbers in columns of {width}, not {shown(line)}"
            raise self.wrong(message)
        return found[: max(count, most)]

    def wrong(self, message: str, line: int | None = None) -> Exception:
        """Word the error of a line, of the last one read if none is named."""
        line = max(self.at - 1, 0) if line is None else max(line, 0)
        before = self.source.read(self.entry.first, self.entry.end).splitlines(keepends=True)
        byte = self.entry.first + sum(map(len, before[:line]))
        return self.entry.wrong(self.source, byte, message)


def columns(line: bytes, width: int) -> list[bytes]:
    """Split a line into columns without blanks around them, up to the last that is not blank."""
    line = line.rstrip()
    return [line[i : i + width].strip() for i in range(0, len(line), width)]


def integers(line: bytes, width: int) -> list[int] | None:
    """Read integers in columns, or between blanks if the columns hold none; None if neither."""
    for fields in (columns(line, width), line.split()):
        if all(INTEGER.fullmatch(f) and len(f) <= LONGEST_INTEGER for f in fields):
            return [int(f) for f in fields]
    return None


def number(field: bytes) -> float:
    """Read a number as Fortran writes it; a `ValueError` if it is none."""
    found = NUMBER.fullmatch(field)
    if not found:
        raise ValueError
    exponent = (found[2] or b"").lstrip(b"EeDd")
    return float(field[: found.start(2)] + b"E" + exponent) if exponent else float(field)


def numbers(line: bytes, width: int) -> list[float] | None:
    """Read numbers in columns, or between blanks if the columns hold none; None if neither."""
    for fields in (columns(line, width), line.split()):
        try:
            return [number(f) for f in fields]
        except ValueError:
            pass
    return None


def table(source: Source, entry: DataSet, start: int, widths: Sequence[int], count: int) -> Array:
    """Read all numbers from `start` to the end of a data set, which must be `count` of them.

    Zeros may fill the last line.

    Parameters
    ----------
    entry : DataSet
        Of text.
    start : int
        Byte at which the first line of numbers begins.
    widths : sequence of int
        Columns of the numbers of a line.

    Raises
    ------
    UserError
        If there are more or fewer, or one is no number; it names the line and the column.
    """
    text = source.read(start, entry.end)
    values = between_blanks(text)
    if values is None or len(values) != count:
        values = _in_columns(source, entry, start, text, widths)
    fills = 0 < len(values) - count < len(widths) and not len(values) % len(widths)
    if fills and not values[count:].any():  # zeros that fill the last line
        return values[:count]
    if len(values) != count:
        more = "more" if len(values) > count else "fewer"
        message = f"the header claims {count} numbers, but there are {more}: {len(values)}"
        raise entry.wrong(source, start, message)
    return values


def between_blanks(text: bytes) -> Array | None:
    """Read numbers between blanks, fast; None if they are not all numbers."""
    if NO_NUMBERS.search(text):
        return None
    try:
        return np.array(text.replace(b"D", b"E").replace(b"d", b"e").split(), dtype=np.float64)
    except ValueError:
        return None


def _in_columns(
    source: Source, entry: DataSet, start: int, text: bytes, widths: Sequence[int]
) -> Array:
    """Read numbers in columns of fixed widths, as where a sign fills the last blank."""
    edges = np.concatenate([[0], np.cumsum(widths)])
    found: list[float] = []
    byte = start
    for line in text.splitlines(keepends=True):
        bare = line.rstrip()
        for a, b in pairwise(edges):
            if field := bare[a:b].strip():
                try:
                    found.append(number(field))
                except ValueError:
                    message = f"{shown(field)} in columns {a + 1} to {b} is not a number"
                    raise entry.wrong(source, byte, message) from None
        if bare[edges[-1] :].strip():
            message = f"has text beyond column {edges[-1]}: {shown(bare[edges[-1] :].strip())}"
            raise entry.wrong(source, byte, message)
        byte += len(line)
    return np.array(found)
