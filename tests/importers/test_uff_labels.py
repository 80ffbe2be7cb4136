"""Units in universal files: of values, abscissae and coordinates, by their labels or as set."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import take_findings
from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView
from sldvexp.importers import conventions as settings
from sldvexp.importers.uff import UffImport
from sldvexp.units import LengthUnit

from .plate_files import FIRST, FREQUENCY, POINTS, SAID, SIX_DIGITS, read, refused

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


@pytest.mark.one_in(9)
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
