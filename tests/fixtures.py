"""Fixtures of all tests: the command, run for real but inside this process."""

from __future__ import annotations

import fcntl
import hashlib
import math
import os
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import chdir, suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import hypothesis
import pytest
import xarray as xr
from hydra._internal.hydra import Hydra
from hydra.core.config_search_path import ConfigSearchPath

from sldvexp import dataset, writing
from sldvexp.cli import command, commands, main
from sldvexp.config import sources
from sldvexp.config.cached_loader import RememberingLoader
from sldvexp.config.paths import conf_dir
from sldvexp.config.repository import Memory
from sldvexp.instrument import connection
from sldvexp.report.html.page import Html
from sldvexp.stopping import handlers_kept
from sldvexp.testing import faults

with suppress(ImportError):  # so that no command keeps xarray in this process from it
    import dask  # noqa: F401

#: Heavy libraries by a module of theirs, since one that is imported lazily stands in sys.modules
#: from the start.
HEAVY = {
    "xarray": "xarray.core",
    "scipy": "scipy._lib",
    "pandas": "pandas.core",
    "matplotlib": "matplotlib.cbook",
    "netCDF4": "netCDF4._netCDF4",
}

#: How long anything is waited for that comes at once on a quiet machine, s.
LONGEST = 300.0

# How long an example takes says more about the machine than about the program.
hypothesis.settings.register_profile("all examples", deadline=None)
hypothesis.settings.register_profile("any machine", deadline=None, max_examples=30)
hypothesis.settings.load_profile("any machine")

# Numbers and words that stand in the sources would be drawn now and then: which, is decided by the
# modules that happen to be imported, and to look for them takes every process 3 s.
with suppress(ImportError):  # other releases look for none, or do it elsewhere
    from hypothesis.internal.conjecture import providers
    from hypothesis.internal.constants_ast import Constants

    providers._get_local_constants = Constants

#: What makes the pages of runs and sweeps.
PAGES = {name: getattr(Html, name) for name in ("of_run", "of_run_at_hand", "of_sweep")}


@dataclass
class Done:
    """What one call of the command left: exit status, what it said, and its folder."""

    status: int
    out: str
    err: str
    folder: Path

    @property
    def tree(self) -> xr.DataTree:
        """The run's dataset, in memory."""
        with dataset.load(self.folder / "run.nc") as tree:
            return tree.load()


@pytest.fixture(scope="session", autouse=True)
def _no_pages() -> Iterator[None]:
    """Hundreds of small runs need no page each; tests about pages ask for the fixture `pages`."""
    with pytest.MonkeyPatch.context() as patch:
        for name in PAGES:
            patch.setattr(Html, name, lambda *_: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def _remembered() -> Iterator[None]:
    """Hundreds of calls compose the program's own files anew; here they share what they know.

    Calls that add a folder of their own, or a package, share nothing.
    """
    composed = Memory()
    begin = RememberingLoader.__init__

    def with_memory(self: RememberingLoader, config_search_path: ConfigSearchPath) -> None:
        begin(self, config_search_path)
        folders = [s.path for s in self.repository.get_sources() if s.scheme() == "file"]
        if folders == [str(conf_dir())]:
            self._known = composed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RememberingLoader, "__init__", with_memory)
        patch.setattr(sources, "NamingLoader", RememberingLoader)
        yield


@pytest.fixture(scope="session", autouse=True)
def _unsynced() -> Iterator[None]:
    """No power is cut in these processes; tests that cut it use others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writing, "sync", lambda _: None)
        yield


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs leave their pages."""
    for name, make in PAGES.items():
        monkeypatch.setattr(Html, name, make)


