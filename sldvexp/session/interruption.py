"""Sentences about a session that stops before its end: what is kept, and how to go on."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sldvexp.config.paths import CONFIGURATION, JOURNAL
from sldvexp.errors import ConfigError, UserError
from sldvexp.instrument.person import mark_name

#: What says before a command that it goes on.
GO_ON = "go on with: "
#: How a sentence about the end of a run goes on that tells what is kept.
LINES_KEPT, SCAN_KEPT = "what was scanned is kept", "the scan is kept"


@dataclass(frozen=True)
class KeptScan:
    """What is kept of a run that ended before it was done, and the command that goes on with it.

    Parameters
    ----------
    told : str
    command : str
    mend : bool
        Whether it ends alike again unless something is mended first.
    """

    told: str
    command: str
    mend: bool = False

    def __str__(self) -> str:
        return f"{self.told} {GO_ON}{self.command}"


class EndedScanError(UserError):
    """Scan that has failed.

    Parameters
    ----------
    why : str
    not_home : str
        How the instrument may have been left, see `sldvexp.instrument.InstrumentError`.
    """

    def __init__(self, why: str, not_home: str = "", *further: str) -> None:
        super().__init__("; ".join(part for part in (why, not_home, *further) if part))
        self.why, self.not_home = why, not_home


class UnfinishedError(EndedScanError):
    """Run that has failed and whose scan is kept in a folder, so that it can go on."""

    def __init__(
        self, why: str, folder: Path, kept: KeptScan | None = None, not_home: str = ""
    ) -> None:
        self.folder, self.kept = folder, kept or kept_lines(folder)
        super().__init__(why, not_home, str(self.kept))


class InterruptedRun(KeyboardInterrupt):
    """Run that somebody has stopped, with what it has scanned in a folder."""

    def __init__(self, why: str, folder: Path) -> None:
        self.why, self.folder, self.kept = why, folder, kept_lines(folder)
        super().__init__(f"{why}; {self.kept}")


def resume_here(folder: Path) -> str:
    """Give the command of a console that goes on with a run."""
    return f"sldvexp console {shlex.quote(f'resume={folder}')}"


def kept_lines(folder: Path, mend: bool = False) -> KeptScan:
    """Tell that the lines of a run are kept that stops before its end, and how it goes on."""
    return KeptScan(f"{LINES_KEPT},", f"sldvexp {shlex.quote(f'resume={folder}')}", mend)


def how_to_go_on(folder: Path) -> str:
    """Tell how to go on with a run that stops before its end and has scan lines."""
    return str(kept_lines(folder))


def has_lines(folder: Path) -> bool:
    """Tell whether a run's folder has anything that was measured."""
    files = (path for path in (folder / JOURNAL).rglob("*") if path.is_file())
    return any(path.name != CONFIGURATION for path in files)


def ended_scan(why: str, folder: Path, not_home: str = "") -> EndedScanError:
    """Give the error of a scan that failed, which can go on if a line of it is kept."""
    if has_lines(folder):
        return UnfinishedError(why, folder, not_home=not_home)
    return EndedScanError(why, not_home)


def how_to_use_the_scan(folder: Path) -> str:
    """Tell how to use the scan that is kept where a run fails behind it."""
    return str(kept_scan(folder))


def kept_scan(folder: Path) -> KeptScan:
    """Tell that the scan is kept of a run that fails behind it, and how it goes on."""
    marks = (
        ", or take marks again (it asks for those that contradict one another, and for each whose "
        f"file {JOURNAL}/<view>/{mark_name('<number>')}.json you delete)"
    )
    by_hand = any((folder / JOURNAL).rglob(f"{mark_name('*')}.json"))
    told = (
        f"{SCAN_KEPT}: mend the configuration's file, or add settings that differ at the end"
        f"{marks * by_hand}, and"
    )
    return KeptScan(told, kept_lines(folder).command)


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
        raise UnfinishedError(str(error), folder, kept_scan(folder)) from error
