"""Comments, strings and attributes of velocity files that contradict what is read of them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io
import xarray as xr

from sldvexp.dataset import take_findings
from sldvexp.errors import UserError
from sldvexp.importers import conventions
from sldvexp.importers.velocity_file import File
from sldvexp.units import LengthUnit, VelocityUnit

RMS, PEAK = conventions.Amplitude.rms, conventions.Amplitude.peak
MM = {"unit": VelocityUnit.mm_per_s}


@pytest.fixture(params=["csv", "mat", "nc"])
def made(request, tmp_path):
    """Write a file of two views that has a line of text, and give its path."""

    def made_(text, heading="velocity"):
        path = tmp_path / f"mine.{request.param}"
        cosines = np.array([[[0.0, 0.0, 1.0]], [[0.6, 0.0, 0.8]]])
        velocity = np.array([[[1.0]], [[2.0]]])
        if request.param == "csv":
            path.write_text(f"# {text}\nview,dx,dy,dz,real\na,0,0,1,1\nb,0.6,0,0.8,2\n")
        elif request.param == "mat":
            arrays = {"direction_cosines": cosines, "velocity": velocity, "remark": text}
            scipy.io.savemat(path, {"data": arrays})
        else:
            dims = ("view", "point", "axis")
            xr.Dataset(
                {
                    "direction_cosines": (dims, cosines),
                    "velocity": (("view", "point", "frequency"), velocity, {"long_name": text}),
                    "frequency": ("frequency", [195.0]),
                }
            ).to_netcdf(path, engine="netcdf4")
        return path

    return made_


def read(path, **settings):
    group = File(path=str(path), **settings).read()
    odd = [f for f in take_findings({"line_of_sight": group}) if f.kind == "unit"]
    return group["velocity"].values.ravel().real, odd


def asked(path, **settings):
    with pytest.raises(UserError) as error:
        File(path=str(path), **settings).read()
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("text", "said", "answer", "factor"),
    [
        ("Velocity [mm/s]", "states mm/s, but would be read as m/s; say which with "
         "instrument.unit", MM, 1e-3),
        ("Velocity RMS", "states rms, but would be read as peak; say which with "
         "instrument.amplitude", {"amplitude": RMS}, 2**0.5),
        ("velocity units: mm/s rms", "2 questions are open", MM | {"amplitude": RMS},
         1e-3 * 2**0.5),
    ],
)  # fmt: skip
def test_text_that_contradicts_is_asked_about_and_the_answer_gives_the_right_number(
    made, text, said, answer, factor
):
    path = made(text)
    assert said in asked(path)
    values, odd = read(path, **answer)
    np.testing.assert_allclose(values, [factor, 2 * factor], rtol=1e-12)
    assert not odd


def test_displacements_are_refused_unless_a_unit_says_that_they_are_velocities(made):
    path = made("Displacement [mm]")
    assert "velocities are needed; convert the values" in asked(path)
    values, (odd,) = read(path, **MM)
    np.testing.assert_allclose(values, [1e-3, 2e-3], rtol=1e-12)
    assert "instrument.unit=mm_per_s wins, although" in odd.text


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("text", "settings", "said"),
    [
        ("Velocity RMS", {"amplitude": PEAK}, "instrument.amplitude=peak wins, although"),
        ("exp(-iwt)", {}, "instrument.phase=exp_plus wins, although"),
        ("positive away from the laser", {}, "instrument.positive=towards wins, although"),
    ],
)
def test_setting_that_wins_over_text_makes_the_run_doubtful(made, text, settings, said):
    values, (odd,) = read(made(text), **settings)
    assert said in odd.text
    assert odd.severity.name == "doubtful"
    np.testing.assert_allclose(values, [1.0, 2.0])


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    "text", ["Velocity [m/s], peak", "RMS averaging", "Vibrometer velocity 50 mm/s/V range", "peak"]
)
def test_text_that_agrees_or_says_nothing_is_silent(made, text):
    values, odd = read(made(text))
    assert not odd
    np.testing.assert_allclose(values, [1.0, 2.0])


def test_contradiction_of_a_heading_names_a_way_on_that_is_not_refused(tmp_path):
    path = tmp_path / "mine.csv"
    rows = "a,0,0,1,1\nb,0.6,0,0.8,2\n"
    path.write_text(f"# velocity in mm/s\nview,dx,dy,dz,v [m/s]\n{rows}")
    mapping = {"v [m/s]": "real"}
    said = asked(path, mapping=mapping)
    assert "line 1: 'velocity in mm/s' states mm/s, but the heading or attribute of the" in said
    assert said.endswith("or say instrument.unit=m_per_s if that is it")
    values, (odd,) = read(path, mapping=mapping, unit=VelocityUnit.m_per_s)
    assert "wins, although" in odd.text
    np.testing.assert_allclose(values, [1.0, 2.0])


def test_unit_of_positions_in_a_text_is_asked_about(tmp_path):
    path = tmp_path / "mine.csv"
    rows = "a,0,0,1,1,p,100,0,0\nb,0.6,0,0.8,2,p,100,0,0\n"
    path.write_text(f"# coordinates in mm\nview,dx,dy,dz,real,point,x,y,z\n{rows}")
    assert "states mm, but would be read as m; say which with instrument.length_unit" in asked(path)
    group = File(path=str(path), length_unit=LengthUnit.mm).read()
    np.testing.assert_allclose(group["position"].values, [[0.1, 0, 0]])


def test_attribute_of_positions_is_what_their_text_is_compared_with(tmp_path):
    path = tmp_path / "mine.nc"
    position = (
        ("point", "axis"),
        [[100.0, 0, 0]],
        {"units": "mm", "long_name": "coordinates [mm]"},
    )
    xr.Dataset(
        {
            "direction_cosines": (("view", "point", "axis"), [[[0.0, 0, 1]], [[0.6, 0, 0.8]]]),
            "velocity": (("view", "point"), [[1.0], [2.0]], {"units": "m/s"}),
            "position": position,
        }
    ).to_netcdf(path, engine="netcdf4")
    group = File(path=str(path)).read()
    np.testing.assert_allclose(group["position"].values, [[0.1, 0, 0]])
    assert not take_findings({"line_of_sight": group})
