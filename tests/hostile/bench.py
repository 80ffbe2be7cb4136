"""Commands on hostile inputs, each in a process of its own that is forked from a warm one.

Run as a program this is the warm process: it has imported and composed what all calls share, reads
a call a line, forks, and answers what the child did: status, words, time, memory, and what it
touched outside of its folder. `Bench` is the side of the tests.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

#: Limits of any refusal: s of processor time, bytes.
SECONDS, BYTES = 5.0, 500 * 2**20
ROOT = str(Path(__file__).parents[2])
#: s after which a call is killed: it hangs, however busy the machine is.
LONGEST = float(os.environ.get("LONGEST", 40.0))
#: Names of folders of a call: where it runs, and what lies beside.
HERE, BESIDE = "here", "beside"
CHANGES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.chmod")
CHANGES += ("os.truncate", "os.utime", "shutil.rmtree", "shutil.move", "shutil.copyfile")
RUNS = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen")


@dataclass
class Outcome:
    """What a call did."""

    status: int
    out: str
    err: str
    seconds: float
    processor: float
    peak: int
    touched: list[str] = field(default_factory=list)

    @property
    def faults(self) -> list[str]:
        """What no call may do, whatever it was given."""
        found = [f"touched {what}" for what in self.touched]
        if "Traceback" in self.err + self.out:
            found.append("a traceback")
        if self.status not in (0, 1, 2, 130):
            found.append(f"ended with {self.status}")
        if self.status == 1 and not self.err:
            found.append("not a word")
        if self.status == 1 and not all(x.startswith("sldvexp: ") for x in self.err.splitlines()):
            found.append("other words than sentences")
        if any(not c.isprintable() for c in self.err.replace("\n", "")):
            found.append("control characters on the terminal")
        if len(self.err) > 4000:
            found.append(f"{len(self.err)} characters")
        if self.processor > SECONDS:
            found.append(f"{self.processor:.1f} s")
        if self.peak > BYTES:
            found.append(f"{self.peak >> 20} MB")
        return found


class Bench:
    """The warm process."""

    def __init__(self) -> None:
        self._warm = subprocess.Popen(
            [sys.executable, __file__],
            env={**os.environ, "PYTHONPATH": ROOT, "PYTHONDONTWRITEBYTECODE": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def close(self) -> None:
        """End it."""
        assert self._warm.stdin
        self._warm.stdin.close()
        self._warm.wait()

    def call(
        self,
        folder: Path,
        arguments: Sequence[str],
        paths: Sequence[str] = (),
        environment: Mapping[str, str] | None = None,
    ) -> Outcome:
        """Call the command in the folder `HERE` below `folder`.

        Parameters
        ----------
        paths : sequence of str
            More places to import from.
        """
        assert self._warm.stdin
        assert self._warm.stdout
        before = content(folder / BESIDE)
        asked = [str(folder), list(arguments), list(paths), dict(environment or {})]
        self._warm.stdin.write(json.dumps(asked) + "\n")
        self._warm.stdin.flush()
        done = Outcome(**json.loads(self._warm.stdout.readline()))
        if content(folder / BESIDE) != before:
            done.touched.append(BESIDE)
        return done


def content(folder: Path) -> dict[str, Any]:
    """Read everything below a folder."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        found[str(path)] = path.read_bytes() if path.is_file() else None
    return found


def _watch(folder: Path, touched: list[str]) -> None:
    """Note what this process changes outside of a folder and the cache, and what it starts."""
    inside = [os.path.realpath(folder), os.path.realpath(f"{os.environ['XDG_CACHE_HOME']}/sldvexp")]

    def note(event: str, given: tuple[Any, ...]) -> None:
        if event in RUNS:
            if given and "git" not in str(given[0]):
                touched.append(f"{event} {given[0]}")
            return
        if event == "open":
            path, _, flags = given
            if not isinstance(path, str | bytes | os.PathLike):
                return
            writing = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
            paths = [path] if writing else []
        elif event in CHANGES:
            paths = [p for p in given[:2] if isinstance(p, str | bytes | os.PathLike)]
            paths = paths if event in ("os.rename", "shutil.move") else paths[:1]
            if event in ("os.remove", "os.rmdir") and given[1] >= 0:  # relative to an open folder
                paths = [os.path.join(os.readlink(f"/proc/self/fd/{given[1]}"), paths[0])]
        else:
            return
        for path in paths:
            name = os.fsdecode(path)
            real = os.path.join(
                os.path.realpath(os.path.dirname(name) or "."), os.path.basename(name)
            )
            real = os.path.realpath(name) if event == "open" else real
            if not any(real == own or real.startswith(f"{own}/") for own in (*inside, "/dev")):
                touched.append(f"{event} {real}")

    sys.addaudithook(note)


