"""Pages at three widths, in dark and light: the result first, inside, and open to everybody."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.report.html import figures, run_page, sweep_page, unfinished
from sldvexp.sweep import ranking
from tests.report import devtools
from tests.report.test_first_screen import interrupted_run, swept

axe = pytest.importorskip("axe_core_python.base", reason="needs axe-core-python")

pytestmark = pytest.mark.skipif(not devtools.PATH, reason="needs chromium")
SIZES = ((390, 844), (1280, 800), (1920, 1080))
FAULTS = """
return axe.run().then((found) => found.violations.map((v) =>
  v.id + ": " + v.nodes.map((n) => n.html.slice(0, 100)).join(" | ")))
"""


def poses():
    views = ["left", "right"]
    origin = np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0]])
    turned = np.tile(np.diag([1.0, -1.0, -1.0]), (2, 1, 1))
    found = {"origin": origin, "rotation": turned, "euler": np.zeros((2, 3))}
    bounds = {"origin_confidence": np.full((2, 3), 1e-3)}
    bounds |= {name: np.array([0.07, 0.15]) for name in ("s", "residual_rms", "pointing_std")}
    return dataset.group("pose", {"view": views}, **found, **bounds)


def keep_only(groups, path):
    with dataset.load(path) as tree:
        attributes = dict(tree.attrs)
    dataset.save(groups, attributes, path)


@pytest.fixture(scope="module")
def pages(write_run, small_points, tmp_path_factory):
    """Pages of a field, of points, of poses alone, of a run that was cut off, and of a sweep."""
    point, ends = small_points
    tmp_path, made = tmp_path_factory.mktemp("pages"), {}
    for name, groups in {
        "field": {"pose": poses()},
        "points": {"point": point, "line_of_sight": ends},
        "poses": {"pose": poses()},
    }.items():
        folder = tmp_path / name
        folder.mkdir()
        path = write_run(folder, **groups)
        if name != "field":
            keep_only(groups, path)
        with pytest.MonkeyPatch.context() as patch:
            if name == "field":
                patch.setattr(figures, "PARTS", {part: {} for part in figures.PARTS})
            made[name] = run_page.write(path, path.with_name("report.html"))
    cut_off = interrupted_run(tmp_path / "cut")
    made["cut"] = unfinished.write(cut_off, cut_off / "report.html")
    table = swept(**{"pose.s": [0.7, np.nan]})
    dataset.save_table(table, tmp_path / "sweep.nc")
    rows = ranking.rows(table, ["pose"], "pose.s")
    made["sweep"] = sweep_page.write(tmp_path / "sweep.nc", rows, tmp_path / "sweep.html")
    return made


def open_at(browser, page, size, scheme):
    browser.size(*size)
    feature = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.command("Emulation.setEmulatedMedia", features=feature)
    browser.command("Page.setBypassCSP", enabled=True)
    browser.open(page)


@pytest.mark.parametrize(
    ("scheme", "sizes"),
    [
        ("light", SIZES[:1]),
        pytest.param("dark", SIZES[1:2], marks=pytest.mark.whole),
        pytest.param("light", SIZES[1:], marks=pytest.mark.whole),
        pytest.param("dark", (SIZES[0], SIZES[2]), marks=pytest.mark.whole),
    ],
)
def test_axe_finds_nothing(browser, pages, scheme, sizes):
    for name, page in pages.items():
        for size in sizes:
            open_at(browser, page, size, scheme)
            browser.command("Runtime.evaluate", expression=axe.AXE_SCRIPT)
            assert browser.js(FAULTS) == [], (name, size)


def test_axe_finds_what_is_wrong(browser, pages):
    open_at(browser, pages["poses"], SIZES[0], "light")
    browser.js("document.querySelector('main').innerHTML += '<img src=\"data:,\"><th></th>'")
    browser.command("Runtime.evaluate", expression=axe.AXE_SCRIPT)
    assert any("image-alt" in fault for fault in browser.js(FAULTS))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("size", SIZES)
def test_verdict_and_shape_are_on_the_first_screen_and_nothing_is_wider(browser, pages, size):
    for name, page in pages.items():
        open_at(browser, page, size, "light")
        wide, ends, top = browser.js(
            "const box = (q) => { const e = document.querySelector(q);"
            " return e ? e.getBoundingClientRect() : null; };"
            "const shown = box('.shape-stage') || box('.lead img') || box('.shown')"
            " || box('main img');"
            "return [document.documentElement.scrollWidth, box('.verdict').bottom, shown.top]"
        )
        assert wide == size[0], name
        assert ends < 0.5 * size[1], name
        assert top < 0.75 * size[1], name
    assert browser.said() == []


@pytest.mark.whole
def test_pictures_and_tables_are_whole_on_a_low_screen_too(
    browser, pages, write_run, small_points, tmp_path
):
    path, size = write_run(tmp_path), (1200, 560)
    keep_only({"point": small_points[0]}, path)
    point = run_page.write(path, path.with_name("report.html"))
    for name, page in {**pages, "point": point}.items():
        open_at(browser, page, size, "light")
        ends, cut = browser.js(
            "const own = document.querySelector('.lead img');"
            "return [own && own.closest('.shown') ? own.getBoundingClientRect().bottom : 0,"
            " [...document.querySelectorAll('.scroll:has(table)')].filter((e) =>"
            " e.clientWidth && e.scrollWidth > e.clientWidth).map((e) => e.outerHTML)]"
        )
        assert ends <= size[1], name
        assert cut == [], name


def test_on_paper_no_heading_stands_alone(browser, pages):
    browser.command("Emulation.setEmulatedMedia", media="print", features=[])
    for name, page in pages.items():
        browser.open(page)
        alone, parted = browser.js(
            "const seen = (e) => e.getClientRects().length > 0;"
            "const shown = [...document.querySelectorAll('section')].filter(seen);"
            "return [shown.filter((s) => ![...s.children].some((e) => e.tagName !== 'H2' &&"
            " seen(e))).map((s) => s.id), [...document.querySelectorAll('h2, h3, p:has(+ pre)')]"
            ".filter(seen).filter((e) => getComputedStyle(e).breakAfter !== 'avoid')"
            ".map((e) => e.textContent)]"
        )
        assert (alone, parted) == ([], []), name


def test_the_contents_stay_in_sight_and_the_keyboard_reaches_them(browser, pages):
    for size in SIZES[:2]:
        open_at(browser, pages["field"], size, "light")
        browser.key("Tab")
        assert browser.js("return document.activeElement.textContent") == "Skip to the content"
        browser.key("Tab")
        assert browser.js("return document.activeElement.textContent") == "Result"
        place = browser.js(
            "document.querySelector('#provenance').scrollIntoView();"
            "return document.querySelector('nav').getBoundingClientRect().top"
        )
        assert -1 <= place <= 1
