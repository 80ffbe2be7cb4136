"""Registration files: what is written comes back, in every format and unit."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.io.registration import RegistrationTable, from_dataset, read, to_dataset, write
from sldvexp.laser import TwoMirror
from sldvexp.units import AngleUnit, LengthUnit, decimal_in

DATA = Path(__file__).parents[3] / "conf" / "data"
SUFFIXES = (".reg", ".csv", ".nc")

# Figure 4.28: number, x, y, z in inch, up-down and left-right in degrees.
FIGURE_4_28 = np.array(
    [
        [1, 2.3490, 3.2156, 0, 5.7240, 0.016338],
        [2, 2.1653, 2.4277, 0, 6.3252, 0.15252],
        [3, 7.5578, 2.0048, 0, 7.5321, -3.68404],
        [4, 7.3725, 1.2100, 0, 8.1404, -3.5342],
        [5, 7.0696, 1.7066, 0, 7.6883, -3.32194],
        [6, 7.8611, 1.5078, 0, 7.9869, -3.8966],
        [7, 9.1017, 9.8073, 0, 1.1459, -5.0806],
        [8, 9.8976, 9.6075, 0, 1.4373, -5.7101],
        [9, 9.5079, 9.2973, 0, 1.6583, -5.3927],
        [10, 9.4905, 10.1177, 0, 0.92188, -5.3952],
        [11, 1.5890, 9.1396, 0, 0.82673, 0.50844],
        [12, 1.5721, 9.9408, 0, 0.15990, 0.52678],
        [13, 1.9797, 9.5806, 0, 0.51099, 0.23635],
        [14, 1.1823, 9.5003, 0, 0.47595, 0.79599],
        [15, 2.6598, 2.8623, 0, 6.0526, -0.19674],
        [16, 1.8549, 2.7813, 0, 5.9968, 0.36480],
    ]
)


@pytest.mark.parametrize("suffix", [".reg", ".csv"])
def test_figure_4_28(suffix):
    (table,) = read(DATA / f"figure_4_28{suffix}")
    assert table.name == "figure_4_28"
    assert table.unit is LengthUnit.inch
    np.testing.assert_array_equal(table.number, FIGURE_4_28[:, 0])
    np.testing.assert_array_equal(table.object_point, FIGURE_4_28[:, 1:4] * 0.0254)
    np.testing.assert_array_equal(table.angle, FIGURE_4_28[:, 4:] * (np.pi / 180))
    if suffix == ".reg":
        assert table.distance_guess == 67 * 0.0254


def normal(largest):
    """Floats that stay normal ones in any unit: below that, digits are lost for good."""
    return st.floats(-largest, largest).map(lambda v: v if abs(v) > 1e-300 else 0.0)


length = normal(100)
angle_rad = normal(1.5)


@st.composite
def tables(draw, name="view", units=tuple(LengthUnit), dac=False):
    """Numbers as a file in `unit` and degrees would have brought them in, of any precision."""
    unit = draw(st.sampled_from(units))
    n = draw(st.integers(1, 5))
    rows = st.lists(st.tuples(*[length] * 3, *[angle_rad] * 2), min_size=n, max_size=n)
    values = np.array(draw(rows))
    numbers = draw(st.lists(st.integers(0, 999), min_size=n, max_size=n, unique=True))
    degrees = np.degrees(values[:, 3:])
    steps = np.rint(values[:, 3:] * 2000)
    guess = draw(st.none() | st.floats(1e-3, 100))
    return RegistrationTable(
        name=name,
        number=np.array(numbers),
        object_point=values[:, :3] * unit.value,
        angle=degrees * AngleUnit.deg.value,
        dac=steps if dac else None,
        distance_guess=None if guess is None else guess * unit.value,
        unit=unit,
    )


def assert_same(ours: RegistrationTable, theirs: RegistrationTable) -> None:
    """To the last bit."""
    np.testing.assert_array_equal(ours.number, theirs.number)
    np.testing.assert_array_equal(ours.object_point, theirs.object_point)
    for name in ("angle", "dac"):
        a, b = getattr(ours, name), getattr(theirs, name)
        assert (a is None) == (b is None)
        if a is not None:
            np.testing.assert_array_equal(a, b)


slow_files = settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.mark.whole
@pytest.mark.parametrize("suffix", SUFFIXES)
@slow_files
@given(tables())
def test_round_trip_to_the_last_bit(tmp_path, suffix, table):
    path = tmp_path / f"round_trip{suffix}"
    write(path, [table])
    (back,) = read(path)
    assert_same(back, table)
    assert back.name == ("round_trip" if suffix == ".reg" else "view")
    assert back.unit == (LengthUnit.m if suffix == ".nc" else table.unit)
    assert back.source == str(path)
    if suffix == ".reg":
        assert back.distance_guess == table.distance_guess


@pytest.mark.one_in(3)
@pytest.mark.parametrize("suffix", SUFFIXES)
@slow_files
@given(st.lists(length, min_size=5, max_size=5), st.sampled_from(LengthUnit))
def test_any_number_comes_back_to_one_unit_in_the_last_place(tmp_path, suffix, values, unit):
    """SI numbers that no decimal of the unit hits come back next to themselves."""
    angle = np.array([values[3:]]) * 0.015
    table = RegistrationTable("v", np.array([1]), np.array([values[:3]]), angle, unit=unit)
    path = tmp_path / f"near{suffix}"
    write(path, [table])
    (back,) = read(path)
    for ours, theirs in ((back.object_point, table.object_point), (back.angle, table.angle)):
        np.testing.assert_array_max_ulp(ours, theirs, maxulp=1)


@pytest.mark.whole
@pytest.mark.parametrize("suffix", [".csv", ".nc"])
@slow_files
@given(
    tables(name="east", units=(LengthUnit.inch,), dac=True),
    tables(name="west", units=(LengthUnit.inch,), dac=True),
)
def test_several_views(tmp_path, suffix, east, west):
    path = tmp_path / f"views{suffix}"
    write(path, [east, west])
    tables = read(path)
    assert [table.name for table in tables] == ["east", "west"]
    assert_same(tables[0], east)
    # Points stand in the order in which they first appear in any view; only netCDF shares them.
    order = np.argsort(west.number)
    back = np.argsort(tables[1].number)
    np.testing.assert_array_equal(tables[1].number[back], west.number[order])
    np.testing.assert_array_equal(tables[1].object_point[back], west.object_point[order])
    np.testing.assert_array_equal(tables[1].angle[back], west.angle[order])
    np.testing.assert_array_equal(tables[1].dac[back], west.dac[order])


@given(normal(1e6), st.sampled_from([*LengthUnit, *AngleUnit]))
def test_decimals_of_a_unit(value, unit):
    short = float(f"{value:.15g}")
    assert float(decimal_in(unit, short * unit.value)) == short
    si = value * unit.value
    assert float(decimal_in(unit, si)) * unit.value == si


def test_text_is_as_short_as_it_was(tmp_path):
    write(tmp_path / "a.reg", read(DATA / "figure_4_28.reg"))
    lines = (tmp_path / "a.reg").read_text().splitlines()
    assert lines[-1].startswith("# 19 lines, crc32 ")
    assert lines[:4] == [
        "NUMREG 16",
        "UNITS inch",
        "DISTGUESS 67",
        "REGPOINT 1 2.349 3.2156 0 5.724 0.016338",
    ]
    write(tmp_path / "a.csv", read(DATA / "figure_4_28.csv"))
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines[1] == "view,point,x_inch,y_inch,z_inch,up_down_deg,left_right_deg"
    assert lines[17] == "figure_4_28,16,1.8549,2.7813,0,5.9968,0.3648"


def test_comments_blank_lines_and_letter_case(tmp_path):
    path = tmp_path / "loose.reg"
    path.write_text(
        "# of the morning\n\n  numreg 1   # one\nUnits INCH\r\n\nregpoint 4 1 2 3 4 5#\n# end"
    )
    (table,) = read(path)
    assert table.number.tolist() == [4]
    np.testing.assert_array_equal(table.object_point, np.array([[1, 2, 3]]) * 0.0254)
    assert table.distance_guess is None
    path = tmp_path / "loose.csv"
    path.write_text(
        "\ufeff# of the morning\n point, z_mm, y_mm, x_mm, left_right_dac, up_down_dac\n\n"
        "# next\n 4, 3, 2, 1, 50, -7\n",
        encoding="utf-8",
    )
    (table,) = read(path)
    assert table.name == "loose"
    np.testing.assert_allclose(table.object_point, [[1e-3, 2e-3, 3e-3]])
    np.testing.assert_array_equal(table.dac, [[-7, 50]])
    assert table.angle is None


def test_angles_in_radians(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("point,x_m,y_m,z_m,up_down_rad,left_right_rad\n1,0,0,1,0.5,-0.25\n")
    np.testing.assert_array_equal(read(path)[0].angle, [[0.5, -0.25]])


def test_a_given_unit_is_used_where_the_file_has_none(tmp_path):
    path = tmp_path / "a.reg"
    path.write_text("NUMREG 1\nDISTGUESS 2\nREGPOINT 1 1 2 3 4 5\n")
    (table,) = read(path, LengthUnit.ft)
    np.testing.assert_array_equal(table.object_point, np.array([[1, 2, 3]]) * 0.3048)
    assert table.distance_guess == 0.6096
    path = tmp_path / "a.csv"
    path.write_text("point,x,y,z,up_down_deg,left_right_deg\n1,1,2,3,4,5\n")
    (table,) = read(path, LengthUnit.cm)
    np.testing.assert_array_equal(table.object_point, np.array([[1, 2, 3]]) * 0.01)
    # The same unit as the file's own is no contradiction.
    assert read(DATA / "figure_4_28.reg", LengthUnit.inch)[0].unit is LengthUnit.inch


def table_of(name, numbers, **image):
    n = len(numbers)
    points = np.arange(3.0 * n).reshape(n, 3)
    return RegistrationTable(name, np.array(numbers), points, **image)


def test_netcdf_is_labelled_and_padded():
    east = table_of("east", [1, 2], angle=np.full((2, 2), 0.1), dac=np.full((2, 2), 3.0))
    west = table_of("west", [2, 7, 1], angle=np.full((3, 2), 0.2))
    data = to_dataset([east, west])
    assert data["object_point"].dims == ("view", "point", "axis")
    assert data["angle"].dims == data["dac"].dims == ("view", "point", "mirror")
    assert [data[v].attrs["units"] for v in ("object_point", "angle", "dac")] == ["m", "rad", "1"]
    assert data["point"].values.tolist() == [1, 2, 7]
    assert data["mirror"].values.tolist() == ["up_down", "left_right"]
    assert data["used"].values.tolist() == [[1, 1, 0], [1, 1, 1]]
    assert np.isnan(data["angle"].sel(view="east", point=7)).all()
    tables = from_dataset(data, "memory")
    assert_same(tables[0], east)
    assert tables[1].number.tolist() == [1, 2, 7]
    np.testing.assert_array_equal(tables[1].object_point, west.object_point[[2, 0, 1]])
    assert tables[1].dac is None


def test_a_run_and_a_dataset_of_other_order_and_units(tmp_path):
    """As ``/registration`` of a run with complex data beside it; as a dataset made by hand."""
    east = table_of("east", [1, 2], angle=np.array([[0.1, 0.2], [0.3, 0.4]]))
    image = xr.Dataset({"velocity": ("pixel", np.array([1 + 2j]))})
    dataset.save({"registration": to_dataset([east]), "image": image}, {}, tmp_path / "run.nc")
    assert_same(read(tmp_path / "run.nc")[0], east)

    other = to_dataset([east]).isel(view=0, drop=True)
    other = other.sel(axis=["z", "x", "y"], mirror=["left_right", "up_down"])
    other = other.transpose("axis", "mirror", "point")
    other["object_point"] = (other["object_point"] * 1000).assign_attrs(units="mm")
    other["angle"] = np.degrees(other["angle"]).assign_attrs(units="deg")
    other.to_netcdf(tmp_path / "hand.nc", engine="netcdf4")
    (table,) = read(tmp_path / "hand.nc")
    assert table.name == "hand"
    assert table.unit is LengthUnit.mm
    np.testing.assert_allclose(table.object_point, east.object_point, rtol=1e-15)
    np.testing.assert_allclose(table.angle, east.angle, rtol=1e-15)


def test_angles_of_dac_steps():
    laser = TwoMirror()
    dac = np.array([[4096, -2048]])
    table = table_of("east", [7], dac=dac)
    np.testing.assert_allclose(np.degrees(table.angle_through(laser)), [[25, -12.5]])
    measured = table_of("east", [7], dac=dac, angle=np.array([[0.1, 0.2]]))
    np.testing.assert_array_equal(measured.angle_through(laser), [[0.1, 0.2]])
    with pytest.raises(UserError, match=r"point 7 of view east: the up_down DAC step 4096\.5 is "):
        table_of("east", [7], dac=dac + 0.5).angle_through(laser)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_failed_write_leaves_the_old_file(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"kept{suffix}"
    write(path, [table_of("a", [1], angle=np.zeros((1, 2)))])
    before = path.read_bytes()

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(UserError, match="cannot be written: No space left on device"):
        write(path, [table_of("a", [1, 2], angle=np.zeros((2, 2)))])
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
