"""The form of a hostile input, and what the lists have in common."""

from __future__ import annotations

import os
import shlex
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench import BESIDE, HERE

Content = str | bytes | Callable[[Path], object]

CONF = Path(__file__).parents[2] / "conf"
#: Bytes of a file that is too large for text; it takes no room on the disk.
HUGE = 3 * 2**30
#: Replaced by the path of the folder of a call, and of the one beside it.
FOLDER, NEIGHBOUR = "<here>", "<beside>"

#: Commands that leave the runs that inputs spoil.
RUNS = {
    "points": "experiment=point report=none",
    "pose": "experiment=pose report=none",
    "session": "~experiment report=none scene=plate scan=rectangle instrument=simulated "
    "signal=sine_fit 'scan.views={1: {corners: [[0, 0], [0, 9], [9, 9], [9, 0]]}}' "
    "scan.pixels=[2,3] scan.sampling.samples=128",
}


@dataclass
class Hostile:
    """One input: a command line, its files, and a part of what must be answered.

    Parameters
    ----------
    entrance : str
        Through which it comes.
    name : str
    arguments : str
        As in a shell.
    files : dict of str to Content
        By their paths; a function makes its file itself.
    told : str
        Must be in the answer.
    refused : bool
        Whether the exit status must be 1.
    packages : dict of str to str
        Code of installed packages with plugins, by their names.
    environment : dict of str to str
    device : callable, optional
        Talks to a client of a socket, whose port stands in the arguments as ``<port>``.
    given : str
        Key of `RUNS`: the run whose folder lies there as ``given`` before the files are made.
    """

    entrance: str
    name: str
    arguments: str
    files: dict[str, Content] = field(default_factory=dict)
    told: str = ""
    refused: bool = True
    packages: dict[str, str] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)
    device: Callable[[Any], None] | None = None
    given: str = ""

    @property
    def words(self) -> list[str]:
        """Arguments of the command line."""
        return shlex.split(self.arguments)

    def lay(self, folder: Path, runs: Mapping[str, Path]) -> None:
        """Make the files below the folder of a call."""
        for name in (HERE, BESIDE):
            (folder / name).mkdir(exist_ok=True)
        (folder / BESIDE / "kept").write_text("kept")
        if self.given:
            shutil.copytree(runs[self.given], folder / HERE / "given", symlinks=True)
        for name, content in self.files.items():
            file = folder / HERE / name
            file.parent.mkdir(parents=True, exist_ok=True)
            if callable(content):
                content(file)
            else:
                file.write_bytes(content if isinstance(content, bytes) else content.encode())
        for name, code in self.packages.items():
            info = folder / "site" / f"{name}-2.1.dist-info"
            info.mkdir(parents=True)
            about = f"Metadata-Version: 2.1\nName: {name}\nVersion: 2.1\n"
            (info / "METADATA").write_text(about)
            (info / "entry_points.txt").write_text(f"[sldvexp.plugins]\nextra = {name}\n")
            (folder / "site" / f"{name}.py").write_text(code)


def later(content: Callable[[], str | bytes]) -> Callable[[Path], None]:
    """Much content, which is made with its file: most who list the inputs lay none."""

    def make(path: Path) -> None:
        made = content()
        path.write_bytes(made if isinstance(made, bytes) else made.encode())

    return make


def link(to: str) -> Callable[[Path], None]:
    """A link in place of a file."""
    return lambda path: path.symlink_to(to)


def sparse(path: Path) -> None:
    """A file of 3 GB."""
    with path.open("wb") as file:
        file.truncate(HUGE)


def sparse_after(start: bytes) -> Callable[[Path], None]:
    """A file of 3 GB that begins well."""

    def make(path: Path) -> None:
        path.write_bytes(start)
        os.truncate(path, HUGE)

    return make


def folder(path: Path) -> None:
    """A folder in place of a file."""
    path.mkdir()


def fifo(path: Path) -> None:
    """A pipe that nobody writes to."""
    os.mkfifo(path)


def listening(path: Path) -> None:
    """A socket."""
    import socket

    here = os.getcwd()
    os.chdir(path.parent)  # names of sockets are short
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(path.name)
    os.chdir(here)
