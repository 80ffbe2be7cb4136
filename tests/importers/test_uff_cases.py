"""Files of universal data sets as other programs leave them: read right, or asked about.

Most hold velocities of four points of a plate, in one spelling or another.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sldvexp.dataset import findings_of, take_findings
from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView
from sldvexp.importers import conventions as settings
from sldvexp.importers.uff import UffImport
from sldvexp.units import LengthUnit

from .plate_files import FIRST, FREQUENCY, POINTS, SAID, SIX_DIGITS, read, refused

CASES = Path(__file__).parent / "cases" / "uff"
#: Name of a file to one of its units in SI, and how often it must be integrated.
READ = {
    "um_latin1": (1e-6, 0),
    "micron": (1e-6, 0),
    "ips": (0.0254, 0),
    "si_power_kind1": (1.0, 0),
    "acc_latin1_kind1": (1.0, 1),
    "two_lf_before_mark": (1.0, 0),
    "padded": (1.0, 0),
    "bom": (1.0, 0),
    "dup_geometry15": (1.0, 0),
}


@pytest.mark.parametrize("name", READ)
def test_right_values(name):
    unit, integrated = READ[name]
    group = read(CASES / f"{name}.uff")
    omega = 2j * np.pi * FREQUENCY
    np.testing.assert_allclose(group["frequency"], FREQUENCY)
    expected = unit * FIRST / omega**integrated
    np.testing.assert_allclose(group["velocity"][0, 0], expected, rtol=SIX_DIGITS)
    np.testing.assert_allclose(group["position"], POINTS, atol=1e-12)
    assert group.sizes["point"] == 4


def test_every_case_is_tested():
    tested = {*READ, "volt", "big_but_little", "two_refs"}
    assert tested == {path.stem for path in CASES.glob("*.uff")}


def test_voltages_are_asked_about():
    refused(
        CASES / "volt.uff",
        "data set 3: does not state the unit of its values",
        "V is a unit of voltage; export values in a unit of motion",
        "say it with instrument.unit",
    )


def test_wrong_order_of_bytes_is_named_with_the_right_one():
    refused(
        CASES / "big_but_little.uff",
        "data set 3 (58b)",
        "most significant one first, values reach",
        "with the least significant one first they are 0.0012 at most",
        "the number behind 58b must be 1",
    )


def test_reference_is_chosen():
    path = CASES / "two_refs.uff"
    refused(path, "choose one of 1+Z, 2+Z with instrument.reference_dof=1+Z")
    for reference in ("1+Z", "2+Z"):
        group = read(path, reference_dof=reference)
        np.testing.assert_allclose(group["velocity"][0, 0], FIRST, rtol=1e-6)
    refused(path, "has no functions of the reference 3+Z", "Valid: 1+Z, 2+Z", reference_dof="3+Z")
    refused(path, "is of the reference 2+Z", reference_dof="any")  # two of one node


OPEN = ("phase", "positive", "reference", "length_unit", "unit")


def test_all_questions_are_asked_in_one_go(uff, tmp_path):
    views = {}
    for name in "abc":
        path = tmp_path / f"{name}.uff"
        path.write_bytes(uff.nodes(POINTS) + uff.function(1, FIRST, unit="Einheiten"))
        views[name] = PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0])
    with pytest.raises(UserError) as error:
        UffImport(views=views, directions=settings.Directions.view).read()
    said = str(error.value)
    assert said.startswith("5 questions are open: (1) ")
    for setting in OPEN:
        assert said.count(f"say it with instrument.{setting}") == 1
    assert said.count("and 2 more") == 5
    assert "\n" not in said
    answers = {
        **SAID,
        "length_unit": LengthUnit.m,
        "unit": settings.MotionUnit.m,
    }
    assert UffImport(views=views, **answers).read()["velocity"].shape == (3, 1, 5)


def test_questions_of_time_records_and_spectra_come_with_the_others(uff, tmp_path):
    path = tmp_path / "a.uff"
    path.write_bytes(uff.nodes(POINTS) + uff.function(1, FIRST.real, kind=1, type_=4))
    said = refused(path, "4 questions are open", length_unit=None, positive=None)
    for setting in ("length_unit", "positive", "frequency", "time_reference"):
        assert f"say it with instrument.{setting}" in said
    path.write_bytes(uff.function(1, FIRST))
    said = refused(
        path,
        "2 questions are open",
        positive=None,
        directions=settings.Directions.pose,
        direction=(),
    )
    assert "name a file that has with instrument.geometry" in said
    both = uff.function(1, FIRST) + uff.function(1, FIRST, kind=12)
    path.write_bytes(uff.units() + uff.nodes(POINTS) + both)
    said = refused(path, "choose with instrument.function=frf or spectrum", positive=None)
    assert "say it with instrument.positive" in said


def motion(uff, quantity, unit, values, reference=(1, 3), direction=3):
    return uff.function(
        1,
        values,
        quantity=quantity,
        unit=unit,
        first=100.0,
        step=10.0,
        type_=6,
        reference=reference,
        direction=direction,
    )


@pytest.fixture
def both(uff, tmp_path):
    """A file with displacement and velocity of one point, of exp(+i omega t) or the other."""

    def write(sign=1, other=(11, "mm/s"), factor=1.0):
        path = tmp_path / "both.uff"
        moved = FIRST / (sign * 2j * np.pi * FREQUENCY)
        content = uff.units() + uff.nodes(POINTS) + motion(uff, 8, "µm", moved / 1e-6)
        path.write_bytes(content + motion(uff, *other, factor * FIRST / 1e-3))
        return path

    return write


def test_velocity_is_read_of_a_file_that_has_the_displacement_too(both):
    np.testing.assert_allclose(read(both())["velocity"][0, 0], FIRST, rtol=1e-9)
    by_displacement = read(both(), quantity=settings.Quantity.displacement)
    np.testing.assert_allclose(by_displacement["velocity"][0, 0], FIRST, rtol=1e-9)
    turned = read(both(sign=-1), phase=settings.Phase.exp_minus)
    np.testing.assert_allclose(turned["velocity"][0, 0], FIRST.conj(), rtol=1e-9)


def test_displacement_and_velocity_of_a_point_contradict_a_wrong_phase(both):
    said = "do not fit instrument.phase=exp_plus; they fit instrument.phase=exp_minus"
    refused(both(sign=-1), "the displacement of the same motion", said)
    refused(
        both(),
        "they fit instrument.phase=exp_plus",
        phase=settings.Phase.exp_minus,
    )


def test_displacement_and_velocity_of_a_point_contradict_a_wrong_quantity(both):
    said = "do not fit instrument.quantity=acceleration; they fit instrument.quantity=velocity"
    refused(both(), said, quantity=settings.Quantity.acceleration, dof="+Z")


def test_functions_that_do_not_belong_together_prove_nothing(both):
    np.testing.assert_allclose(read(both(factor=7.0))["velocity"][0, 0], 7 * FIRST, rtol=1e-9)


def test_file_without_functions_says_what_it_has(uff, tmp_path):
    path = tmp_path / "a.uff"
    path.write_bytes(uff.units() + uff.nodes(POINTS) + uff.trace([1, 2, 3]) * 2)
    refused(path, "data set 164 (units), 1 data set 2411 (nodes), 2 data sets 82 (lines)")


def analysis(uff, values, frequency, kind=5, place=1):
    """A data set 2414 of complex velocities, shape (node, 3)."""
    rows = []
    for node, row in enumerate(values, 1):
        flat = np.ascontiguousarray(row, complex).view(float)
        rows += [f"{node:10d}", "".join(f"{v:13.5E}" for v in flat)]
    ten = lambda *numbers: "".join(f"{n:10d}" for n in numbers)  # noqa: E731
    return uff.data_set(
        2414,
        ten(1),
        "response",
        ten(place),
        *["NONE"] * 5,
        ten(1, kind, 2, 11, 5, 3),
        ten(0, 0, 0, 0, 0, 0, 0, 1),
        ten(0, 0),
        "".join(f"{v:13.5E}" for v in (0.0, frequency, 0.0, 0.0, 0.0, 0.0)),
        "".join(f"{0.0:13.5E}" for _ in range(6)),
        *rows,
    )


def test_values_of_an_analysis_are_read(uff, tmp_path):
    path = tmp_path / "a.uff"
    rng = np.random.default_rng(4)
    v = 1e-3 * (rng.normal(size=(2, 4, 3)) + 1j * rng.normal(size=(2, 4, 3)))
    sets = [analysis(uff, one, f) for one, f in zip(v, (20.0, 10.0), strict=True)]
    path.write_bytes(uff.units() + uff.nodes(POINTS) + b"".join(sets))
    group = read(path, dof="+Y", amplitude=settings.Amplitude.peak)
    np.testing.assert_allclose(group["frequency"], [10, 20])
    np.testing.assert_allclose(group["velocity"][0], v[::-1, :, 1].T, rtol=1e-5)
    for more, said in (({"kind": 2}, "of a normal mode"), ({"place": 2}, "must be at nodes")):
        path.write_bytes(uff.nodes(POINTS) + analysis(uff, v[0], 10.0, **more))
        refused(path, "data set 2 (2414)", said, dof="+Y")


def test_files_in_utf_16_are_named(uff, tmp_path):
    path = tmp_path / "a.uff"
    path.write_bytes(uff.units().decode().encode("utf-16"))
    refused(path, "is text in UTF-16")


def test_response_direction_that_contradicts_positive_is_said(uff, tmp_path):
    path = tmp_path / "a.uff"
    away = {"direction": (0.0, 0.3, -1.0)}
    towards, along = settings.Positive.towards, settings.Positive.away
    for code, more, kinds in (
        (3, {}, []),
        (-3, {}, ["sign"]),
        (3, away, ["sign"]),
        (-3, away, []),
        (3, {"positive": along}, ["sign"]),
        (-3, {"positive": along}, []),
        (1, {}, []),  # across: nothing is said of the sense
        (0, away, []),
        (3, {"positive": towards}, []),
    ):
        functions = uff.function(1, FIRST, direction=code)
        path.write_bytes(uff.units() + uff.nodes(POINTS) + functions)
        groups = {"line_of_sight": read(path, **more)}
        found = take_findings(groups)
        assert [f.kind for f in found] == kinds, (code, more)
        assert not groups["line_of_sight"].attrs.get("findings")
    path.write_bytes(uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST, direction=-3))
    (finding,) = take_findings({"line_of_sight": read(path)})
    assert "is -Z, 180 deg from that to the instrument" in finding.text
    assert finding.remedy == "instrument.positive=away"


def test_finding_of_an_import_is_in_the_verdict(uff, tmp_path, sldvexp):
    views = []
    for name in ("front", "left", "below"):
        path = tmp_path / f"{name}.uff"
        path.write_bytes(uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST, first=1.0))
        views.append(f"instrument.views.{name}.path={path}")
    behind = "instrument.views.left.origin=[-0.9,-0.2,-1.1]"
    done = sldvexp("experiment=tutorial_points", *views, behind, "instrument.frequency=[]")
    assert done.status == 0, done.err
    said = [f for f in findings_of(done.tree.children) if "response direction" in f.text]
    assert [(f.subject, f.severity.name) for f in said] == [("view left", "doubtful")]
    assert "\nverdict: doubtful" in done.out, done.out


def test_real_functions_are_doubtful(uff, tmp_path):
    path = tmp_path / "a.uff"
    functions = uff.function(1, abs(FIRST)) + uff.function(2, FIRST)
    path.write_bytes(uff.units() + uff.nodes(POINTS) + functions)
    (finding,) = take_findings({"line_of_sight": read(path)})
    assert "1 of 2 functions of view a are of real numbers, as magnitudes are" in finding.text
    assert (finding.kind, finding.severity.name) == ("phase", "doubtful")


def test_functions_of_zeros_are_asked_about_with_the_others(uff, tmp_path):
    path = tmp_path / "a.uff"
    functions = uff.function(1, FIRST) + uff.function(2, 0 * FIRST)
    path.write_bytes(uff.units() + uff.nodes(POINTS) + functions)
    said = refused(path, "2 questions are open", "say it with instrument.phase", phase=None)
    assert "all values of 2+Z are zero" in said
    assert "instrument.zeros=missing" in said
    refused(path, "data set 4 (58)", "all values of 2+Z are zero")
