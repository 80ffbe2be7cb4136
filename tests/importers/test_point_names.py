"""Names of points in tables: matched between views, kept in the run, and named if missing."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import take_findings
from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView, conventions
from sldvexp.importers.scan_export import ScanExport

SAID = {
    "positive": conventions.Positive.towards,
    "phase": conventions.Phase.exp_plus,
    "amplitude": conventions.Amplitude.peak,
}
HEAD = "195 Hz\nName\tX [m]\tY [m]\tZ [m]\tReal [m/s]\tImag [m/s]\n"
PLACES = {1: "0\t0\t0", 2: "0.3\t0\t0", 3: "0\t0.2\t0", 4: "0.3\t0.2\t0"}
NAMES = {1: "P01", 2: "P02", 3: "P03", 4: "P04"}


def table(names, points, gain=1):
    return HEAD + "".join(f"{names[p]}\t{PLACES[p]}\t{gain * p}\t0\n" for p in points)


def read(tmp_path, *texts, **more):
    views = {}
    for name, text, x in zip("abc", texts, (0.0, 1.0, -1.0), strict=False):
        path = tmp_path / f"{name}.txt"
        path.write_text(text, encoding="utf-8")
        views[name] = PointwiseView(path=str(path), origin=[x, 0.0, 1.5])
    return ScanExport(views=views, **{**SAID, **more}).read()


def asked(tmp_path, *texts, **more):
    with pytest.raises(UserError) as error:
        read(tmp_path, *texts, **more)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    "names",
    [
        NAMES,
        {1: "A-1", 2: "A-2", 3: "A-3", 4: "A-4"},
        {1: "tip", 2: "root", 3: "left edge", 4: "right edge"},
        {1: "A1", 2: "B1", 3: "A2", 4: "B2"},
    ],
    ids=["P01", "A-1", "words", "A1, B1"],
)
def test_points_of_one_name_are_one_point_in_all_views(tmp_path, names):
    group = read(tmp_path, table(names, (1, 2, 3, 4)), table(names, (4, 2, 1, 3), gain=10))
    for point, name in names.items():
        own = group.sel(point=name)
        np.testing.assert_allclose(own["velocity"].values.ravel(), [point, 10 * point])
        place = [float(x) for x in PLACES[point].split()]
        np.testing.assert_allclose(own["position"], place)
    (note,) = (f for f in take_findings({"line_of_sight": group}) if f.kind == "names")
    assert note.severity.name == "note"
    assert "the 4 points have names" in note.text
    kept = names[1] in ("P01", "A-1")
    assert ("numbered by the numbers at their ends" in note.text) == kept


def test_point_that_a_view_lacks_is_named(tmp_path):
    texts = table(NAMES, (1, 2, 3, 4)), table(NAMES, (1, 2, 4))
    assert "the view b has not measured point P03, as others have" in asked(tmp_path, *texts)
    group = read(tmp_path, *texts, incomplete="drop")
    assert list(group["point"].values) == ["P01", "P02", "P04"]
    said = [f.text for f in take_findings({"line_of_sight": group})]
    assert any("the first is point P03" in text for text in said)


def test_name_that_stands_twice_or_is_empty_is_named_by_its_line(tmp_path):
    twice = table(NAMES | {3: "P02"}, (1, 2, 3, 4))
    assert "is not understood" in asked(tmp_path, twice)
    columns = {"index": 1, "x": 2, "y": 3, "z": 4, "real": 5, "imag": 6}
    said = asked(tmp_path, twice, columns=columns)
    assert "line 5: point P02 at 195 Hz is given twice" in said
    said = asked(tmp_path, table(NAMES | {3: ""}, (1, 2, 3, 4)))
    assert "line 5: the point has no name, as others have" in said


def test_names_in_one_view_and_numbers_in_another_are_asked_about(tmp_path):
    numbered = table({1: "1", 2: "2", 3: "3", 4: "4"}, (1, 2, 3, 4))
    said = asked(tmp_path, table(NAMES, (1, 2, 3, 4)), numbered)
    assert "b.txt: the points of view b have no names, as P01 of view a has" in said


def test_words_before_coordinates_that_repeat_are_no_names(tmp_path):
    assert "is not understood" in asked(
        tmp_path, table({1: "ok", 2: "bad", 3: "ok", 4: "bad"}, (1, 2, 3, 4))
    )


def test_names_come_again_at_each_frequency(tmp_path):
    head = "Name\tX [m]\tY [m]\tZ [m]\tf [Hz]\tReal [m/s]\tImag [m/s]\n"
    rows = "".join(
        f"{NAMES[p]}\t{PLACES[p]}\t{f}\t{f * p}\t0\n" for f in (100, 200) for p in (1, 2, 3, 4)
    )
    group = read(tmp_path, head + rows)
    assert list(group["point"].values) == list(NAMES.values())
    np.testing.assert_allclose(group["velocity"].sel(point="P03").values[0], [300.0, 600.0])


def test_names_stay_with_frequencies_above_columns(tmp_path):
    head = "\t\t\t\t100 Hz\t200 Hz\nName\tX [m]\tY [m]\tZ [m]\tReal [m/s]\tReal [m/s]\n"
    rows = "".join(f"{NAMES[p]}\t{PLACES[p]}\t{p}\t{2 * p}\n" for p in (4, 3, 1, 2))
    group = read(tmp_path, head + rows)
    np.testing.assert_allclose(group["velocity"].sel(point="P04").values[0], [4.0, 8.0])
