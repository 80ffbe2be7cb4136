"""The page in a real browser: quiet, offline, and its shape moves and obeys its controls."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.report.html import figures, packing, render, run_page, shape
from sldvexp.report.html.pair import pair_section
from tests.report import devtools
from tests.report.opened import DESKTOP, PHONE, Opened, nothing_is_wider_than_the_window, place_of
from tests.shell.made_strain import made_strain

pytestmark = pytest.mark.skipif(not devtools.PATH, reason="needs chromium")


@pytest.fixture(scope="module")
def shown(open_at):
    """One page for several tests: loading it takes longest."""
    return open_at(DESKTOP)


def test_page_is_quiet_and_fetches_nothing(shown, browser):
    nothing_is_wider_than_the_window(shown)
    assert browser.said() == []
    fetched = browser.fetched()
    own = ("data:", "blob:")
    outside = [
        url for url in fetched if not url.startswith(own) and not url.endswith("report.html")
    ]
    assert (len(fetched) > 0, outside) == (True, [])


@pytest.mark.one_in(2)
@pytest.mark.parametrize("size", [PHONE, DESKTOP])
def test_numbers_and_names_of_the_box_stand_apart(open_at, size):
    boxes = open_at(size).js(
        "return [...document.querySelectorAll('.shape-labels span')].map((e) => {"
        " const b = e.getBoundingClientRect(); return [b.left, b.right, b.top, b.bottom]; })"
    )
    assert len(boxes) >= 6
    for one, other in itertools.combinations(boxes, 2):
        across = min(one[1], other[1]) - max(one[0], other[0])
        down = min(one[3], other[3]) - max(one[2], other[2])
        assert min(across, down) < 3, (one, other)


def test_shape_moves_when_it_is_played_and_stands_when_it_is_paused(shown, browser):
    shown.box("plot")
    still, picture = shown.deflection, browser.picture()
    assert shown.text("play") == "▶ Play"
    shown.click("play")
    shown.wait(lambda: not np.allclose(shown.deflection, still))
    assert shown.text("play") == "❚❚ Pause"
    shown.click("play")
    stopped = shown.deflection
    time.sleep(0.3)
    np.testing.assert_array_equal(shown.deflection, stopped)
    shown.set("phase", 100)
    shown.wait(lambda: browser.picture() != picture)


def test_controls_choose_component_frequency_phase_colour_bounds_and_size(
    shown, small_volume, small_field
):
    shown.set("phase", 0)
    around = small_volume()
    nodes = np.flatnonzero(around["node_layer"].values == 1)
    field = small_field(around).isel(node=nodes)
    velocity, bound = 1e3 * field["velocity"].values, 1e3 * field["confidence"].values
    height = 1e3 * around["position"].values[nodes, 2]
    whole = np.linalg.norm(velocity[:, :, 0].real, axis=1)
    np.testing.assert_allclose(shown.colours, whole, rtol=1e-5)
    for component, hertz in ((0, 0), (2, 1)):
        shown.set("component", component)
        shown.set("frequency", hertz)
        for degrees in (0, 90):
            shown.set("phase", degrees)
            turned = velocity[:, component, hertz] * np.exp(1j * np.radians(degrees))
            np.testing.assert_allclose(shown.colours, turned.real, rtol=1e-4, atol=1e-3)
            drawn = shown.deflection - height
            factor = drawn @ turned.real / (turned.real @ turned.real)
            np.testing.assert_allclose(drawn, factor * turned.real, rtol=1e-3, atol=1e-3)
    shown.set("colour", "amplitude")
    np.testing.assert_allclose(shown.colours, np.abs(velocity[:, 2, 1]), rtol=1e-5)
    shown.set("colour", "bound")
    np.testing.assert_allclose(shown.colours, bound[:, 2, 1], rtol=1e-5)
    shown.set("shell", 10)
    above, below = shown.drawn(10)[:, 2], shown.drawn(-10)[:, 2]
    np.testing.assert_allclose((above - below) / 2, factor * 10 * bound[:, 2, 1], rtol=1e-2)
    shown.set("size", 0)
    np.testing.assert_allclose(shown.deflection, height, atol=1e-4)
    assert "bound of V_z" in shown.text("told")


def test_parts_of_a_component_are_its_colours(shown, small_volume, small_field):
    nodes = np.flatnonzero(small_volume()["node_layer"].values == 1)
    velocity = 1e3 * small_field(small_volume())["velocity"].values[nodes, 1, 0]
    shown.set("component", 1)
    shown.set("frequency", 0)
    for colour, wanted in {
        "real": velocity.real,
        "imaginary": velocity.imag,
        "phase": np.degrees(np.angle(velocity)),
    }.items():
        shown.set("colour", colour)
        for phase in (0, 130):
            shown.set("phase", phase)
            np.testing.assert_allclose(shown.colours, wanted, rtol=1e-4, atol=1e-3)


def test_a_picked_node_tells_its_velocity_and_bound(shown, small_volume, small_field):
    nodes = np.flatnonzero(small_volume()["node_layer"].values == 1)
    field = small_field(small_volume()).isel(node=nodes[6], frequency=1)
    shown.set("component", -1)
    shown.set("frequency", 1)
    shown.set("node", int(nodes[6]))
    told = shown.text("picked")
    for name, value, own in zip(
        "xyz", 1e3 * abs(field["velocity"].values), 1e3 * field["confidence"].values, strict=True
    ):
        assert f"V_{name} {float(f'{value:.3g}'):g} ± {float(f'{own:.3g}'):g}" in told
    assert f"Node {nodes[6]}: " in told  # by its number in the volume
    assert shown.joined("picked") == [6]
    shown.set("node", "")
    assert shown.text("picked") == ""


def test_keys_step_through_frequencies_turn_the_shape_and_play(shown, browser):
    shown.set("frequency", 0)
    shown.focus("spectrum")
    browser.key("ArrowRight")
    assert shown.told("spectrum", "aria-valuetext").startswith("439 Hz")
    browser.key("ArrowLeft")
    assert shown.told("spectrum", "aria-valuetext").startswith("197 Hz")
    labels = "return document.getElementById('shape-labels').innerHTML"
    before = shown.js(labels)
    shown.focus("stage")
    browser.key("ArrowRight")
    assert shown.js(labels) != before
    browser.key(" ")
    assert shown.text("play") == "❚❚ Pause"
    browser.key(" ")
    assert shown.text("play") == "▶ Play"


def test_the_mouse_turns_the_shape_and_picks_a_node(shown, browser):
    left, top, width, height = shown.box("stage")
    shown.set("component", -1)
    shown.set("node", "")
    labels = "return document.getElementById('shape-labels').innerHTML"
    before = shown.js(labels)
    middle = (left + width / 2, top + height / 2)
    browser.mouse(middle, (middle[0] + 60, middle[1] + 20))
    assert shown.js(labels) != before
    assert shown.joined("picked") == []
    shown.js("document.getElementById('shape-reset').click()")
    at = place_of(shown, 7)
    browser.mouse(at, at)
    assert shown.joined("picked") == [7]


@pytest.mark.whole
def test_a_shape_follows_the_one_beside_it(browser, write_run, small_volume, small_field, tmp_path):
    around, paths = small_volume(), []
    for name in "ab":
        field = small_field(around)
        if name == "b":
            field["velocity"].values[:] = 2 * field["velocity"].values[:, :, ::-1]
        (tmp_path / name).mkdir()
        paths.append(write_run(tmp_path / name, volume=around, field=field))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "PARTS", {part: {} for part in figures.PARTS})
        sections = [pair_section(paths, ["a", "b"])]
        page = render.write(tmp_path / "report.html", "Two runs", "", sections)
    shown = Opened(browser, page, DESKTOP)
    browser.wait(lambda: shown.js("return document.getElementById('other-plot').dataset.ready"))
    followed = (
        "const s = document.getElementById('other-plot').shape;"
        "return [s.state.component, s.state.frequency, s.camera.azimuth, s.camera.flat]"
    )
    shown.set("component", 2)
    shown.set("frequency", 1)
    shown.click("flat")
    shown.focus("stage")
    browser.key("ArrowRight")
    assert shown.js(followed) == [2, 0, pytest.approx(-124.5), True]
    shown.set("phase", 90)
    other = "return Array.from(document.getElementById('other-plot').shape.drawn())"
    colours = np.array(shown.js(other)).reshape(-1, 4)[:, 3]
    np.testing.assert_allclose(colours, 2 * shown.colours, rtol=1e-4, atol=1e-3)
    shown.click("play")
    moves = "return document.getElementById('other-play').getAttribute('aria-pressed')"
    assert shown.js(moves) == "true"
    assert browser.said() == []
    nothing_is_wider_than_the_window(shown)


def test_what_lies_below_its_bound_is_pale(open_at, small_volume, small_field):
    around = small_volume()
    field = small_field(around)
    node = np.flatnonzero(around["node_layer"].values == 1)[3]
    field["velocity"].values[node] *= 1e-6
    shown = open_at(DESKTOP, field=field)
    assert "pale: below its bound, 1 of 20 nodes" in shown.text("told")
    shown.set("colour", "bound")
    assert "pale" not in shown.text("told")


@pytest.mark.whole
def test_the_shape_is_coloured_by_strain(open_at, small_volume):
    around = small_volume()
    strain = made_strain(around)
    shown = open_at(DESKTOP, strain=strain)
    shown.set("phase", 90)
    shown.set("colour", "strain0")
    turned = 1e6 * strain["strain"].values[:, 0, 0] * 1j * np.exp(0.5j * np.pi)
    np.testing.assert_allclose(shown.colours, turned.real, rtol=1e-4, atol=1e-4)
    shown.set("colour", "strain4")
    stress = 1e-3 * strain["von_mises"].values[:, 0]
    np.testing.assert_allclose(shown.colours, stress, rtol=1e-4)


@pytest.mark.whole
def test_rounded_numbers_are_shown_as_near_as_their_bounds_ask(
    open_at, small_volume, small_field, monkeypatch
):
    monkeypatch.setattr(shape, "MOST_BYTES", 1500)
    shown = open_at(DESKTOP)
    nodes = np.flatnonzero(small_volume()["node_layer"].values == 1)
    field = small_field(small_volume()).isel(node=nodes)
    velocity, bound = 1e3 * field["velocity"].values, 1e3 * field["confidence"].values
    shown.set("component", 2)
    for hertz in (0, 1):
        shown.set("frequency", hertz)
        shown.set("colour", "imaginary")
        away = abs(shown.colours - velocity[:, 2, hertz].imag) / bound[:, 2, hertz]
        assert 1e-4 < away.max() < 1.01 * packing.SHARE / 2
        shown.set("colour", "bound")
        np.testing.assert_allclose(shown.colours, bound[:, 2, hertz], rtol=0.006)


@pytest.mark.whole
def test_undetermined_nodes_are_marked_on_a_phone_too(open_at, small_volume, small_field):
    around = small_volume()
    field = small_field(around)
    node = np.flatnonzero(around["node_layer"].values == 1)[3]
    field["velocity"].values[node, 0, :] = np.nan
    shown = open_at(PHONE, field=field)
    assert shown.joined("marks") == [3]
    shown.set("component", 1)
    assert shown.joined("marks") == []
    nothing_is_wider_than_the_window(shown)


@pytest.mark.whole
def test_points_that_no_triangle_joins_are_coloured_and_move(browser, small_points, tmp_path):
    point, lines_of_sight = small_points
    groups = {"point": point, "line_of_sight": lines_of_sight.drop_vars("triangle")}
    dataset.save(groups, {"config": "{}", "plugins": "{}"}, tmp_path / "run.nc")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "PARTS", {part: {} for part in figures.PARTS})
        page = run_page.write(tmp_path / "run.nc", tmp_path / "report.html")
    shown = Opened(browser, page, PHONE)
    rest = 1e3 * lines_of_sight["position"].values[:, 2]
    shown.set("frequency", 1)
    shown.set("phase", 90)
    velocity = 1e3 * point["velocity"].values[:, :, 1] * 1j
    away = shown.deflection - rest
    factor = away @ velocity[:, 2].real / (velocity[:, 2].real @ velocity[:, 2].real)
    assert factor > 0
    np.testing.assert_allclose(away, factor * velocity[:, 2].real, rtol=1e-3, atol=1e-3)
    whole = np.linalg.norm(velocity.real, axis=1)
    np.testing.assert_allclose(shown.colours, whole, rtol=1e-4)
    assert shown.joined("dots") == [0, 1, 2, 3, 4]
    assert len(shown.joined("lines")) == 2 * 3
    assert browser.said() == []
    nothing_is_wider_than_the_window(shown)


@pytest.mark.whole
def test_without_webgl_the_page_has_its_figure(open_at, browser):
    """A browser that gives no drawing context gets the figure that printed pages have."""
    opened = open_at(DESKTOP)
    refuse = "HTMLCanvasElement.prototype.getContext = () => null;"
    added = browser.command("Page.addScriptToEvaluateOnNewDocument", source=refuse)
    try:
        browser.open(opened.path)
        seen = "return getComputedStyle(document.querySelector(arguments[0])).display"
        assert browser.js(seen, ".still") == "block"
        assert browser.js(seen, ".shape") == "none"
    finally:
        browser.command("Page.removeScriptToEvaluateOnNewDocument", **added)
