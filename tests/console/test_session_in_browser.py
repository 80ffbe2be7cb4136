"""A whole session by clicks and keys alone, and what becomes of it when somebody is killed."""

from __future__ import annotations

import os

import numpy as np
import pytest

import sldvexp
from sldvexp import dataset
from tests.console.conftest import BENCH
from tests.console.served import Page, Served, bench_lab
from tests.report import devtools
from tests.report.opened import DESKTOP, PHONE

pytestmark = [
    pytest.mark.skipif(not devtools.PATH, reason="needs chromium"),
    pytest.mark.whole,
]
#: Places of the example's own operator in two of the views.
CONFIGURED = (
    "scan.calibration.views={'1': {dac: [[-371,1322],[-517,601],[588,318],[551,1430]]},"
    " '2': {dac: [[-225,1163],[-464,551],[596,307],[657,1268]]}}",
    "scan.structure.views={'1': {corners: [[-661,159],[-659,-1454],[683,-1503],[682,165]]},"
    " '2': {corners: [[-639,152],[-836,-1426],[574,-1485],[689,158]]}}",
)


def pictured(page, name):
    if folder := os.environ.get("SLDVEXP_SHOTS"):
        page.js("document.documentElement.scrollTop = 0")
        with open(f"{folder}/{name}.png", "wb") as file:
            file.write(page.picture())


@pytest.fixture
def served(tmp_path):
    made = Served(tmp_path)
    yield made
    made.end()


@pytest.fixture
def configured(tmp_path_factory, monkeypatch):
    """The run of the same experiment with the places of the example."""
    folder = tmp_path_factory.mktemp("configured")
    (folder / "experiment").mkdir()
    (folder / "experiment" / "bench.yaml").write_text(BENCH)
    monkeypatch.chdir(folder)
    return sldvexp.run("experiment=bench", *CONFIGURED, config_dir=folder, quiet=True)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_two_views_are_aimed_at_scanned_paused_and_finished(served, configured, size):
    lab, page = bench_lab(), Page(served.address, size)
    try:
        page.click("nearer")
        page.key("l")
        page.until(lambda: page.js("return document.getElementById('map').cells.count") > 1000)
        page.key("l")
        page.aim(lab, "1")
        pictured(page, f"aimed-{size[0]}")
        page.choose_next_view()
        page.aim(lab, "2")
        page.click("start")
        page.until(lambda: page.js("return document.getElementById('image').cells.count") > 0)
        page.click("pause")
        page.until(lambda: page.text("progress-told") == "Paused.")
        pictured(page, f"paused-{size[0]}")
        page.click("again")
        page.click("go-on")
        page.until(lambda: page.can("report"))
        assert "run.nc, pose.txt, report.html" in page.text("result-lines")
        pictured(page, f"done-{size[0]}")
        page.click("tab-scan")
        page.until(lambda: page.text("views-done").count("Pose: origin") == 2)
        pictured(page, f"scanned-{size[0]}")
        assert page.text("views-done").count("trusted") == 2
        assert page.said() == []
        assert [url for url in page.fetched() if not url.startswith(served.address)] == []
        page.open_address(f"{served.address}run.html")
        assert "sldvexp" in page.js("return document.title + document.body.textContent")
        assert page.said() == []
    finally:
        page.close()
    (run,) = served.runs
    with dataset.load(run / "run.nc") as tree:
        aimed = tree["pose"].to_dataset().load()
    wanted = configured["pose"].to_dataset()
    for name in ("origin", "euler"):
        off = aimed[name] - wanted[name]
        bound = np.hypot(aimed[f"{name}_confidence"], wanted[f"{name}_confidence"])
        assert (np.abs(off) <= bound).all(), name
    assert served.end() == 0


def test_browser_that_is_killed_leaves_a_scan_that_waits_for_the_next_one(served):
    lab, page = bench_lab(), Page(served.address, DESKTOP)
    page.aim(lab, "1")
    page.click("start")
    page.until(lambda: page.js("return document.getElementById('image').cells.count") > 0)
    page.kill()
    other = Page(served.address, DESKTOP)

    def done():
        """Tell whether it is, also where the scan came to its end before anybody was missed."""
        return other.js("return !document.getElementById('report').hidden")

    try:
        other.until(lambda: "You are steering" in other.text("who"))
        other.click("tab-scan")
        other.until(lambda: "The scan waits" in other.text("progress-told") or done())
        if not done():
            other.click("go-on")
        other.until(done)
    finally:
        other.close()
    assert (served.runs[0] / "run.nc").is_file()
