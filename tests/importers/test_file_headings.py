"""Units in headings that a mapping gives the program's names: heeded, or asked about."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io
import xarray as xr

from sldvexp.errors import UserError
from sldvexp.importers.velocity_file import File
from sldvexp.io.velocities.headings import unit_in
from sldvexp.unit_labels import Amplitude
from sldvexp.units import LengthUnit, VelocityUnit

DIRECTIONS = np.array([[0.0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8]])
#: Headings that the texts below replace, by the program's names.
HEADINGS = {
    "view": "Ansicht",
    "point": "Messpunkt [Nr]",
    "x": "X [mm]",
    "y": "Y [mm]",
    "z": "Z [mm]",
    "dx": "Richtung X",
    "dy": "Richtung Y [-]",
    "dz": "Richtung Z",
    "frequency": "Frequenz [kHz]",
    "real": "Realteil [mm/s eff]",
    "imag": "Imaginärteil [mm/s eff]",
    "std": "Streuung [mm/s eff]",
}
SI = {own: own for own in HEADINGS}


@pytest.fixture
def read(tmp_path):
    def read_(headings=(), encoding="latin-1", **settings):
        names = HEADINGS | dict(headings)
        lines = [";".join(names.values())]
        for view, direction in enumerate(DIRECTIONS):
            cells = [view, "p1", 100, 200, -50, *direction, 0.195, 2, 3, 0.5]
            lines.append(";".join(map(str, cells)))
        path = tmp_path / "mine.csv"
        path.write_text("\n".join(lines), encoding=encoding)
        mapping = {theirs: own for own, theirs in names.items() if theirs != own}
        return File(path=str(path), mapping=mapping, **settings).read()

    return read_


def values(name):
    """Name the columns of values with what is the same behind each."""
    return {own: name.format(own) for own in ("real", "imag", "std")}


def places(name):
    return {own: name.format(own.upper()) for own in "xyz"}


@pytest.mark.parametrize("settings", [{}, {"unit": VelocityUnit.mm_per_s}])
def test_units_of_headings_are_those_of_the_values(read, settings):
    group = read(**settings)
    np.testing.assert_allclose(group["velocity"], 2**0.5 * 1e-3 * (2 + 3j), rtol=1e-14)
    np.testing.assert_allclose(group["velocity_std"], 2**0.5 * 0.5e-3, rtol=1e-14)
    np.testing.assert_allclose(group["position"][0], [0.1, 0.2, -0.05], rtol=1e-14)
    np.testing.assert_allclose(group["frequency"], [195.0], rtol=1e-14)
    assert group.attrs["import_amplitude"] == "rms"


@pytest.mark.parametrize(
    ("headings", "velocity", "length", "frequency"),
    [
        (values("{} [µm/s]"), 1e-6, 1e-3, 1e3),
        (values("{} (µm/s pk)"), 1e-6, 1e-3, 1e3),
        (values("{}, mm/s p-p"), 0.5e-3, 1e-3, 1e3),
        (values("{}_um_per_s"), 1e-6, 1e-3, 1e3),
        (values("{}_mm_s_rms"), 2**0.5 * 1e-3, 1e-3, 1e3),
        (values("{} in mm/s"), 1e-3, 1e-3, 1e3),
        (values("{}/(in/s)"), 0.0254, 1e-3, 1e3),
        (values("{} Kanal 1"), 1.0, 1e-3, 1e3),
        (places("{}_cm"), 2**0.5 * 1e-3, 1e-2, 1e3),
        (places("{} [Zoll]") | {"frequency": "f/MHz"}, None, None, None),
        (places("{}, inch") | {"frequency": "f_khz"}, 2**0.5 * 1e-3, 0.0254, 1e3),
        ({"frequency": "Frequenz, Hz"}, 2**0.5 * 1e-3, 1e-3, 1.0),
        ({"frequency": "Frequenz / kHz"}, 2**0.5 * 1e-3, 1e-3, 1e3),
        ({"frequency": "f_s"}, 2**0.5 * 1e-3, 1e-3, 1.0),
        (SI, 1.0, 1.0, 1.0),
    ],
)
def test_ways_to_write_a_unit(read, headings, velocity, length, frequency):
    if velocity is None:
        with pytest.raises(UserError, match=r"'X \[Zoll\]', x: the unit 'Zoll' is not known here"):
            read(headings)
        return
    group = read(headings, encoding="utf-8")
    np.testing.assert_allclose(group["velocity"], velocity * (2 + 3j), rtol=1e-14)
    np.testing.assert_allclose(group["position"][0], length * np.array([100, 200, -50]))
    np.testing.assert_allclose(group["frequency"], [frequency * 0.195], rtol=1e-14)


@pytest.mark.parametrize(
    ("headings", "settings", "said"),
    [
        (values("{} [Digit]"), {}, "'real \\[Digit\\]', real: the unit 'Digit' .* instrument.unit"),
        (values("{} [Digit]"), {"unit": VelocityUnit.mm_per_s}, "and instrument.amplitude"),
        (values("{} [mm]"), {}, r"the unit 'mm' \(length\) is none of a velocity"),
        (values("{} [m/s²]"), {}, r"the unit 'm/s²' \(acceleration\) is none of a velocity"),
        (values("{} [(m/s)/N]"), {}, "is none of a velocity"),
        (values("{} [dB]"), {}, "is logarithmic"),
        (values("{}_mm"), {}, "is none of a velocity"),
        ({"imag": "imag"}, {}, r"'imag' \(no unit\).* must state the same unit"),
        ({"std": "Streuung [mm/s]"}, {}, "must state the same unit"),
        ({"x": "X [cm]"}, {}, "must state the same unit"),
        ({"frequency": "Frequenz [U/min]"}, {}, "'Frequenz .*; correct the heading"),
        ({"frequency": "Frequenz [rad/s]"}, {}, "is none of a frequency"),
        ({"dx": "Richtung X [mm]"}, {}, r"the unit 'mm' \(length\) is none of a number without"),
        ({}, {"unit": VelocityUnit.m_per_s}, "states mm/s eff, .*instrument.unit=m_per_s; they"),
        ({}, {"amplitude": Amplitude.peak}, "states mm/s eff, .*instrument.amplitude=peak; they"),
        ({}, {"length_unit": LengthUnit.m}, "states mm, .*instrument.length_unit=m; they"),
    ],
)
def test_what_is_not_understood_or_contradicts_is_asked_about(read, headings, settings, said):
    with pytest.raises(UserError, match=said):
        read(headings, encoding="utf-8", **settings)


def test_settings_answer_for_units_that_are_not_understood(read):
    group = read(
        values("{} [Digit]") | places("{} [Zoll]"),
        unit=VelocityUnit.um_per_s,
        amplitude=Amplitude.rms,
        length_unit=LengthUnit.inch,
    )
    np.testing.assert_allclose(group["velocity"], 2**0.5 * 1e-6 * (2 + 3j), rtol=1e-14)
    np.testing.assert_allclose(group["position"][0], 0.0254 * np.array([100, 200, -50]))


@pytest.mark.parametrize("ending", ["mat", "nc"])
def test_names_of_arrays_state_units_too(tmp_path, ending):
    path = tmp_path / f"mine.{ending}"
    arrays = {
        "direction_cosines": (("view", "axis"), DIRECTIONS),
        "v_mm_s_rms": (("view", "frequency"), np.full((3, 2), 4.0)),
        "f_khz": (("frequency",), np.array([0.195, 0.44])),
    }
    if ending == "mat":
        scipy.io.savemat(path, {name: values for name, (_, values) in arrays.items()})
    else:
        xr.Dataset(arrays).to_netcdf(path)
    mapping = {"v_mm_s_rms": "velocity", "f_khz": "frequency"}
    group = File(path=str(path), mapping=mapping).read()
    np.testing.assert_allclose(group["velocity"], 2**0.5 * 4e-3, rtol=1e-14)
    np.testing.assert_allclose(group["frequency"], [195.0, 440.0], rtol=1e-14)
    with pytest.raises(UserError, match=r"states mm/s rms, .*instrument.unit=m_per_s; they must"):
        File(path=str(path), mapping=mapping, unit=VelocityUnit.m_per_s).read()


@pytest.mark.parametrize(
    ("name", "units", "unit"),
    [
        ("velocity", "mm/s", None),
        ("velocity", "mm s-1", VelocityUnit.mm_per_s),
        ("v_mm_s", "mm/s", None),
        ("v_mm_s", "mm/s", VelocityUnit.mm_per_s),
    ],
)
def test_unit_in_an_attribute_is_heeded_and_may_agree_with_the_name(tmp_path, name, units, unit):
    path = array_with_units(tmp_path, name, units)
    group = File(path=str(path), mapping=mapping_of(name), unit=unit).read()
    np.testing.assert_allclose(group["velocity"], 4e-3, rtol=1e-14)
    np.testing.assert_allclose(group["position"][0], [0.3048, 0.6096, 0.0], rtol=1e-14)


@pytest.mark.parametrize(
    ("units", "unit", "said"),
    [
        ("m/s", None, "the name of an array and its attribute units contradict"),
        ("m/s", VelocityUnit.mm_per_s, "states velocities in m/s, .*instrument.unit=mm_per_s;"),
    ],
)
def test_attribute_that_contradicts_is_refused(tmp_path, units, unit, said):
    path = array_with_units(tmp_path, "v_mm_s", units)
    with pytest.raises(UserError, match=said):
        File(path=str(path), mapping=mapping_of("v_mm_s"), unit=unit).read()


def spectra(tmp_path, name, units, std_units):
    """Write velocities of 4 m/s at two frequencies in a unit, with standard errors."""
    path = tmp_path / "mine.nc"
    values = np.full((3, 2), 4.0)
    arrays = {
        "direction_cosines": (("view", "axis"), DIRECTIONS),
        "velocity": (("view", "frequency"), values, {"units": "m/s"}),
        "velocity_std": (("view", "frequency"), values / 10, {"units": std_units}),
        name: (("frequency",), np.array([0.195, 0.44]), {"units": units}),
    }
    xr.Dataset(arrays).to_netcdf(path)
    return {"path": str(path), "mapping": {} if name == "frequency" else {name: "frequency"}}


@pytest.mark.parametrize(
    ("name", "units", "factor"),
    [("frequency", "kHz", 1e3), ("f_khz", "kHz", 1e3), ("frequency", "Hz", 1.0), ("f", "", 1.0)],
)
def test_frequencies_are_in_the_unit_of_their_attribute(tmp_path, name, units, factor):
    group = File(**spectra(tmp_path, name, units, "m s-1")).read()
    np.testing.assert_allclose(group["frequency"], factor * np.array([0.195, 0.44]), rtol=1e-14)
    np.testing.assert_allclose(group["velocity_std"], 0.4, rtol=1e-14)


@pytest.mark.parametrize(
    ("name", "units", "std_units", "said"),
    [
        ("f_khz", "Hz", "m/s", "the name of an array and its attribute units contradict"),
        ("f_hz", "kHz", "m/s", "the name of an array and its attribute units contradict"),
        ("frequency", "rad/s", "m/s", "frequency: the unit 'rad/s' .* is none of a frequency"),
        ("frequency", "lines", "m/s", "frequency: the unit 'lines' is not known here"),
        ("frequency", "Hz", "mm/s", "velocity_std is in mm/s, velocity in m/s; they must be in"),
    ],
)
def test_attributes_of_frequencies_and_errors_may_be_refused(
    tmp_path, name, units, std_units, said
):
    with pytest.raises(UserError, match=said):
        File(**spectra(tmp_path, name, units, std_units)).read()


def array_with_units(tmp_path, name, units):
    """Write velocities of 4 in a unit, and positions whose name and attribute both say ft."""
    path = tmp_path / "mine.nc"
    places = np.array([[1.0, 2.0, 0.0], [3.0, 1.0, 0.0]])
    arrays = {
        "direction_cosines": (("view", "point", "axis"), np.stack([DIRECTIONS] * 2, axis=1)),
        name: (("view", "point"), np.full((3, 2), 4.0), {"units": units}),
        "p_ft": (("point", "axis"), places, {"units": "ft"}),
    }
    xr.Dataset(arrays).to_netcdf(path)
    return path


def mapping_of(name):
    return {"p_ft": "position"} | ({} if name == "velocity" else {name: "velocity"})


def test_words_that_look_like_no_unit_are_none():
    assert unit_in("Richtung X", "") is None
    assert unit_in("v_m", "velocity") is None
    assert unit_in("x_m", "displacement").factor == 1.0
