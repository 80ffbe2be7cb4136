"""A board that browsers read: topics whose last word counts, and pictures that grow.

The bench writes here and never waits for a browser. Every browser has a `Reader` of its own, which
takes what is new since it read last: of a topic only the last word, of a picture all its parts in
their order. So a slow browser, or one that comes late, has the same in the end and holds up nobody.
"""

from __future__ import annotations

import json
import struct
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Parts of pictures that a browser gets at once at most; between them it hears of topics.
AT_ONCE = 64


class NoticeBoard:
    """Board of all that browsers see, written by some threads and read by others."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0
        self._topics: dict[str, tuple[int, str]] = {}
        self._pictures: dict[str, _Picture] = {}
        self._readers: set[Reader] = set()

    def tell(self, topic: str, word: Any) -> None:
        """Write the last word on a topic, made of lists, tables, texts and numbers."""
        text = json.dumps({"topic": topic, "word": word}, allow_nan=False)
        with self._lock:
            known = self._topics.get(topic)
            if known is not None and known[1] == text:
                return
            self._count += 1
            self._topics[topic] = (self._count, text)
        self._wake()

    def begin(self, picture: str, arrays: Sequence[NDArray[Any]] = (), **header: Any) -> None:
        """Begin a picture anew, perhaps with arrays; what it had is forgotten."""
        with self._lock:
            self._count += 1
            part = packed({"picture": picture, "begin": True, **header}, arrays)
            self._pictures[picture] = _Picture(self._count, [part])
        self._wake()

    def add(self, picture: str, arrays: Sequence[NDArray[Any]], **header: Any) -> None:
        """Add a part to a picture that was begun."""
        part = packed({"picture": picture, **header}, arrays)
        with self._lock:
            self._pictures[picture].parts.append(part)
        self._wake()

    def reader(self, wake: Callable[[], None]) -> Reader:
        """Make a reader to whom everything is new; `wake` is called from any thread."""
        made = Reader(self, wake)
        with self._lock:
            self._readers.add(made)
        return made

    def leave(self, reader: Reader) -> None:
        """Forget a reader."""
        with self._lock:
            self._readers.discard(reader)

    def news(self, reader: Reader) -> tuple[list[str | bytes], bool]:
        """Give what is new for a reader, and whether there is more."""
        found: list[str | bytes] = []
        more = False
        with self._lock:
            for count, text in sorted(self._topics.values()):
                if count > reader.count:
                    found.append(text)
            reader.count = self._count
            for name, picture in self._pictures.items():
                begun, read = reader.read.get(name, (0, 0))
                read = read if begun == picture.begun else 0
                parts = picture.parts[read : read + AT_ONCE]
                found += parts
                reader.read[name] = (picture.begun, read + len(parts))
                more |= read + len(parts) < len(picture.parts)
        return found, more

    def _wake(self) -> None:
        with self._lock:
            readers = list(self._readers)
        for reader in readers:
            reader.wake()


@dataclass
class _Picture:
    """A picture that grows: when it was begun, and its parts."""

    begun: int
    parts: list[bytes]


@dataclass(eq=False)
class Reader:
    """How far a browser has read."""

    board: NoticeBoard
    wake: Callable[[], None]
    count: int = 0
    read: dict[str, tuple[int, int]] = field(default_factory=dict)


def packed(header: dict[str, Any], arrays: Sequence[NDArray[Any]]) -> bytes:
    r"""Pack a header and arrays: its length, the header as JSON, and the arrays, each at fours.

    Examples
    --------
    >>> packed({"a": 1}, [np.array([1, 2], np.int16)])[:4]
    b' \x00\x00\x00'
    """
    shapes = [[a.dtype.str[1:], a.size] for a in arrays]
    text = json.dumps({**header, "arrays": shapes}, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    parts = [np.ascontiguousarray(a, a.dtype.newbyteorder("<")).tobytes() for a in arrays]
    padded = [part + b"\0" * (-len(part) % 4) for part in parts]
    return b"".join([struct.pack("<I", len(text)), text, *padded])
