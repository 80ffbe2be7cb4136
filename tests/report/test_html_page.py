"""A page is one file, in order, and nothing in a run's file can become a part of it."""

from __future__ import annotations

import gc
import json
import shutil
from html.parser import HTMLParser
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
import yaml

from sldvexp import dataset
from sldvexp.dataset import read_yaml
from sldvexp.errors import UserError
from sldvexp.field.estimate import NO_COVARIANCE
from sldvexp.plot import FIGURES
from sldvexp.report import attempt
from sldvexp.report.html import figures, render, results, run_page, setup
from sldvexp.report.html.blocks import having
from sldvexp.report.html.page import Html
from sldvexp.report.html.render import number_like


class Page(HTMLParser):
    """What a browser would see: tags with their attributes, and the text outside of scripts."""

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self._inside = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._inside = tag

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside not in ("script", "style"):
            self.words.append(data)

    def count(self, tag: str) -> int:
        return sum(name == tag for name, _ in self.tags)

    @property
    def sections(self) -> list[str]:
        return [str(a["id"]) for tag, a in self.tags if tag == "section"]

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def made(path) -> Page:
    page = path.with_name("report.html")
    assert run_page.write(path, page) == page
    return Page(page.read_text())


def test_page_is_in_order_and_ends_with_the_command(run_file, no_figures):
    check = dataset.group(
        "check",
        {"quantity": ["field@sse"]},
        published=[1.0],
        computed=[2.0],
        correct=[np.nan],
        tolerance=[0.1],
        relation=["="],
        passed=[False],
        source=["Table 5.7"],
    )
    page = made(run_file(check=check))
    assert page.sections == [
        "result",
        "what-to-mind",
        "views",
        "velocity-field",
        "checks",
        "settings",
        "provenance",
    ]
    assert page.text.endswith("sldvexp rerun run.nc")
    assert "not as expected: field@sse is 2, and should be = 1 (Table 5.7)" in page.text
    assert page.text.index("not as expected") < page.text.index("mind </") < len(page.text) / 2
    assert "Velocity field of 60 nodes from 2 views at 2 frequencies" in page.text
    assert "2026-01-02 03:04:05 UTC · took 2 s · sldvexp 0.1.0 · seed 3" in page.text
    assert "had been changed since its last commit" in page.text


def test_nothing_is_fetched_and_what_draws_is_there_once(run_file, no_figures):
    path = run_file()
    page = made(path)
    for tag, attributes in page.tags:
        for name in ("src", "href", "data", "action", "srcset", "poster"):
            address = attributes.get(name) or "#"
            assert address.startswith(("#", "data:")), (tag, address)
    assert page.count("script") == 2  # data, what draws it
    text = path.with_name("report.html").read_text()
    assert "default-src 'none'" in text
    assert "url(" not in text.partition("<style>")[2].partition("</style>")[0]
    assert len(text) < 1e5


def test_hostile_names_are_only_text(run_file, hostile, no_figures):
    path = run_file()
    page = made(path)
    assert page.count("img") == 0
    assert page.count("script") == 2
    assert hostile in page.text  # as it was, 7 times 7 not worked out
    assert "<img src=x" not in path.with_name("report.html").read_text()


def test_data_cannot_end_its_script(hostile):
    text = render._json({hostile: [hostile, 1.5]})
    assert json.loads(text) == {hostile: [hostile, 1.5]}
    assert not set("<>&") & set(text)


def test_page_without_a_field_has_no_script(tmp_path, run_file, no_figures):
    whole = dataset.load(run_file()).load()
    path = tmp_path / "other" / "run.nc"
    path.parent.mkdir()
    dataset.save({"volume": whole["volume"].to_dataset()}, whole.attrs, path)
    page = made(path)
    assert page.count("script") == 0
    assert page.sections == ["result", "what-to-mind", "settings", "provenance"]
    assert path.with_name("report.html").stat().st_size < 50_000


@pytest.mark.whole
def test_figures_are_in_the_page_and_one_that_fails_is_told(run_file, monkeypatch):
    page = made(run_file())
    pictures = [a["src"] for tag, a in page.tags if tag == "img"]
    assert len(pictures) >= 2
    assert all(p.startswith("data:image/") and len(p) > 1000 for p in pictures)

    def fail(*_):
        raise ZeroDivisionError("nothing to divide")

    monkeypatch.setattr(figures, "_address", fail)
    page = made(run_file())
    assert "The figure field could not be drawn: nothing to divide" in page.text
    assert page.count("img") == 0


