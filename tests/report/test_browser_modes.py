"""In the browser: modes or lines, and measured beside computed shapes."""

from __future__ import annotations

import pytest

from tests.report import devtools, made_modes
from tests.report.opened import DESKTOP, PHONE, nothing_is_wider_than_the_window

pytestmark = pytest.mark.skipif(not devtools.PATH, reason="needs chromium")

SEEN = "return [...document.querySelectorAll('.choice .shape')].map((e) => e.checkVisibility())"
CHOOSE = """
const select = document.getElementById('shape-of'); select.value = arguments[0];
select.dispatchEvent(new Event('input'));"""
SHAPE = "document.getElementById(arguments[0] + '-plot').shape"


@pytest.fixture(scope="module", params=[DESKTOP, pytest.param(PHONE, marks=pytest.mark.whole)])
def shown(request, open_at, small_volume, small_field):
    model = made_modes.model(pair=(1, 2, 3))
    groups = {"modes": made_modes.modes(), "model": model, **made_modes.pixels(3)}
    groups["modes/field"] = small_field(small_volume(), hertz=tuple(made_modes.HERTZ))
    return open_at(request.param, **groups)


def test_modes_are_shown_until_the_lines_are_chosen(shown):
    options = (
        "return [...document.getElementById('shape-modes-frequency').options].map((o) => o.text)"
    )
    assert shown.js(options) == ["mode 1: 197 Hz", "mode 2: 439 Hz", "mode 3: 545 Hz"]
    assert shown.js(SEEN) == [True, False]
    shown.js(CHOOSE, 1)
    assert shown.js(SEEN) == [False, True]
    size = "return document.getElementById('shape-stage').clientWidth"
    width = "return document.getElementById('shape-canvas').width"
    shown.wait(lambda: shown.js(width) >= shown.js(size) > 100)
    shown.js(CHOOSE, 0)
    assert shown.js(SEEN) == [True, False]
    nothing_is_wider_than_the_window(shown)


def test_the_computed_shape_follows_the_measured_one_and_no_other(shown):
    tune = f"{SHAPE}.tune(arguments[1])"
    told = f"return {SHAPE}.state.frequency"
    for mode in (1, 0):
        before = shown.js(told, "shape-modes")
        shown.js(tune, "modes-measured", mode)
        assert shown.js(told, "modes-computed") == mode
        assert shown.js(told, "shape-modes") == before
    shown.js(tune, "shape-modes", 2)
    assert shown.js(told, "modes-measured") == 0


def test_pixels_are_drawn_as_a_surface(shown):
    count = f"return {SHAPE}.joined(arguments[1]).length"
    assert shown.js(count, "modes-measured", "dots") == 0
    assert shown.js(count, "modes-measured", "triangles") > 0
