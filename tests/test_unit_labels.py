"""Labels of units as vibrometers, analysers and people write them."""

from __future__ import annotations

import math
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.unit_labels import Amplitude, SpectralForm, UnitNotUnderstoodError, read_unit

INCH, G = 0.0254, 9.80665
#: Spellings of velocities, with one of them in m/s.
VELOCITIES = {
    "m/s": 1.0,
    "mm/s": 1e-3,
    "cm/s": 1e-2,
    "nm/s": 1e-9,
    "pm/s": 1e-12,
    "um/s": 1e-6,
    "µm/s": 1e-6,  # the sign of Latin-1
    "μm/s": 1e-6,  # the Greek letter
    "\\mu m/s": 1e-6,
    "$\\mu$m/s": 1e-6,
    "micron/s": 1e-6,
    "microns/sec": 1e-6,
    "Micron/s": 1e-6,
    "micrometer/s": 1e-6,
    "micrometre/s": 1e-6,
    "MM/S": 1e-3,
    "M/S": 1.0,
    "UM/S": 1e-6,
    "IN/SEC": INCH,
    "mm/S": 1e-3,
    "mm/sec": 1e-3,
    "mm/Sek.": 1e-3,
    "mm / s": 1e-3,
    "[mm/s]": 1e-3,
    "(mm/s)": 1e-3,
    "([mm/s])": 1e-3,
    "mm per s": 1e-3,
    "ips": INCH,
    "IPS": INCH,
    "in/s": INCH,
    "in./s": INCH,
    "inch/s": INCH,
    "inches/second": INCH,
    "mil/s": 1e-3 * INCH,
    "mils/s": 1e-3 * INCH,
    "thou/s": 1e-3 * INCH,
    "ft/s": 12 * INCH,
    "fps": 12 * INCH,
    "feet/sec": 12 * INCH,
    "km/h": 1 / 3.6,
    "mm/min": 1e-3 / 60,
    "m/ms": 1e3,
    "m s^-1": 1.0,
    "m s-1": 1.0,
    "m.s-1": 1.0,
    "m.s^-1": 1.0,
    "m·s⁻¹": 1.0,
    "m⋅s⁻¹": 1.0,
    "m*s^-1": 1.0,
    "m*s**-1": 1.0,
    "m s^{-1}": 1.0,
    "m s−1": 1.0,  # with the sign of minus
    "mm s⁻¹": 1e-3,
    "s^-1 m": 1.0,
    "meter/second": 1.0,
    "metre second-1": 1.0,
    "meters per second": 1.0,
    "Meter/Sekunde": 1.0,
    "1e-3 m/s": 1e-3,
    "10^-6 m/s": 1e-6,
    "10⁻⁶ m/s": 1e-6,
    "kine": 1e-2,
}
DISPLACEMENTS = {
    "m": 1.0,
    "MM": 1e-3,
    "nm": 1e-9,
    "µm": 1e-6,
    "micron": 1e-6,
    "mil": 1e-3 * INCH,
    "mils": 1e-3 * INCH,
    "in": INCH,
    "inch": INCH,
    "Å": 1e-10,
    "ft": 12 * INCH,
}
ACCELERATIONS = {
    "m/s²": 1.0,
    "m/s^2": 1.0,
    "m/s**2": 1.0,
    "m/s2": 1.0,
    "m/s/s": 1.0,
    "m/sec/sec": 1.0,
    "M/S**2": 1.0,
    "m s^-2": 1.0,
    "m.s-2": 1.0,
    "m·s⁻²": 1.0,
    "mm/s²": 1e-3,
    "in/sec²": INCH,
    "g": G,
    "G": G,
    "gn": G,
    "g_n": G,
    "g0": G,
    "G's": G,
    "Gal": 1e-2,
}
#: Labels that say more: quantity, factor, amplitude, form, reference, product.
PEAK, RMS, PP = Amplitude.peak, Amplitude.rms, Amplitude.peak_to_peak
LINEAR, POWER, DENSITY = SpectralForm.linear, SpectralForm.power, SpectralForm.density
ROOT, TRANSFORM = SpectralForm.root_density, SpectralForm.transform
MORE = {
    "mm/s RMS": ("velocity", 1e-3, RMS, LINEAR, "", False),
    "mm/s rms": ("velocity", 1e-3, RMS, LINEAR, "", False),
    "mm/s r.m.s.": ("velocity", 1e-3, RMS, LINEAR, "", False),
    "mm/s_rms": ("velocity", 1e-3, RMS, LINEAR, "", False),
    "mm/s (RMS)": ("velocity", 1e-3, RMS, LINEAR, "", False),
    "mm/s, eff.": ("velocity", 1e-3, RMS, LINEAR, "", False),
    "grms": ("acceleration", G, RMS, LINEAR, "", False),
    "Grms": ("acceleration", G, RMS, LINEAR, "", False),
    "mm/srms": ("velocity", 1e-3, RMS, LINEAR, "", False),
    "mm/s²rms": ("acceleration", 1e-3, RMS, LINEAR, "", False),
    "RMS(mm/s)": ("velocity", 1e-3, RMS, LINEAR, "", False),
    "[mm/s] RMS": ("velocity", 1e-3, RMS, LINEAR, "", False),
    "m/s²/√Hz rms": ("acceleration", 1.0, RMS, ROOT, "", False),
    "mm/s pk": ("velocity", 1e-3, PEAK, LINEAR, "", False),
    "mm/s peak": ("velocity", 1e-3, PEAK, LINEAR, "", False),
    "mm/s 0-p": ("velocity", 1e-3, PEAK, LINEAR, "", False),
    "mm/s 0-pk": ("velocity", 1e-3, PEAK, LINEAR, "", False),
    "ips pk": ("velocity", INCH, PEAK, LINEAR, "", False),
    "mils p-p": ("displacement", 1e-3 * INCH, PP, LINEAR, "", False),
    "mm/s p-p": ("velocity", 1e-3, PP, LINEAR, "", False),
    "mm/s pk-pk": ("velocity", 1e-3, PP, LINEAR, "", False),
    "mm/s peak-to-peak": ("velocity", 1e-3, PP, LINEAR, "", False),
    "µm pp": ("displacement", 1e-6, PP, LINEAR, "", False),
    "(mm/s)²": ("velocity", 1e-3, None, POWER, "", False),
    "(m/s)^2": ("velocity", 1.0, None, POWER, "", False),
    "mm²/s²": ("velocity", 1e-3, None, POWER, "", False),
    "(mm/s)^2/Hz": ("velocity", 1e-3, None, DENSITY, "", False),
    "g²/Hz": ("acceleration", G, None, DENSITY, "", False),
    "m/s/√Hz": ("velocity", 1.0, None, ROOT, "", False),
    "nm/√(Hz)": ("displacement", 1e-9, None, ROOT, "", False),
    "mm/s/sqrt(Hz)": ("velocity", 1e-3, None, ROOT, "", False),
    "mm/s/rtHz": ("velocity", 1e-3, None, ROOT, "", False),
    "mm/s/Hz^0.5": ("velocity", 1e-3, None, ROOT, "", False),
    "m/s/Hz": ("velocity", 1.0, None, TRANSFORM, "", False),
    "(m/s)/N": ("velocity", 1.0, None, LINEAR, "N", False),
    "m/s/N": ("velocity", 1.0, None, LINEAR, "N", False),
    "mm/s/V": ("velocity", 1e-3, None, LINEAR, "V", False),
    "m/N": ("displacement", 1.0, None, LINEAR, "N", False),
    "in/s/lbf": ("velocity", INCH, None, LINEAR, "lbf", False),
    "g/N": ("acceleration", G, None, LINEAR, "N", False),
    "g/g": ("acceleration", G, None, LINEAR, "g", False),
    "(m/s)/(m/s²)": ("velocity", 1.0, None, LINEAR, "m/s^2", False),
    "(mm/s RMS)/Pa": ("velocity", 1e-3, RMS, LINEAR, "Pa", False),
    "m/N/s": ("velocity", 1.0, None, LINEAR, "N", False),
    "m s^-1 N^-1": ("velocity", 1.0, None, LINEAR, "N", False),
    "(m/s/N)/√Hz": ("velocity", 1.0, None, ROOT, "N", False),
    "m/s/(N*V)": ("velocity", 1.0, None, LINEAR, "N*V", False),
    "N*m/s": ("velocity", 1.0, None, LINEAR, "N", True),
    "(mm/s)·V": ("velocity", 1e-3, None, LINEAR, "V", True),
    "in/s N": ("velocity", INCH, None, LINEAR, "N", True),
    "[(µm/s)·V/Hz]": ("velocity", 1e-6, None, DENSITY, "V", True),
}
OTHERS = {
    "V": ("voltage", 1.0),
    "mV": ("voltage", 1e-3),
    "N": ("force", 1.0),
    "lbf": ("force", 4.4482216152605),
    "Pa": ("pressure", 1.0),
    "Hz": ("frequency", 1.0),
    "kHz": ("frequency", 1e3),
    "deg": ("angle", math.pi / 180),
    "degrees": ("angle", math.pi / 180),
    "°": ("angle", math.pi / 180),
    "rad": ("angle", 1.0),
    "radians": ("angle", 1.0),
    "s": ("time", 1.0),
    "V²/Hz": ("voltage", 1.0),
    "kg": ("mass", 1.0),
}
ASKED = {
    "": "names no unit",
    "-": "names no unit",
    "rms": "names no unit",
    "dB": "is logarithmic",
    "dB re 1 nm/s": "is logarithmic",
    "mm/s dB": "is logarithmic",
    "?m/s": "lost on the way",
    "�m/s": "lost on the way",
    "µ/s": "'μ'",
    "æm/s": "'æm'",
    "Mm/s": "'Mm'",
    "EU": "not known here",
    "counts": "not known here",
    "%": "not known here",
    "mg": "not known here",
    "m/s rms pk": "more than one measure",
    "m/(N*s)": "may mean several things",
    "m/(s·N)": "may mean several things",
    "V/(mm/s)": "is of no motion",
    "m/s/m": "may mean several things",
    "m/s m": "may mean several things",
    "m/s*mm/s": "may mean several things",
    "g·mm": "may mean several things",
    "m s": "is of no motion",
    "m/s³": "is of no motion",
    "m²/s³": "is of no motion",
    "(m/s)²/N²": "may mean several things",
    "100 mm/s": "may be a range",
    "2 m/s": "may be a range",
    "mm/s @ 100 Hz": "'@ 100 Hz'",
    "mm//s": "'/s'",
    "mm/": "'/'",
    "mm/s)": "')'",
    "(mm/s": "'(mm/s'",
    "Velocity": "not known here",
    "m/s p": "'p'",
    "m/s" + " " * 100: "is too long",
    "(" * 80: "is not known here",
    "m^99999": "has a part that is not known",
    "10^9999 m/s": "has a part that is not known",
    "m/0s": "has a part that is not known",
}


