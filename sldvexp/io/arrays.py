"""Named arrays in one file as numpy keeps them, `numpy.savez`, written and read many times as fast.

A session keeps thousands of small scan lines, and most of the time of each goes into opening and
closing the entries of an archive. This writes the same archive at once: entries that are not
compressed, each an array as `numpy.save` writes it. What was written so is read at once as well,
after all of it has been compared with what would be written of these arrays; any other archive is
left to numpy.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Sequence
from functools import lru_cache
from io import BytesIO
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

#: Numbers of the ZIP format: version that an entry needs, and the first day it knows, 1.1.1980.
VERSION, FIRST_DAY = 20, 0x21
#: Entries and the whole file must be smaller, or sizes need fields of their own, bytes.
LARGEST = 2**31

ENTRY = struct.Struct("<4s5H3I2H")
LISTED = struct.Struct("<4s6H3I5H2I")
END = struct.Struct("<4s4H2IH")
#: What an array begins with, and how long its description is.
HEAD, MAGIC = struct.Struct("<8sH"), b"\x93NUMPY\1\0"


def write_arrays(file: BinaryIO, **arrays: NDArray[np.generic]) -> None:
    """Write arrays that `numpy.load` reads by their names.

    Parameters
    ----------
    file : binary file
        Empty.
    **arrays : ndarray
        Of numbers.

    Examples
    --------
    >>> file = BytesIO()
    >>> write_arrays(file, dac=np.arange(3), rate=np.array(2.5))
    >>> kept = np.load(BytesIO(file.getvalue()))
    >>> kept["dac"].tolist(), float(kept["rate"])
    ([0, 1, 2], 2.5)
    """
    if sum(array.nbytes for array in arrays.values()) > LARGEST:
        np.savez(file, **arrays)  # type: ignore[arg-type]
        return
    parts: list[bytes | memoryview] = []
    entries, at = [], 0
    for name, array in arrays.items():
        content = np.ascontiguousarray(array).reshape(array.shape)
        head, data = _head(content.dtype, content.shape), content.reshape(-1).view(np.uint8).data
        entry, size = f"{name}.npy".encode(), len(head) + len(data)
        about = _about(zlib.crc32(data, zlib.crc32(head)), size, len(entry))
        parts += [ENTRY.pack(b"PK\3\4", VERSION, *about), entry, head, data]
        entries.append((entry, about, at))
        at += ENTRY.size + len(entry) + size
    file.writelines([*parts, _end(entries, at)])


def read_arrays(content: bytes) -> dict[str, NDArray[np.generic]] | None:
    """Read the arrays of a file that `write_arrays` wrote; None of any other, sound or damaged.

    Examples
    --------
    >>> file = BytesIO()
    >>> write_arrays(file, dac=np.arange(3), rate=np.array(2.5))
    >>> read_arrays(file.getvalue())["dac"].tolist()
    [0, 1, 2]
    >>> read_arrays(file.getvalue()[:-1]) is None
    True
    """
    found: dict[str, NDArray[np.generic]] = {}
    entries, at, view = [], 0, memoryview(content)
    while content.startswith(b"PK\3\4", at) and len(content) - at > ENTRY.size:
        _, version, *about = ENTRY.unpack_from(content, at)
        size, length = about[5], about[7]
        first = at + ENTRY.size + length
        entry, stored = content[at + ENTRY.size : first], view[first : first + size]
        as_written = list(_about(zlib.crc32(stored), len(stored), len(entry)))
        if version != VERSION or about != as_written or not entry.endswith(b".npy"):
            return None
        if (array := _array(content, first, first + size)) is None:
            return None
        found[entry.decode("utf-8", "replace").removesuffix(".npy")] = array
        entries.append((entry, tuple(about), at))
        at = first + size
    return found if content[at:] == _end(entries, at) and len(found) == len(entries) else None


#: What the list of an archive says of an entry, with its name and where it begins.
_Entry = tuple[bytes, tuple[int, ...], int]


def _about(checksum: int, size: int, name: int) -> tuple[int, ...]:
    """Give what stands in an entry and in the list: flags, method, time, day and so on."""
    return 0, 0, 0, FIRST_DAY, checksum, size, size, name, 0


def _end(entries: Sequence[_Entry], at: int) -> bytes:
    """Write the list of the entries, which begins so far from the start, and what ends it."""
    listed = b"".join(
        LISTED.pack(b"PK\1\2", VERSION, VERSION, *about, 0, 0, 0, 0, start) + entry
        for entry, about, start in entries
    )
    number = len(entries)
    return listed + END.pack(b"PK\5\6", 0, 0, number, number, len(listed), at, 0)


@lru_cache(maxsize=256)
def _head(dtype: np.dtype[np.generic], shape: tuple[int, ...]) -> bytes:
    """Write what stands before the numbers of an array."""
    file = BytesIO()
    about = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, about)
    return file.getvalue()


def _array(content: bytes, first: int, stop: int) -> NDArray[np.generic] | None:
    """Make an array of its own of the bytes of an entry; None if `_head` did not begin it."""
    start = first + HEAD.size
    if stop < start:
        return None
    magic, length = HEAD.unpack_from(content, first)
    head = content[first : start + length]
    known = _known(head) if magic == MAGIC else None
    if known is None or stop != first + len(head) + known[2]:
        return None
    dtype, shape, size = known
    numbers = np.frombuffer(content, dtype, size // dtype.itemsize, first + len(head))
    return numbers.reshape(shape).copy()


@lru_cache(maxsize=256)
def _known(head: bytes) -> tuple[np.dtype[np.generic], tuple[int, ...], int] | None:
    """Read what `_head` wrote: kind of numbers, shape, and how many bytes; None of all else."""
    try:
        read = np.lib.format.read_array_header_1_0(BytesIO(head[len(MAGIC) :]))
    except ValueError:
        return None
    shape, fortran, dtype = read
    if fortran or dtype.hasobject or not dtype.itemsize or head != _head(dtype, shape):
        return None
    return dtype, shape, math.prod(shape) * dtype.itemsize
