"""Replaces files in a single step, so that one is there whole or not at all.

A power cut takes what was not synced: a file's content until the file is, a name until its folder
is. So a file is written beside its place and synced, renamed, and then its folder is synced. Many
files that belong together are made in a folder beside them, see `take_over`.
"""

from __future__ import annotations

import errno
import os
import platform
import re
import shutil
import stat
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from sldvexp.errors import UserError
from sldvexp.stopping import is_alive

#: A disk that does not take so many bytes is full.
LITTLE = 2**20
FULL = (errno.ENOSPC, errno.EDQUOT)
#: Answers of file systems that cannot sync a folder, or anything.
NO_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)
#: In a run's folder: where its results are made, and where they wait to be put in their places.
NEW, READY = ".new-run", ".ready-run"
#: In `READY`: names of files that go when the new ones come, one a line.
OUTDATED = ".outdated"
#: In the names of files and folders that one process makes for itself.
OWN = "sldvexp"
#: After so long nobody on another machine is at work with a file any more, s.
FORGOTTEN = 86400.0


def require_no_links(folder: Path) -> None:
    """Complain about links, pipes and devices in a folder that is written to.

    What a link leads to is not the run's. The folder itself may be one.

    Raises
    ------
    UserError
    """
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(place, name)
            require_no_link(path)
            if name in files and not stat.S_ISREG(path.lstat().st_mode):
                told = "is a device or a pipe; remove it, or choose another folder"
                raise UserError(f"{path}: {told}")


def require_no_link(path: Path) -> None:
    """Complain about a link in the place of something that is written.

    Raises
    ------
    UserError
    """
    if path.is_symlink():
        raise UserError(
            f"{path}: is a link to {os.readlink(path)}, and what is written there would leave the "
            "run's folder; remove the link, or choose another folder"
        )


def sync(path: Path) -> None:
    """Have the disk take what a file holds, or which names a folder has.

    It is then still there after a power cut.
    """
    if os.name == "nt" and path.is_dir():
        return
    opened = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(opened)
    except OSError as error:
        if error.errno not in NO_SYNC:
            raise
    finally:
        os.close(opened)


def sync_all(folder: Path) -> None:
    """Sync a folder and everything below it."""
    for below in sorted(folder.rglob("*")):
        if not below.is_symlink():
            sync(below)
    sync(folder)


def make_folder(path: Path) -> None:
    """Make a folder, and those that are missing above it, so that a power cut leaves them there."""
    if path.is_dir():
        return
    missing = [p for p in (path, *path.parents) if not p.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for made in missing:
        sync(made.parent)


@contextmanager
def whole_or_nothing(path: Path, lasting: bool = True) -> Iterator[Path]:
    """Give a path beside `path` to write to, which takes its place when all went well.

    Parameters
    ----------
    lasting : bool
        Whether it must survive a power cut; what can be made again at once need not. Results in
        `NEW` are synced together, when they take their places.

    Raises
    ------
    UserError
        If the folder is missing or not writable, or the disk is full.
    """
    with _replacing(path, lasting) as beside:
        beside.touch()
        yield beside


@contextmanager
def whole_file(path: Path, lasting: bool = True) -> Iterator[BinaryIO]:
    """Give a file to write bytes to, as `whole_or_nothing` gives a path.

    Opened once, many small ones take a third less time.
    """
    with _replacing(path, lasting) as beside, beside.open("xb") as file:
        yield file


@contextmanager
def _replacing(path: Path, lasting: bool) -> Iterator[Path]:
    """Give the path of a file that is to be made, and put it in its place when all went well."""
    beside = path.with_name(f".{path.stem}.{_here()}{path.suffix}")
    lasting = lasting and NEW not in path.parts
    try:
        beside.unlink(missing_ok=True)  # a link would lead elsewhere
        yield beside
        if lasting:
            sync(beside)
        os.replace(beside, path)
        if lasting:
            sync(path.parent)
    except (OSError, RuntimeError) as error:
        full = _full(beside)  # which HDF5 does not tell: it says "Permission denied" or "HDF error"
        if not full and isinstance(error, RuntimeError):
            raise
        told = full or getattr(error, "strerror", None) or error
        raise UserError(f"{path}: cannot be written: {told}") from None
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)


def _full(path: Path) -> str:
    """Ask what the system says if the disk of a file, of which nothing is kept, is full."""
    try:
        with path.open("ab") as file:
            file.write(bytes(LITTLE))
    except OSError as error:
        if error.errno in FULL:
            return error.strerror or str(error)
    return ""


