"""How far a sweep is whose runs other processes do: each leaves a sign, which is watched for."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType

#: Folder of the signs, in that of the sweep.
SIGNS = ".signs"
PERIOD = 0.5  # s


def leave_sign(run: Path, computed: bool) -> None:
    """Let the process that watches know that a run has come to its end.

    Parameters
    ----------
    run : Path
        Its folder.
    computed : bool
        Whether it was done now.
    """
    signs = run.parent / SIGNS
    with suppress(OSError):  # the run itself is not the worse for it
        signs.mkdir(exist_ok=True)
        (signs / f"{int(computed)}{run.name}").touch()


class Watch:
    """Looks for signs while it is entered; none is missed at the end.

    Parameters
    ----------
    folder : Path
        Of the sweep.
    tell : callable
        Gets the folder of each run that came to its end, and whether it was done now.
    """

    def __init__(self, folder: Path, tell: Callable[[str, bool], None]):
        self.folder, self.tell = folder, tell
        self._seen: set[str] = set()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Watch:
        shutil.rmtree(self.folder / SIGNS, ignore_errors=True)  # of a sweep that was killed
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._over.set()
        self._thread.join()
        self._look()
        shutil.rmtree(self.folder / SIGNS, ignore_errors=True)

    def _watch(self) -> None:
        while not self._over.wait(PERIOD):
            self._look()

    def _look(self) -> None:
        signs = self.folder / SIGNS
        names = {sign.name for sign in signs.iterdir()} if signs.is_dir() else set()
        for name in sorted(names - self._seen):
            self._seen.add(name)
            self.tell(str(self.folder / name[1:]), name[0] == "1")