def test_points_that_are_left_out_are_counted_below_the_table(
    tmp_path, run_file, small_points, no_figures, monkeypatch
):
    monkeypatch.setattr(results, "MOST_VELOCITIES", 4)
    whole = dataset.load(run_file()).load()
    point, line_of_sight = small_points
    path = tmp_path / "points" / "run.nc"
    path.parent.mkdir()
    dataset.save({"point": point, "line_of_sight": line_of_sight}, whole.attrs, path)
    page = made(path)
    assert "point: 18 more in run.nc, group point." in page.text
    assert page.text.count(": V_x ") == 4


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("passed", "told"),
    [
        ([True], "The one expectation is met."),
        ([True, True], "All 2 expectations are met."),
        ([True, False], "1 of 2 expectations are met."),
    ],
)
def test_expectations_are_counted(run_file, no_figures, passed, told):
    numbers = dict.fromkeys(("published", "computed", "correct", "tolerance"), [1.0] * len(passed))
    about = {"relation": ["="] * len(passed), "source": ["a book"] * len(passed)}
    check = dataset.group(
        "check",
        {"quantity": [f"q{i}" for i in range(len(passed))]},
        **numbers,
        **about,
        passed=passed,
    )
    assert told in made(run_file(check=check)).text


@pytest.mark.whole
def test_a_figure_is_spelt_in_its_address_and_read_as_it_was(run_file, monkeypatch):
    drawn, spelt = [], figures._as_address
    monkeypatch.setattr(figures, "_as_address", lambda svg: drawn.append(svg) or spelt(svg))
    page = made(run_file())
    pictures = [a["src"] for tag, a in page.tags if tag == "img"]
    for svg, address in zip(drawn, pictures, strict=True):
        start = "data:image/svg+xml,"
        assert address.startswith(start)
        assert not set('<>&"#\n') & set(address)
        read, was = (
            ElementTree.canonicalize(text) for text in (unquote(address[len(start) :]), svg)
        )
        assert read.replace("\n", " ") == was.replace("\n", " ")
        assert len(address) < 1.2 * len(svg)


def test_every_figure_of_a_page_is_one_that_there_is():
    names = {name for part in figures.PARTS.values() for name in part}
    assert names <= set(FIGURES)
    left_out = {"scan_lines", "conics", "conic_residuals", "phase_correction", "sweep"}
    assert set(FIGURES) - names == left_out


@pytest.mark.whole
def test_a_page_shows_the_setup_and_the_nodes(run_file, monkeypatch):
    monkeypatch.setattr(figures, "_address", lambda _: "data:,")
    pose = {
        "origin": np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0]]),
        "rotation": np.tile(np.diag([1.0, -1.0, -1.0]), (2, 1, 1)),
        "euler": np.zeros((2, 3)),
    }
    page = made(run_file(pose=dataset.group("pose", {"view": ["left", "right"]}, **pose)))
    for part, name in (("stands", "volume"), ("field", "nodal"), ("field", "field")):
        assert figures.PARTS[part][name] in page.text


@pytest.mark.one_in(2)
@pytest.mark.parametrize("known", [True, False])
def test_poses_that_were_given_have_no_words_of_bounds(run_file, no_figures, known):
    bound = np.full((2, 3), 1e-3 if known else np.nan)
    pose = {
        "origin": np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0]]),
        "rotation": np.tile(np.diag([1.0, -1.0, -1.0]), (2, 1, 1)),
        "euler": np.zeros((2, 3)),
        "origin_std": bound / 2,
        "origin_confidence": bound,
        "euler_confidence": bound,
        "dof": [26, 26] if known else [np.inf, np.inf],
    }
    groups = {"pose": dataset.group("pose", {"view": ["left", "right"]}, **pose)}
    told = made(run_file(**groups)).text.partition("Velocity images")[0]
    assert ("The poses were given, and have no bounds." in told) is not known
    assert ("Origin, with 95% bounds" in told) is known
    assert ("dof" in told) is known
    assert "(no bound)" not in told
    assert " inf " not in told
    if not known:
        assert "the pose of views left, right has no bounds" in told
        with dataset.load(run_file()) as tree:
            field = tree["field"].to_dataset().load()
        field.attrs["notes"] = NO_COVARIANCE
        told = made(run_file(field=field, **groups)).text
        assert told.count("no covariance") == 1
        assert "has no bounds" not in told


def test_garbage_is_looked_for_later_as_it_was_before(pages, monkeypatch, tmp_path):
    during = []

    def write(path, page):
        during.append(gc.isenabled())
        raise ZeroDivisionError

    monkeypatch.setattr(run_page, "write", write)
    for turn in (gc.disable, gc.enable):  # on in the end, as for other tests
        turn()
        was = gc.isenabled()
        with pytest.raises(ZeroDivisionError):
            Html().of_run(tmp_path / "run.nc")
        assert gc.isenabled() is was
    assert during == [False, False]


