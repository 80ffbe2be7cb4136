"""Universal files as a whole: an index of their data sets, and each read when it is asked for.

The index finds where data sets begin and end without reading what is in them.
"""

from __future__ import annotations

import codecs
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.io.uff.fortran import TextLines
from sldvexp.io.uff.functions import (
    NODAL,
    Function,
    Units,
    bytes_needed,
    read_amplitude,
    read_header,
    read_units,
    read_values,
)
from sldvexp.io.uff.geometry import UniversalGeometry, read_geometry
from sldvexp.io.uff.nodal import (
    ANALYSIS,
    Nodal,
    ShapeFunctions,
    read_nodal,
    read_normal_mode,
)
from sldvexp.io.uff.seal import require_seal
from sldvexp.io.uff.source import (
    ASCII_LINES,
    CHUNK,
    Binary,
    DataSet,
    Source,
    decoded,
    opened,
    shown,
)

#: The line that begins and ends every data set: -1 in columns 5 and 6, blanks up to its end.
MARK = b"    -1"
MARK_LINE = re.compile(rb"    -1[ \t]*(\r\n|\n|\r|\Z)")
BLANK = re.compile(rb"[\s\0\x1a]*")
IDENTIFIER = re.compile(rb"[ \t]*(\d{1,6})([ \t]|([bB])(?=[ \t]|\d|$)|$)")
#: Marks of the encoding that editors put before a text.
UTF_8, UTF_16 = codecs.BOM_UTF8, (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
#: Line ends and filling before the mark behind binary values, as little of it as there is.
FILLING = re.compile(rb"[\s\0\x1a]*?(?=" + MARK_LINE.pattern + rb")")
#: Formats of binary numbers by their number in the file.
IEEE = 2
OTHER_FORMATS = {1: "VAX floating-point", 3: "IBM floating-point"}
#: Longest line that is looked at in search of its end; a line of a universal file has 80 columns.
LONGEST_LINE = 4096
#: Bytes of a file that takes seconds to search.
LARGE = 2**28
#: Bytes between data sets at most, which are blank.
LONGEST_BLANK = 2**22
#: Longest line of -1, with blanks to its end.
SHORT = 512


def index(source: Source) -> list[DataSet]:
    """Find all data sets of a file, in its order.

    Raises
    ------
    UserError
        If it is no universal file, or a data set has no end or no number.
    """
    entries: list[DataSet] = []
    start = source.peek(0, len(UTF_8))
    if start.startswith(UTF_16):
        raise UserError(
            f"{source.path}: is text in UTF-16, as an editor or a shell may have saved it; write "
            "the file anew, or save it as plain text (ASCII or UTF-8)"
        )
    if source.size > LARGE and MARK not in source.read(source.size - CHUNK, source.size):
        raise UserError(
            f"{source.path}: the last MB of the file has no line '    -1', with which a universal "
            "file ends; it is truncated"
        )
    position, binary = (len(UTF_8) if start == UTF_8 else 0), False
    while (begin := _begin(source, position, entries)) is not None:
        entry, position = _entry(source, begin, len(entries) + 1, binary)
        entries.append(entry)
        binary |= entry.binary is not None
    if not entries:
        raise UserError(f"{source.path}: is empty; a universal file begins with the line '    -1'")
    return entries


def _begin(source: Source, position: int, entries: list[DataSet]) -> int | None:
    """Find the byte after the next line of -1, None at the end of the file."""
    first = position
    while True:  # skip blank lines, also those of a whole window
        if position - first > LONGEST_BLANK:
            message = f"has more than {LONGEST_BLANK >> 20} MB of blanks or zeros from byte {first}"
            raise UserError(f"{source.path}: {message}; it is damaged")
        piece = source.peek(position, LONGEST_LINE)
        if not piece:
            return None
        blank = BLANK.match(piece).end()  # type: ignore[union-attr]
        if blank < len(piece):
            break
        if blank < LONGEST_LINE:
            return None
        position += blank - len(MARK)  # a mark's own blanks may be the last of them
    # The blanks of the mark itself were skipped as well.
    start = position + (piece.rfind(b"\n", 0, blank) + 1)
    if mark := MARK_LINE.match(source.peek(start, LONGEST_LINE)):
        return start + mark.end()
    if not entries:
        raise UserError(
            f"{source.path}, line {source.line(start)}: is not a universal file, which begins "
            "with a line of four blanks and -1"
        )
    message = "after the end of this data set there must be a line '    -1' that begins another"
    raise entries[-1].wrong(source, start, message)


def _entry(source: Source, start: int, number: int, after_binary: bool) -> tuple[DataSet, int]:
    """Find the data set whose identifier line begins at `start`, and the byte after its end."""
    blind = DataSet(number, 0, start, start, start, None, after_binary)
    line, first = _line(source, start)
    found = IDENTIFIER.match(line)
    if not found:
        raise blind.wrong(
            source, start, f"must begin with the data set's number, not {shown(line)}"
        )
    kind = int(found[1])
    if not found[3]:
        end, after = _end(
            source, first, DataSet(number, kind, first, first, first, None, after_binary)
        )
        return DataSet(number, kind, first, first, end, None, after_binary), after
    known = DataSet(number, kind, first, first, first, Binary("<", 0), after_binary)
    if kind != 58:
        raise known.wrong(source, start, "only data set 58 is known in binary form")
    binary = _binary(source, start, line[found.end() :], known)
    data = _after_header(source, known)
    entry = DataSet(number, kind, first, data, data + binary.bytes, binary, after_binary)
    return _closed(source, entry)


def _after_header(source: Source, entry: DataSet) -> int:
    """Find the byte after the header's eleven lines of a 58b."""
    piece = source.peek(entry.first, LONGEST_LINE)
    lines = piece.split(b"\n", ASCII_LINES)
    if len(lines) <= ASCII_LINES or any(MARK_LINE.fullmatch(line) for line in lines[:-1]):
        message = f"the header ends before its {ASCII_LINES} lines"
        raise entry.wrong(source, entry.first, message)
    return entry.first + len(piece) - len(lines[-1])


def _binary(source: Source, start: int, rest: bytes, entry: DataSet) -> Binary:
    """Read the identifier line of a 58b: I6, I6, I12 and I12."""
    fields = rest.split()
    if len(fields) < 4 or not all(f.isdigit() for f in fields[:4]):
        fields = [rest[a:b].strip() for a, b in ((0, 6), (6, 12), (12, 24), (24, 36))]
    if not all(f.isdigit() for f in fields[:4]):
        raise entry.wrong(
            source, start, f"must state byte order, format, lines and bytes, not {shown(rest)}"
        )
    order, form, lines, count = (int(f) for f in fields[:4])
    if order not in (1, 2):
        raise entry.wrong(source, start, f"the byte order must be 1 or 2, not {order}")
    if form != IEEE:
        whose = f"{OTHER_FORMATS.get(form, 'unknown')} numbers (format {form})"
        raise entry.wrong(
            source,
            start,
            f"its values are {whose}, and only IEEE numbers (format {IEEE}) can be read; write the "
            "file anew with these, or as text (data set 58 without b)",
        )
    if lines != ASCII_LINES:
        raise entry.wrong(source, start, f"the header must have {ASCII_LINES} lines, not {lines}")
    return Binary("<" if order == 1 else ">", count)


def _closed(source: Source, entry: DataSet) -> tuple[DataSet, int]:
    """Give a 58b the end that its mark confirms, and find the byte after the mark.

    Where the identifier line has a wrong number of bytes (some programs count a complex value as
    one, others leave 0), the length that the header's number of values needs is tried.
    """
    after = _after_mark(source, entry.end) if entry.end > entry.data else None
    if after is None:
        for needed in bytes_needed(source, entry):
            if (after := _after_mark(source, entry.data + needed)) is not None:
                entry = entry._replace(end=entry.data + needed)
                break
    if after is not None and not _turned(source, entry):
        return entry, after
    claimed, left = entry.end - entry.data, source.size - entry.data
    if claimed > left:
        raise entry.wrong(
            source,
            entry.data,
            f"its header claims {claimed} bytes of values, but only {left} are left; the file is "
            "truncated or the header wrong",
        )
    message = (
        f"after the {claimed} bytes of values that its header claims there is no line '    -1'"
    )
    raise entry.wrong(source, entry.end, message + _line_ends(source, entry))


def _after_mark(source: Source, end: int) -> int | None:
    """Find the byte after the line of -1 at the end of binary values, None if there is none.

    Programs that write text put a line end before the mark, others fill a block with zeros.
    """
    tail = source.peek(end, SHORT) if end < source.size else b""
    filling = FILLING.match(tail)
    mark = MARK_LINE.match(tail, filling.end()) if filling else None
    return end + mark.end() if mark else None


def _turned(source: Source, entry: DataSet) -> bool:
    """Tell whether a transfer as text turned each LF of header and values to CR LF.

    As there are more values then than the header claims, the last of them look like filling.
    """
    if MARK_LINE.match(source.peek(entry.end, SHORT)):
        return False  # nothing is between
    header = source.read_binary(entry.first, entry.data)
    if header.count(b"\n") != header.count(b"\r\n"):
        return False
    values = source.read_binary(entry.data, entry.end)
    return 0 < values.count(b"\n") == values.count(b"\r\n")


def _line_ends(source: Source, entry: DataSet) -> str:
    """Say more if a transfer as text turned LF of the values to CR LF."""
    mark = source.find(b"\n" + MARK, entry.end)
    later = source.find(MARK, entry.end) if mark < 0 else min(mark, source.find(MARK, entry.end))
    extra = later - entry.end
    turned, at = 0, entry.data
    while 0 <= (at := source.find(b"\r\n", at)) < later:
        turned, at = turned + 1, at + 2
    if later < 0 or not turned or not 0 < extra <= turned + 2:
        return ""
    return (
        f", but {extra} bytes later: CR LF stands where the values have LF; transfer the file "
        "again, as a binary one"
    )


def _end(source: Source, first: int, entry: DataSet) -> tuple[int, int]:
    """Find the end of a data set of text and the byte after the line of -1 that closes it."""
    at = first - 1
    while (at := source.find(b"\n" + MARK, at)) >= 0:
        if mark := MARK_LINE.match(source.peek(at + 1, LONGEST_LINE)):
            return at + 1, at + 1 + mark.end()
        at += 1
    raise entry.wrong(
        source, max(first, source.size - 1), "the file ends before the line '    -1' that ends it"
    )


def _line(source: Source, start: int) -> tuple[bytes, int]:
    """Read a line without its end, and find where the next one begins."""
    piece = source.peek(start, LONGEST_LINE)
    stop = piece.find(b"\n")
    if stop < 0:
        return piece, start + len(piece)
    return piece[:stop].rstrip(b"\r"), start + stop + 1


#: Lines before the identifying ones, by the data set's kind, and those of data set 151.
BEFORE_TEXT, ABOUT = {ANALYSIS: 3}, 3
#: Names of data sets by their number.
NAMES = {
    15: "nodes",
    18: "coordinate systems",
    55: "values at nodes",
    56: "values at elements",
    58: "functions",
    82: "lines",
    151: "about the file",
    164: "units",
    1858: "about functions",
    2411: "nodes",
    2412: "elements",
    2414: "values of an analysis",
    2420: "coordinate systems",
}


@dataclass(eq=False)
class UniversalFile:
    """An open universal file. Nothing but `values` reads what a function's header does not say.

    Parameters
    ----------
    entries : list of DataSet
        Its data sets, in the file's order.
    """

    source: Source
    entries: list[DataSet]
    _shapes: ShapeFunctions | None = field(default=None, repr=False)

    @cached_property
    def functions(self) -> list[Function]:
        """Headers of the data sets 58 and 58b."""
        return [read_header(self.source, e) for e in self.entries if e.kind == 58]

    def nodal_functions(self, containing: str = "") -> list[Function]:
        """Read data sets 55 and 2414, each as a whole, as functions of frequency.

        Parameters
        ----------
        containing : str
            Text that the data sets' identifying lines must have.

        Raises
        ------
        UserError
            See `sldvexp.io.uff.nodal.read_nodal` and `ShapeFunctions`.
        """
        entries = [e for e in self.entries if e.kind in (NODAL, ANALYSIS)]
        sets = [n for e in entries if (n := read_nodal(self.source, e, containing)) is not None]
        self._shapes = ShapeFunctions(self.source, sets) if sets else None
        return self._shapes.functions if self._shapes else []

    def normal_modes(self, containing: str = "") -> list[Nodal]:
        """Read those data sets 55 and 2414 that are of normal modes, in the file's order.

        Parameters
        ----------
        containing : str
            Text that the data sets' identifying lines must have.

        Raises
        ------
        UserError
            See `sldvexp.io.uff.nodal.read_normal_mode`.
        """
        entries = [e for e in self.entries if e.kind in (NODAL, ANALYSIS)]
        found = (read_normal_mode(self.source, e, containing) for e in entries)
        return [mode for mode in found if mode is not None]

    @cached_property
    def geometry(self) -> UniversalGeometry | None:
        """Nodes, elements and lines; None if there are no nodes."""
        return read_geometry(self.source, self.entries)

    @cached_property
    def units(self) -> Units | None:
        """The units of lengths; None if the file does not state them."""
        return read_units(self.source, self.entries)

    @cached_property
    def amplitude(self) -> tuple[int, DataSet] | None:
        """The scale of amplitudes and who states it; None if it is unknown."""
        return read_amplitude(self.source, self.entries)

    def values(self, function: Function) -> tuple[NDArray, NDArray]:
        """Read abscissa and ordinate of a function; see `sldvexp.io.uff.functions.read_values`."""
        if function.kind == NODAL and self._shapes is not None:
            return self._shapes.values_of(function)
        return read_values(self.source, function)

    @property
    def contents(self) -> str:
        """The numbers of its data sets, how many of each, and what these are."""
        count = Counter(entry.kind for entry in self.entries)
        return ", ".join(
            f"{n} data set{'s' * (n > 1)} {kind}" + (f" ({NAMES[kind]})" if kind in NAMES else "")
            for kind, n in count.items()
        )

    def texts(self, functions: Sequence[Function]) -> list[tuple[DataSet, int, str]]:
        """List identifying lines of functions: data set, its line from 0, and text."""
        return [
            (function.entry, i, line)
            for function in functions
            for i, line in enumerate(function.text, BEFORE_TEXT.get(function.entry.kind, 0))
        ]

    @cached_property
    def about(self) -> list[tuple[DataSet, int, str]]:
        """Lines of the data sets 151, which are about the file, as of `texts`."""
        entries = [entry for entry in self.entries if entry.kind == 151]
        return [
            (entry, i, decoded(line).strip())
            for entry in entries
            for i, line in enumerate(TextLines(self.source, entry).text[:ABOUT])
        ]

    def at(self, entry: DataSet, line: int) -> str:
        """Name the place of a line, from 0, of a data set, for a message."""
        text = self.source.peek(entry.first, LONGEST_LINE).splitlines(keepends=True)
        return entry.at(self.source, entry.first + sum(map(len, text[:line])))

    def wrong(self, function: Function, message: str) -> UserError:
        """Word the error of a function as a whole."""
        return function.entry.wrong(self.source, function.entry.first, message)


@contextmanager
def universal_file(path: Path) -> Iterator[UniversalFile]:
    """Open a universal file and find its data sets.

    Raises
    ------
    UserError
        If it is missing, is no universal file, or is not what its seal says.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from sldvexp.io.uff import writer
    >>> path = Path(tempfile.mkdtemp(), "points.uff")
    >>> _ = path.write_text(writer.units() + writer.nodes(np.eye(3), np.ones(3, int)))
    >>> with universal_file(path) as file:
    ...     print(file.units, file.geometry.label)
    Units(name='SI: Meter (newton)', length=1.0, force=1.0) [1 2 3]
    """
    with opened(path) as source:
        entries = index(source)
        require_seal(source, entries)
        yield UniversalFile(source, entries)
