"""What a user is told about a registration file that is wrong: one sentence, with file and line."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from sldvexp.errors import UserError
from sldvexp.io.registration import RegistrationTable, read, to_dataset, write
from sldvexp.units import LengthUnit

GOOD = (
    "NUMREG 2",
    "UNITS inch",
    "DISTGUESS 67",
    "REGPOINT 1 2 3 0 5 0.5",
    "REGPOINT 2 4 3 0 6 0.5",
)
LENGTHS = "m, cm, mm, inch, ft"


def changed(line: int, text: str) -> str:
    lines = list(GOOD)
    lines[line - 1] = text
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "\n".join(GOOD[:-1]),
            ": NUMREG promises 2 points but 1 REGPOINT lines follow (point 2 is missing)",
        ),
        (changed(1, "NUMREG 1"), ": NUMREG promises 1 points but 2 REGPOINT lines follow"),
        (changed(1, ""), ": NUMREG, the number of points, is missing"),
        (changed(1, "NUMREG two"), ", line 1: NUMREG must be a whole number, not 'two'"),
        (changed(1, "NUMREG"), ", line 1: NUMREG needs one value, not 0"),
        (changed(2, "NUMREG 2"), ", line 2: NUMREG stands twice"),
        ("NUMREG 0\nUNITS m", ": has no REGPOINT line"),
        ("", ": NUMREG, the number of points, is missing"),
        (
            changed(2, "UNITS furlong"),
            ", line 2: unknown unit 'furlong'; Valid: cm, ft, inch, m, mm",
        ),
        (
            changed(2, "UNITS ich"),
            ", line 2: unknown unit 'ich'; did you mean inch? Valid: cm, ft, inch, m, mm",
        ),
        (
            changed(2, ""),
            f": states no unit of length; add a line UNITS with one of {LENGTHS}",
        ),
        (changed(3, "DISTGUESS far"), ", line 3: DISTGUESS must be a number, not 'far'"),
        (changed(3, "DISTGUESS 0"), ", line 3: DISTGUESS must be a positive distance, not 0"),
        (
            changed(3, "DISTGUES 67"),
            ", line 3: unknown keyword 'DISTGUES'; did you mean DISTGUESS? "
            "Valid: DISTGUESS, NUMREG, REGPOINT, UNITS",
        ),
        (
            changed(4, "REGPOINT 1 2 x 0 5 0.5"),
            ", line 4: y of point 1 must be a number, not 'x'",
        ),
        (
            changed(4, "REGPOINT 1 2 3 nan 5 0.5"),
            ", line 4: z of point 1 must be finite, not nan",
        ),
        (
            changed(5, "REGPOINT 2 4 3 0 6 -inf"),
            ", line 5: left_right of point 2 must be finite, not -inf",
        ),
        (
            changed(5, "REGPOINT 2 4 3 0 1e999 0"),
            ", line 5: up_down of point 2 must be finite, not 1e999",
        ),
        (
            changed(5, "REGPOINT 1 4 3 0 6 0.5"),
            ", line 5: point number 1 stands on line 4 already",
        ),
        (
            changed(5, "REGPOINT 4 3 0 6 0.5"),
            ", line 5: REGPOINT needs a point number, x, y, z, up_down, left_right, "
            "but has 5 values",
        ),
        (
            changed(5, "REGPOINT 2.5 4 3 0 6 0.5"),
            ", line 5: the point number must be a whole number, not '2.5'",
        ),
        (
            changed(5, "REGPOINT 2 4 3 0 983 82"),
            ", line 5: up_down of point 2 must be below 90 deg, not 983 (are these DAC steps?)",
        ),
    ],
)
def test_reg(tmp_path, text, message):
    path = tmp_path / "mine.reg"
    path.write_text(text)
    with pytest.raises(UserError) as error:
        read(path)
    assert str(error.value) == f"{path}{message}"


HEADER = "point,x_inch,y_inch,z_inch,up_down_deg,left_right_deg"
NEEDED = (
    "needed are point, x_U, y_U, z_U and up_down_V, left_right_V with U one of m, cm, mm, inch, "
    "ft and V one of rad, deg, dac"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", f": the column point is missing; there are none; {NEEDED}"),
        (
            "x_inch,y_inch,z_inch\n1,2,3",
            f": the column point is missing; there are x_inch, y_inch, z_inch; {NEEDED}",
        ),
        (
            "point,x_inch,z_inch,up_down_deg,left_right_deg\n",
            ": the column y_inch is missing; there are point, x_inch, z_inch, up_down_deg, "
            f"left_right_deg; {NEEDED}",
        ),
        (
            "point,x_m,y_m,z_m\n1,2,3,4",
            f": the column up_down_deg is missing; there are point, x_m, y_m, z_m; {NEEDED}",
        ),
        (
            "point,x_m,y_m,z_m,up_down_dac\n1,2,3,4,5",
            ": the column left_right_dac is missing; there are point, x_m, y_m, z_m, "
            f"up_down_dac; {NEEDED}",
        ),
        (
            "point,x_m,y_m,z_m,up_down_deg,left_rigth_deg\n",
            ": unknown column 'left_rigth_deg'; did you mean left_right_deg? "
            f"Valid: view, {NEEDED.removeprefix('needed are ')}",
        ),
        (
            "point,x_m,y_mm,z_m,up_down_deg,left_right_deg\n",
            ": the columns x, y, z mix the units m and mm",
        ),
        (
            "point,x_m,y_m,z_m,up_down_deg,left_right_rad\n",
            ": the columns up_down, left_right mix the units rad and deg",
        ),
        (f"{HEADER},point\n", ": the column point stands twice"),
        (
            "point,x,y,z,up_down_deg,left_right_deg\n1,2,3,4,5,6",
            ": states no unit of length; add it to the columns' names, as in x_inch, with one of "
            f"{LENGTHS}",
        ),
        (f"{HEADER}\n", ": has a header but no points"),
        (f"view,{HEADER}\n ,1,2,3,0,9,1", ", line 2: the view has no name"),
        (
            f"{HEADER}\n{'9' * 200_000}",
            ", line 2: is not CSV: field larger than field limit (131072)",
        ),
        (
            f"{HEADER}\n# a\n\n1,2,3,0,5,0.5\n2,,3,0,5,0.5",
            ", line 5: x_inch of point 2 must be a number, not ''",
        ),
        (
            f"{HEADER}\n1,2,3,0,5,NaN",
            ", line 2: left_right_deg of point 1 must be finite, not NaN",
        ),
        (f"{HEADER}\n1,2,3,0,5", ", line 2: has 5 values under 6 columns"),
        (
            f"{HEADER}\none,2,3,0,5,1",
            ", line 2: the point number must be a whole number, not 'one'",
        ),
        (
            f"{HEADER}\n1,2,3,0,5,1\n3,2,3,0,5,1\n1,2,3,0,5,1",
            ", line 4: point number 1 stands on line 2 already",
        ),
        (
            f"{HEADER}\n1,2,3,0,95,1",
            ", view mine: the up_down angle of point 1 is 95 deg, but a beam towards the object "
            "stays below 90 deg (are these DAC steps?)",
        ),
        (
            f"view,{HEADER}\neast,1,2,3,0,9,1\nwest,1,2,3,0,-90,1",
            ", view west: the up_down angle of point 1 is -90 deg, but a beam towards the object "
            "stays below 90 deg (are these DAC steps?)",
        ),
    ],
)
def test_csv(tmp_path, text, message):
    path = tmp_path / "mine.csv"
    path.write_text(text)
    with pytest.raises(UserError) as error:
        read(path)
    assert str(error.value) == f"{path}{message}"


def good(**changes) -> RegistrationTable:
    fields = {
        "name": "east",
        "number": np.array([1, 2]),
        "object_point": np.array([[0.0, 0, 0], [1, 0, 0]]),
        "angle": np.array([[0.1, 0.2], [0.1, 0.3]]),
    }
    return RegistrationTable(**{**fields, **changes})


def partly_nan(data: xr.Dataset) -> xr.Dataset:
    data["angle"].loc[{"point": 2, "mirror": "up_down"}] = np.nan
    return data


def without_units(name: str):
    def change(data: xr.Dataset) -> xr.Dataset:
        del data[name].attrs["units"]
        return data

    return change


@pytest.mark.one_in(12)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda data: data.drop_vars("object_point"),
            ": the variable object_point is missing, in the group /registration or at the root; "
            "there are angle, used",
        ),
        (
            lambda data: data.drop_vars("angle"),
            ", view east: has neither mirror angles nor DAC steps",
        ),
        (
            without_units("object_point"),
            ": states no unit of length; add an attribute units to object_point with one of "
            f"{LENGTHS}",
        ),
        (
            without_units("angle"),
            ": angle has no attribute units; add one of rad, deg",
        ),
        (
            lambda data: data.assign(angle=data["angle"].assign_attrs(units="degz")),
            ", angle: unknown unit 'degz'; did you mean deg? Valid: deg, rad",
        ),
        (
            lambda data: data.drop_vars("point"),
            ": the coordinate point with the points' numbers is missing",
        ),
        (
            lambda data: data.drop_vars("mirror"),
            ": the coordinate mirror of angle must be up_down, left_right, not missing",
        ),
        (
            lambda data: data.isel(axis=[0, 1]),
            ": the coordinate axis of object_point must be x, y, z, not x, y",
        ),
        (
            lambda data: data.rename(axis="xyz"),
            ": object_point must have the dimensions view, point, axis, not view, point, xyz",
        ),
        (partly_nan, ", view east: angle of point 2 is not a finite number"),
        (
            lambda data: data.where(data["point"] != 1).assign(angle=data["angle"]),
            ", view east: object_point of point 1 is not a finite number",
        ),
        (
            lambda data: data.assign_coords(point=[4, 4]),
            ", view east: point number 4 stands twice",
        ),
    ],
)
def test_netcdf(tmp_path, change, message):
    path = tmp_path / "mine.nc"
    change(to_dataset([good()])).to_netcdf(path, engine="netcdf4")
    with pytest.raises(UserError) as error:
        read(path)
    assert str(error.value) == f"{path}{message}"


@pytest.mark.parametrize("suffix", [".reg", ".csv", ".nc"])
def test_files_that_are_none(tmp_path, suffix):
    path = tmp_path / f"mine{suffix}"
    with pytest.raises(UserError) as error:
        read(path)
    assert str(error.value).startswith(f"{path}: there is no such file (looked from ")
    path.mkdir()
    with pytest.raises(UserError) as error:
        read(path)
    assert str(error.value) == f"{path}: is a folder; a file is needed"


@pytest.mark.parametrize("content", [b"NUMREG\0 2", b"\x89HDF\r\n\x1a\n\xff\xfe"])
@pytest.mark.parametrize("suffix", [".reg", ".csv"])
def test_binary_files(tmp_path, suffix, content):
    path = tmp_path / f"mine{suffix}"
    path.write_bytes(content)
    with pytest.raises(UserError) as error:
        read(path)
    assert str(error.value) == f"{path}: is not a text file, although its suffix says so"


def test_text_that_is_no_netcdf(tmp_path):
    path = tmp_path / "mine.nc"
    path.write_text("NUMREG 2")
    with pytest.raises(UserError, match="is not a readable netCDF-4 file"):
        read(path)


@pytest.mark.parametrize(("name", "what"), [("a.txt", ".txt"), ("a", "file without a suffix")])
def test_unknown_formats(tmp_path, name, what):
    path = tmp_path / name
    message = f"{path}: registration data cannot be a {what}; valid: .reg, .csv, .nc"
    for call in (lambda: read(path), lambda: write(path, [good()])):
        with pytest.raises(UserError) as error:
            call()
        assert str(error.value) == message


@pytest.mark.parametrize("suffix", [".reg", ".csv"])
def test_a_given_unit_that_contradicts_the_file(tmp_path, suffix):
    path = tmp_path / f"mine{suffix}"
    write(path, [good()])
    with pytest.raises(UserError) as error:
        read(path, LengthUnit.inch)
    assert str(error.value) == f"{path}: is in m but was to be read in inch"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"angle": None}, "has neither mirror angles nor DAC steps"),
        (
            {"object_point": np.zeros((3, 3))},
            "object_point has the shape (3, 3) where 2 points need (2, 3)",
        ),
        ({"dac": np.zeros(2)}, "dac has the shape (2,) where 2 points need (2, 2)"),
        ({"dac": np.array([[0, 0], [0, np.nan]])}, "dac of point 2 is not a finite number"),
        ({"number": np.array([2, 2])}, "point number 2 stands twice"),
        (
            {"number": np.array([]), "object_point": np.zeros((0, 3)), "angle": np.zeros((0, 2))},
            "has no points",
        ),
    ],
)
def test_tables(changes, message):
    with pytest.raises(UserError) as error:
        good(**changes)
    assert str(error.value) == f"registration data, view east: {message}"


@pytest.mark.parametrize(
    ("name", "tables", "message"),
    [
        ("a.csv", [], "{path}: there are no views to write"),
        (
            "a.reg",
            [good(), good(name="west")],
            "a .reg file holds one view, not 2; write .csv or .nc, or a file a view",
        ),
        (
            "a.reg",
            [good(angle=None, dac=np.zeros((2, 2)))],
            "a .reg file holds angles, and view east has DAC steps only; write .csv or .nc",
        ),
        (
            "a.csv",
            [good(), good(name="west", dac=np.zeros((2, 2)))],
            "views east and west cannot share a .csv file: one has angles or DAC steps that the "
            "other lacks",
        ),
        ("a.csv", [good(name="#1")], "view #1 would be a comment in a .csv file; rename it"),
        ("a.nc", [good(), good()], "registration data: two of the views east, east have one name"),
        ("none/a.csv", [good()], "{path}: cannot be written: No such file or directory"),
    ],
)
def test_writing(tmp_path, name, tables, message):
    path = tmp_path / name
    with pytest.raises(UserError) as error:
        write(path, tables)
    assert str(error.value) == message.format(path=path)
    assert not list(tmp_path.iterdir())


def test_writing_over_a_folder(tmp_path):
    path = tmp_path / "a.csv"
    path.mkdir()
    with pytest.raises(UserError, match="cannot be written: Is a directory"):
        write(path, [good()])
    assert list(tmp_path.iterdir()) == [path]
