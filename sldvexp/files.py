"""Files as a whole: is there one, is it text, and how to replace one in a single step."""

from __future__ import annotations

import errno
import os
import platform
from collections.abc import Iterator
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


def read_text(path: Path) -> str:
    """Read the text of a file.

    Raises
    ------
    UserError
        If it cannot be read or is not text.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise UserError(f"{path}: is not a text file, although its suffix says so")
    return text


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
