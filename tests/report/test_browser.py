"""The page in a real browser: quiet, offline, and its shape moves and obeys its controls."""

from __future__ import annotations

import json
import shutil
import time

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.report.html import figures, packing, run_page, shape
from tests.shell.made_strain import made_strain

webdriver = pytest.importorskip("selenium.webdriver")

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next((path for name in BROWSERS if (path := shutil.which(name))), None)
DRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.skipif(not (BROWSER and DRIVER), reason="needs chromium and chromedriver"),
    pytest.mark.xdist_group("browser"),
]
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--force-prefers-reduced-motion",  # the shape begins to move when it is told to
)
PHONE, DESKTOP = (390, 844), (1280, 900)
PATIENCE = 60
LEFT, RIGHT = "\ue012", "\ue014"  # arrow keys


@pytest.fixture(scope="module")
def browser():
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for option in OPTIONS:
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    yield driver
    driver.quit()


class Opened:
    """A page in the browser, at a size."""

    def __init__(self, driver, path, size):
        self.driver = driver
        # Of the page itself, not of a window that headless browsers keep wider than a phone.
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        driver.get(path.as_uri())
        self.wait(lambda: self.js("return document.getElementById('shape-plot').dataset.ready"))

    def wait(self, condition):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "the page takes too long"
            time.sleep(0.1)

    def js(self, code, *arguments):
        return self.driver.execute_script(code, *arguments)

    def set(self, name, value):
        self.js(
            "const e = document.getElementById('shape-' + arguments[0]); e.value = arguments[1];"
            "e.dispatchEvent(new Event('input'))",
            name,
            value,
        )

    def drawn(self, offset=0):
        """Place and value of every node, as the graphics processor has worked them out."""
        code = "return Array.from(document.getElementById('shape-plot').shape.drawn(arguments[0]))"
        return np.array(self.js(code, offset), float).reshape(-1, 4)

    @property
    def deflection(self):
        return self.drawn()[:, 2]

    @property
    def colours(self):
        return self.drawn()[:, 3]

    def joined(self, name):
        """Tell which nodes are drawn as what."""
        code = "return Array.from(document.getElementById('shape-plot').shape.joined(arguments[0]))"
        return self.js(code, name)

    def text(self, name):
        return self.js("return document.getElementById('shape-' + arguments[0]).textContent", name)


@pytest.fixture(scope="module")
def open_at(browser, write_run, tmp_path_factory):
    """Open the page of a run with a small field, without pictures."""

    def opened(size, **groups):
        path = write_run(tmp_path_factory.mktemp("run"), **groups)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(figures, "PARTS", {part: {} for part in figures.PARTS})
            page = run_page.write(path, path.with_name("report.html"))
        return Opened(browser, page, size)

    return opened


@pytest.fixture(scope="module")
def shown(open_at):
    """One page for several tests: loading it takes longest."""
    return open_at(DESKTOP)


def test_page_is_quiet_and_fetches_nothing(shown, browser):
    nothing_is_wider_than_the_window(shown)
    assert said_by_the_page(browser) == []
    events = [json.loads(e["message"])["message"] for e in browser.get_log("performance")]
    fetched = [e["params"]["request"]["url"] for e in events if e["method"].endswith("BeSent")]
    own = ("data:", "blob:")
    outside = [
        url for url in fetched if not url.startswith(own) and not url.endswith("report.html")
    ]
    assert (len(fetched) > 0, outside) == (True, [])


def test_shape_moves_when_it_is_played_and_stands_when_it_is_paused(shown, browser):
    plot = browser.find_element("id", "shape-plot")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", plot)
    still, picture = shown.deflection, plot.screenshot_as_png
    button = browser.find_element("id", "shape-play")
    assert button.text == "▶ Play"
    button.click()
    shown.wait(lambda: not np.allclose(shown.deflection, still))
    assert button.text == "❚❚ Pause"
    button.click()
    stopped = shown.deflection
    time.sleep(0.3)
    np.testing.assert_array_equal(shown.deflection, stopped)
    shown.set("phase", 100)
    shown.wait(lambda: plot.screenshot_as_png != picture)


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
    shown.set("node", 7)
    told = shown.text("picked")
    for name, value, own in zip(
        "xyz", 1e3 * abs(field["velocity"].values), 1e3 * field["confidence"].values, strict=True
    ):
        assert f"V_{name} {float(f'{value:.3g}'):g} ± {float(f'{own:.3g}'):g}" in told
    assert shown.joined("picked") == [6]
    shown.set("node", "")
    assert shown.text("picked") == ""


