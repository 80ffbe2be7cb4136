"""Ctrl-C in a session: it stops once, and never while the instrument is sent home."""

from __future__ import annotations

import shlex
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sldvexp.errors import ConfigError, UserError
from sldvexp.instrument.recording import JOURNAL
from sldvexp.session.journal import CONFIGURATION


def how_to_go_on(folder: Path) -> str:
    """Tell how to go on with a run that stops before its end and has scan lines."""
    resume = shlex.quote(f"resume={folder}")
    return f"what was scanned is kept, go on with: sldvexp {resume}"


def has_lines(folder: Path) -> bool:
    """Tell whether a run's folder has anything that was measured."""
    files = (path for path in (folder / JOURNAL).rglob("*") if path.is_file())
    return any(path.name != CONFIGURATION for path in files)


def how_to_use_the_scan(folder: Path) -> str:
    """Tell how to use the scan that is kept where a run fails behind it."""
    path = shlex.quote(f"instrument.path={folder}")
    return f"the scan is kept: repeat the command, mended, with instrument=replay {path}"


@contextmanager
def telling_of_the_scan(folder: Path, scanned: bool) -> Iterator[None]:
    """End a user's mistake in what runs inside with how to use the scan that is kept.

    Parameters
    ----------
    folder : Path
        Of the run.
    scanned : bool
        Whether the scan was finished before.
    """
    try:
        yield
    except ConfigError:  # which is told with the place of the setting
        raise
    except UserError as error:
        if not scanned or not has_lines(folder):
            raise
        raise UserError(f"{error}; {how_to_use_the_scan(folder)}") from error


@contextmanager
def stopping_once() -> Iterator[None]:
    """Stop at the first Ctrl-C, and with it the program; more of them do nothing.

    So an impatient second one can neither keep the mirrors from going home nor take away what the
    operator is told at the end.
    """
    if not _heeded():
        yield
        return

    def stop(*_: object) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is stop:
            signal.signal(signal.SIGINT, before)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let a Ctrl-C wait until what is inside has ended."""
    if not _heeded():
        yield
        return
    pressed: list[object] = []
    before = signal.signal(signal.SIGINT, lambda *_: pressed.append(_))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pressed:
        signal.raise_signal(signal.SIGINT)


def _heeded() -> bool:
    """Tell whether this thread is told of Ctrl-C, and this process does not ignore it."""
    main = threading.current_thread() is threading.main_thread()
    return main and signal.getsignal(signal.SIGINT) not in (signal.SIG_IGN, None)