def _child(
    folder: str, arguments: list[str], paths: list[str], environment: dict[str, str]
) -> None:
    """Do a call; what is noted goes to a file beside its words."""
    from sldvexp.cli import main
    from sldvexp.report.html.page import Html

    top = Path(folder)
    os.chdir(top / HERE)
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(top / name, os.O_CREAT | os.O_WRONLY | os.O_TRUNC), number)
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115
    with open("/proc/self/clear_refs", "w") as reset:
        reset.write("5")  # the peak of memory is this call's
    sys.path[:0] = paths
    os.environ.update(environment)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + 3 * 2**30, -1))
    resource.setrlimit(resource.RLIMIT_CPU, (30, 40))
    resource.setrlimit(resource.RLIMIT_FSIZE, (200 * 2**20, -1))
    sys.argv = ["sldvexp", *arguments]
    if arguments[:1] != ["report"]:  # a page takes a second, and every run would make one
        for name in ("of_run", "of_run_at_hand"):
            setattr(Html, name, lambda *_: None)
    touched: list[str] = []
    _watch(top / HERE, touched)
    noted = os.open(top / "noted", os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
    touched.clear()
    status = 99
    try:
        main.main()
    except SystemExit as stop:
        status = int(stop.code or 0)
    except BaseException:
        import traceback

        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    words = Path("/proc/self/status").read_text().split("VmHWM:")[1].split()
    os.write(noted, json.dumps([int(words[0]) * 1024, touched]).encode())
    os._exit(status)


def _answer(call: list[Any]) -> dict[str, Any]:
    """Fork for a call, and wait for it."""
    folder = Path(call[0])
    begun = time.monotonic()
    child = os.fork()
    if not child:
        try:
            _child(*call)
        finally:
            os._exit(98)
    while not (done := os.wait4(child, os.WNOHANG))[0]:
        if time.monotonic() - begun > LONGEST:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.002)
    _, status, used = done
    text = (folder / "noted").read_text() if (folder / "noted").is_file() else ""
    peak, touched = json.loads(text) if text else (used.ru_maxrss * 1024, [])
    return {
        "status": os.waitstatus_to_exitcode(status),
        "out": (folder / "out").read_text(errors="replace")[:20000],
        "err": (folder / "err").read_text(errors="replace")[:20000],
        "seconds": time.monotonic() - begun,
        "processor": used.ru_utime + used.ru_stime,
        "peak": peak,
        "touched": touched,
    }


def _warm_up() -> None:
    """Import and compose what calls have in common, so that a call takes a tenth of a second."""
    import matplotlib.pyplot
    import netCDF4
    import numpy
    import pandas
    import scipy.io
    import xarray
    from hydra._internal.hydra import Hydra

    from sldvexp.cli import main
    from sldvexp.config.cached_loader import RememberingLoader
    from sldvexp.config.paths import conf_dir
    from sldvexp.config.repository import Memory
    from sldvexp.pipeline import provenance

    assert all((matplotlib.pyplot, netCDF4, numpy, pandas, scipy.io, xarray))
    provenance.git_commit()
    composed = Memory()
    begin = RememberingLoader.__init__

    def with_memory(self: RememberingLoader, config_search_path: Any) -> None:
        begin(self, config_search_path)
        if [s.path for s in self.repository.get_sources() if s.scheme() == "file"] == [
            str(conf_dir())
        ]:
            self._known = composed

    RememberingLoader.__init__ = with_memory  # type: ignore[method-assign]
    # Hydra composes twice, first only for `hydra.mode`: half the time.
    Hydra.get_mode = lambda *_, **__: None  # type: ignore[method-assign, assignment, return-value]
    place = mkdtemp()
    os.chdir(place)
    null = os.open(os.devnull, os.O_WRONLY)
    kept = os.dup(1)
    os.dup2(null, 1)
    for arguments in (
        ["~experiment", "target=dissertation", "report=none"],
        ["experiment=pose", "report=none"],
        ["experiment=point", "report=none"],
        ["experiment=point", "seed=-1"],
    ):
        sys.argv = ["sldvexp", *arguments]
        with suppress(SystemExit):
            main.main()
    sys.stdout.flush()
    os.dup2(kept, 1)
    os.chdir("/")
    shutil.rmtree(place)


if __name__ == "__main__":
    _warm_up()
    for line in sys.stdin:
        print(json.dumps(_answer(json.loads(line))), flush=True)
