"""Marks that are taken by keys alone where they were predicted, as the page shows them."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.virtual_lab.console import experiment
from sldvexp.virtual_lab.lab import VirtualLab
from tests.console.served import Page, Served
from tests.report import devtools
from tests.report.opened import DESKTOP

pytestmark = [
    pytest.mark.skipif(not devtools.PATH, reason="needs chromium"),
    pytest.mark.whole,
]
BENCH = """# @package _global_
defaults:
  - _self_
  - override /target: fiducials
  - override /scene: plate
  - override /scan: by_hand
  - override /instrument: simulated
  - override /pose: registration
"""
NAMES = "return document.getElementById('map').aim.names.map((name) => name.text)"
OFF = "return document.getElementById('marks').tBodies[0].rows[4].cells[3].textContent"
MOVE = "document.getElementById('map').aim.page.wish('move', {to: arguments[0]})"


@pytest.fixture
def served(tmp_path):
    made = Served(tmp_path, bench=BENCH)
    yield made
    made.end()


def go(page):
    before = page.beam
    page.key("g")
    page.until(lambda: page.beam != before)
    return page.beam


def test_mark_taken_by_g_and_m_alone_keeps_its_question_mark_until_the_beam_was_moved(served):
    e = experiment(["~experiment", "target=fiducials", "scene=plate", "instrument=simulated"])
    lab, page = VirtualLab(e.scene, e.laser, e.target, e.seed), Page(served.address, DESKTOP)
    lab.use_view("1")
    try:
        page.until(lambda: page.text("who").startswith("You are steering"))
        true = np.rint(lab.true_dac(e.target.points().position)).astype(int).tolist()
        for k, place in enumerate(true[:4]):
            if k == 3:  # which may be at several places by now
                assert "g) again goes to where it may be instead" in page.text("pose")
                assert len({go(page) for _ in range(3)}) >= 2
            page.js(MOVE, place)
            page.until(lambda place=place: page.beam == tuple(place))
            page.mark()
        go(page)
        page.mark()
        page.until(lambda: "Mark 5: taken where it was predicted" in page.text("said"))
        assert "mark 5?" in page.js(NAMES)
        assert page.js(OFF) == "?"
        assert "Left out: mark 5, taken" in page.text("pose")
        page.key("p")
        for key in ("ArrowUp", "ArrowDown"):
            before = page.beam
            page.key(key)
            page.until(lambda before=before: page.beam != before)
        page.key("m")
        page.until(lambda: "Left out" not in page.text("pose"))
        assert "mark 5" in page.js(NAMES)
        assert "≤" in page.js(OFF)
        assert page.said() == []
    finally:
        page.close()
