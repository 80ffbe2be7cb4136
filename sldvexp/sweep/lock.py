"""One at a time: locks that the system itself takes back when a process is killed."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from sldvexp.config.paths import JOURNAL
from sldvexp.errors import UserError
from sldvexp.writing import leftovers, make_folder, remove_leftovers, sweep_up

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

#: In the folder that one process at a time may write to.
LOCK_FILE = ".lock"
#: What file systems without locks answer, as some of clusters are.
NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)


def _lock(opened: int, wait: bool) -> None:
    """Lock an open file; where there are no locks nobody can be kept out."""
    if fcntl is None:
        return
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise


@contextmanager
def locked(path: Path, wait: bool = True) -> Iterator[None]:
    """Hold the lock of a file, which is made if it is not there; its folder too.

    Parameters
    ----------
    wait : bool
        Until others let it go; otherwise BlockingIOError is raised.

    Raises
    ------
    UserError
        If the file cannot be made.
    """
    try:
        make_folder(path.parent)
        opened = os.open(path, os.O_CREAT | os.O_RDWR)
    except OSError as error:
        raise UserError(f"{path.parent}: cannot be written: {error.strerror or error}") from None
    try:
        _lock(opened, wait)
        yield
    finally:
        os.close(opened)


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Be the only one at work in the folder of a run, without what killed ones left there.

    Nor in the folders beside it, as each run has a new one.

    Raises
    ------
    UserError
        If another run is.
    """
    with ExitStack() as held:
        try:
            held.enter_context(locked(folder / LOCK_FILE, wait=False))
        except BlockingIOError:
            raise UserError(f"{folder}: another run is at work in this folder") from None
        sweep_up(folder, folder / JOURNAL)
        for killed in {left.parent for left in leftovers(folder.parent, "*/")}:
            with suppress(BlockingIOError, UserError), locked(killed / LOCK_FILE, wait=False):
                remove_leftovers(killed, killed / JOURNAL)
        yield
