"""`stream=dask`: some of a field's frequencies at a time, by the optional package dask.

Tasks go to Dask's scheduler, whichever there is: threads of this process, processes, or a cluster.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from typing import Any

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError

#: A parameter of glibc's `mallopt`, and the bytes from which on arrays have pages of their own.
MMAP_THRESHOLD, LARGE = -3, 1 << 20


@register("stream", "dask")
@dataclass
class Dask:
    """Memory for some frequencies instead of all, on threads, processes or a Dask cluster.

    Needs the extra: ``pip install 'sldvexp[dask]'``. What does not depend on the frequency is done
    once; results are those of all frequencies at once, but for rounding.

    Parameters
    ----------
    frequencies : int
        That are in memory together.
    pixels : int
        Of one view that are in memory together where all frequencies are needed.
    workers : int
        Processes of their own on this machine; one that dies is replaced. 0 is this process alone.
    scheduler : str
        Address of a running ``dask scheduler`` instead, whose workers see the same files.
    """

    frequencies: int = 16
    pixels: int = 8192
    workers: int = 0
    scheduler: str = ""

    def __post_init__(self) -> None:
        checks = Checks()
        for name in ("frequencies", "pixels"):
            value = getattr(self, name)
            checks.require(value >= 1, name, f"must be 1 or more, not {value}")
        checks.require(self.workers >= 0, "workers", f"must be 0 or more, not {self.workers}")
        both = bool(self.workers and self.scheduler)
        checks.require(not both, "workers", "must be 0 if scheduler is given, which has its own")
        checks.done()

    @property
    def chunks(self) -> dict[str, int]:
        """Sizes of the chunks of images.

        Raises
        ------
        UserError
            If the package is not installed.
        """
        _require("dask.array")
        return {"pixel": self.pixels, "frequency": self.frequencies}

    @contextmanager
    def at_work(self) -> Iterator[Work]:
        """Open what does tasks, and close it at the end.

        Raises
        ------
        UserError
            If a package is not installed, the scheduler does not answer, or workers keep dying.
        """
        _require("dask.array")

        if not (self.workers or self.scheduler):
            _give_memory_back()
            yield Work(at_once=1)
            return
        _require("distributed")
        from distributed import Client, KilledWorker, LocalCluster, default_client

        with ExitStack() as opened:
            try:
                where: str | LocalCluster = self.scheduler or opened.enter_context(
                    LocalCluster(
                        self.workers, threads_per_worker=1, dashboard_address="127.0.0.1:0"
                    )
                )
                client = opened.enter_context(Client(where, timeout="10s"))
            except (OSError, ValueError) as error:
                told = (str(error) or type(error).__name__).splitlines()[0]
                with suppress(ValueError):  # there is none; else later runs would be given it
                    default_client().close()
                raise UserError(f"stream: there is no scheduler to be used: {told}") from None
            try:
                yield Work(at_once=max(1, sum(client.nthreads().values())))
            except KilledWorker as error:
                raise UserError(
                    "stream: several workers died at the same task, perhaps because they have too "
                    f"little memory; use fewer stream.frequencies than {self.frequencies} "
                    f"({str(error).splitlines()[0]})"
                ) from None


def _give_memory_back() -> None:
    """Let glibc return every large array at once, as Dask's own worker processes do."""
    with suppress(AttributeError, OSError):  # another C library
        ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, LARGE)


def _require(package: str) -> None:
    """Complain in a sentence if an optional package is missing."""
    try:
        import_module(package)
    except ImportError:
        raise UserError(
            f"stream=dask needs the package {package.partition('.')[0]}: pip install "
            "'sldvexp[dask]', or leave stream out, so that everything is in memory at once"
        ) from None


@dataclass(frozen=True)
class Work:
    """Worker at tasks, a few at a time, so that no more than these are in memory.

    Parameters
    ----------
    at_once : int
        How many.
    """

    at_once: int

    def share(self, what: Any) -> Any:
        """Share something that many tasks need, to be given to `map` in its place.

        A cluster has it once a worker, and makes it again if a worker dies.
        """
        import dask

        (shared,) = dask.persist(dask.delayed(what, traverse=False))
        return shared

    def map(self, function: Callable[..., Any], tasks: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
        """Compute ``function(*task)`` of every task in order; Dask arrays come as NumPy's."""
        import dask

        waiting = iter(tasks)
        while some := [dask.delayed(function)(*task) for task in islice(waiting, self.at_once)]:
            yield from dask.compute(*some)
