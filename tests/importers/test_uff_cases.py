"""Files of universal data sets as other programs leave them: read right, or asked about.

Most hold the velocities `EXPECTED` of four points of a plate, in one spelling or another.
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
from sldvexp.io.uff import universal_file
from sldvexp.units import LengthUnit

CASES = Path(__file__).parent / "cases" / "uff"
POINTS = [[0, 0, 0], [0.15, 0, 0], [0.15, 0.1, 0], [0, 0.1, 0]]
FREQUENCY = 100.0 + 10 * np.arange(5)
#: Values of the first point in the file's unit, as texts have them: with six digits.
FIRST = np.array(
    [
        9.55336e-4 + 2.95520e-4j,
        9.65341e-4 + 5.27368e-4j,
        9.17811e-4 + 7.73061e-4j,
        8.08093e-4 + 1.01832e-3j,
        6.35035e-4 + 1.24769e-3j,
    ]
)
SIX_DIGITS = 5e-6
SAID = {
    "directions": settings.Directions.view,
    "positive": settings.Positive.towards,
    "phase": settings.Phase.exp_plus,
    "reference": 1.0,
}


def read(path, direction=(0.0, 0.0, 1.0), dof="", **more):
    view = PointwiseView(path=str(path), direction=list(direction), dof=dof)
    return UffImport(views={"a": view}, **{**SAID, **more}).read()


def refused(path, *said, **more):
    with pytest.raises(UserError) as error:
        read(path, **more)
    for part in said:
        assert part in str(error.value), str(error.value)
    assert "\n" not in str(error.value)
    return str(error.value)


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


def test_roving_references_are_asked_about(uff, tmp_path):
    path = tmp_path / "a.uff"
    functions = [
        uff.function(n, FIRST, first=100.0, step=10.0, reference=(20 + n, 3)) for n in (1, 2)
    ]
    path.write_bytes(uff.units() + uff.nodes(POINTS[:2]) + b"".join(functions))
    refused(path, "is of the reference 22+Z, data set 3 of 21+Z", "or say any")
    np.testing.assert_allclose(read(path, reference_dof="any")["velocity"][0, 1], FIRST, rtol=1e-5)


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


LABELS = {
    "quantity of number and label": (
        {"quantity": 12, "unit": "m/s"},
        "states the quantity acceleration, but its unit m/s is one of velocity",
    ),
    "power": ({"unit": "(mm/s)²"}, "has values in (mm/s)², a power of a velocity"),
    "root density": ({"unit": "mm/s/√Hz"}, "a root density of a velocity"),
    "rms of a response function": ({"unit": "mm/s rms"}, "names a measure of amplitudes"),
    "product": ({"unit": "m/s*N"}, "is of a motion multiplied with a reference"),
    "decibel": ({"unit": "dB"}, "is logarithmic; export linear values"),
    "lost character": ({"unit": "?m/s"}, "has a character that was lost on the way"),
    "unknown": ({"unit": "EU"}, "the unit 'EU' is not known here"),
    "gram": ({"unit": "g·mm"}, "may mean several things"),
}


@pytest.mark.parametrize("name", LABELS)
@pytest.mark.parametrize("units", [True, False])
def test_labels_that_are_not_read_are_asked_about(uff, tmp_path, name, units):
    written, said = LABELS[name]
    path = tmp_path / "a.uff"
    before = uff.units() if units else b""
    path.write_bytes(before + uff.nodes(POINTS) + uff.function(1, FIRST, **written))
    refused(path, said, length_unit=LengthUnit.m)


AMPLITUDES = {"mm/s RMS": 2**0.5, "mm/s pk": 1.0, "mm/s 0-p": 1.0, "mm/s p-p": 0.5}


@pytest.mark.parametrize("unit", AMPLITUDES)
def test_amplitudes_by_the_label(uff, tmp_path, unit):
    path = tmp_path / "a.uff"
    function = uff.function(1, FIRST, kind=12, unit=unit)
    path.write_bytes(uff.units() + uff.nodes(POINTS) + function)
    expected = 1e-3 * AMPLITUDES[unit] * FIRST
    np.testing.assert_allclose(read(path)["velocity"][0, 0], expected, rtol=1e-5)
    path.write_bytes(uff.qualifiers(2) + uff.units() + uff.nodes(POINTS) + function)
    if unit.endswith(("RMS", "p-p")):
        refused(path, "data set 1 (1858) the scale 2", "say which with instrument.amplitude")
    else:
        np.testing.assert_allclose(read(path)["velocity"][0, 0], expected, rtol=1e-5)


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


@pytest.mark.parametrize("filling", [b"\n\n", b"\r\n\r\n", b"\0" * 100, b"\0\0\n", b" \n"])
def test_filling_between_binary_values_and_the_mark(uff, tmp_path, filling):
    path = tmp_path / "a.uff"
    path.write_bytes(uff.binary(1, FIRST, before_mark=filling) + uff.nodes(POINTS))
    with universal_file(path) as file:
        np.testing.assert_allclose(file.values(file.functions[0])[1], FIRST, rtol=1e-6)
        assert file.geometry is not None


@pytest.mark.parametrize("more", [{}, {"type_": 6}, {"abscissa": FREQUENCY}])
@pytest.mark.parametrize("order", "<>")
def test_either_order_of_bytes_is_told_from_the_other(uff, tmp_path, order, more):
    path = tmp_path / "a.uff"
    content = uff.binary(1, FIRST, order=order, **more)
    path.write_bytes(content)
    with universal_file(path) as file:
        np.testing.assert_allclose(file.values(file.functions[0])[1], FIRST, rtol=1e-6)
    number = (b"58b     1", b"58b     2")
    path.write_bytes(content.replace(*(number if order == "<" else number[::-1]), 1))
    with universal_file(path) as file, pytest.raises(UserError, match="number behind 58b must be"):
        file.values(file.functions[0])
    path.write_bytes(uff.binary(1, 0 * FIRST, order=order, **more))
    with universal_file(path) as file:
        assert not file.values(file.functions[0])[1].any()


def test_zeros_that_fill_a_last_line_but_no_others(uff, tmp_path):
    path = tmp_path / "a.uff"
    values = uff.function(1, FIRST[:4], abscissa=FREQUENCY[:4])
    path.write_bytes(values)
    with universal_file(path) as file:
        assert len(file.values(file.functions[0])[1]) == 4
    claimed = b"         5         4"
    for claims in (b"         5         3", b"         5         2"):
        path.write_bytes(values.replace(claimed, claims))
        with universal_file(path) as file, pytest.raises(UserError, match="but there are more"):
            file.values(file.functions[0])


def test_nodes_given_twice_must_be_alike(uff, tmp_path):
    path = tmp_path / "a.uff"
    exact = np.array(POINTS) * (1 + 1e-7)
    for one, two in (
        (uff.nodes(exact), uff.nodes_15(POINTS)),
        (uff.nodes_15(POINTS), uff.nodes(exact)),
    ):
        path.write_bytes(one + two)
        with universal_file(path) as file:
            np.testing.assert_array_equal(file.geometry.position, exact)
    path.write_bytes(uff.nodes(POINTS) + uff.nodes_15(np.array(POINTS) + 1e-3))
    with universal_file(path) as file, pytest.raises(UserError, match=r"here at .* before at"):
        _ = file.geometry


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
    assert done.out.startswith("\nverdict: doubtful"), done.out


NOT_HEEDED = {
    "nothing": ({"unit": "m/s"}, {}, []),
    "unit": (
        {"unit": "mm/s"},
        {"unit": settings.MotionUnit.m},
        ["instrument.unit=m wins, although the file says velocity in mm/s"],
    ),
    "unknown label": (
        {"unit": "EU"},
        {"unit": settings.MotionUnit.mil},
        ["instrument.unit=mil wins, although the file says velocity in EU"],
    ),
    "same unit": ({"unit": "mm/s"}, {"unit": settings.MotionUnit.mm}, []),
    "quantity": (
        {"unit": "m/s"},
        {"quantity": settings.Quantity.displacement},
        ["instrument.quantity=displacement wins, although the file says velocity in m/s"],
    ),
    "amplitude": (
        {"unit": "mm/s rms", "kind": 12},
        {"amplitude": settings.Amplitude.peak, "unit": settings.MotionUnit.mm},
        ["instrument.amplitude=peak wins, although the file says velocity in mm/s rms"],
    ),
    "units of SI": (
        {"unit": "mm/s"},
        {},
        ["values are in mm/s as their label says, although data set 164 states m"],
    ),
}


@pytest.mark.parametrize("name", NOT_HEEDED)
def test_words_of_a_file_that_are_not_heeded_are_noted(uff, tmp_path, name):
    written, more, said = NOT_HEEDED[name]
    path = tmp_path / "a.uff"
    path.write_bytes(uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST, first=1.0, **written))
    found = take_findings({"line_of_sight": read(path, **more)})
    assert [f.text.removeprefix(f"{path}: ") for f in found] == said
    heavy = name in ("unit", "quantity", "amplitude")  # of words that are understood
    assert {f.severity.name for f in found} <= {"doubtful" if heavy else "note"}


ABSCISSAE = {"Hz": 1.0, "": 1.0, "kHz": 1e3, "1/s": 1.0, "rad/s": 1 / (2 * np.pi), "Hertz": 1.0}


@pytest.mark.parametrize("unit", ABSCISSAE)
def test_frequencies_by_the_label_of_the_abscissa(uff, tmp_path, unit):
    path = tmp_path / "a.uff"
    path.write_bytes(
        uff.units()
        + uff.nodes(POINTS)
        + uff.function(1, FIRST, first=2.0, axis=(18, "Frequency", unit))
    )
    expected = ABSCISSAE[unit] * (2.0 + np.arange(5))
    np.testing.assert_allclose(read(path)["frequency"], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("axis", "said"),
    [
        ((18, "", "m/s"), "its abscissa is in m/s; a frequency response function must be of"),
        ((18, "", "Ordnung"), "its abscissa is in a unit that is not understood"),
        ((17, "", "s"), "its abscissa is of time; a frequency response function must be of"),
        ((19, "", ""), "its abscissa is of revolutions"),
        ((20, "", ""), "its abscissa is of order"),
        ((13, "", ""), "its abscissa is of the quantity 13"),
    ],
)
def test_other_abscissae_are_refused(uff, tmp_path, axis, said):
    path = tmp_path / "a.uff"
    path.write_bytes(uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST, axis=axis))
    refused(path, said)


def test_times_by_the_label_of_the_abscissa(uff, tmp_path):
    path = tmp_path / "a.uff"
    t = np.arange(100) / 1e3
    record = uff.function(
        1,
        np.cos(2 * np.pi * 50 * t),
        kind=1,
        type_=4,
        first=0.0,
        step=1.0,
        axis=(17, "Time", "ms"),
    )
    path.write_bytes(uff.units() + uff.nodes(POINTS) + record)
    group = read(path, frequency=[50.0], time_reference="trigger", phase=None, reference=None)
    np.testing.assert_allclose(group["velocity"][0, 0], [1.0], atol=1e-9)


def test_real_functions_are_doubtful(uff, tmp_path):
    path = tmp_path / "a.uff"
    functions = uff.function(1, abs(FIRST)) + uff.function(2, FIRST)
    path.write_bytes(uff.units() + uff.nodes(POINTS) + functions)
    (finding,) = take_findings({"line_of_sight": read(path)})
    assert "1 of 2 functions of view a are of real numbers, as magnitudes are" in finding.text
    assert (finding.kind, finding.severity.name) == ("phase", "doubtful")


def test_coordinate_systems_given_twice_must_be_alike(uff, tmp_path):
    path = tmp_path / "a.uff"
    turned = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
    one = uff.systems({5: (turned, [0.1, 0, 0])})
    path.write_bytes(one * 2 + uff.nodes(POINTS, motion=5))
    with universal_file(path) as file:
        np.testing.assert_array_equal(file.geometry.system[0].axes, turned)
    path.write_bytes(one + uff.systems({5: (turned, [0.2, 0, 0])}) + uff.nodes(POINTS, motion=5))
    with universal_file(path) as file, pytest.raises(UserError, match="5 is given twice"):
        _ = file.geometry


#: Labels of a file to one of their unit in SI, and how often it must be integrated.
SPELLINGS = {
    "mm/s": (1e-3, 0),
    "µm/s": (1e-6, 0),
    "µm/s²": (1e-6, 1),
    "micron/s": (1e-6, 0),
    "ips": (0.0254, 0),
    "mil/s": (2.54e-5, 0),
    "MM/S": (1e-3, 0),
    "mm/min": (1e-3 / 60, 0),
    "m s-1": (1.0, 0),
    "m·s^-1": (1.0, 0),
    "m/s²": (1.0, 1),
    "M/S**2": (1.0, 1),
    "(m/s²)/N": (1.0, 1),
    "G": (9.80665, 1),
    "gn": (9.80665, 1),
    "g": (9.80665, 1),
    "mil": (2.54e-5, -1),
    "µm": (1e-6, -1),
}


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
@pytest.mark.parametrize("unit", SPELLINGS)
def test_spellings_in_files_that_state_si(uff, tmp_path, unit, encoding):
    factor, integrated = SPELLINGS[unit]
    numbers = {0: 11, 1: 12, -1: 8}
    path = tmp_path / "a.uff"
    omega = 2j * np.pi * FREQUENCY
    for quantity in (0, 1, numbers[integrated]):
        function = uff.function(1, FIRST, quantity=quantity, unit=unit, first=100.0, step=10.0)
        content = uff.units() + uff.nodes(POINTS) + function
        path.write_bytes(content.decode().encode(encoding))
        velocity = read(path)["velocity"][0, 0]
        np.testing.assert_allclose(velocity, factor * FIRST / omega**integrated, rtol=SIX_DIGITS)
    for quantity in {8, 11, 12} - {numbers[integrated]}:
        function = uff.function(1, FIRST, quantity=quantity, unit=unit, first=100.0, step=10.0)
        path.write_bytes((uff.units() + uff.nodes(POINTS) + function).decode().encode(encoding))
        refused(path, "states the quantity", "say which with instrument.quantity")


def test_functions_of_zeros_are_asked_about_with_the_others(uff, tmp_path):
    path = tmp_path / "a.uff"
    functions = uff.function(1, FIRST) + uff.function(2, 0 * FIRST)
    path.write_bytes(uff.units() + uff.nodes(POINTS) + functions)
    said = refused(path, "2 questions are open", "say it with instrument.phase", phase=None)
    assert "all values of 2+Z are zero" in said
    assert "instrument.zeros=missing" in said
    refused(path, "data set 4 (58)", "all values of 2+Z are zero")


def views_of_references(uff, tmp_path, references):
    views = {}
    for name, reference in references.items():
        path = tmp_path / f"{name}.uff"
        function = uff.function(1, FIRST, reference=(reference, 3))
        path.write_bytes(uff.units() + uff.nodes(POINTS) + function)
        views[name] = PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0])
    return views


def test_views_of_several_references_are_asked_about(uff, tmp_path):
    views = views_of_references(uff, tmp_path, {"a": 1, "b": 1, "c": 7})
    with pytest.raises(UserError, match=r"several references: 1\+Z \(a, b\), 7\+Z \(c\)") as error:
        UffImport(views=views, **SAID).read()
    assert "instrument.reference_dof=any if one excitation" in str(error.value)
    group = UffImport(views=views, **SAID, reference_dof="any").read()
    assert not take_findings({"line_of_sight": group})
    views = views_of_references(uff, tmp_path, {"a": 1, "b": 1})
    assert UffImport(views=views, **SAID).read().sizes["view"] == 2


def test_any_cannot_choose_among_references_of_one_node(uff, tmp_path):
    path = tmp_path / "several.uff"
    functions = uff.function(1, FIRST) + uff.function(1, 2 * FIRST, reference=(7, 1))
    path.write_bytes(uff.units() + uff.nodes(POINTS) + functions)
    asked = "choose one of 1+Z, 7+X with instrument.reference_dof=1+Z"
    assert refused(path, "the same node 1", asked).endswith(asked)
    refused(path, f"{asked}, as any cannot choose among", reference_dof="any")
    group = read(path, reference_dof="7+X")
    np.testing.assert_allclose(group["velocity"][0, 0], 2 * FIRST, rtol=SIX_DIGITS)


LBF = 4.4482216152605
#: Unit of length and force of data set 164, labels of values and reference, and the reference's
#: unit in N: of files that are to be in lbf.
IN_POUNDS = {
    "labels": (1.0, 1.0, "in/s", "lbf"),
    "label of values": (1.0, 1.0, "in/s/lbf", ""),
    "data set 164": (0.0254, LBF, "", ""),
}


def views_of_units(uff, tmp_path, length, force, unit, reference_unit):
    """Two views of the same motion, ``2 N * FIRST``, of functions per N and in inches per lbf."""
    labels = {"unit": unit, "reference_unit": reference_unit}
    contents = {
        "a": uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST),
        "b": uff.units(length, force=force)
        + uff.nodes(np.array(POINTS) / length)
        + uff.function(1, FIRST / 0.0254 * LBF, **labels),
    }
    views = {}
    for name, content in contents.items():
        path = tmp_path / f"{name}.uff"
        path.write_bytes(content)
        views[name] = PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0])
    return views


@pytest.mark.parametrize("name", IN_POUNDS)
def test_references_in_several_units_are_converted_or_asked_about(uff, tmp_path, name):
    views = views_of_units(uff, tmp_path, *IN_POUNDS[name])
    with pytest.raises(UserError, match=r"are in N \(a\), lbf \(b\); say in which unit") as error:
        UffImport(views=views, **SAID | {"reference": 2.0}).read()
    assert str(error.value).endswith("instrument.reference='2.0 N'")
    for reference in ("2 N", "2000 mN", f"{2 / LBF:.12g} lbf"):
        group = UffImport(views=views, **SAID | {"reference": reference}).read()
        np.testing.assert_allclose(group["velocity"][:, 0], [2 * FIRST] * 2, rtol=SIX_DIGITS)
        # A note says that values are in inches although data set 164 states m.
        found = take_findings({"line_of_sight": group})
        assert {f.severity.name for f in found} <= {"note"}
    assert group.attrs["import_reference"] == "2 N; 0.449618 lbf"


def test_reference_whose_unit_is_not_known_is_doubtful(uff, tmp_path):
    views = views_of_units(uff, tmp_path, 1.0, 1.0, "m/s", "EU")
    (finding,) = take_findings({"line_of_sight": UffImport(views=views, **SAID).read()})
    assert "are N (a), EU (b)" in finding.text
    assert finding.severity.name == "doubtful"


def test_unit_of_a_setting_that_no_file_confirms_is_doubtful(uff, tmp_path):
    path = tmp_path / "a.uff"
    path.write_bytes(uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST, reference_unit="EU"))
    assert not take_findings({"line_of_sight": read(path, reference=2.0)})
    (finding,) = take_findings({"line_of_sight": read(path, reference="2 N")})
    assert "are EU (a); where that is not known, the number of" in finding.text
    assert finding.remedy == "instrument.reference=2"
    assert finding.severity.name == "doubtful"


def test_reference_of_another_quantity_or_several_units_is_refused(uff, tmp_path):
    path = tmp_path / "a.uff"
    nodes = uff.units() + uff.nodes(POINTS)
    path.write_bytes(nodes + uff.function(1, FIRST))
    refused(path, "a reference in N, a force", "is in V, a voltage", reference="2 V")
    for wrong in ("2 EU", "N", "-2 N", 0.0, "nan"):
        with pytest.raises(UserError, match="reference: "):
            read(path, reference=wrong)
    other = uff.function(2, FIRST, reference_unit="lbf")
    path.write_bytes(nodes + uff.function(1, FIRST) + other)
    refused(path, "has a reference in lbf, data set 3 in N", "different files")


def test_one_view_without_unit_of_coordinates_can_have_those_of_another(uff, tmp_path):
    views = {}
    contents = {"a": uff.units() + uff.nodes(POINTS), "b": uff.nodes(np.array(POINTS) / 0.0254)}
    for name, content in contents.items():
        path = tmp_path / f"{name}.uff"
        path.write_bytes(content + uff.function(1, FIRST) + uff.function(3, 2 * FIRST))
        views[name] = PointwiseView(path=str(path), origin=[0.0, 0.0, 1.0])
    geometry = views["a"].path
    for unit in ("m", "inch"):
        with pytest.raises(UserError, match="must have one geometry") as error:
            UffImport(views=views, **SAID, length_unit=LengthUnit[unit]).read()
        assert f"instrument.geometry={geometry} without instrument.length_unit" in str(error.value)
    group = UffImport(views=views, **SAID, geometry=geometry).read()
    np.testing.assert_allclose(group["position"], [POINTS[0], POINTS[2]], rtol=1e-12)


def test_unit_of_coordinates_that_contradicts_the_file_is_doubtful(uff, tmp_path):
    path = tmp_path / "a.uff"
    path.write_bytes(uff.units() + uff.nodes(POINTS) + uff.function(3, FIRST))
    group = read(path, length_unit=LengthUnit.mm)
    np.testing.assert_allclose(group["position"], [1e-3 * np.array(POINTS[2])])
    (finding,) = take_findings({"line_of_sight": group})
    assert "instrument.length_unit wins, although data set 164 states" in finding.text
    assert finding.severity.name == "doubtful"
    assert not take_findings({"line_of_sight": read(path, length_unit=LengthUnit.m)})