@pytest.mark.whole
@pytest.mark.parametrize(
    "words", [("experiment=point",), ("experiment=pose",), (), ("experiment=plate_modes",)]
)
def test_page_of_what_is_in_memory_is_that_of_the_file(words, run_once, pages, tmp_path):
    folder = run_once(*words, pages=True)
    shutil.copy(folder / "run.nc", tmp_path)
    assert Html().of_run(tmp_path / "run.nc").read_bytes() == (folder / "report.html").read_bytes()


def test_a_configuration_makes_no_objects():
    assert read_yaml("{a: [1, 2.5], b: null}") == {"a": [1, 2.5], "b": None}
    with pytest.raises(yaml.YAMLError, match="python"):
        read_yaml("!!python/object/apply:os.getcwd []")


def test_flagged_pixels_do_not_count_in_the_table_of_images(run_file, no_figures):
    image = dataset.group(
        "image",
        {"pixel": [0, 1, 2, 3], "frequency": [197.0]},
        velocity=np.array([[0.001], [0.003j], [0.002], [9.0]]),
        velocity_std=np.array([[1e-5], [3e-5], [2e-5], [7.0]]),
        flags=np.array([0, 0, 0, 4], np.uint8),
    )
    page = made(run_file(**{"image/left": image}))
    assert "left 4 197 3 0.02 " in page.text


@pytest.mark.usefixtures("no_figures")
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_image_without_a_good_pixel_has_a_line_without_numbers(run_file):
    image = dataset.group(
        "image",
        {"frequency": [100.0, 200.0]},
        velocity=np.full((6, 2), 1e-3 + 0j),
        velocity_std=np.full((6, 2), 1e-6),
        flags=np.full(6, 4),
    ).assign_attrs(summary="6 of 6 pixels are flagged")
    page = made(run_file(**{"image/dark": image}))
    assert "dark 6 100 - - 6 of 6 pixels are flagged" in page.text


def test_what_is_left_out_of_a_check_is_counted(run_file, no_figures):
    many = xr.Dataset({"ratio": ("run", np.arange(251.0)), "other": ("view", np.arange(10.0))})
    page = made(run_file(**{"examined/many": many}))
    assert "ratio 251 of run 0 to 250, half of them below 125" in page.text
    assert "run 16" not in page.text
    assert "other view 9 9" in page.text


def test_long_figure_becomes_pixels(run_file, monkeypatch):
    monkeypatch.setattr(figures, "MOST_BYTES", 10)
    few = {part: {} for part in figures.PARTS} | {"field": {"residuals": "by view"}}
    monkeypatch.setattr(figures, "PARTS", few)
    page = made(run_file())
    pictures = [a["src"] for tag, a in page.tags if tag == "img"]
    assert pictures
    assert all(p.startswith("data:image/png;base64,iVBOR") for p in pictures)


def test_file_that_is_no_runs_is_refused(tmp_path):
    path = tmp_path / "run.nc"
    with pytest.raises(UserError, match="there is no such file"):
        run_page.write(path, tmp_path / "report.html")
    dataset.save({}, {"config": "[1, 2]", "plugins": "{}"}, path)
    with pytest.raises(UserError, match=r"run.nc: config: must be a table"):
        run_page.write(path, tmp_path / "report.html")
    dataset.save({}, {"config": "{}"}, path)
    with pytest.raises(UserError, match="has no attribute plugins"):
        run_page.write(path, tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_failing_page_costs_a_sentence_only(tmp_path, capsys):
    def fail():
        raise KeyError("velocity")

    assert attempt(fail, tmp_path / "run.nc") == []
    said = capsys.readouterr().err
    assert said.startswith("sldvexp: report: was not made (KeyError: 'velocity'); the results are ")
    assert said.count("\n") == 1
    assert attempt(lambda: None, tmp_path / "run.nc") == []
    assert attempt(lambda: tmp_path, tmp_path / "run.nc") == [tmp_path]


@pytest.mark.parametrize(
    ("cell", "number"),
    [("1.5 ± 0.2", True), ("-3", True), ("96%", True), ("-", False), ("x", False), ("", False)],
)
def test_cells_of_numbers_are_known(cell, number):
    assert number_like(cell) is number


def test_blocks_that_are_missing_are_left_out():
    assert having(None, [1, [None, 2]], 3) == [1, 2, 3]


def test_a_choice_that_builds_on_a_plugin_is_told_in_its_own_words():
    every = {"rows": "all", "model": "partial"}
    choice, told = setup.preset("reconstruction", "contravariant", every)
    assert choice == "samplewise"
    assert "all views" in told
    assert setup.preset("reconstruction", "contravariant", {"rows": "1,2,3"}) == ("", "")
    assert setup.preset("reconstruction", "absolute", every) == ("", "")
    assert setup.preset("reconstruction", "absolute", {"model": "full"})[0] == "absolute_full"
    assert setup.preset("pose", "edge", {}) == ("", "")
    name, told = setup._method("reconstruction", "contravariant", every)
    assert name == "samplewise (contravariant)"
    assert "Three rows" not in told
