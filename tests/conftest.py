"""Fixtures of all tests: the command, run for real but inside this process."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import xarray as xr
from hydra.core.config_search_path import ConfigSearchPath

from sldvexp import dataset
from sldvexp.cli import commands, main
from sldvexp.config.cached_loader import Memory, RememberingLoader
from sldvexp.config.paths import conf_dir
from sldvexp.report.html.page import Html

#: Heavy libraries by a module of theirs, since one that is imported lazily stands in sys.modules
#: from the start.
HEAVY = {
    "xarray": "xarray.core",
    "scipy": "scipy._lib",
    "pandas": "pandas.core",
    "matplotlib": "matplotlib.cbook",
    "netCDF4": "netCDF4._netCDF4",
}

#: What makes the pages of runs and sweeps.
PAGES = {name: getattr(Html, name) for name in ("of_run", "of_sweep")}


def pytest_xdist_auto_num_workers() -> int:
    """One more than processors: tests wait for sockets and for other processes now and then."""
    return (os.cpu_count() or 1) + 1


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
    files, composed = Memory(), Memory()
    begin = RememberingLoader.__init__

    def with_memory(self: RememberingLoader, config_search_path: ConfigSearchPath) -> None:
        begin(self, config_search_path)
        folders = [s.path for s in self.repository.get_sources() if s.scheme() == "file"]
        if folders == [str(conf_dir())]:
            self.repository._known, self._known = files, composed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RememberingLoader, "__init__", with_memory)
        yield


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs leave their pages."""
    for name, make in PAGES.items():
        monkeypatch.setattr(Html, name, make)


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
        with pytest.raises(SystemExit) as stop:
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
