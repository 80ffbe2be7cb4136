"""Text of any program is opened alike by every reader, and what was changed since is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.files import decoded, read_text, with_check_line
from sldvexp.io import read_centres, read_points, read_table
from sldvexp.io.registration import read as read_registration
from sldvexp.io.tables import plain_cells
from sldvexp.io.velocities import read as read_velocities
from sldvexp.pose.digitizer import read_repeats
from sldvexp.units import AngleUnit, LengthUnit, VelocityUnit, unit_named

ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp1252"]
NAMES = ["a", "b", "c"]

#: Readers with a file of theirs, and what of it is compared.
READERS = {
    "registration.csv": (
        "point,x_mm,y_mm,z_mm,up_down_deg,left_right_deg\n1,0.5,1.5,2.5,3.5,-4.5\n",
        lambda path: read_registration(path)[0].angle,
    ),
    "registration.reg": (
        "NUMREG 1\nUNITS inch\nREGPOINT 1 0.5 1.5 2.5 3.5 -4.5\n",
        lambda path: read_registration(path)[0].object_point,
    ),
    "points.csv": (
        "x_mm,y_mm,z_mm\n0.5,1.5,2.5\n1.5,0.5,0.25\n",
        lambda path: read_points(path)[0],
    ),
    "digitised.csv": (
        "point,x_mm,y_mm,z_mm\na,0.5,1.5,2.5\nb,1.5,0.5,0.25\nc,0.5,0.5,0.5\n",
        lambda path: read_repeats(path, NAMES, LengthUnit.mm),
    ),
    "digitised.txt": (
        "0.5 1.5 2.5\n1.5 0.5 0.25\n0.5 0.5 0.5\n",
        lambda path: read_repeats(path, NAMES, LengthUnit.mm),
    ),
    "velocities.csv": (
        "view,dx,dy,dz,real\na,0.6,0.0,0.8,0.5\nb,0.0,0.6,0.8,1.5\n",
        lambda path: read_velocities(path, VelocityUnit.mm_per_s).velocity,
    ),
    "Scan6pt": ("100 200\n-50 25\n", read_centres),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("name", READERS)
def test_every_reader_opens_every_encoding(name, encoding, tmp_path):
    text, read = READERS[name]
    path = tmp_path / name
    path.write_text(text)
    right = read(path)
    path.write_bytes(f"# Prüfstück\n{text}".replace("\n", "\r\n").encode(encoding))
    np.testing.assert_array_equal(read(path), right)


@pytest.mark.parametrize("delimiter", [";", "\t"])
@pytest.mark.parametrize("name", [n for n in READERS if n.endswith(".csv")])
def test_every_table_may_have_other_delimiters_and_decimal_commas(name, delimiter, tmp_path):
    text, read = READERS[name]
    path = tmp_path / name
    path.write_text(text)
    right = read(path)
    path.write_text(text.replace(",", delimiter).replace(".", ","))
    np.testing.assert_array_equal(read(path), right)


@pytest.mark.parametrize(
    ("line", "cells"),
    [
        ("1 2.5 3", ["1", "2.5", "3"]),
        ("1,2.5,3", ["1", "2.5", "3"]),
        ("1, 2.5, 3", ["1", "2.5", "3"]),
        ("1;2.5;3", ["1", "2.5", "3"]),
        ("1 2,5 3,0", ["1", "2.5", "3.0"]),
        ("1;2,5;3", ["1", "2.5", "3"]),
        ("1,2 , 3", ["1", "2", "3"]),
        ("", []),
    ],
)
def test_plain_lines_of_numbers(line, cells):
    assert plain_cells(line) == cells


def test_what_is_no_text():
    for content in (b"\x00\x01", bytes(range(256)), b"\x89HDF\r\n\x1a\n", b"a\x00b", b"a\x1fb"):
        assert decoded(content) is None
    assert decoded(b"") == ""
    assert decoded(b"\xb5m/s \x80") == "µm/s €"


TEXT = "x_m,y_m,z_m\n1,2,3\n4,5,6\n"


@pytest.mark.parametrize("last", [False, True])
def test_a_change_after_writing_is_refused(tmp_path, last):
    path, whole = tmp_path / "points.csv", with_check_line(TEXT, last)
    path.write_text(whole)
    assert read_table(path).rows == [("1", "2", "3"), ("4", "5", "6")]
    line = 4 if last else 1
    path.write_text(whole.replace("4,5,6", "4,8,6"))
    with pytest.raises(UserError) as error:
        read_table(path)
    assert str(error.value) == (
        f"{path}: was changed since it was written, as the checksum in line {line} tells; delete "
        "that line if the change is meant"
    )
    path.write_text(whole.replace("4,5,6\n", ""))
    with pytest.raises(UserError, match=r"has 2 lines besides line \d, which promises 3; the file"):
        read_table(path)
    path.write_text(TEXT.replace("4,5,6", "4,8,6"))
    assert read_table(path).rows[1] == ("4", "8", "6")


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_the_same_lines_in_another_form_are_no_change(tmp_path, encoding):
    path = tmp_path / "points.csv"
    whole = with_check_line(TEXT).replace("\n", " \r\n") + "\r\n"
    path.write_bytes(whole.encode(encoding))
    assert read_table(path).rows == [("1", "2", "3"), ("4", "5", "6")]
    assert read_text(Path(path)).startswith("# 3 lines, crc32 ")


@pytest.mark.parametrize(
    ("kind", "name", "unit"),
    [
        (LengthUnit, "inches", LengthUnit.inch),
        (LengthUnit, "Millimetres", LengthUnit.mm),
        (LengthUnit, "MM", LengthUnit.mm),
        (AngleUnit, "degrees", AngleUnit.deg),
        (AngleUnit, "°", AngleUnit.deg),
        (VelocityUnit, "m s-1", VelocityUnit.m_per_s),
        (VelocityUnit, "µm/s", VelocityUnit.um_per_s),
        (VelocityUnit, "mm s^-1", VelocityUnit.mm_per_s),
    ],
)
def test_units_are_compared_by_their_meaning(kind, name, unit):
    assert unit_named(kind, name, "here") is unit


@pytest.mark.parametrize("name", ["V", "mm/s RMS", "(mm/s)^2", "km/h", "m", "mm/s/N", "", "dB"])
def test_units_of_something_else_are_no_units_of_velocity(name):
    with pytest.raises(UserError, match=r"here: unknown unit .*; .*Valid: inch_per_s, m_per_s"):
        unit_named(VelocityUnit, name, "here")
