"""Files as a whole: is there one, is it text, and is it what was written.

All text is opened here, whatever program wrote it: UTF-8, UTF-16 and UTF-32 with a mark, UTF-16
without one, else the Western code page of Windows, which has Latin-1 in it. Tables that are written
here have a comment with their number of lines and a checksum, so that what was damaged or cut off
later is refused.
"""

from __future__ import annotations

import codecs
import json
import os
import re
import stat
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sldvexp.errors import UserError
from sldvexp.limits import TEXT_BYTES, too_much_text

#: Longest name of a folder or group, in bytes; file systems take 255, and some is added.
LONGEST_NAME = 200


def require_file(path: Path) -> None:
    """Complain unless `path` is an existing file.

    Raises
    ------
    UserError
        If nothing is there, or a folder.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise UserError(f"{path}: there is no such file (looked from {Path.cwd()})") from None
    except (OSError, ValueError) as error:  # links in a circle, a name that is too long
        told = getattr(error, "strerror", None) or error
        raise UserError(f"{path}: cannot be read: {told}") from None
    if stat.S_ISDIR(mode):
        raise UserError(f"{path}: is a folder; a file is needed")
    if not stat.S_ISREG(mode):
        raise UserError(f"{path}: is a device or a pipe; a file is needed")


#: Marks at the beginning of a file that tell its encoding; those of UTF-32 begin as UTF-16's do.
MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
#: Characters that no text has, but numbers in binary do, and some of which Python takes for blanks.
CONTROL = [chr(k) for k in (*range(9), *range(14, 32))]


def read_bytes(path: Path, most: int = TEXT_BYTES) -> bytes:
    """Read a file as a whole.

    Raises
    ------
    UserError
        If it is no file, cannot be read, or is larger than `most` bytes.
    """
    require_file(path)
    try:
        with path.open("rb") as file:
            content = file.read(most + 1) if os.fstat(file.fileno()).st_size <= most else None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    if content is None or len(content) > most:
        size, allowed = (f"{n / 2**20:.3g} MB" for n in (path.stat().st_size, most))
        raise UserError(f"{path}: has {size}, more than the {allowed} of such a file")
    return content


def read_json(path: Path, most: int = TEXT_BYTES) -> Any:
    """Read a small file of JSON.

    Raises
    ------
    UserError
        See `read_bytes`.
    ValueError
        If it is none.
    """
    try:
        return json.loads(read_bytes(path, most))
    except RecursionError:
        raise ValueError("is nested too deep") from None


def read_text(path: Path, most: int = TEXT_BYTES) -> str:
    r"""Read the text of a file, in whatever encoding, and compare it with its check line.

    Parameters
    ----------
    most : int
        Bytes.

    Raises
    ------
    UserError
        If it cannot be read, is not text, is too long, or is not what its check line says.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "units.txt")
    >>> _ = path.write_bytes(b"\xb5m/s")
    >>> read_text(path)
    'µm/s'
    """
    content = read_bytes(path, most)
    if told := too_much_text(content):
        raise UserError(f"{path}: {told}; .nc and .mat files may be larger")
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
    if encoding is None and 0 in content and (half := len(content) // 2):
        zeros = content[::2].count(0), content[1::2].count(0)
        if min(zeros) == 0 and max(zeros) > 0.5 * half:
            encoding = "utf-16-le" if zeros[1] else "utf-16-be"
    for name in (encoding,) if encoding else ("utf-8", "cp1252"):
        try:
            text = content.decode(name).removesuffix("\x1a")  # the end of a file of DOS
        except UnicodeDecodeError:
            continue
        return None if any(c in text for c in CONTROL) else text
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


def unusable(name: str) -> str:
    """Say why neither a folder nor a group of netCDF can have a name; empty if both can.

    Examples
    --------
    >>> unusable("front"), unusable("-30 deg")
    ('', 'must begin with a letter, a digit or _, as 30 deg does')
    """
    if not re.match(r"\w|[^\x00-\x7f]", name):
        rest = re.sub(r"^[\W]+", "", name)
        return "must begin with a letter, a digit or _" + (f", as {rest} does" if rest else "")
    if set(name) & {"/", "\\"} or not name.isprintable():
        return "must be one that a folder can have, without / and \\ and what cannot be printed"
    if name != name.rstrip():
        return "must not end with a blank"
    if len(name.encode()) > LONGEST_NAME:
        return f"must not be longer than {LONGEST_NAME} bytes"
    return ""
