"""One refusal has all that the files of a session leave open, and the answers read them right."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.io
import xarray as xr

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.importers import conventions
from sldvexp.importers.scan_export import ScanExport
from sldvexp.importers.uff import UffImport
from sldvexp.importers.velocity_file import File
from sldvexp.units import LengthUnit, VelocityUnit

from .plate_files import FIRST, POINTS, SAID, SIX_DIGITS
from .test_settings_of_views import SENSES, VALUES, asked, right, table, views_of

PEAK = {"amplitude": conventions.Amplitude.peak}


def with_all(views, **own):
    return {name: dataclasses.replace(view, **own) for name, view in views.items()}


def test_points_that_a_view_lacks_are_asked_about_with_the_conventions(tmp_path):
    texts = {"a": table("mm/s", 1.0), "b": table("mm/s", 1.0, rows=(0, 1, 3))}
    views = views_of(tmp_path, texts)
    said = asked(ScanExport, views, directions=conventions.Directions.view)
    assert said.startswith("4 questions are open: ")
    for setting in ("amplitude", "positive", "phase"):
        assert f"say it with instrument.{setting}" in said
    assert f"{views['b'].path}: the view b has not measured node 3, as others have" in said
    assert "instrument.incomplete=drop" in said
    group = ScanExport(views=views, **SENSES, **PEAK, incomplete="drop").read()
    np.testing.assert_allclose(group["velocity"][:, :, 0], [1e-3 * VALUES[[0, 1, 3]]] * 2)


def test_rows_without_numbers_are_asked_about_with_columns_and_units(tmp_path):
    text = table("EU", 1.0).replace("-3\t0.5", "\t").replace("Frequency: 197 Hz\n", "")
    rows = table("mm/s", 1.0).splitlines()
    at_two = [rows[1].replace("\tRe", "\tf [Hz]\tRe"), *(r for r in rows[2:])]
    blocks = [
        "\t".join([*cells[:4], f, *cells[4:]])
        for f in ("197", "300")
        for cells in (r.split("\t") for r in at_two[1:])
    ]
    texts = {"a": text, "b": "\n".join([at_two[0], *blocks[:-1]]) + "\n"}
    views = views_of(tmp_path, texts)
    said = asked(ScanExport, {"a": views["a"]}, directions=conventions.Directions.view)
    for part in (
        "the column 5 (Re [EU]) is not understood",
        "say it with instrument.unit",
        "say it with instrument.quantity",
        "say it with instrument.amplitude",
        "say it with instrument.positive",
        "say it with instrument.phase",
        "say it with instrument.frequency",
        "say it with instrument.incomplete",
    ):
        assert said.count(part) == 1, said
    assert said.startswith("8 questions are open: ")
    said = asked(ScanExport, views, **SENSES, **PEAK)
    assert "there is no row for point 4 at 300 Hz" in said
    assert "say it with instrument.views.a.unit" in said
    answers = {
        "columns": {"index": 1, "x": 2, "y": 3, "z": 4, "real": 5, "imag": 6},
        "frequency": [197.0],
        "unit": conventions.MotionUnit.mm,
        "quantity": conventions.Quantity.velocity,
        "incomplete": "mark",
    }
    group = ScanExport(views={"a": views["a"]}, **SENSES, **PEAK, **answers).read()
    right(group, np.where([0, 1, 0, 0], np.nan, 1e-3 * VALUES))


def test_columns_that_are_named_too_few_are_asked_about_with_the_rest(tmp_path):
    views = views_of(tmp_path, {"a": table("mm/s", 1.0)})
    said = asked(ScanExport, views, columns={"index": 1, "x": 2, "real": 5}, **SENSES)
    assert "instrument.columns does not name y and z" in said
    assert "say it with instrument.amplitude" in said


def universal(uff, nodes, first=100.0, units=True, zero=()):
    functions = [uff.function(n, 0 * FIRST if n in zero else FIRST, first=first) for n in nodes]
    return (uff.units() if units else b"") + uff.nodes(POINTS) + b"".join(functions)


def test_universal_files_are_asked_about_points_and_frequencies_with_the_rest(uff, tmp_path):
    contents = {
        "a": universal(uff, (1, 2, 3)),
        "b": universal(uff, (1, 3), first=101.0, units=False),
        "c": universal(uff, (1, 2, 3), zero=(3,)),
    }
    views = views_of(tmp_path, contents, "uff")
    said = asked(UffImport, views, **SAID | {"phase": None})
    assert said.startswith("5 questions are open: ")
    for part in (
        "say it with instrument.phase",
        "say it with instrument.views.b.length_unit, or give the geometry of a file that does "
        "with instrument.geometry, for example instrument.views.b.length_unit=mm",
        "instrument.zeros=missing with instrument.incomplete=drop or mark",
        "view b has other frequencies than view a",
        "the view b has not measured node 2",
    ):
        assert said.count(part) == 1, said
    said = asked(UffImport, views, **SAID, length_unit=LengthUnit.m)
    assert said.startswith("3 questions are open: ")  # also if no convention is open
    answers = {"zeros": conventions.Zeros.missing, "incomplete": "drop"}
    answers |= {"geometry": views["a"].path, "frequency": [101.0, 103.0]}
    group = UffImport(views=views, **SAID, **answers).read()
    assert group["point"].values.tolist() == ["1"]
    expected = [FIRST[[1, 3]], FIRST[[0, 2]], FIRST[[1, 3]]]
    np.testing.assert_allclose(group["velocity"][:, 0], expected, rtol=SIX_DIGITS)


def test_choice_among_functions_is_asked_for_with_their_conventions(uff, tmp_path):
    path = tmp_path / "a.uff"
    twice = uff.function(1, FIRST) + uff.function(1, 2 * FIRST, reference=(7, 3))
    path.write_bytes(uff.nodes(POINTS) + twice)
    views = views_of(tmp_path, {"a": path.read_bytes()}, "uff")
    said = asked(UffImport, views, directions=conventions.Directions.view)
    for setting in ("length_unit", "reference_dof", "phase", "positive", "reference"):
        assert f"instrument.{setting}" in said
    assert said.startswith("5 questions are open: ")
    group = UffImport(views=views, **SAID, length_unit=LengthUnit.m, reference_dof="7+Z").read()
    np.testing.assert_allclose(group["velocity"][0, 0], 2 * FIRST, rtol=SIX_DIGITS)


@pytest.mark.parametrize("kind", ["uff", "scan_export"])
def test_standard_errors_that_a_field_needs_are_asked_for_with_the_rest(uff, tmp_path, kind):
    if kind == "uff":
        cls, views = UffImport, views_of(tmp_path, {"a": universal(uff, (1, 2))}, "uff")
    else:
        cls, views = ScanExport, views_of(tmp_path, {"a": table("mm/s pk", 1.0)})
    settings = SAID | {"phase": None} if kind == "uff" else SENSES | {"phase": None}
    with pytest.raises(UserError) as error:
        cls(views=views, **settings).images_of_points({}, None)
    assert str(error.value).startswith("2 questions are open: ")
    assert "say them with instrument.std" in str(error.value)
    with pytest.raises(UserError, match="phase") as error:
        cls(views=views, **settings, std=1e-6).images_of_points({}, None)
    assert "questions" not in str(error.value)


ANSWERS = {
    "unit": VelocityUnit.mm_per_s,
    "amplitude": conventions.Amplitude.rms,
    "incomplete": "drop",
}
ROWS = ["a,1,0,0,p,1,2", "a,1,0,0,q,,", "b,0,1,0,p,3,4"]


def file_refused(path, **settings):
    with pytest.raises(UserError) as error:
        File(path=str(path), **settings).read()
    return str(error.value)


def test_velocities_of_a_csv_are_asked_about_in_one_go(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["view,dx,dy,dz,point,Re [EU],Im [EU]", *ROWS]))
    said = file_refused(path)
    assert said.startswith("3 questions are open: ")
    assert "has the unknown columns Re [EU], Im [EU]" in said
    assert "of velocities say it with both instrument.unit and instrument.amplitude" in said
    assert "line 3: Re [EU] has no number; leave points" in said
    mapping = {"Re [EU]": "real", "Im [EU]": "imag"}
    said = file_refused(path, mapping=mapping)
    assert said.startswith("2 questions are open: ")
    assert "say it with both instrument.unit and instrument.amplitude" in said
    assert "line 3: real must be a finite number, not ''" in said
    group = File(path=str(path), mapping=mapping, **ANSWERS).read()
    expected = 2**0.5 * 1e-3 * np.array([[1 + 2j], [3 + 4j]])
    np.testing.assert_allclose(group["velocity"], expected)
    (finding,) = dataset.take_findings({"line_of_sight": group})
    assert finding.size == 1


@pytest.mark.parametrize("suffix", ["nc", "mat"])
def test_velocities_of_arrays_are_asked_about_in_one_go(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    velocity = np.array([[1.0, np.nan], [3.0, 4.0]])
    cosines = np.array([[[1.0, 0, 0]] * 2, [[0, 1.0, 0]] * 2])
    if suffix == "mat":
        scipy.io.savemat(path, {"v_": velocity, "direction_cosines": cosines})
        name = "v_"
    else:
        name = "v [EU]"
        xr.Dataset(
            {
                name: (("view", "point"), velocity),
                "direction_cosines": (("view", "point", "axis"), cosines),
            }
        ).to_netcdf(path, engine="netcdf4")
    said = file_refused(path, mapping={name: "velocity"})
    assert "the velocity of view 1, point 2 is nan, but must be finite; leave points" in said
    if suffix == "nc":
        assert said.startswith("2 questions are open: ")
        assert "say it with both instrument.unit and instrument.amplitude" in said
    group = File(path=str(path), mapping={name: "velocity"}, **ANSWERS).read()
    np.testing.assert_allclose(group["velocity"], 2**0.5 * 1e-3 * np.array([[1.0], [3.0]]))
