"""Sentences about a session that stops before its end: what is kept, and how to go on."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sldvexp.config.paths import CONFIGURATION, JOURNAL
from sldvexp.errors import ConfigError, UserError
from sldvexp.instrument.person import mark_name

#: What says before a command that it goes on.
GO_ON = "go on with: "
#: How a sentence about the end of a run goes on that tells what is kept.
LINES_KEPT, SCAN_KEPT = "what was scanned is kept", "the scan is kept"


class UnfinishedError(UserError):
    """Run that has failed and whose scan is kept in a folder, so that it can go on."""

    def __init__(self, told: str, folder: Path):
        super().__init__(told)
        self.folder = folder


class InterruptedRun(KeyboardInterrupt):
    """Run that somebody has stopped, with what it has scanned in a folder."""

    def __init__(self, told: str, folder: Path):
        super().__init__(told)
        self.folder = folder


def how_to_go_on(folder: Path) -> str:
    """Tell how to go on with a run that stops before its end and has scan lines."""
    resume = shlex.quote(f"resume={folder}")
    return f"{LINES_KEPT}, {GO_ON}sldvexp {resume}"


def has_lines(folder: Path) -> bool:
    """Tell whether a run's folder has anything that was measured."""
    files = (path for path in (folder / JOURNAL).rglob("*") if path.is_file())
    return any(path.name != CONFIGURATION for path in files)


def how_to_use_the_scan(folder: Path) -> str:
    """Tell how to use the scan that is kept where a run fails behind it."""
    resume = shlex.quote(f"resume={folder}")
    marks = (
        ", or take marks again (it asks for those that contradict one another, and for each whose "
        f"file {JOURNAL}/<view>/{mark_name('<number>')}.json you delete)"
    )
    by_hand = any((folder / JOURNAL).rglob(f"{mark_name('*')}.json"))
    return (
        f"{SCAN_KEPT}: mend the configuration's file, or add settings that differ at the end"
        f"{marks * by_hand}, and {GO_ON}sldvexp {resume}"
    )


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