@pytest.mark.parametrize("text", VELOCITIES | DISPLACEMENTS | ACCELERATIONS)
def test_spellings_of_motions(text):
    of = {"velocity": VELOCITIES, "displacement": DISPLACEMENTS, "acceleration": ACCELERATIONS}
    label = read_unit(text)
    assert text in of[label.quantity]
    assert label.factor == pytest.approx(of[label.quantity][text], rel=1e-12)
    rest = (label.amplitude, label.form, label.reference, label.product, label.is_motion)
    assert rest == (None, SpectralForm.linear, "", False, True)


@pytest.mark.parametrize("text", MORE)
def test_amplitudes_forms_and_references(text):
    label = read_unit(text)
    quantity, factor, *more = MORE[text]
    assert (label.quantity, label.factor) == (quantity, pytest.approx(factor, rel=1e-12))
    assert [label.amplitude, label.form, label.reference, label.product] == more


@pytest.mark.parametrize("text", OTHERS)
def test_units_of_no_motion(text):
    label = read_unit(text)
    assert (label.quantity, label.factor) == (OTHERS[text][0], pytest.approx(OTHERS[text][1]))
    assert not label.is_motion


@pytest.mark.parametrize("text", ASKED)
def test_labels_that_are_asked_about(text):
    with pytest.raises(UnitNotUnderstoodError) as error:
        read_unit(text)
    assert ASKED[text] in str(error.value)
    assert "\n" not in str(error.value)


