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


#: A browser that takes all it is told, and says at the end how much that was.
LISTENER = """
import sys
from contextlib import suppress
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

origin = f"http://127.0.0.1:{sys.argv[1]}"
line = connect(f"{origin.replace('http', 'ws')}/{sys.argv[2]}/talk", origin=origin, proxy=None)
print("come", flush=True)
pictures = 0
with suppress(ConnectionClosed):
    while True:
        pictures += isinstance(line.recv(), bytes)
print(pictures)
"""


@pytest.fixture
def browser(server):
    """Somebody in another process who sees everything, as fast as it comes."""
    line = [sys.executable, "-c", LISTENER, str(server.port), server.token]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "come\n"
    yield process
    process.kill()
    process.wait(timeout=PATIENCE)


def _quietly(work):
    try:
        work()
    except Exception:
        return


class Hooked(Scanning):
    """Counts the time that the scan waits for its watcher."""

    waited = 0.0

    def line_done(self, line):
        begun = time.perf_counter()
        super().line_done(line)
        self.waited += time.perf_counter() - begun

    def between_lines(self, view, lines, done, count):
        begun = time.perf_counter()
        wish = super().between_lines(view, lines, done, count)
        self.waited += time.perf_counter() - begun
        return wish


def used(*names):
    """Add up the processor's time of threads of these names, s."""
    clocks = (time.pthread_getcpuclockid(t.ident) for t in threading.enumerate() if t.name in names)
    return sum(time.clock_gettime(clock) for clock in clocks)


@pytest.mark.long
@pytest.mark.skipif(not hasattr(time, "pthread_getcpuclockid"), reason="threads have no clocks")
def test_console_adds_no_more_than_a_twentieth_to_a_scan(
    one_view, board, wishes, server, browser, tmp_path
):
    """What it makes the scan wait and what its threads do meanwhile, of the time a scan takes.

    The times of scans with and without it differ by more from run to run than by that.
    """
    shares = []
    for k in range(7):
        before = used("painter", "console")
        watcher = Hooked(one_view, board, wishes)
        begun = time.perf_counter()
        scan_views(one_view, tmp_path / f"{k}", watcher=watcher)
        took = time.perf_counter() - begun
        watcher._painter.settle()
        shares.append((used("painter", "console") - before + watcher.waited) / took)
        watcher.end()
        watcher.join(PATIENCE)  # what is told after the view is not the next scan's
    server.__exit__()
    assert int(browser.stdout.readline()) > 6  # somebody has looked on
    print(f"the console adds {statistics.median(shares):.1%}")
    assert statistics.median(shares) < 0.05


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
