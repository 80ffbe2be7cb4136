"""Bytes of a universal file and where its data sets stand, so that every error names a line.

The file is read piece by piece: a large one costs no more than its headers, and to be read through
once if it has a seal.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

from sldvexp.errors import UserError
from sldvexp.files import require_file

#: Bytes that are searched at a time.
CHUNK = 1 << 20
#: The beginning of a file whose lines end with CR alone, as on a Mac of old: its first two lines.
CR_ALONE = re.compile(rb"[^\r\n]*\r(?![\r\n])[^\r\n]*\r(?!\n)")
#: Bytes that are read at least, for what comes next.
AHEAD = 1 << 13
#: Lines of the header of a data set 58.
ASCII_LINES = 11


@dataclass(eq=False)
class Source:
    """An open file with one window into it.

    Parameters
    ----------
    path, file : Path and binary file
    size : int, bytes
    cr_alone : bool
        Whether its lines end with CR alone; `read`, `peek` and `find` see LF in their place.
    """

    path: Path
    file: BinaryIO
    size: int
    cr_alone: bool = False
    _start: int = field(default=0, repr=False)
    _window: bytes = field(default=b"", repr=False)

    def read(self, start: int, stop: int) -> bytes:
        """Read the bytes from `start` to `stop`, fewer at the end of the file; nothing is kept."""
        stop = min(stop, self.size)
        if start >= self._start and stop <= self._start + len(self._window):
            return self._window[start - self._start : stop - self._start]
        return self._at(start, stop - start) if stop > start else b""

    def read_binary(self, start: int, stop: int) -> bytes:
        """Read the bytes as `read`, but as they stand in the file, whatever its lines end with."""
        stop = min(stop, self.size)
        return self._raw(start, stop - start) if stop > start else b""

    def peek(self, start: int, count: int) -> bytes:
        """Read as `read`, for small pieces one after the other."""
        if not self._start <= start <= start + count <= self._start + len(self._window):
            self._look_at(start, max(count, AHEAD))
        return self.read(start, start + count)

    def find(self, wanted: bytes, start: int) -> int:
        """Find where `wanted` first begins at or after `start`; -1 if nowhere."""
        while start < self.size:
            if not self._start <= start < self._start + len(self._window) - len(wanted) + 1:
                self._look_at(start, CHUNK)
            found = self._window.find(wanted, start - self._start)
            if found >= 0:
                return self._start + found
            if self._start + len(self._window) >= self.size:
                return -1
            start = self._start + len(self._window) - len(wanted) + 1
        return -1

    def line(self, byte: int) -> int:
        """Count the line, from 1, that a byte is in."""
        starts = range(0, byte, CHUNK)
        return 1 + sum(self._at(s, min(CHUNK, byte - s)).count(b"\n") for s in starts)

    def _look_at(self, start: int, count: int) -> None:
        self._start, self._window = start, self._at(start, count)

    def _at(self, start: int, count: int) -> bytes:
        piece = self._raw(start, count)
        return piece.replace(b"\r", b"\n") if self.cr_alone else piece

    def _raw(self, start: int, count: int) -> bytes:
        try:
            self.file.seek(start)
            return self.file.read(max(count, 0))
        except OSError as error:
            raise UserError(f"{self.path}: cannot be read: {error.strerror or error}") from None


class Binary(NamedTuple):
    """Statement of the identifier line of a data set 58b about its values.

    Parameters
    ----------
    order : str
        ``<`` or ``>``, least or most significant byte first.
    bytes : int
        Length of the values; 0 if the line leaves it to the header.
    """

    order: str
    bytes: int


class DataSet(NamedTuple):
    """One data set.

    Parameters
    ----------
    number : int
        Which one of the file it is, from 1.
    kind : int
        What the file calls data set number, as 58.
    first : int
        Byte at which the line after the identifier begins.
    data : int
        Byte at which the values of a 58b begin; `first` in all others.
    end : int
        Byte after the last one.
    after_binary : bool
        Whether binary values come before it in the file, so that its lines cannot be counted.
    """

    number: int
    kind: int
    first: int
    data: int
    end: int
    binary: Binary | None = None
    after_binary: bool = False

    def wrong(self, source: Source, byte: int, message: str) -> UserError:
        """Word the error of something wrong at a byte of this data set."""
        return UserError(f"{self.at(source, byte)}: {message}")

    def at(self, source: Source, byte: int) -> str:
        """Name the place of a byte of this data set, for a message."""
        in_values = self.binary is not None and byte >= self.data
        counted = not (self.after_binary or in_values)
        place = f"line {source.line(byte)}" if counted else f"byte {byte}"
        kind = f"{self.kind}{'b' if self.binary else ''}" if self.kind else "unknown"
        return f"{source.path}, data set {self.number} ({kind}), {place}"


@contextmanager
def opened(path: Path) -> Iterator[Source]:
    """Open a file for reading.

    Raises
    ------
    UserError
        If it is missing, a folder, or cannot be read.
    """
    require_file(path)
    try:
        file = path.open("rb", buffering=0)
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    with file:
        source = Source(path, file, os.fstat(file.fileno()).st_size)
        source.cr_alone = CR_ALONE.match(source.read(0, AHEAD)) is not None
        yield source


def decoded(text: bytes) -> str:
    r"""Decode text in UTF-8 or, as programs of Windows write it, the Western code page or Latin-1.

    Examples
    --------
    >>> decoded(b"\xb5m/s"), decoded("µm/s".encode())
    ('µm/s', 'µm/s')
    """
    for encoding in ("utf-8", "cp1252"):
        try:
            return text.decode(encoding)
        except UnicodeDecodeError:
            continue
    return text.decode("latin-1")


def shown(line: bytes) -> str:
    """Show the beginning of a line in a message, whatever is in it."""
    text = line[:40].decode("ascii", "replace").rstrip()
    return repr("".join(c if c.isprintable() else "?" for c in text)) if text else "nothing"
