"""What the console costs a scan, and how soon a pixel is seen."""

from __future__ import annotations

import statistics
import subprocess
import sys
import threading
import time
from dataclasses import replace

import pytest

from sldvexp.console.scanning import Scanning
from sldvexp.instrument.visa import Visa
from sldvexp.session.session import scan_views
from sldvexp.virtual_lab.console import experiment
from sldvexp.virtual_lab.lab import Simulated
from tests.console.conftest import PATIENCE


@pytest.fixture
def lab():
    """The virtual lab in a process of its own, as a real instrument is."""
    line = [sys.executable, "-m", "sldvexp.virtual_lab.console", "experiment=plate", "--port", "0"]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
    yield process.stdout.readline().strip()
    process.terminate()
    process.wait(timeout=PATIENCE)


@pytest.fixture
def one_view(lab):
    e = experiment(["experiment=plate"])
    scan = replace(
        e.scan,
        calibration=replace(e.scan.calibration, views={"1": e.scan.calibration.views["1"]}),
        structure=replace(e.scan.structure, views={"1": e.scan.structure.views["1"]}),
    )
    return replace(e, scan=scan, instrument=Visa(resource=lab, timeout=10.0))


@pytest.fixture
def small_view(one_view):
    """The image alone, of few pixels, and in this process."""
    structure = replace(one_view.scan.structure, pixels=[12, 12])
    return replace(one_view, scan=structure, instrument=Simulated())


@pytest.fixture
def browser(join):
    """Somebody who sees everything, as fast as it comes; when it was seen."""
    heard, seen = join(), []

    def listen():
        while True:
            heard.line.recv()
            seen.append(time.perf_counter())

    thread = threading.Thread(target=lambda: _quietly(listen), daemon=True)
    thread.start()
    return seen


def _quietly(work):
    try:
        work()
    except Exception:
        return


@pytest.mark.long
def test_console_adds_no_more_than_a_twentieth_to_a_scan(
    one_view, board, wishes, browser, tmp_path
):
    """By the processor's time, which does not depend on who else is at work on the machine."""
    took: dict[bool, list[float]] = {True: [], False: []}
    used: dict[bool, list[float]] = {True: [], False: []}
    for k in range(6):
        for watched in (True, False):
            watcher = Scanning(one_view, board, wishes) if watched else None
            begun, before = time.perf_counter(), time.process_time()
            scan_views(one_view, tmp_path / f"{k}{watched}", watcher=watcher)
            took[watched].append(time.perf_counter() - begun)
            used[watched].append(time.process_time() - before)
            if watcher:
                watcher.end()
                watcher.join(PATIENCE)  # what is told after the view is not the next scan's
    assert len(browser) > 6  # somebody has looked on
    share = (min(used[True]) - min(used[False])) / min(took[False])
    print(f"the console adds {share:.1%}")
    assert share < 0.05


@pytest.mark.whole
def test_pixel_is_seen_within_half_a_second(small_view, board, wishes, join, tmp_path):
    heard, seen = join(), {}

    class Timed(Scanning):
        def line_done(self, line):
            seen[line.number, line.lines] = time.perf_counter()
            super().line_done(line)
            self._painter.settle()

    heard.until(lambda: "scan" in heard.topics or heard.role)
    watcher = Timed(small_view, board, wishes)
    delays = []

    def listen():
        while True:
            heard.pictures.clear()
            heard.until(lambda: heard.pictures)
            delays.append(time.perf_counter() - max(seen.values(), default=0.0))

    threading.Thread(target=lambda: _quietly(listen), daemon=True).start()
    scan_views(small_view, tmp_path / "journal", watcher=watcher)
    watcher.end()
    assert len(delays) > 10
    assert statistics.median(delays) < 0.5
