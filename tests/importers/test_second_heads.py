"""Heads that come again inside a table: passed over if they are the same, else asked about."""

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
    "frequency": [195.0],
}
HEAD = "Index\tX [m]\tY [m]\tZ [m]\tReal [mm/s]\tImag [mm/s]"
ROWS = ["1\t0\t0\t0\t1\t2", "2\t0.3\t0\t0\t3\t4", "3\t0\t0.2\t0\t5\t6", "4\t0.3\t0.2\t0\t7\t8"]
RIGHT = 1e-3 * np.array([1 + 2j, 3 + 4j, 5 + 6j, 7 + 8j])


def read(tmp_path, *lines, **more):
    path = tmp_path / "scan.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    view = PointwiseView(path=str(path), origin=[0.0, 0.0, 1.5])
    return ScanExport(views={"a": view}, **{**SAID, **more}).read()


def right(group):
    np.testing.assert_allclose(group["velocity"].values.ravel(), RIGHT, rtol=1e-12)
    assert not [f for f in take_findings({"line_of_sight": group}) if f.kind == "unit"]


@pytest.mark.parametrize(
    "page",
    [
        [HEAD],
        ["", "Page 2 of 2", HEAD],
        ["\x0c", "Page 2 of 2", "", HEAD, ""],
        ["% " + HEAD],
        ["# one\t2\tthree\tfour\tfive\tsix"],
        ["% a remark\tof\tas\tmany\tcells\tas rows"],
    ],
    ids=["head", "page", "form feed", "comment", "words and a number", "words"],
)
def test_pages_and_comments_are_passed_over(tmp_path, page):
    right(read(tmp_path, "Page 1 of 2", HEAD, *ROWS[:2], *page, *ROWS[2:]))


def test_column_that_differs_is_named_although_units_are_left_out(tmp_path):
    second = "Index\tX\tY\tZ\tReal\tOther"
    with pytest.raises(UserError, match="column 6 is 'Other'"):
        read(tmp_path, HEAD, *ROWS[:2], second, *ROWS[2:])


@pytest.mark.parametrize(
    "head",
    [
        ["% Index\tX [m]\tY [m]\tZ [m]\tReal [mm/s]\tImag [mm/s]"],
        [HEAD, "% a remark\tof\tas\tmany\tcells\tas rows"],
        ["Index\tX\tY\tZ\tReal\tImag", "-\tm\tm\tm\tmm/s\tmm/s", "# made\tby\tone\tof\tthe\trooms"],
        ["# Index\tX\tY\tZ\tReal\tImag", "# -\tm\tm\tm\tmm/s\tmm/s"],
    ],
    ids=["commented head", "comment below it", "comment below two lines", "two commented lines"],
)
def test_comments_do_not_hide_the_head(tmp_path, head):
    right(read(tmp_path, *head, *ROWS))


def test_commented_head_of_a_table_of_blanks(tmp_path):
    head = "%  Nr   X[m]  Y[m]  Z[m]  Real[mm/s]  Imag[mm/s]"
    right(read(tmp_path, head, *(row.replace("\t", "   ") for row in ROWS)))


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (HEAD.replace("mm/s", "m/s"), "column 5 is in m/s and not in mm/s"),
        (HEAD.replace("X [m]", "X [mm]"), "column 2 is in mm and not in m"),
        ("% " + HEAD.replace("mm/s", "µm/s"), "column 5 is in µm/s and not in mm/s"),
        (HEAD.replace("Real [mm/s]", "Real [mm/s rms]"), "column 5 is in mm/s rms and not in mm/s"),
        ("-\tm\tm\tm\tm/s\tm/s", "column 5 is in m/s and not in mm/s"),
        ("Index\tX [m]\tY [m]\tZ [m]\tImag [mm/s]\tReal [mm/s]",
         "looks like a second head, in which column 5 is 'Imag [mm/s]' and not 'Real [mm/s]'"),
    ],
)  # fmt: skip
def test_second_head_with_other_units_or_columns_is_asked_about(tmp_path, head, said):
    with pytest.raises(UserError) as error:
        read(tmp_path, HEAD, *ROWS[:2], head, *ROWS[2:])
    assert "scan.txt, line 4: " in str(error.value)
    assert said in str(error.value), str(error.value)


def test_second_head_whose_unit_differs_in_a_number_alone_is_asked_about(tmp_path):
    first = HEAD.replace("mm/s", "1e-3 m/s")
    with pytest.raises(UserError, match="line 4: is a second head, in which column 5 is in 1e-6"):
        read(tmp_path, first, *ROWS[:2], first.replace("1e-3", "1e-6"), *ROWS[2:])
    right(read(tmp_path, first, *ROWS[:2], first, *ROWS[2:]))


def test_second_head_with_a_unit_in_another_spelling_is_the_same(tmp_path):
    other = HEAD.replace("mm/s", "mm s^-1")
    right(read(tmp_path, HEAD, *ROWS[:2], other, *ROWS[2:]))
    right(read(tmp_path, HEAD, *ROWS[:2], "% " + other, *ROWS[2:]))
