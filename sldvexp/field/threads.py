"""Views side by side: numpy and scipy let others work while they compute."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

MOST_THREADS = 4


def side_by_side(work: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """Compute ``[work(item) for item in items]``, several at once."""
    with ThreadPoolExecutor(min(MOST_THREADS, os.cpu_count() or 1)) as pool:
        return list(pool.map(work, items))
