"""Scan lines lie where they should, and the legacy files come back as they were."""

from __future__ import annotations

import netCDF4
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sldvexp.errors import ConfigError, UserError
from sldvexp.io import read_centres, read_list, read_rectangle
from sldvexp.io.scan_files import write_list
from sldvexp.scan.calibration import CalibrationScan, Centres, CircleLines
from sldvexp.scan.lines import across, along_ellipse, rectangle, strided

steps = st.integers(-4096, 4096)


@given(up_down=steps, left_right=steps, lines=st.integers(1, 8), pixels=st.integers(3, 300))
def test_lines_across_are_contiguous_and_centred(up_down, left_right, lines, pixels):
    found = across([up_down, left_right], lines, pixels)
    assert found.shape == (lines, pixels, 2)
    np.testing.assert_array_equal(np.abs(np.diff(found, axis=1)).max(axis=-1), 1)
    np.testing.assert_allclose(found.mean(axis=1), [[up_down, left_right]] * lines, atol=1.01)


def test_three_lines_cross_a_circle_at_six_spread_points():
    ends = across([0, 0], 3, 301)[:, [0, -1]].reshape(-1, 2)
    azimuth = np.sort(np.degrees(np.arctan2(ends[:, 0], ends[:, 1])) % 360)
    np.testing.assert_allclose(np.diff(azimuth), 60, atol=0.5)


@given(turn=st.floats(0, 3.1), ratio=st.floats(0.4, 1.0), lines=st.integers(8, 60))
def test_fine_lines_cross_the_ellipse_in_the_middle_from_inside(turn, ratio, lines):
    c, s = np.cos(turn), np.sin(turn)
    axes = 60 * np.array([[c, s], [-s * ratio, c * ratio]])
    found = along_ellipse([100, -50], axes, lines, 25)
    level = np.linalg.norm((found - [100, -50]) @ np.linalg.inv(axes), axis=-1)
    assert (level[:, 0] < 1).all()
    assert (level[:, -1] > 1).all()
    # Half a step of rounding in each coordinate, over the smaller semi-axis.
    np.testing.assert_allclose(level[:, 12], 1, atol=0.75 / (60 * ratio))


def test_rectangle_over_the_box_of_its_corners():
    corners = [[10, -5], [12, 40], [-30, 38], [-28, -6]]
    grid = rectangle(corners, 11, 12)
    assert grid.shape == (11, 12, 2)
    np.testing.assert_array_equal(grid[0, 0], [-30, -6])
    np.testing.assert_array_equal(grid[-1, -1], [12, 40])
    assert strided(corners, 1).shape == (43, 47, 2)
    assert rectangle(corners, 1000, 3).shape == (43, 3, 2)


def test_legacy_files(tmp_path):
    dac = across([5, -7], 3, 20).reshape(-1, 2)
    write_list(tmp_path / "ScanList.default", dac)
    np.testing.assert_array_equal(read_list(tmp_path / "ScanList.default"), dac)
    assert (tmp_path / "ScanList.default").read_text().splitlines()[0] == f"{dac[0, 1]} {dac[0, 0]}"
    (tmp_path / "Scan6pt").write_text("# left-right up-down\n10 -20\n30, -40\n")
    np.testing.assert_array_equal(read_centres(tmp_path / "Scan6pt"), [[-20, 10], [-40, 30]])
    (tmp_path / "ScanRect").write_text("11 12\n0 0\n10 0\n10 20\n0 20\n")
    rows, columns, corners = read_rectangle(tmp_path / "ScanRect")
    assert (rows, columns) == (11, 12)
    np.testing.assert_array_equal(corners[2], [20, 10])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n", "line 1: must be two whole numbers"),
        ("1.5 2\n", "line 1"),
        ("\n", "has no pixels"),
    ],
)
def test_wrong_files_are_named(tmp_path, text, message):
    (tmp_path / "f").write_text(text)
    with pytest.raises(UserError, match=message):
        read_list(tmp_path / "f")
    with pytest.raises(UserError, match=r"four of corners|must be two whole"):
        read_rectangle(tmp_path / "f")


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("", "must begin with a letter, a digit or _"),
        (".", "must begin with a letter, a digit or _"),
        ("..", "must begin with a letter, a digit or _"),
        ("-30 deg", "must begin with a letter, a digit or _, as 30 deg does"),
        ("+45", "must begin with a letter, a digit or _, as 45 does"),
        ("#1", "must begin with a letter, a digit or _, as 1 does"),
        ("front ", "must not end with a blank"),
        ("a/b", "must be one that a folder can have"),
        ("a\\b", "must be one that a folder can have"),
        ("a\x1b[31m", "must be one that a folder can have"),
        ("a" * 201, "must not be longer than 200 bytes"),
    ],
)
def test_views_are_names_of_folders_and_groups(name, told):
    with pytest.raises(ConfigError) as error:
        CalibrationScan(views={name: Centres(dac=[[0, 0]])})
    assert f"the name of the view {name!r} {told}" in str(error.value)


@pytest.mark.parametrize("name", ["1", "_x", "vorne links", "30°", "°", "β (2)", "a" * 200])
def test_all_other_names_are_those_of_a_folder_and_a_group(tmp_path, name):
    CalibrationScan(views={name: Centres(dac=[[0, 0]])})
    (tmp_path / name).mkdir()
    with netCDF4.Dataset(tmp_path / "file.nc", "w") as file:
        file.createGroup("image").createGroup(name)
    with netCDF4.Dataset(tmp_path / "file.nc") as file:
        assert list(file["image"].groups) == [name]


@pytest.mark.parametrize("stage", ["coarse", "fine"])
def test_lines_are_no_longer_than_a_mirror_reaches(stage):
    views = {"a": Centres(dac=[[0, 0]])}
    CalibrationScan(views=views, **{stage: CircleLines(3, 8193, 5)})
    with pytest.raises(
        ConfigError, match=f"{stage}.pixels: must be at most the 8193 steps"
    ) as error:
        CalibrationScan(views=views, **{stage: CircleLines(3, 8194, 5)})
    assert [p.field for p in error.value.problems] == [f"{stage}.pixels"]