def test_keys_step_through_frequencies_turn_the_shape_and_play(shown, browser):
    shown.set("frequency", 0)
    slider, stage = (browser.find_element("id", f"shape-{name}") for name in ("spectrum", "stage"))
    slider.send_keys(RIGHT)
    assert slider.get_attribute("aria-valuetext").startswith("439 Hz")
    slider.send_keys(LEFT)
    assert slider.get_attribute("aria-valuetext").startswith("197 Hz")
    labels = "return document.getElementById('shape-labels').innerHTML"
    before = shown.js(labels)
    stage.send_keys(RIGHT)
    assert shown.js(labels) != before
    stage.send_keys(" ")
    assert browser.find_element("id", "shape-play").text == "❚❚ Pause"
    stage.send_keys(" ")
    assert browser.find_element("id", "shape-play").text == "▶ Play"


def test_the_mouse_turns_the_shape_and_picks_a_node(shown, browser):
    shown.js("document.getElementById('shape-stage').scrollIntoView({block: 'center'})")
    shown.set("component", -1)
    shown.set("node", "")
    labels = "return document.getElementById('shape-labels').innerHTML"
    before = shown.js(labels)
    left, top, width, height = shown.js(
        "const b = document.getElementById('shape-stage').getBoundingClientRect();"
        "return [b.left, b.top, b.width, b.height]"
    )
    middle = (left + width / 2, top + height / 2)
    mouse(browser, middle, (middle[0] + 60, middle[1] + 20))
    assert shown.js(labels) != before
    assert shown.joined("picked") == []
    shown.js("document.getElementById('shape-reset').click()")
    near = shown.js("return document.getElementById('shape-plot').shape.seen(7)")
    at = (left + near[0], top + near[1])
    mouse(browser, at, at)
    assert shown.joined("picked") == [7]


def mouse(browser, start, end):
    """Press the button at one place and let it go at another."""
    told = {"button": "left", "clickCount": 1}
    for kind, (x, y), buttons in (
        ("mouseMoved", start, 0),
        ("mousePressed", start, 1),
        ("mouseMoved", end, 1),
        ("mouseReleased", end, 0),
    ):
        event = {"type": kind, "x": x, "y": y, "buttons": buttons, **told}
        browser.execute_cdp_cmd("Input.dispatchMouseEvent", event)


def test_what_lies_below_its_bound_is_pale(open_at, small_volume, small_field):
    around = small_volume()
    field = small_field(around)
    node = np.flatnonzero(around["node_layer"].values == 1)[3]
    field["velocity"].values[node] *= 1e-6
    shown = open_at(DESKTOP, field=field)
    assert "pale: below its bound, 1 of 20 nodes" in shown.text("told")
    shown.set("colour", "bound")
    assert "pale" not in shown.text("told")


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


def test_points_that_no_triangle_joins_are_coloured_and_move(browser, small_points, tmp_path):
    point, lines_of_sight = small_points
    groups = {"point": point, "line_of_sight": lines_of_sight.drop_vars("triangle")}
    dataset.save(groups, {"config": "{}", "plugins": "{}"}, tmp_path / "run.nc")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "PARTS", {part: {} for part in figures.PARTS})
        page = run_page.write(tmp_path / "run.nc", tmp_path / "report.html")
    browser.get_log("browser")
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
    assert said_by_the_page(browser) == []
    nothing_is_wider_than_the_window(shown)


def test_without_webgl_the_page_has_its_figure(open_at, browser):
    """A browser that gives no drawing context gets the figure that printed pages have."""
    open_at(DESKTOP)
    refuse = "HTMLCanvasElement.prototype.getContext = () => null;"
    source = {"source": refuse}
    added = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", source)
    try:
        browser.get(browser.execute_script("return location.href").split("#")[0])
        seen = "return getComputedStyle(document.querySelector(arguments[0])).display"
        assert browser.execute_script(seen, ".shape") == "none"
        assert browser.execute_script(seen, ".still") == "block"
    finally:
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)


def said_by_the_page(browser):
    """Errors, and warnings that come from the page's own scripts."""
    said = browser.get_log("browser")
    return [e for e in said if e["level"] == "SEVERE" or "report.html" in e["message"]]


def nothing_is_wider_than_the_window(shown):
    assert shown.js("return document.documentElement.scrollWidth - innerWidth") <= 0
    wide = shown.js(
        "return [...document.querySelectorAll('main *')].filter(e => !e.closest('.scroll, details,"
        " #shape-plot') && e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML)"
    )
    assert wide == []
