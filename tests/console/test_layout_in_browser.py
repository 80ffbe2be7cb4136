"""What stands in the window at once, and that nothing moves when marks are counted."""

from __future__ import annotations

import itertools
import os

import pytest

from tests.console.served import Page, Served
from tests.console.two_faces import FILES, write_files
from tests.report import devtools
from tests.report.opened import PHONE

#: What the page does is tried by its own tests; these take a console and pages of their own.
pytestmark = [
    pytest.mark.whole,
    pytest.mark.skipif(not devtools.PATH, reason="needs chromium"),
]
LAPTOP, SMALL = (1440, 900), (1280, 720)
#: All that is used to aim.
USED = ("field", "look", "nearer", "whole", "shown", "marks-box", "mark", "go", "undo", "redo")
USED += ("pose", "name", "write", "start", "written", "slide-up", "flags", "layout-box")
BOXES = """
return Object.fromEntries(arguments[0].map((id) => {
  const b = document.getElementById(id).getBoundingClientRect();
  return [id, [b.left, b.top, b.right, b.bottom].map((v) => Math.round(v))];
}));
"""
VIEWS = """
return [...document.querySelectorAll('#view li')].map((li) => {
  const b = li.getBoundingClientRect(); return [b.left, b.right, b.top].map(Math.round); });
"""


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two_faces")
    write_files(folder / "my")
    made = Served(folder, bench=FILES["experiment/bench.yaml"])
    yield made
    made.end()


def opened(served, size):
    page = Page(served.address, size)
    page.until(lambda: page.text("who").startswith("You are steering"))
    page.until(lambda: page.text("flags"))
    page.until(lambda: not page.js("return document.getElementById('camera-box').hidden"))
    return page


def pictured(page, name):
    if folder := os.environ.get("SLDVEXP_SHOTS"):
        with open(f"{folder}/{name}.png", "wb") as file:
            file.write(page.picture())


@pytest.mark.parametrize("size", [LAPTOP, SMALL])
def test_all_that_is_used_to_aim_stands_in_the_window(served, size):
    page = opened(served, size)
    try:
        used = (*USED, "camera-box") if size == LAPTOP else USED
        for name, (left, top, right, bottom) in page.js(BOXES, used).items():
            assert min(left, top) >= 0, name
            assert right <= size[0], name
            assert bottom <= size[1], name
        pictured(page, f"fits-{size[0]}")
    finally:
        page.close()


@pytest.mark.parametrize("size", [LAPTOP, SMALL, PHONE])
def test_counts_of_marks_and_bounds_move_nothing(served, size):
    page = opened(served, size)
    try:
        before = page.js(BOXES, USED), page.js(VIEWS)
        for k, at in enumerate(((-15228, -3723), (-11314, -7976), (-7551, -7883), (-10888, -4142))):
            move = "document.getElementById('map').aim.page.wish('move', {to: arguments[0]})"
            page.js(move, [at[0] + k, at[1]])
            page.until(lambda at=at, k=k: page.beam == (at[0] + k, at[1]))
            page.mark()
            assert (page.js(BOXES, USED), page.js(VIEWS)) == before
        page.until(lambda: "≤" in page.text("marks"))
        wide = (
            "const t = document.getElementById('marks');"
            "return t.scrollWidth <= t.parentNode.clientWidth"
        )
        assert page.js(wide)
        tall = "return document.querySelector('#marks thead').getBoundingClientRect().height"
        assert page.js(tall) < 30
        assert page.js("return document.getElementById('view').firstChild.textContent") == "1(4)"
        pictured(page, f"counted-{size[0]}")
        for count in (3, 2, 1, 0):
            page.key("u")
            page.until(lambda count=count: page.marks == count)
    finally:
        page.close()


#: Boxes of the parts of the drawing: shapes, and numbers.
DRAWN = """
const boxes = (kind) => [...document.querySelectorAll(`#layout ${kind}`)].map((e) => {
  const b = e.getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]; });
return [boxes('polygon'), boxes('text'), document.getElementById('layout-told').textContent];
"""


def overlap(one, other):
    left, top = max(one[0], other[0]), max(one[1], other[1])
    right, bottom = min(one[2], other[2]), min(one[3], other[3])
    return right - left > 1 and bottom - top > 4  # a text's box has room above its figures


def test_drawing_shows_all_faces_with_numbers_that_cover_nothing(served):
    page = opened(served, LAPTOP)
    try:
        for known, told in ((True, "in view 1"), (False, "obliquely")):
            if not known:  # as where nothing tells yet where the instrument stands
                page.js(
                    "const aim = document.getElementById('map').aim;"
                    "aim.marks.predicted = []; aim.drawLayout()"
                )
            shapes, numbers, caption = page.js(DRAWN)
            assert len(shapes) == len(numbers) == 8
            assert told in caption
            for one, other in itertools.combinations([*shapes, *numbers], 2):
                assert not overlap(one, other)
            pictured(page, f"drawn-{known}")
    finally:
        page.close()


#: Boxes of the names on the field of view.
NAMES = "return document.getElementById('map').aim.names.map(({box}) => box)"
CHOOSE = "document.getElementById('map').aim.page.wish('view', {name: arguments[0]})"


def test_names_of_twelve_marks_can_be_read_on_a_phone(served):
    """Where many stand close together they cover marks and outlines rather than one another."""
    page = opened(served, PHONE)
    try:
        for view in ("1", "3"):
            page.js(CHOOSE, view)
            page.until(lambda view=view: page.view == view and len(page.js(NAMES)) == 12)
            for one, other in itertools.combinations(page.js(NAMES), 2):
                wide, tall = (min(one[k + 2], other[k + 2]) - max(one[k], other[k]) for k in (0, 1))
                assert min(wide, tall) < 1, view
            pictured(page, f"named-{view}")
    finally:
        page.close()


#: Tells of one view, of two, of these again after the first was chosen; what is shown each time.
PANE = """
const told = (names) => names.map((name) => ({name, told: [`Pose of ${name}`]}));
const shown = () => [...document.querySelectorAll('#views-lists ul')]
  .filter((list) => !list.hidden).map((list) => list.textContent);
return import('./scan.js').then(({Scan}) => {
  const scan = new Scan({wish() {}, choose() {}}), found = [];
  for (const names of [['1'], ['1', '2']]) { scan.done(told(names)); found.push(shown()); }
  document.querySelector('#views-told button').click();
  found.push(shown());
  scan.done(told(['1', '2']));
  found.push(shown());
  scan.done(told(['1', '2', '3']));
  found.push(shown());
  return found;
});
"""


def test_pane_follows_the_view_that_was_done_last_and_shows_others_on_a_click(served):
    page = opened(served, LAPTOP)
    try:
        shown = page.js(PANE)
        assert shown == [[f"Pose of {view}"] for view in ("1", "2", "1", "1", "3")]
    finally:
        page.close()
