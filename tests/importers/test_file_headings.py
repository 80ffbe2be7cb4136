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


@pytest.mark.one_in(2)
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


@pytest.mark.one_in(2)
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


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("name", "units", "factor"),
    [("frequency", "kHz", 1e3), ("f_khz", "kHz", 1e3), ("frequency", "Hz", 1.0), ("f", "", 1.0)],
)
def test_frequencies_are_in_the_unit_of_their_attribute(tmp_path, name, units, factor):
    group = File(**spectra(tmp_path, name, units, "m s-1")).read()
    np.testing.assert_allclose(group["frequency"], factor * np.array([0.195, 0.44]), rtol=1e-14)
    np.testing.assert_allclose(group["velocity_std"], 0.4, rtol=1e-14)


@pytest.mark.one_in(2)
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


#: Names of arrays in a file, and how large 4 of the file are in m/s peak.
NAMES = {
    "v_rms": 4 * 2**0.5,
    "v_pp": 2.0,
    "data.v_mm_s": 4e-3,
    "data.v_rms": 4 * 2**0.5,
    "data.v_mm_s_rms": 4e-3 * 2**0.5,
    "data.V.mm_s": 4e-3,
    "data.V.rms": 4 * 2**0.5,
    "messung_s.v_mm_s": 4e-3,
    "scan_m.v": 4.0,
}


def write_fields(path, arrays):
    """Write arrays by names of fields, as ``data.v`` of a struct."""
    tree = {}
    for name, values in arrays.items():
        *structs, last = name.split(".")
        place = tree
        for struct in structs:
            place = place.setdefault(struct, {})
        place[last] = values
    scipy.io.savemat(path, tree)
    return str(path)


@pytest.mark.parametrize("name", NAMES)
def test_names_of_fields_state_units_and_measures_as_others_do(tmp_path, name):
    arrays = {"direction_cosines": DIRECTIONS, name: np.full((3, 1), 4.0)}
    path = write_fields(tmp_path / "mine.mat", arrays)
    group = File(path=path, mapping={name: "velocity"}).read()
    np.testing.assert_allclose(group["velocity"], NAMES[name], rtol=1e-14)


@pytest.mark.parametrize("struct", ["scan_mm_s", "mm_s", "scan_rms"])
@pytest.mark.parametrize("name", ["velocity", "v"])
def test_unit_in_the_name_of_a_struct_is_asked_about(tmp_path, struct, name):
    arrays = {"direction_cosines": DIRECTIONS, name: np.full((3, 1), 4.0)}
    path = write_fields(tmp_path / "mine.mat", {f"{struct}.{k}": v for k, v in arrays.items()})
    mapping = {} if name == "velocity" else {f"{struct}.v": "velocity"}
    if mapping:
        mapping[f"{struct}.direction_cosines"] = "direction_cosines"
    said = f"the name of {struct} may state .*; say it with both instrument.unit and instrument.am"
    with pytest.raises(UserError, match=said):
        File(path=path, mapping=mapping).read()
    answers = {"unit": VelocityUnit.mm_per_s, "amplitude": Amplitude.rms}
    group = File(path=path, mapping=mapping, **answers).read()
    np.testing.assert_allclose(group["velocity"], 4e-3 * 2**0.5, rtol=1e-14)


def test_measure_without_a_unit_is_heeded_and_may_not_be_contradicted(read):
    headings = values("{} (rms)")
    group = read(headings, unit=VelocityUnit.mm_per_s)
    np.testing.assert_allclose(group["velocity"], 2**0.5 * 1e-3 * (2 + 3j), rtol=1e-14)
    np.testing.assert_allclose(group["velocity_std"], 2**0.5 * 0.5e-3, rtol=1e-14)
    with pytest.raises(UserError, match=r"states rms, .*instrument.amplitude=peak; they must"):
        read(headings, amplitude=Amplitude.peak)
    with pytest.raises(UserError, match="must state the same unit"):
        read({"real": "Re (rms)", "imag": "Im", "std": "s"})


