"""Memory of one part of a field for the next: the system would have to clear it again.

A part's arrays are freed before the next part's are made. The C library of Linux then gives memory
back, and gets it again page by page, each of which the system fills with zeros: a seventh of the
time of a field of 65 thousand nodes.
"""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

#: Names that ``mallopt`` has for the free memory at the end of the heap from which it is given
#: back, and for the size from which an array has pages of its own, given back at once.
TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
#: Both as the library comes to by itself while large arrays are freed.
USUAL_TRIM, LARGEST = 2**26, 2**25


@cache
def _library() -> Any:
    """Find the C library whose memory can be told to stay; None if it is another one."""
    return ctypes.CDLL(None) if platform.libc_ver()[0] == "glibc" else None


@contextmanager
def kept_memory() -> Iterator[None]:
    """Keep what is freed for what is made next, and give it back in the end."""
    library = _library()
    if library is None:
        yield
        return
    library.mallopt(MMAP_THRESHOLD, LARGEST)
    library.mallopt(TRIM_THRESHOLD, 2**31 - 1)
    try:
        yield
    finally:
        library.mallopt(TRIM_THRESHOLD, USUAL_TRIM)
        library.malloc_trim(0)