@pytest.fixture(scope="session")
def run_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Run the command once for all processes of the tests, in this one; nobody changes its folder.

    Who comes second waits, and finds the folder of whoever came first.
    """
    base = tmp_path_factory.getbasetemp()
    runs = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "runs"

    def run(*words: str, pages: bool = False) -> Path:
        name = hashlib.sha256(repr((words, pages)).encode()).hexdigest()[:12]
        folder = runs / name / "run"
        folder.parent.mkdir(parents=True, exist_ok=True)
        with (folder.parent / "lock").open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            if not folder.exists():
                run_here(folder, *words, pages=pages)
        return folder

    return run


def run_here(folder: Path, *words: str, pages: bool) -> None:
    """Run the command in this process, quietly; expectations may be missed."""
    started = command.Command([*words, f"hydra.run.dir={folder}"], full_error=True, quiet=True)
    with handlers_kept(), chdir(folder.parent), pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["sldvexp"])
        for name, make in PAGES.items() if pages else ():
            patch.setattr(Html, name, make)
        with command.hydra_raises():
            assert started.run() in (command.DONE, command.MISSED)


@pytest.fixture
def sldvexp(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Done]:
    """Call the command with arguments, in an empty folder; runs go to numbered folders there."""
    monkeypatch.chdir(tmp_path)
    calls = []

    def call(*arguments: str) -> Done:
        folder = tmp_path / f"run{len(calls)}"
        calls.append(folder)
        given = any("hydra.run.dir" in a or a.startswith("-") for a in arguments)
        given |= commands.begins(arguments)
        where = [] if given else [f"hydra.run.dir={folder}"]
        monkeypatch.setattr(sys, "argv", ["sldvexp", *arguments, *where])
        capsys.readouterr()
        with monkeypatch.context() as patch:
            # Hydra composes once more for `hydra.mode`, which a file of one's own may set as well.
            if not any(a.startswith("-") or "hydra.mode" in a for a in arguments):
                patch.setattr(Hydra, "get_mode", lambda *_, **__: None)
            with pytest.raises(SystemExit) as stop, handlers_kept():
                main.main()
        said = capsys.readouterr()
        return Done(int(stop.value.code or 0), said.out, said.err, folder)

    return call


@pytest.fixture
def loaded_by(tmp_path: Path) -> Callable[..., tuple[str, str]]:
    """Run code in a new process; which heavy libraries it loads, and what it prints."""

    def run(code: str, *arguments: str) -> tuple[str, str]:
        told = f"print(*(k for k, m in {HEAVY}.items() if m in sys.modules), file=sys.stderr)"
        ended = "except SystemExit as stop:\n    assert not stop.code"
        code = f"import sys\ntry:\n    exec({code!r})\n{ended}\n{told}"
        command = [sys.executable, "-c", code, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=True)
        return done.stderr.splitlines()[-1], done.stdout

    return run


class ClientClock:
    """The time of a client of the virtual lab, which stands still while the server is at work.

    A time-out then says nothing about how busy the machine is: time passes only where a fault keeps
    the server silent on purpose, and there at once.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self._tell, self._told = socket.socketpair()
        self._changed = threading.Condition()
        self._connection = object()
        self._left = 0.0

    def keep_silent(self, seconds: float, connection: object) -> None:
        """Say nothing for so long of the client's time, or until it hangs up: the server's part."""
        with self._changed:
            if connection is not self._connection:
                return
            self._left = seconds
            self._tell.send(b"!")
            assert self._changed.wait_for(
                lambda: self._left == 0 or connection is not self._connection, LONGEST
            )

    @property
    def connection(self) -> object:
        """The client's present connection."""
        return self._connection

    def hang_up(self) -> None:
        """End whatever silence there is: the client's part."""
        with self._changed:
            if self._left > 0:
                self._told.recv(1)
            self._left, self._connection = 0.0, object()
            self._changed.notify_all()

    def select(
        self, readers: list[socket.socket], writers: list[Any], others: list[Any], *timeout: float
    ) -> tuple[list[Any], list[Any], list[Any]]:
        """Wait for an answer as `select.select` does, in the client's time."""
        if writers:
            return select.select(readers, writers, others, *timeout)
        (link,), (left,) = readers, timeout or (math.inf,)
        while True:
            ready = select.select([link, self._told], [], [], LONGEST)[0]
            assert ready, "the server neither answers nor is it silent on purpose"
            if link in ready:
                if connection._closed(link):  # PyVISA goes on asking until its time is over
                    self.now += left
                return [link], [], []
            with self._changed:
                passed = min(left, self._left)
                self.now += passed
                left -= passed
                self._left -= passed
                if self._left > 0:
                    return [], [], []
                self._told.recv(1)
                self._changed.notify_all()


@pytest.fixture
def client_clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[ClientClock]:
    """Let clients in this process have no time but `ClientClock`'s."""
    from pyvisa_py import tcpip

    clock = ClientClock()
    seen = SimpleNamespace(select=clock.select)
    monkeypatch.setattr(connection, "select", seen)
    monkeypatch.setattr(tcpip, "select", seen)
    monkeypatch.setattr(tcpip, "time", SimpleNamespace(time=lambda: clock.now))
    close, cut, slow = connection.VisaLine.close, faults.Cut.spoil, faults.Slow.spoil

    def hang_up(line: connection.VisaLine) -> None:
        close(line)
        clock.hang_up()

    def say_nothing(*_: object) -> None:
        clock.keep_silent(math.inf, clock.connection)

    def say_less(*how: Any) -> None:
        cut(*how)
        say_nothing()

    def say_late(
        fault: faults.Slow, answer: bytes, send: faults.Send, server: faults.LabServer
    ) -> None:
        there = clock.connection

        def wait(seconds: float) -> None:
            clock.keep_silent(seconds, there)

        slow(fault, answer, send, SimpleNamespace(stopping=SimpleNamespace(wait=wait)))

    monkeypatch.setattr(connection.VisaLine, "close", hang_up)
    monkeypatch.setattr(faults.Silence, "spoil", say_nothing)
    monkeypatch.setattr(faults.Cut, "spoil", say_less)
    monkeypatch.setattr(faults.Slow, "spoil", say_late)
    yield clock
    clock._tell.close()
    clock._told.close()