def of_places(tmp_path, suffix, unit):
    """Write two points 1 and 2 of a unit from the origin, whose unit the file states."""
    path = tmp_path / f"mine.{suffix}"
    if suffix == "csv":
        rows = [
            f"{v},{p},{','.join(map(str, d))},1,{x},0,0"
            for v, d in enumerate(DIRECTIONS)
            for p, x in (("a", 1), ("b", 2))
        ]
        head = f"view,point,dx,dy,dz,real,x_{unit},y_{unit},z_{unit}"
        path.write_text("\n".join([head, *rows]))
        return str(path)
    place = np.array([[1.0, 0, 0], [2.0, 0, 0]])
    arrays = {
        "direction_cosines": (("view", "point", "axis"), np.stack([DIRECTIONS] * 2, axis=1)),
        "velocity": (("view", "point"), np.ones((3, 2))),
    }
    if suffix == "nc":
        arrays["position"] = (("point", "axis"), place, {"units": unit})
    else:
        arrays |= {c: ("point", place[:, i], {"units": unit}) for i, c in enumerate("xyz")}
    xr.Dataset(arrays).to_netcdf(path, engine="netcdf4")
    return str(path)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("suffix", ["nc", "xyz.nc", "csv"])
def test_unit_of_lengths_that_contradicts_the_file_is_refused(tmp_path, suffix):
    path = of_places(tmp_path, suffix, "mm")
    for settings in ({}, {"length_unit": LengthUnit.mm}):
        group = File(path=path, **settings).read()
        np.testing.assert_allclose(group["position"][:, 0], [1e-3, 2e-3], rtol=1e-14)
    for unit in (LengthUnit.m, LengthUnit.inch):
        with pytest.raises(UserError, match=f"mm.*instrument.length_unit={unit.name}; they must"):
            File(path=path, length_unit=unit).read()


def test_coordinates_in_several_units_are_refused(tmp_path):
    path = of_places(tmp_path, "xyz.nc", "mm")
    with xr.open_dataset(path) as data:
        data = data.load()
    data["z"].attrs["units"] = "m"
    data.to_netcdf(path, engine="netcdf4")
    with pytest.raises(UserError, match="x, y and z are in mm, mm, m; they must be in the same"):
        File(path=path).read()


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("units", "settings", "factor"),
    [
        ("mm/s rms", {}, 2**0.5 * 1e-3),
        ("mm s-1", {"amplitude": Amplitude.rms}, 2**0.5 * 1e-3),
        ("cm/s p-p", {}, 0.5e-2),
        ("mm_per_s", {}, 1e-3),
        ("EU", {"unit": VelocityUnit.mm_per_s, "amplitude": Amplitude.rms}, 2**0.5 * 1e-3),
    ],
)
def test_attribute_states_the_measure_too_or_settings_answer(tmp_path, units, settings, factor):
    path = array_with_units(tmp_path, "velocity", units)
    group = File(path=str(path), **settings).read()
    np.testing.assert_allclose(group["velocity"], 4 * factor, rtol=1e-14)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("name", "units", "settings", "said"),
    [
        ("velocity", "EU", {"unit": VelocityUnit.m_per_s}, "both instrument.unit and instrument.a"),
        ("velocity", "m/s²", {}, "is none of a velocity; correct its attribute"),
        ("velocity", "mm/s rms", {"amplitude": Amplitude.peak}, "instrument.amplitude=peak; they"),
        ("v_mm_s_rms", "mm/s pk", {}, "the name of an array and its attribute units contradict"),
    ],
)
def test_attribute_that_is_not_understood_is_asked_about(tmp_path, name, units, settings, said):
    path = array_with_units(tmp_path, name, units)
    with pytest.raises(UserError, match=said):
        File(path=str(path), mapping=mapping_of(name), **settings).read()


def test_measure_of_standard_errors_that_is_not_that_of_velocities_is_refused(tmp_path):
    settings = spectra(tmp_path, "frequency", "Hz", "m/s rms")
    with pytest.raises(UserError, match=r"velocity_std is in m/s rms, velocity in m/s; they must"):
        File(**settings).read()
    group = File(**settings, amplitude=Amplitude.rms).read()
    np.testing.assert_allclose(group["velocity_std"], 0.4 * 2**0.5, rtol=1e-14)