def test_table_is_long_enough():
    assert len(VELOCITIES | DISPLACEMENTS | ACCELERATIONS | MORE | OTHERS | ASKED) >= 120


def test_length_is_told_only_of_motions_per_second():
    lengths = {t: read_unit(t).length for t in ("mm/s", "mil/s²", "ips", "mm/min", "g", "V")}
    assert lengths == pytest.approx(
        {"mm/s": 1e-3, "mil/s²": 1e-3 * INCH, "ips": INCH, "mm/min": 0, "g": 0, "V": 0}
    )


KNOWN = VELOCITIES | DISPLACEMENTS | ACCELERATIONS


@settings(
    max_examples=settings.default.max_examples, deadline=None, derandomize=True, database=None
)
@given(
    st.sampled_from(sorted(MORE) + sorted(KNOWN)),
    st.integers(0, 20),
    st.sampled_from("xqz@#~!Ł%&|"),
)
def test_a_strange_character_is_never_passed_over(text, at, strange):
    with pytest.raises(UnitNotUnderstoodError):
        read_unit(text[:at] + strange + text[at:])


@settings(
    max_examples=settings.default.max_examples, deadline=None, derandomize=True, database=None
)
@given(st.text(max_size=20))
def test_any_text_is_understood_or_asked_about(text):
    try:
        label = read_unit(text)
    except UnitNotUnderstoodError as error:
        assert len(error.args[0]) < 200  # noqa: PT017
    else:
        assert label.factor > 0
        assert math.isfinite(label.factor)


@pytest.mark.parametrize(
    "text", ["p" + " " * 78, "-_ /2to" * 11, "p-" * 40, "(" * 79 + "m", "0" * 80]
)
def test_hostile_labels_take_no_time(text):
    begin = time.process_time()
    with pytest.raises(UnitNotUnderstoodError):
        read_unit(text)
    assert time.process_time() - begin < 0.5
