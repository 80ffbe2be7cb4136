"""Seal of the universal files that are written here: a checksum of all lines behind the first.

A changed digit of a number leaves a number, which no reader can see. Files of this program begin
with a data set 151, the header that other programs skip, whose description states how many lines
follow that data set, and their CRC-32. Blanks at the ends of lines, blank lines, and LF or CR LF
do not count: programs that only pass a file on may change them. A single burst of up to 32 wrong
bits is always seen, any other damage but once in 2^32.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable
from typing import TextIO

from sldvexp.errors import UserError
from sldvexp.io.uff.source import CHUNK, DataSet, Source
from sldvexp.io.uff.writer import dataset

HEADER = 151
STATED = re.compile(rb"^ *(\d+) lines follow this set, crc32 ([0-9a-f]{8})", re.M)


class SealedWriter:
    r"""Writer of a universal file that begins with its seal.

    Parameters
    ----------
    file : TextIO
        Open for writing and at its beginning; it is gone back to once all is written.

    Examples
    --------
    >>> import io
    >>> from sldvexp.io.uff import writer
    >>> file = io.StringIO()
    >>> with SealedWriter(file) as sealed:
    ...     sealed.write(writer.units())
    >>> file.getvalue().splitlines()[3].strip()
    '6 lines follow this set, crc32 24f8a2d7; delete it if you change them'
    """

    def __init__(self, file: TextIO):
        self._file, self._lines, self._sum = file, 0, 0

    def __enter__(self) -> SealedWriter:
        """Leave room for the seal."""
        self._file.write(_header(0, 0))
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Write the seal, unless writing failed."""
        if kind is None:
            self._file.seek(0)
            self._file.write(_header(self._lines, self._sum))

    def write(self, text: str) -> None:
        """Write whole lines."""
        self._file.write(text)
        self._lines, self._sum = _add(text.encode().splitlines(), self._lines, self._sum)

    def writelines(self, texts: Iterable[str]) -> None:
        """Write whole lines, a text after the other."""
        for text in texts:
            self.write(text)


def _header(lines: int, crc: int) -> str:
    """Write data set 151; its length does not depend on the numbers."""
    said = f"{lines:10d} lines follow this set, crc32 {crc:08x}; delete it if you change them"
    nothing = f"{'NONE':<10}{'NONE':<10}"
    about = ["sldvexp", said, "sldvexp", nothing + f"{0:10d}" * 3, nothing, "sldvexp", nothing]
    return dataset(HEADER, about)


def _add(lines: Iterable[bytes], count: int, crc: int) -> tuple[int, int]:
    """Add lines to their number and checksum."""
    bare = [stripped + b"\n" for line in lines if (stripped := line.rstrip())]
    return count + len(bare), zlib.crc32(b"".join(bare), crc)


def require_seal(source: Source, entries: list[DataSet]) -> None:
    """Refuse a file that is not what its seal says; files without one pass.

    Raises
    ------
    UserError
        If lines were lost, added or changed.
    """
    first = entries[0]
    stated = STATED.search(source.read(first.first, first.end)) if first.kind == HEADER else None
    if stated is None:
        return
    start = source.find(b"\n", first.end) + 1  # behind the mark
    lines, crc, rest = 0, 0, b""
    for begin in range(start, source.size, CHUNK):
        # A CR at the end of a piece may be the first half of CR LF.
        *whole, rest = (rest + source.read(begin, begin + CHUNK)).split(b"\n")
        lines, crc = _add(whole, lines, crc)
    lines, crc = _add([rest], lines, crc)
    if lines != int(stated[1]):
        raise UserError(
            f"{source.path}: has {lines} lines behind its first data set, which promises "
            f"{int(stated[1])}: the file was cut or changed; get it anew, or delete its first data "
            "set (151) if the change is meant"
        )
    if crc != int(stated[2], 16):
        raise UserError(
            f"{source.path}: its lines were changed after it was written, as the checksum in its "
            "first data set shows; get the file anew, or delete that data set (151) if the change "
            "is meant"
        )