def own_folder(folder: Path, name: str) -> Path:
    """Make a folder of this process alone in another; `sweep_up` removes it if it is killed."""
    own = folder / f".{name}.{_here()}"
    own.mkdir(parents=True, exist_ok=True)
    return own


@contextmanager
def making(folder: Path) -> Iterator[Path]:
    """Give the folder's `NEW` to make results in; it does not stay if there are none."""
    new = folder / NEW
    new.mkdir(exist_ok=True)
    try:
        yield new
    finally:
        with suppress(OSError):  # it has something, or has become `READY`
            new.rmdir()


def take_over(folder: Path, outdated: Collection[str] = ()) -> None:
    """Put everything that was made in the folder's `NEW` in the place of what it has already.

    From one moment on this is decided: before it the folder is as it was, afterwards whoever comes
    next goes on with it, see `settle`.

    Parameters
    ----------
    outdated : collection of str
        Names of files in `folder` that go when the new ones come.

    Raises
    ------
    UserError
        If the folder cannot be written, or a file is to come where a folder is.
    """
    new = folder / NEW
    for entry in new.iterdir():
        place = folder / entry.name
        if place.exists() and place.is_dir() != entry.is_dir():
            told = "is a folder" if place.is_dir() else "is no folder"
            raise UserError(f"{place}: cannot be written: it {told}")
    try:
        if outdated:
            (new / OUTDATED).write_text("\n".join(outdated))
        sync_all(new)
        os.rename(new, folder / READY)
        sync(folder)
        settle(folder)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None


def settle(folder: Path) -> None:
    """Finish what `take_over` has decided; every step can be done again."""
    ready = folder / READY
    if ready.is_symlink() or not ready.is_dir():  # only this program makes it, and no link
        return
    told = ready / OUTDATED
    for name in told.read_text().splitlines() if told.is_file() else []:
        (folder / Path(name).name).unlink(missing_ok=True)
    entries = [entry for entry in ready.iterdir() if entry != told]
    for entry in sorted(entries, key=lambda e: (e.suffix == ".nc", e.name)):
        _replace(entry, folder / entry.name)  # where the dataset is, all the others are
    sync(folder)
    shutil.rmtree(ready)


@contextmanager
def replacing(folder: Path) -> Iterator[Path]:
    """Give an empty folder; what is made there replaces what `folder` has when all went well.

    Raises
    ------
    UserError
        If the folder cannot be written.
    """
    try:
        own = own_folder(folder, "made")
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None
    try:
        yield own
        sync_all(own)
        for entry in sorted(own.iterdir()):
            _replace(entry, folder / entry.name)
        sync(folder)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(own, ignore_errors=True)


def _replace(entry: Path, place: Path) -> None:
    """Put a file into its place, or all files of a folder; others that are there stay."""
    if not entry.is_dir():
        os.replace(entry, place)  # a link there is replaced, not what it leads to
        return
    if place.is_symlink():
        place.unlink()
    make_folder(place)
    for below in sorted(entry.iterdir()):
        _replace(below, place / below.name)
    sync(place)


def sweep_up(folder: Path, below: Path) -> None:
    """Finish or remove what killed processes left in a folder that nobody else is at work in.

    Parameters
    ----------
    below : Path
        Folder in it that is looked through with all that is below.

    Raises
    ------
    UserError
        If what was decided cannot be finished.
    """
    try:
        settle(folder)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None
    _remove(folder / NEW)
    remove_leftovers(folder, below)


def remove_leftovers(folder: Path, below: Path) -> None:
    """Remove what killed processes had not finished in a folder; see `sweep_up`."""
    for left in (*leftovers(folder), *leftovers(below, "**/")):
        _remove(left)


def leftovers(folder: Path, where: str = "") -> list[Path]:
    """List what killed processes had not finished in a folder, or in those below it.

    Parameters
    ----------
    where : str
        Which of them, as in ``*/``.
    """
    return [p for p in folder.glob(f"{where}.*.{OWN}-*") if not _may_be_in_use(p)]


def _remove(path: Path) -> None:
    """Remove a file, a link, or a folder with all that is below, as far as that is possible."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()


def _here() -> str:
    """Name this process among all that may write to a folder, also those of other machines."""
    return f"{OWN}-{os.getpid()}-{platform.node()}"


def _may_be_in_use(left: Path) -> bool:
    """Tell whether the process may be at work that made a file or folder for itself."""
    made = re.fullmatch(rf"\..*\.{OWN}-(\d+)-(.*)", left.name)
    if made is None:
        return True
    process = int(made[1])
    if not made[2].startswith(platform.node()):
        with suppress(FileNotFoundError):
            return time.time() - left.stat().st_mtime < FORGOTTEN
        return False
    return process != os.getpid() and is_alive(process)
