"""Named arrays in one file as numpy keeps them, `numpy.savez`, written several times as fast.

A session keeps thousands of small scan lines, and most of the time of each goes into opening and
closing the entries of an archive. This writes the same archive at once: entries that are not
compressed, each an array as `numpy.save` writes it.
"""

from __future__ import annotations

import struct
import zlib
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
    parts, listed, at = [], [], 0
    for name, array in arrays.items():
        content = np.ascontiguousarray(array).reshape(array.shape)
        head, data = _head(content.dtype, content.shape), content.tobytes()
        entry, size = f"{name}.npy".encode(), len(head) + len(data)
        about = (0, 0, 0, FIRST_DAY, zlib.crc32(data, zlib.crc32(head)), size, size, len(entry), 0)
        parts += [ENTRY.pack(b"PK\3\4", VERSION, *about), entry, head, data]
        listed += [LISTED.pack(b"PK\1\2", VERSION, VERSION, *about, 0, 0, 0, 0, at), entry]
        at += ENTRY.size + len(entry) + size
    length, number = sum(map(len, listed)), len(arrays)
    end = END.pack(b"PK\5\6", 0, 0, number, number, length, at, 0)
    file.write(b"".join([*parts, *listed, end]))


@lru_cache(maxsize=256)
def _head(dtype: np.dtype[np.generic], shape: tuple[int, ...]) -> bytes:
    """Write what stands before the numbers of an array."""
    file = BytesIO()
    about = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, about)
    return file.getvalue()
