"""How all tests are collected, ordered and divided; their fixtures are in ``tests/fixtures.py``."""

from __future__ import annotations

import gc
import os
import stat
import sys
import tempfile
from bisect import bisect_left
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import suppress
from itertools import accumulate
from pathlib import Path
from typing import Any

import pytest

from sldvexp.config.kept import _is_own


def _kept_folder(otherwise: str) -> str:
    """Give a folder that is this user's alone, whose files the next run finds again."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = root / "sldvexp-tests"
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_own(folder.lstat(), stat.S_ISDIR, 0o077) and os.access(folder, os.W_OK):
            return str(folder)
    return otherwise


if "PYTEST_XDIST_WORKER" not in os.environ:  # workers have what the first process has
    # Commands that tests start share what they compose, and leave the user's alone.
    _shared = tempfile.TemporaryDirectory(prefix="sldvexp-tests-")
    _kept = _kept_folder(f"{_shared.name}/kept")
    os.environ["MPLCONFIGDIR"] = f"{_kept}/matplotlib"  # whose list of fonts takes a second to make
    # Tables of all characters take another second.
    os.environ.setdefault("HYPOTHESIS_STORAGE_DIRECTORY", f"{_kept}/hypothesis")
    os.environ["XDG_CACHE_HOME"] = _shared.name
    # Code is compiled beside its source, where that of all libraries is already.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    # Processes of which there is one for each processor would only wait for threads of the others.
    for _library in ("OMP", "OPENBLAS"):
        os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

TESTS = Path(__file__).parent

#: Rooms with the longest tests, which begin first: at the end a worker waits for little.
LONGEST_FIRST = (
    *("experiments", "console", "handbook", "report", "session", "modes", "planner", "sweep"),
)


def pytest_xdist_auto_num_workers() -> int:
    """Two more than processors: tests wait for sockets and for other processes now and then."""
    return (os.cpu_count() or 1) + 2


def pytest_configure(config: pytest.Config) -> None:
    """Load the fixtures where tests run: whoever only hands tests out is quicker without them."""
    runs = config.option.dist == "no" or config.option.collectonly
    if runs or config.getoption("--hypothesis-profile"):
        config.pluginmanager.import_plugin("tests.fixtures")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Look for no garbage among thousands of tests, neither as they are found nor later.

    Later it is looked for a tenth as often as by default.
    """
    gc.disable()
    gc.set_threshold(7000, 10, 10)
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Begin with other rooms than other workers do.

    Each then compiles its share of the tests and of what they try, and finds the rest compiled;
    side by side, all would compile everything.
    """
    report = yield
    worker = getattr(collector.config, "workerinput", None)
    if worker and collector.path == TESTS:
        files = [len([*node.path.rglob("*.py")]) for node in report.result]
        share = int(worker["workerid"].removeprefix("gw")) / worker["workercount"]
        first = bisect_left([*accumulate(files, initial=0)], share * sum(files))
        report.result = report.result[first:] + report.result[:first]
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest; leave cases that ``one_in(n)`` leaves out to ``-m whole``.

    These are all but every n-th case of a test. Whatever rooms it collected first, every worker
    has the same order.
    """
    order = {room: k for k, room in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: (order.get(item.path.parent.name, len(order)), item.path))
    seen: Counter[str] = Counter()
    for item in items:
        marked = item.get_closest_marker("one_in")
        if marked is None or item.get_closest_marker("long") or item.get_closest_marker("whole"):
            continue
        test = item.nodeid.partition("[")[0]
        if seen[test] % marked.args[0]:
            item.add_marker(pytest.mark.whole)
        seen[test] += 1


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Say how many blocks of the handbook ran."""
    reports = [r for r in terminalreporter.stats.get("passed", []) if r.when == "call"]
    ran = [n for r in reports for name, n in r.user_properties if name == "handbook blocks"]
    if ran:
        terminalreporter.write_line(f"handbook: {sum(ran)} blocks of {len(ran)} pages ran")
