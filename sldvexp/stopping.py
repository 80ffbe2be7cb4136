"""Ctrl-C, and the signals by which a system ends a program: all of them stop it in the same order.

SIGTERM comes from whoever shuts a machine or a job down, SIGHUP from a terminal that is closed.
"""

from __future__ import annotations

import errno
import os
import platform
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

try:
    import termios
except ImportError:  # Windows
    termios = None  # type: ignore[assignment]

#: Ctrl-C, and what means the same; Windows has no SIGHUP.
SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
#: Shells say so of a program that a signal ended; it is added to the signal's number.
ENDED_BY_SIGNAL = 128

#: How often a worker looks for the process that it works for, s.
PERIOD = 0.5
#: How long a worker may take to end in order, once nobody waits for it any more, s.
GRACE = 5.0

#: Held by what must not be cut short, such as an instrument on its way home.
_busy = threading.RLock()


class Stopped(KeyboardInterrupt):
    """Ctrl-C, or what means the same.

    Parameters
    ----------
    number : int
        Of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


def exit_status(stop: KeyboardInterrupt) -> int:
    """Give the exit status of a program that was stopped: 130 by Ctrl-C, 143 by SIGTERM.

    Examples
    --------
    >>> exit_status(KeyboardInterrupt()), exit_status(Stopped(signal.SIGTERM))
    (130, 143)
    """
    return ENDED_BY_SIGNAL + int(getattr(stop, "number", signal.SIGINT))


def heed() -> None:
    """Let the signals that would end this process at once stop it as Ctrl-C does."""
    for number in SIGNALS[1:]:
        if _in_main_thread() and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _stop)


@contextmanager
def handlers_kept() -> Iterator[None]:
    """Give back at the end what a program that calls this one does about the signals."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            if _in_main_thread() and handler is not None:
                signal.signal(number, handler)


@contextmanager
def stopping_once() -> Iterator[None]:
    """Stop at the first signal, and with it the program; more of them do nothing.

    So an impatient second one can neither keep the mirrors from going home nor take away what the
    operator is told at the end.
    """
    heeded = _heeded()

    def stop(number: int, frame: object) -> None:
        for each in heeded:
            signal.signal(each, signal.SIG_IGN)
        _stop(number, frame)

    before = {number: signal.signal(number, stop) for number in heeded}
    try:
        yield
    finally:
        for number, handler in before.items():
            if signal.getsignal(number) is stop:
                signal.signal(number, handler)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let all signals wait until what is inside has ended."""
    came: list[int] = []
    before = {n: signal.signal(n, lambda number, _: came.append(number)) for n in _heeded()}
    try:
        with _busy:
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(came[0])


def _stop(number: int, _: object) -> None:
    """Stop what the main thread does."""
    _leave_lost_terminal()
    raise Stopped(number)


def _leave_lost_terminal() -> None:
    """Say nothing more to a terminal that is gone, as every word to it would be an error."""
    for output in (1, 2):
        try:
            if termios is not None:
                termios.tcgetattr(output)
        except termios.error as error:
            if error.args[0] == errno.EIO:  # what is no terminal answers otherwise
                os.dup2(os.open(os.devnull, os.O_WRONLY), output)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _heeded() -> Sequence[int]:
    """List the signals that this thread is told of, and that this process does not ignore."""
    ignored = (signal.SIG_IGN, None)
    return [n for n in SIGNALS if _in_main_thread() and signal.getsignal(n) not in ignored]


def this_process() -> tuple[str, int]:
    """Name this process so that others on the same machine can look for it."""
    space = Path("/proc/self/ns/pid")  # containers count their processes each for itself
    with suppress(OSError):
        return f"{platform.node()} {os.readlink(space)}", os.getpid()
    return platform.node(), os.getpid()


@cache
def end_with(owner: tuple[str, int]) -> None:
    """End this process, in order and soon, when the one is gone that it works for.

    Parameters
    ----------
    owner : tuple
        As `this_process` names it; one on another machine cannot be looked for.
    """
    (place, process), (here, own) = owner, this_process()
    if place != here or process == own or not is_alive(process):
        return
    heed()
    threading.Thread(target=_end_after, args=(process,), daemon=True).start()


def _end_after(process: int) -> None:
    while is_alive(process):
        time.sleep(PERIOD)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    with _busy:
        os._exit(ENDED_BY_SIGNAL + signal.SIGTERM)


def is_alive(process: int) -> bool:
    """Tell whether a process of this machine is alive; one that is dead but not buried is not.

    Examples
    --------
    >>> is_alive(os.getpid())
    True
    """
    if os.name == "nt":  # where asking would end it
        return True
    with suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # somebody else's
        return True
    return True
