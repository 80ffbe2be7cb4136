"""The legacy text files of a scan: `Scan6pt`, `ScanRect` and `ScanList` (Appendix A).

Pairs stand in the files as left-right, up-down; here and in every array up_down comes first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.files import read_text, require_file
from sldvexp.typing import IntArray
from sldvexp.writing import whole_or_nothing


def read_centres(path: Path) -> IntArray:
    r"""Read rough centres of the circles (`Scan6pt`), shape (circle, 2), one pair a line.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "Scan6pt")
    >>> _ = path.write_text("100 200\n-50 25")
    >>> read_centres(path).tolist()
    [[200, 100], [25, -50]]
    """
    return _pairs(list(_rows(path)), path)


def read_rectangle(path: Path) -> tuple[int, int, IntArray]:
    r"""Read rows, columns and the four corners (`ScanRect`), the corners of shape (4, 2).

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "ScanRect")
    >>> _ = path.write_text("2 3\n0 0\n0 9\n5 9\n5 0")
    >>> rows, columns, corners = read_rectangle(path)
    >>> rows, columns, corners[1].tolist()
    (2, 3, [9, 0])
    """
    rows = list(_rows(path))
    if len(rows) != 5:
        raise UserError(
            f"{path}: needs a line of rows and columns and four of corners, has {len(rows)}"
        )
    (_, (first, second)), corners = rows[0], _pairs(rows[1:], path)
    if first < 1 or second < 1:
        raise UserError(f"{path}: rows and columns must be positive, not {first} and {second}")
    return first, second, corners


def read_list(path: Path) -> IntArray:
    """Read all pixels of a scan in their order (`ScanList`), shape (pixel, 2).

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "ScanList")
    >>> write_list(path, [(200, 100)])
    >>> read_list(path).tolist()
    [[200, 100]]
    """
    return _pairs(list(_rows(path)), path)


def write_list(path: Path, dac: Iterable[Iterable[int]]) -> None:
    """Write the pixels of a scan as `ScanList`; whole or not at all.

    Parameters
    ----------
    dac : iterable of pairs (up_down, left_right), steps

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "ScanList")
    >>> write_list(path, [(200, 100), (200, 101)])
    >>> path.read_text().splitlines()
    ['100 200', '101 200']
    """
    with whole_or_nothing(path) as beside:
        beside.write_text("".join(f"{lr} {ud}\n" for ud, lr in dac))


def _rows(path: Path) -> Iterator[tuple[int, tuple[int, int]]]:
    """Read line number and two whole numbers of every line that is neither blank nor a comment."""
    require_file(path)
    for line, text in enumerate(read_text(path).splitlines(), 1):
        cells = text.replace(",", " ").split()
        if not cells or cells[0].startswith("#"):
            continue
        try:
            first, second = map(int, cells)
            np.array([first, second], np.int64)  # which holds them
        except (ValueError, OverflowError):
            raise UserError(
                f"{path}, line {line}: must be two whole numbers, not {text.strip()!r}"
            ) from None
        yield line, (first, second)


def _pairs(rows: list[tuple[int, tuple[int, int]]], path: Path) -> IntArray:
    """Put up_down first in pairs."""
    if not rows:
        raise UserError(f"{path}: has no pixels")
    return np.array([(ud, lr) for _, (lr, ud) in rows], dtype=np.int64)
