"""Files of a cache that is one user's alone, and what they hold for: a state of the program.

A state is told by names, sizes and times of all files of the program. Assumed is that the system
gives a changed file another time of change, which no program can set.

Nothing that takes time is imported: what is kept is read before anything else is loaded.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress

#: Folder of the user's cache; what others could write to or read is left alone.
CACHE = "sldvexp"
#: Files that the cache keeps, the newest, and the largest of them, bytes.
MOST_KEPT, LARGEST_KEPT = 100, 2**22
#: Length of the digest before what is kept, bytes.
DIGEST = hashlib.sha256().digest_size
#: Endings of files that decide what the program says.
DECIDES = (".py", ".pyi", ".yaml", ".yml")


class KeptFiles:
    """Files of the user's cache; there are none where others may write to it."""

    def __init__(self) -> None:
        self.folder = private_folder(CACHE)

    def read(self, name: str) -> bytes | None:
        """Read what was kept under a name; None if nothing whole was."""
        if not self.folder:
            return None
        with suppress(OSError):
            handle = os.open(os.path.join(self.folder, name), os.O_RDONLY | os.O_NOFOLLOW)
            with open(handle, "rb") as file:
                about = os.fstat(handle)
                if not _is_own(about, stat.S_ISREG, 0o022) or about.st_size > LARGEST_KEPT:
                    return None
                said, content = file.read(DIGEST), file.read()
            if hashlib.sha256(content).digest() == said:
                return content
        return None

    def write(self, name: str, content: bytes) -> None:
        """Keep something, if it can be kept."""
        if not self.folder:
            return
        beside = os.path.join(self.folder, f".{name}.{os.getpid()}")
        with suppress(OSError):
            new = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
            with open(os.open(beside, new, 0o600), "wb") as file:
                file.write(hashlib.sha256(content).digest() + content)
            os.replace(beside, os.path.join(self.folder, name))
            with os.scandir(self.folder) as entries:
                kept = sorted(entries, key=lambda entry: entry.stat().st_mtime)
            for old in kept[:-MOST_KEPT]:
                os.unlink(old.path)


def private_folder(name: str) -> str:
    """Make a folder in the user's cache; empty if it cannot be, or is not the user's alone."""
    root = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = os.path.join(root, name)
    with suppress(OSError):
        if not os.path.isdir(folder):
            os.makedirs(root, exist_ok=True)
            with suppress(FileExistsError):
                os.mkdir(folder, 0o700)
        if _is_own(os.lstat(folder), stat.S_ISDIR, 0o077):
            return folder
    return ""


def _is_own(about: os.stat_result, is_kind: Callable[[int], bool], others: int) -> bool:
    """Tell whether something is of the right kind, and this user's alone."""
    own = hasattr(os, "geteuid") and about.st_uid == os.geteuid()
    return own and is_kind(about.st_mode) and not about.st_mode & others


def name_of(*said: object) -> str:
    """Name what is kept by what decides it, beside the state of the program."""
    told = hashlib.sha256(f"{sys.version} {sys.executable} {said!r}".encode())
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    for folder in (package, os.path.join(os.path.dirname(package), "conf")):
        for line in sorted(_states(folder)):
            told.update(line.encode("utf-8", "surrogateescape"))
    return told.hexdigest()


def _states(folder: str) -> Iterator[str]:
    """Yield a line for every file of a folder that decides something."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                if entry.name != "__pycache__":
                    yield from _states(entry.path)
            elif entry.name.endswith(DECIDES):
                about = entry.stat()
                yield f"{entry.path} {about.st_mtime_ns} {about.st_ctime_ns} {about.st_size}\n"
