"""Files of a session that older programs read: what is exported comes back to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.dataset import open_run
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.export.reg import Reg
from sldvexp.export.scanlist import ScanList
from sldvexp.io import read_list
from sldvexp.io.registration import RegistrationTable, read, to_dataset
from sldvexp.laser import TwoMirror
from sldvexp.pose.from_points import MirrorName
from sldvexp.pose.registration import Registration
from sldvexp.scan.pixel_list import PixelList, PixelSequence
from sldvexp.units import LengthUnit

FIGURE = Path(__file__).parents[2] / "conf/data/figure_4_28.reg"


def solved(**settings):
    """Figure 4.28's groups of a run."""
    made = Registration(path=str(FIGURE), **settings)
    return made.estimate(TwoMirror(), None, {}).groups()


def image_of(dac):
    dac = np.asarray(dac)
    angle = TwoMirror().angle_from_dac(dac)
    coords = {"frequency": [450.0]}
    velocity = np.zeros((len(dac), 1), complex)
    return dataset.group("image", coords, velocity=velocity, angle=angle, dac=dac)


def test_figure_4_28_is_written_as_it_stands(tmp_path):
    path = Reg(unit=LengthUnit.inch).export(RunData(solved()), tmp_path, "mine")
    assert path == tmp_path / "mine.reg"
    [found], [known] = read(path), read(FIGURE)
    for name in ("number", "object_point", "angle"):
        np.testing.assert_array_equal(getattr(found, name), getattr(known, name))
    printed = [line.split() for line in FIGURE.read_text().splitlines()]
    *written, check = [line.split() for line in path.read_text().splitlines()]
    assert check[0] == "#"
    assert written[:2] == printed[:2]
    for one, other in zip(written[2:], printed[3:], strict=True):  # a run keeps no DISTGUESS
        assert list(map(float, one[1:])) == list(map(float, other[1:]))


@pytest.mark.one_in(12)
@pytest.mark.parametrize("inverted", [[], [MirrorName.up_down]])
@pytest.mark.parametrize("unit", LengthUnit)
def test_the_same_pose_is_found_from_the_file(unit, inverted, tmp_path):
    groups = solved(inverted=inverted)
    path = Reg(unit=unit).export(RunData(groups), tmp_path, "mine")
    again = Registration(path=str(path)).estimate(TwoMirror(), None, {})
    for name in ("origin", "rotation", "covariance"):
        known, found = groups["pose"][name].values, again.pose[name].values
        np.testing.assert_allclose(found, known, rtol=1e-9, atol=1e-12)
    if unit is LengthUnit.m:
        [table] = read(path)
        np.testing.assert_array_equal(
            table.object_point, groups["registration"]["object_point"].values[0]
        )
        # Decimals of degrees that hit a float in rad exactly need not exist.
        np.testing.assert_array_max_ulp(
            table.angle, groups["registration"]["angle"].values[0], maxulp=1
        )


def two_views():
    rng = np.random.default_rng(5)
    tables = [
        RegistrationTable(n, np.array(k), rng.normal(size=(3, 3)), rng.normal(size=(3, 2)) / 9)
        for n, k in (("front", [4, 7, 9]), ("left", [7, 9, 11]))
    ]
    return tables, RunData({"registration": to_dataset(tables)})


@pytest.mark.parametrize("view", [0, 1])
def test_one_view_has_its_own_points(view, tmp_path):
    tables, run = two_views()
    [found] = read(Reg(view=tables[view].name).export(run, tmp_path, "mine"))
    assert found.number.tolist() == tables[view].number.tolist()
    np.testing.assert_array_equal(found.object_point, tables[view].object_point)
    np.testing.assert_array_max_ulp(found.angle, tables[view].angle, maxulp=1)


@pytest.mark.parametrize("steps", [[[3, -700]], [[-1, 2], [0, 0], [4095, -4096], [7, 7], [-1, 2]]])
def test_pixels_come_back_in_their_order(steps, tmp_path):
    run = RunData({"image/front": image_of(steps)})
    path = ScanList().export(run, tmp_path, "mine")
    assert read_list(path).tolist() == steps
    assert path.read_text().splitlines()[0] == f"{steps[0][1]} {steps[0][0]}"
    scan = PixelList(views={"front": PixelSequence(path=str(path))})
    assert np.concatenate(scan.lines("front")).tolist() == steps


def test_mirrors_in_the_other_order_are_told_by_their_names(tmp_path):
    image = image_of([[3, -700], [5, 6]]).isel(mirror=[1, 0])
    path = ScanList().export(RunData({"image/front": image}), tmp_path, "mine")
    assert read_list(path).tolist() == [[3, -700], [5, 6]]


def test_files_that_cannot_be_written_say_why(tmp_path):
    _, both = two_views()
    images = RunData({f"image/{n}": image_of([[1, 2]]) for n in ("front", "left")})
    half = RunData({"image/front": image_of([[1.5, 2]])})
    for export, run, told in (
        (Reg(), RunData({}), "export=reg needs registration data: choose pose=bitangent"),
        (Reg(), both, "export=reg holds one view; say which with view, of front, left"),
        (Reg(view="lef"), both, "export=reg: there is no view lef; did you mean left"),
        (ScanList(), RunData({}), "export=scanlist needs velocity images in DAC steps"),
        (ScanList(), images, "export=scanlist holds one view; say which with view"),
        (ScanList(), half, "view front has pixels between whole DAC steps"),
    ):
        with pytest.raises(UserError, match=told):
            export.export(run, tmp_path, "mine")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.whole
def test_the_command_exports_both_and_a_run_scans_and_solves_them_again(sldvexp):
    done = sldvexp("experiment=dissertation/velocity_image", "scan.pixels=[3,4]", "expect={}")
    sent = sldvexp("export", str(done.folder), "scanlist")
    path = done.folder / "scanlist.txt"
    assert (sent.status, sent.out.strip()) == (0, str(path))
    dac = open_run(done.folder)["image/1/dac"].values
    assert read_list(path).tolist() == dac.tolist()
    again = sldvexp(
        *("~experiment", "scene=plate", "scan=list", "instrument=simulated"),
        *("signal=sine_fit", f"scan.views={{1: {{path: {path}}}}}"),
    )
    assert again.status == 0, again.err
    assert open_run(again.folder)["image/1/dac"].values.tolist() == dac.tolist()

    done = sldvexp("experiment=dissertation/registration", "export={mine: {plugin: reg}}")
    path = done.folder / "mine.reg"
    again = sldvexp("experiment=dissertation/registration", f"pose.path={path}", "pose.inverted=[]")
    assert again.status == 0, again.err
    known, found = (open_run(d.folder)["pose/origin"].values for d in (done, again))
    np.testing.assert_allclose(found, known, atol=1e-9)
