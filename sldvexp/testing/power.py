"""Power cuts, on purpose: what a disk has of a folder when it took no more than was synced.

A disk has a file's content as of the file's last sync, and a folder's names as of the folder's. It
may also have later names, those of files whose content never came: both are tried.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

from sldvexp import writing

#: Of a record: what was there before ends here.
BEGUN = {"begun": True}


class Names(Enum):
    """Names that the disk has of files and folders.

    Attributes
    ----------
    synced
        Those that were synced, and no others.
    all
        All, also of files whose content it has not.
    """

    synced = "synced"
    all = "all"


class Disk:
    """Record of what was synced of a folder, kept where no power is cut.

    Parameters
    ----------
    folder : Path
        That is watched.
    record : Path
        Folder for the record, on the same disk.
    cut : int, optional
        Number of the sync, from 0, before which this process ends as by a power cut.
    """

    def __init__(self, folder: Path, record: Path, cut: int | None = None) -> None:
        self.folder, self.record, self._cut = folder.resolve(), record, cut
        self._count = 0
        self._opened: list[int] = []  # so that no other file or folder gets the same number
        shutil.rmtree(record, ignore_errors=True)
        record.mkdir(parents=True)
        for path in (self.folder, *self.folder.rglob("*")):
            self._note(path)
        self._write(BEGUN)

    def sync(self, path: Path) -> None:
        """Note what `path` has, in the place of `sldvexp.writing.sync`."""
        if not path.resolve().is_relative_to(self.folder):
            return
        if self._count == self._cut:
            os.kill(os.getpid(), signal.SIGKILL)
        self._count += 1
        self._note(path)

    def _note(self, path: Path) -> None:
        number = path.stat().st_ino
        if path.is_dir():
            self._opened.append(os.open(path, os.O_RDONLY))
            names = {p.name: (p.lstat().st_ino, p.is_dir()) for p in path.iterdir()}
            self._write({"folder": number, "names": names})
        else:
            if not (kept := self.record / str(number)).exists():
                os.link(path, kept)
            self._write({"file": number, "size": path.stat().st_size})

    def _write(self, line: dict[str, Any]) -> None:
        with (self.record / "synced").open("a") as file:
            file.write(f"{json.dumps(line)}\n")


def recorded(
    command: Callable[[], None],
    arguments: Sequence[str],
    folder: Path,
    record: Path,
    cut: int | None = None,
) -> None:
    """Run a command and record what it syncs of a folder, up to a power cut.

    Parameters
    ----------
    command : callable
        As the entry of the program; it reads `arguments` from ``sys.argv``.
    folder, record, cut
        See `Disk`.
    """
    writing.sync = Disk(folder, record, cut).sync
    sys.argv = ["sldvexp", *arguments]
    command()


def count_syncs(record: Path) -> int:
    """Count how often a process synced."""
    lines = (record / "synced").read_text().splitlines()
    return len(lines) - 1 - lines.index(json.dumps(BEGUN))


def cut_power(folder: Path, record: Path, names: Names) -> None:
    """Leave of a folder what the disk has of it after a power cut.

    Parameters
    ----------
    folder, record : Path
        See `Disk`; nothing may be at work with them any more.
    """
    sizes, listed = _read(record)
    after = folder.with_name(f"{folder.name}-after")

    def restore(number: int, place: Path, now: Path) -> None:
        place.mkdir()
        known = dict(listed.get(number, {}))
        if names is Names.all:
            known = {p.name: (p.lstat().st_ino, p.is_dir()) for p in now.iterdir()}
        for name, (inner, is_folder) in known.items():
            if is_folder:
                restore(inner, place / name, now / name)
            else:
                kept = record / str(inner)
                content = kept.read_bytes()[: sizes[inner]] if inner in sizes else b""
                (place / name).write_bytes(content)

    restore(folder.stat().st_ino, after, folder)
    shutil.rmtree(folder)
    after.rename(folder)


def _read(record: Path) -> tuple[dict[int, int], dict[int, dict[str, tuple[int, bool]]]]:
    """Read the last known size of every file, and the last known names of every folder."""
    sizes: dict[int, int] = {}
    listed: dict[int, dict[str, tuple[int, bool]]] = {}
    for text in (record / "synced").read_text().splitlines():
        line = json.loads(text)
        if "file" in line:
            sizes[line["file"]] = line["size"]
        elif "folder" in line:
            listed[line["folder"]] = {n: (i, d) for n, (i, d) in line["names"].items()}
    return sizes, listed
