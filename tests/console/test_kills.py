"""A session whose browser, console or instrument is killed in mid-scan: nothing is lost."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress

import pytest
from websockets.sync.client import connect

from sldvexp import dataset
from tests.console.conftest import Heard
from tests.console.served import PATIENCE, ROOT, Served, bench_lab

pytestmark = pytest.mark.long

#: Scan lines after which somebody is killed; the session has 95.
MOMENTS = (1, 9, 20, 33, 47, 70, 90)
WHO = ("browser", "console", "instrument")
CASES = [(who, lines) for who in WHO for lines in MOMENTS][:-1]  # twenty


class Instrument:
    """The virtual lab in a process of its own, always at the same port."""

    def __init__(self):
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.start()

    def start(self):
        line = [sys.executable, "-m", "sldvexp.virtual_lab.console", "experiment=plate"]
        line += ["--port", str(self.port)]
        self.process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        assert self.process.stdout.readline()

    def kill(self):
        self.process.kill()
        self.process.wait()


@pytest.fixture(scope="module")
def instrument():
    made = Instrument()
    yield made
    made.kill()


def settings(instrument):
    resource = f"TCPIP::127.0.0.1::{instrument.port}::SOCKET"
    return ["instrument=visa", f"instrument.resource={resource}", "instrument.retries=0"]


def joined(served):
    address = served.address.replace("http", "ws") + "talk"
    origin = "/".join(served.address.split("/")[:3])
    heard = Heard(connect(address, origin=origin, proxy=None, close_timeout=0.2))
    heard.wish("take")
    heard.until(lambda: heard.role == "controller")
    return heard


def aim_and_scan(heard):
    """Mark as somebody who knows the truth, and begin."""
    lab = bench_lab()
    places = [p.tolist() for p in lab.true_dac(lab.calibration_object.center).round().astype(int)]
    corners = [[-661, 159], [-659, -1454], [683, -1503], [682, 165]]
    for kind, found in (("circle", places), ("corner", corners)):
        for number, place in enumerate(found, 1):
            heard.wish("move", to=place)
            heard.wish("mark", kind=kind, number=number)
    heard.wish("scan", name="aimed")


def lines_of(served):
    return len(list(served.folder.glob("outputs/*/*/journal/1/*.npz")))


def until(condition, heard):
    """Wait, and listen all the while, as a browser does."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        with suppress(TimeoutError):
            heard.line.recv(timeout=0.002)


def velocity(run):
    with dataset.load(run / "run.nc") as tree:
        return tree["image/1/velocity"].values.tobytes(), tree["edge/1/dac"].values.tobytes()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, instrument):
    served = Served(tmp_path_factory.mktemp("undisturbed"), *settings(instrument))
    heard = joined(served)
    aim_and_scan(heard)
    heard.until(lambda: heard.topics.get("phase", {}).get("tab") == "result")
    heard.leave()
    served.end()
    return velocity(served.runs[0])


@pytest.mark.parametrize(("who", "lines"), CASES)
def test_scan_goes_on_to_the_same_bits(who, lines, undisturbed, instrument, tmp_path):
    served = Served(tmp_path, *settings(instrument))
    heard = joined(served)
    aim_and_scan(heard)
    until(lambda: lines_of(served) >= lines, heard)
    if who == "browser":
        heard.line.socket.shutdown(socket.SHUT_RDWR)
        other = joined(served)
        other.until(
            lambda: other.topics["phase"]["tab"] == "result" or other.topics["scan"]["paused"]
        )
        other.wish("go_on")
        other.until(lambda: other.topics["phase"]["tab"] == "result")
        other.leave()
    elif who == "console":
        served.end(signal.SIGKILL)
    else:
        instrument.kill()
        heard.until(lambda: heard.topics.get("result", {}).get("told", "").find("resume=") > 0)
        instrument.start()
    heard.leave()
    served.end()
    (run,) = served.runs
    if not (run / "run.nc").is_file():
        line = [sys.executable, "-m", "sldvexp.cli.main", f"resume={run}"]
        done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE)
        assert done.returncode == 0, done.stderr
    assert velocity(run) == undisturbed
