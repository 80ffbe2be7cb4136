"""Every control of the shape does its work by mouse and by keyboard."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.report.html import packing, shape
from sldvexp.volume import Grid
from tests.report import devtools
from tests.report.opened import DESKTOP, place_of

pytestmark = pytest.mark.skipif(not devtools.PATH, reason="needs chromium")
SELECTS = ("component", "layer", "frequency", "colour", "glyph", "shell", "view", "speed")
RANGES = ("phase", "size")
NUMBERS = ("node", "from", "to")
TICKS = ("fade", "rest", "flat", "common", "logarithmic", "stands")
BUTTONS = ("play", "reset", "save", "cut")
OTHERS = ("stage", "spectrum")

#: All that a control can change, as text.
EFFECT = """
const {state, look, camera, control} = document.getElementById('shape-plot').shape;
const {azimuth, elevation, distance, shift, flat} = camera;
const texts = ['play', 'cut'].map((name) => control(name).textContent);
return JSON.stringify([{...state, phase: control('phase').value}, {...look, phase: 0, scale: 0},
  azimuth, elevation, distance, shift, flat, texts, window.saved || 0])
"""


@pytest.fixture(scope="module")
def shown(open_at):
    """A page on which every control has something to do."""
    pose = {
        "origin": np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0]]),
        "rotation": np.tile(np.diag([1.0, -1.0, -1.0]), (2, 1, 1)),
        "euler": np.zeros((2, 3)),
    }
    pose = dataset.group("pose", {"view": ["left", "right"]}, **pose)
    opened = open_at(DESKTOP, pose=pose)
    opened.js(
        "HTMLCanvasElement.prototype.toBlob = () => { window.saved = (window.saved || 0) + 1; }"
    )
    return opened


@pytest.fixture(autouse=True)
def paused(shown):
    """Stand still before and after."""
    yield
    if shown.told("play", "aria-pressed") == "true":
        shown.js("document.getElementById('shape-play').click()")


def test_all_controls_are_known(shown):
    reachable = shown.js(
        "return [...document.querySelectorAll('.shape :is(button, select, input, [tabindex])')]"
        ".filter((e) => e.checkVisibility() && !e.disabled).map((e) => e.id.replace('shape-', ''))"
    )
    assert sorted(reachable) == sorted([*SELECTS, *RANGES, *NUMBERS, *TICKS, *BUTTONS, *OTHERS])


def test_all_controls_are_reached_by_the_tab_key_in_the_order_of_the_page(shown, browser):
    every = shown.js(
        "return [...document.querySelectorAll('.shape :is(button, select, input, [tabindex])')]"
        ".filter((e) => e.checkVisibility()).map((e) => e.id)"
    )
    shown.focus("play")
    reached = ["shape-play"]
    for _ in every[1:]:
        browser.key("Tab")
        reached.append(shown.js("return document.activeElement.id"))
    assert reached == every


def changes(shown, act):
    """Tell whether an act changes what is shown."""
    before = shown.js(EFFECT)
    act()
    return json.loads(shown.js(EFFECT)) != json.loads(before)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", SELECTS)
def test_a_list_is_chosen_from(shown, browser, name):
    start = shown.js("return document.getElementById('shape-' + arguments[0]).selectedIndex", name)
    down, up = ("ArrowUp", "ArrowDown") if name == "speed" else ("ArrowDown", "ArrowUp")
    if start:
        down, up = "ArrowUp", "ArrowDown"
    shown.focus(name)
    assert changes(shown, lambda: browser.key(down))
    assert changes(shown, lambda: browser.key(up))

    def by_mouse():
        shown.click(name)
        browser.key(down)
        browser.key("Enter")

    assert changes(shown, by_mouse)
    shown.focus(name)
    assert changes(shown, lambda: browser.key(up))


@pytest.mark.parametrize("name", RANGES)
def test_a_slider_slides(shown, browser, name):
    shown.focus(name)
    assert changes(shown, lambda: browser.key("ArrowLeft" if name == "size" else "ArrowRight"))
    assert changes(shown, lambda: shown.click(name, across=0.3))


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_is_typed(shown, browser, name):
    shown.focus(name)
    assert changes(shown, lambda: browser.key("7"))
    assert changes(shown, lambda: browser.key("Backspace"))
    shown.js("document.activeElement.blur()")
    shown.click(name, across=0.2)
    assert changes(shown, lambda: browser.key("5"))
    assert changes(shown, lambda: browser.key("Backspace"))


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", TICKS)
def test_a_box_is_ticked_and_cleared(shown, browser, name):
    start = shown.js(EFFECT)
    assert changes(shown, lambda: shown.click(name))
    shown.focus(name)
    assert changes(shown, lambda: browser.key(" "))
    if name != "stands":  # which puts the camera where all is seen
        assert json.loads(shown.js(EFFECT)) == json.loads(start)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", BUTTONS)
def test_a_button_is_pressed(shown, browser, name):
    if name == "reset":
        shown.focus("stage")
        browser.key("ArrowRight")
    assert changes(shown, lambda: shown.click(name))
    if name == "reset":
        shown.focus("stage")
        browser.key("ArrowRight")
    shown.focus(name)
    assert changes(shown, lambda: browser.key("Enter"))


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "key", ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "+", "-", "Home", " "]
)
def test_the_shape_obeys_keys(shown, browser, key):
    shown.focus("stage")
    if key == "Home":
        browser.key("ArrowUp")
    assert changes(shown, lambda: browser.key(key))


def test_the_wheel_zooms_with_control_and_scrolls_without(shown, browser):
    left, top, width, height = shown.box("stage")
    place = (left + width / 2, top + height / 2)
    assert changes(shown, lambda: browser.wheel(place, -100, control=True))
    at = shown.js("return scrollY")
    assert not changes(shown, lambda: browser.wheel(place, 100))
    browser.wait(lambda: shown.js("return scrollY") > at)


def test_the_spectrum_is_chosen_from(shown, browser):
    shown.set("frequency", 0)
    assert changes(shown, lambda: shown.click("spectrum", across=0.95))
    shown.focus("spectrum")
    assert changes(shown, lambda: browser.key("ArrowLeft"))
    assert changes(shown, lambda: browser.key("End"))
    assert changes(shown, lambda: browser.key("Home"))


def test_a_cut_is_made_by_two_clicks_and_has_the_fields_numbers(
    shown,
    browser,
    small_volume,
    small_field,
):
    shown.js("document.getElementById('shape-view').value = 'z';")
    shown.click("reset")
    for name, value in (("component", 2), ("frequency", 1), ("size", 0), ("glyph", -1)):
        shown.set(name, value)
    shown.click("cut")
    for node in (4, 7):  # one row of the grid
        at = place_of(shown, node)
        browser.mouse(at, at)
    told = shown.js("return [...document.getElementById('shape-plot').shape.profile]")
    around = small_volume()
    nodes = np.flatnonzero(around["node_layer"].values == 1)[4:8]
    field = small_field(around).isel(node=nodes, component=2, frequency=1)
    distance = 1e3 * np.linalg.norm(
        around["position"].values[nodes] - around["position"].values[nodes[0]], axis=1
    )
    np.testing.assert_allclose([p["distance"] for p in told], distance, atol=1e-3)
    size = 1e3 * abs(field["velocity"].values)
    np.testing.assert_allclose([p["value"] for p in told], size, rtol=1e-5)
    np.testing.assert_allclose([p["bound"] for p in told], 1e3 * field["confidence"], rtol=1e-5)
    assert f"Cut from node {nodes[0]} to {nodes[3]}" in shown.text("profile-told")
    shown.click("cut")
    assert shown.js("return document.getElementById('shape-plot').shape.profile.length") == 0
    shown.click("cut")


def test_a_cut_across_the_grid_is_linear_between_nodes(shown, small_volume, small_field):
    shown.set("from", 20)  # of the volume's middle layer, which is drawn
    shown.set("to", 39)
    told = shown.js("return [...document.getElementById('shape-plot').shape.profile]")
    assert len(told) > 5
    around = small_volume()
    length = 1e3 * np.hypot(0.2, 0.15)
    assert told[-1]["distance"] == pytest.approx(length, rel=1e-4)
    assert np.all(np.diff([p["distance"] for p in told]) > 0)
    nodes = np.flatnonzero(around["node_layer"].values == 1)
    field = small_field(around).isel(node=nodes[[0, 19]], component=2, frequency=1)
    ends = [told[0]["value"], told[-1]["value"]]
    np.testing.assert_allclose(ends, 1e3 * abs(field["velocity"].values), rtol=1e-5)
    shown.set("from", "")


def test_a_cut_along_a_tube_stays_on_its_wall(shown):
    around, along = 24, 10
    turn, row = np.meshgrid(2 * np.pi * np.arange(around) / around, np.arange(along))
    place = np.stack([np.sin(turn), 0.3 * row, np.cos(turn)], axis=-1).reshape(-1, 3)
    first = (around * np.arange(along - 1)[:, None] + np.arange(around)).ravel()
    beside = first - first % around + (first + 1) % around
    upper = [first, beside, beside + around], [first, beside + around, first + around]
    triangle = np.concatenate([np.stack(corners, axis=1) for corners in upper])
    code = (
        "return makeMesh(arguments[0], arguments[1]).cut(arguments[2], arguments[3], arguments[4])"
    )
    for begin, end in ((3, 3 + 9 * around), (74, 173), (2 + 5 * around, 6 + 5 * around)):
        normal = (place[begin] + place[end]) * [1, 0, 1]
        path = shown.js(
            code, place.ravel().tolist(), triangle.ravel().tolist(), begin, end, normal.tolist()
        )
        assert (path[0]["a"], path[-1]["b"]) == (begin, end)
        for point in path:
            for node in (point["a"], point["b"]):
                assert place[node] @ normal > 0
        assert np.all(np.diff([point["distance"] for point in path]) > 0)


def test_paths_and_arrows_are_drawn_at_every_node(shown, browser):
    shown.box("plot")
    shown.set("size", 1)
    count = "return document.getElementById('shape-plot').shape.count('glyphs')"
    pictures = set()
    for glyph, drawn in ((-1, 0), (0, 20), (1, 20)):
        shown.set("glyph", glyph)
        assert shown.js(count) == drawn
        shown.js("document.getElementById('shape-plot').shape.draw()")
        pictures.add(browser.picture())
    assert len(pictures) == 3
    shown.set("glyph", -1)


def test_another_layer_is_drawn_at_its_place_with_its_velocity(shown, small_volume, small_field):
    around = small_volume()
    for name, value in (("component", 2), ("frequency", 0), ("phase", 0), ("colour", "real")):
        shown.set(name, value)
    shown.set("size", 0)
    for choice, layer in ((1, 0), (2, 2)):
        shown.set("layer", choice)
        nodes = np.flatnonzero(around["node_layer"].values == layer)
        height = 1e3 * around["position"].values[nodes, 2]
        np.testing.assert_allclose(shown.deflection, height, atol=1e-3)
        field = small_field(around).isel(node=nodes, component=2, frequency=0)
        away = abs(shown.colours - 1e3 * field["velocity"].values.real)
        assert np.all(away < 0.07 * 1e3 * field["confidence"].values)
    shown.set("layer", 0)


def test_a_picked_nodes_spectrum_is_that_of_the_run(shown, small_volume):
    nodes = np.flatnonzero(small_volume()["node_layer"].values == 1)
    with dataset.load(shown.path.with_name("run.nc")) as run:
        field = run["field"].to_dataset().isel(node=nodes[11], component=1).load()
    shown.set("component", 1)
    shown.set("node", int(nodes[11]))
    told = np.array(shown.js("return document.getElementById('shape-plot').spectrum"))
    np.testing.assert_allclose(told[:, 0], 1e3 * abs(field["velocity"].values), rtol=1e-6)
    np.testing.assert_allclose(told[:, 1], 1e3 * field["confidence"].values, rtol=1e-6)
    shown.set("node", "")


def test_components_have_one_scale_or_their_own(shown):
    ranges = "return document.getElementById('shape-plot').shape.look.range[1]"
    shown.set("colour", "now")
    shown.js("const e = document.getElementById('shape-common'); if (!e.checked) e.click()")
    common, own = [], []
    for found in (common, own):
        for component in (0, 1, 2):
            shown.set("component", component)
            found.append(shown.js(ranges))
        shown.js("document.getElementById('shape-common').click()")
    assert len(set(common)) == 1
    assert len(set(own)) == 3
    assert max(own) == common[0]


@pytest.mark.whole
def test_all_of_256_frequencies_are_reached_by_keys_and_are_the_fields(
    open_at, browser, small_volume, small_field, monkeypatch
):
    monkeypatch.setattr(shape, "MOST_BYTES", 100_000)  # exact numbers have no room
    around, hertz = small_volume(), tuple(np.linspace(100, 610, 256))
    field = small_field(around, hertz=hertz)
    many = open_at(DESKTOP, field=field)
    nodes = np.flatnonzero(around["node_layer"].values == 1)
    velocity = 1e3 * field["velocity"].values[nodes, 2].real
    bound = 1e3 * field["confidence"].values[nodes, 2]
    many.set("component", 2)
    many.set("colour", "real")
    many.focus("spectrum")
    browser.key("Home")
    for f in range(256):
        assert many.told("spectrum", "aria-valuenow") == str(f)
        assert many.told("spectrum", "aria-valuetext").startswith(f"{hertz[f]:g} Hz")
        if f % 15 == 0:
            assert np.all(abs(many.colours - velocity[:, f]) <= 0.51 * packing.SHARE * bound[:, f])
        browser.key("ArrowRight")
    assert many.js("return document.getElementById('shape-frequency').options.length") == 256


@pytest.mark.whole
def test_a_frame_of_10000_nodes_takes_little_script(open_at, small_field):
    around = Grid(size=[0.4, 0.3], shape=[100, 100], layers=2, thickness=0.005).group()
    many = open_at(DESKTOP, volume=around, field=small_field(around))
    many.set("glyph", 0)
    assert many.drawn().shape == (10_000, 4)
    took = many.js(
        "const {draw, state} = document.getElementById('shape-plot').shape, took = [];"
        "for (let n = 0; n < 60; n++) { state.phase = 0.1 * n; const start = performance.now();"
        "draw(); took.push(performance.now() - start); } return took"
    )
    assert np.median(took) <= 4  # ms
