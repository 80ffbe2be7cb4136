"""Files as a whole: is there one, is it text, and how to replace one in a single step.

All text is opened here, whatever program wrote it: UTF-8, UTF-16 and UTF-32 with a mark, UTF-16
without one, else the Western code page of Windows, which has Latin-1 in it. Tables that are written
here have a comment with their number of lines and a checksum, so that what was damaged or cut off
later is refused.
"""

from __future__ import annotations

import codecs
import errno
import os
import platform
import re
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sldvexp.errors import UserError

#: A disk that does not take so many bytes is full.
LITTLE = 2**20
FULL = (errno.ENOSPC, errno.EDQUOT)


def require_file(path: Path) -> None:
    """Complain unless `path` is an existing file.

    Raises
    ------
    UserError
        If nothing is there, or a folder.
    """
    if path.is_dir():
        raise UserError(f"{path}: is a folder; a file is needed")
    if not path.exists():
        raise UserError(f"{path}: there is no such file (looked from {Path.cwd()})")


#: Marks at the beginning of a file that tell its encoding; those of UTF-32 begin as UTF-16's do.
MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
#: Characters that no text has, but numbers in binary do, and some of which Python takes for blanks.
CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f]")


def read_text(path: Path) -> str:
    r"""Read the text of a file, in whatever encoding, and compare it with its check line.

    Raises
    ------
    UserError
        If it cannot be read, is not text, or is not what its check line says.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "units.txt")
    >>> _ = path.write_bytes(b"\xb5m/s")
    >>> read_text(path)
    'µm/s'
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    text = decoded(content)
    if text is None:
        raise UserError(f"{path}: is not a text file, although its suffix says so")
    _require_check(text, path)
    return text


def decoded(content: bytes) -> str | None:
    r"""Decode text; None if it is none.

    Examples
    --------
    >>> decoded("\u00b2".encode("utf-16")), decoded(b"\xb2"), decoded(b"\x00\x01")
    ('²', '²', None)
    """
    encoding = next((e for mark, e in MARKS.items() if content.startswith(mark)), None)
    if encoding is None and (half := len(content) // 2):
        zeros = content[::2].count(0), content[1::2].count(0)
        if min(zeros) == 0 and max(zeros) > 0.5 * half:
            encoding = "utf-16-le" if zeros[1] else "utf-16-be"
    for name in (encoding,) if encoding else ("utf-8", "cp1252"):
        try:
            text = content.decode(name).removesuffix("\x1a")  # the end of a file of DOS
        except UnicodeDecodeError:
            continue
        return None if CONTROL.search(text) else text
    return None


CHECK_LINE = re.compile(r"#\s*(?P<lines>\d+) lines, crc32 (?P<sum>[0-9a-f]{8})\b")


def with_check_line(text: str, last: bool = False) -> str:
    r"""Put a comment with the number of lines and a checksum before a table, or behind it.

    Ends of lines and blanks there do not count, as programs that only pass a file on change them.

    Parameters
    ----------
    last : bool
        Where a format's number of rows shows that a file was cut, and other programs, which know
        no comments, read no further than that.

    Examples
    --------
    >>> with_check_line("x_m,y_m\n1,2\n").splitlines()[0]
    '# 2 lines, crc32 3af407be; delete this line if you change the others'
    """
    lines, found = _sum(text.splitlines())
    check = f"# {lines} lines, crc32 {found}; delete this line if you change the others\n"
    return text + check if last else check + text


def _sum(text: Iterable[str]) -> tuple[int, str]:
    """Count the lines of a text that are not blank, and compute their checksum."""
    lines = [line.rstrip() for line in text if line.strip()]
    return len(lines), f"{zlib.crc32(chr(10).join(lines).encode('utf-8', 'replace')):08x}"


def _require_check(text: str, path: Path) -> None:
    """Refuse a text that is not what its check line says, if it has one."""
    if "crc32" not in text:
        return
    lines = text.splitlines()
    stated = {i: match for i, line in enumerate(lines) if (match := CHECK_LINE.match(line))}
    if not stated:
        return
    at, promised = next(iter(stated.items()))
    count, found = _sum(line for i, line in enumerate(lines) if i != at)
    if int(promised["lines"]) != count:
        raise UserError(
            f"{path}: has {count} lines besides line {at + 1}, which promises {promised['lines']}; "
            "the file was cut or changed; delete that line if the change is meant"
        )
    if promised["sum"] != found:
        raise UserError(
            f"{path}: was changed since it was written, as the checksum in line {at + 1} tells; "
            "delete that line if the change is meant"
        )


@contextmanager
def whole_or_nothing(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to, which takes its place when all went well.

    Raises
    ------
    UserError
        If the folder is missing or not writable, or the disk is full.
    """
    here = f"{os.getpid()}-{platform.node()}"  # other machines may write to the same folder
    beside = path.with_name(f".{path.stem}.{here}{path.suffix}")
    try:
        beside.touch()
        yield beside
        os.replace(beside, path)
    except (OSError, RuntimeError) as error:
        full = _full(beside)  # which HDF5 does not tell: it says "Permission denied" or "HDF error"
        if not full and isinstance(error, RuntimeError):
            raise
        told = full or getattr(error, "strerror", None) or error
        raise UserError(f"{path}: cannot be written: {told}") from None
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)


def _full(path: Path) -> str:
    """Ask what the system says if the disk of a file, of which nothing is kept, is full."""
    try:
        with path.open("ab") as file:
            file.write(bytes(LITTLE))
    except OSError as error:
        if error.errno in FULL:
            return error.strerror or str(error)
    return ""
