"""A session from rough poses with an instrument that a person carries from view to view."""

from __future__ import annotations

import os
import re

import pytest

from sldvexp import dataset
from sldvexp.config.paths import conf_dir
from sldvexp.virtual_lab.lab import VirtualLab
from sldvexp.virtual_lab.server import LabServer
from tests.console.served import Page, Served, bench_lab
from tests.report import devtools
from tests.report.opened import DESKTOP, PHONE

pytestmark = [
    pytest.mark.skipif(not devtools.PATH, reason="needs chromium"),
    pytest.mark.whole,
]
#: Views as they are called here and in the lab.
VIEWS = {"front": "1", "left": "2", "right": "3"}
#: Of the plate of the virtual lab, as somebody measures it.
CORNERS = "[[0.34,-0.02,0],[0.62,-0.02,0],[0.62,0.2,0],[0.34,0.2,0]]"


@pytest.fixture
def carried():
    """A lab that stands in no view by itself: who carries it is the test."""
    with LabServer(bench_lab()) as server:
        server.dialect.lab.use_view("5")
        yield server


@pytest.fixture
def served(tmp_path, carried):
    source = (conf_dir() / "profile" / "virtual_lab.yaml").read_text()
    going = '  view: {lab: ["VIEW {view}"]}\n'
    assert going in source
    (tmp_path / "carried.yaml").write_text(source.replace(going, ""))
    lab: VirtualLab = carried.dialect.lab
    poses = (
        f"{name}: {{euler: {list(lab.scene.views[true].euler)}, "
        f"origin: {[round(x + 0.01, 3) for x in lab.scene.views[true].place.tolist()]}}}"
        for name, true in VIEWS.items()
    )
    made = Served(
        tmp_path,
        "instrument=visa",
        f"instrument.resource={carried.resource}",
        "instrument.profile=carried.yaml",
        f"scan.poses={{{', '.join(poses)}}}",
        f"scan.structure.corners_at={CORNERS}",
    )
    yield made
    made.end()


def pictured(page, name):
    if folder := os.environ.get("SLDVEXP_SHOTS"):
        page.js("document.documentElement.scrollTop = 0")
        with open(f"{folder}/{name}.png", "wb") as file:
            file.write(page.picture())


@pytest.mark.one_in(2)
@pytest.mark.parametrize("size", [PHONE, DESKTOP], ids=["phone", "desktop"])
def test_person_is_asked_for_every_view_and_says_when_the_instrument_is_there(
    served, carried, size
):
    page = Page(served.address, size)
    try:
        page.until(lambda: page.can("go"))  # predicted, though nothing is marked
        page.click("start")
        for view in VIEWS:
            page.until(lambda view=view: f"to the view {view}, to about (" in page.text("asked"))
            assert page.js("return document.getElementById('answer-box').hidden")
            pictured(page, f"asked-{view}-{size[0]}")
            carried.dialect.lab.use_view(VIEWS[view])
            page.click("reply")
            page.until(lambda: not page.can("reply"))
        page.until(lambda: page.can("report"))
        pictured(page, f"result-{size[0]}")
        assert "verdict" in page.text("result-lines")
        page.click("tab-scan")
        done, total = re.search(r"pixels(\d+) of (\d+)line", page.text("facts")).groups()
        assert done == total
        page.click("tab-plan")
        page.until(lambda: page.js("return document.getElementById('plan-figure').naturalWidth"))
        pictured(page, f"plan-{size[0]}")
        assert page.js("return document.documentElement.scrollWidth - innerWidth") <= 0
        assert page.said() == []
    finally:
        page.close()
    with dataset.load(served.runs[0] / "run.nc") as tree:
        pose = tree["pose"].to_dataset().load()
    for view, true in VIEWS.items():
        off = pose["origin"].sel(view=view) - carried.dialect.lab.scene.views[true].place
        assert (abs(off) <= 2 * pose["origin_confidence"].sel(view=view)).all()
