"""Tasks for Dask's scheduler, whichever there is: threads of this process, or a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

import dask


@dataclass(frozen=True)
class Work:
    """Does tasks, a few at a time, so that no more than these are in memory.

    Parameters
    ----------
    at_once : int
        How many.
    """

    at_once: int

    def share(self, what: Any) -> Any:
        """Something that many tasks need, to be given to `map` in its place.

        A cluster has it once a worker, and makes it again if a worker dies.
        """
        (shared,) = dask.persist(dask.delayed(what, traverse=False))
        return shared

    def map(self, function: Callable[..., Any], tasks: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
        """``function(*task)`` of every task, in their order; Dask arrays come as NumPy's."""
        waiting = iter(tasks)
        while some := [dask.delayed(function)(*task) for task in islice(waiting, self.at_once)]:
            yield from dask.compute(*some)
