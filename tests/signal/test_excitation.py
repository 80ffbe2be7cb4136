"""Waveforms of excitations, their lines and their windows."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import Checks, UserError
from sldvexp.signal import Excitation, ExcitationKind, LineChoice

RATE, SAMPLES = 5120.0, 1024
NOISY = (ExcitationKind.random, ExcitationKind.burst_random)


def design(kind, samples=SAMPLES, **more):
    settings = {"kind": kind, "amplitude": 2.0, **more}
    return Excitation(**settings).design(RATE, samples, tones=[200.0, 400.0])


@pytest.mark.parametrize("kind", ExcitationKind)
def test_waveform_has_its_amplitude_and_stays_in_its_band(kind):
    made = design(kind)
    wave = made.waveform(20 if kind in NOISY else 1)
    if kind is ExcitationKind.sine:
        assert wave.max() == pytest.approx(4.0)  # two tones of 2 V in phase
    elif kind is ExcitationKind.hammer:
        assert wave.max() == pytest.approx(2.0, rel=0.06)  # of four samples
    else:
        plays = wave[wave != 0] if kind is ExcitationKind.burst_random else wave
        # Of noise the r.m.s. is known to 1 / sqrt(2 n) of n independent lines.
        lines = 20 * len(made.lines) * (0.5 if kind is ExcitationKind.burst_random else 1)
        accuracy = 4 / np.sqrt(4 * lines) if kind in NOISY else 2e-3
        assert plays.std() == pytest.approx(2.0, rel=accuracy)
        power = np.abs(np.fft.rfft(wave)) ** 2
        hertz = np.fft.rfftfreq(len(wave), 1 / RATE)
        inside = (hertz > 49) & (hertz < 1341)
        # A sweep is cut off at its ends, and so is a burst.
        assert power[inside].sum() > 0.98 * power.sum()


@pytest.mark.parametrize("kind", ExcitationKind)
def test_nominal_amplitude_of_a_line_is_that_of_its_power(kind):
    made = design(kind)
    count = 200
    if kind in NOISY:
        blocks = made.waveform(count).reshape(count, SAMPLES)
        power = np.mean(np.abs(2 / SAMPLES * np.fft.rfft(blocks)[:, made.lines]) ** 2)
        nominal = np.mean(made.reference_amplitude**2)
        # A block of noise without a window leaks out of the band at its ends.
        assert power == pytest.approx(nominal, rel=0.03)
    else:
        phasors = made.spectra(made.waveform())
        np.testing.assert_allclose(np.abs(phasors), made.reference_amplitude, rtol=1e-9)


@pytest.mark.parametrize("kind", [k for k in ExcitationKind if Excitation(k).periodic])
def test_periodic_records_repeat_and_need_a_lead(kind):
    made = design(kind)
    np.testing.assert_array_equal(made.waveform(3), np.tile(made.waveform(), 3))
    assert made.excitation.lead == 1
    assert (made.window == 1).all()


def test_random_goes_on_from_record_to_record_and_is_another_with_another_seed():
    made = design(ExcitationKind.random)
    wave = made.waveform(4)
    step = np.abs(np.diff(wave))
    assert step[SAMPLES - 1] < 6 * step.std()  # no jump at the end of a record
    assert not np.allclose(wave, design(ExcitationKind.random, seed=1).waveform(4))
    assert made.excitation.lead == 0
    assert made.window[0] == 0
    assert made.window.max() == pytest.approx(1)


def test_crest_of_a_multisine_is_low():
    wave = design(ExcitationKind.multisine).waveform()
    assert np.abs(wave).max() / wave.std() < 1.85
    wave = design(ExcitationKind.pseudo_random).waveform()
    assert np.abs(wave).max() / wave.std() > 2.5


def test_lines_that_are_left_out_are_silent():
    for choice, share in {LineChoice.odd: 1 / 2, LineChoice.sparse: 3 / 8}.items():
        made = design(ExcitationKind.multisine, lines=choice)
        phasors = made.spectra(made.waveform())
        excited = np.isin(made.read_lines, made.lines)
        assert np.abs(phasors[~excited]).max() < 1e-12
        assert (made.lines % 2 == 1).all()
        assert excited.mean() == pytest.approx(share, abs=0.02)
    assert (made.unexcited % 2 == 1).any()


def test_a_half_sine_reaches_the_highest_frequency():
    phasors = np.abs(np.fft.rfft(design(ExcitationKind.hammer, samples=8192).waveform()))
    hertz = np.fft.rfftfreq(8192, 1 / RATE)
    ratio = np.interp(1340, hertz, phasors) / phasors[0]
    assert ratio == pytest.approx(1 / 3, abs=0.06)  # a few samples a pulse


def test_damping_that_an_exponential_window_adds():
    made = design(ExcitationKind.hammer, decay=0.05)
    assert made.window[int(0.05 * RATE)] == pytest.approx(np.exp(-1))
    assert made.added_damping(200.0) == pytest.approx(1 / (0.05 * 2 * np.pi * 200))
    assert design(ExcitationKind.hammer).added_damping([1.0, 2.0]).tolist() == [0, 0]


REFUSED = {
    "no line": (Excitation(band=[51.0, 53.0]), "no line of a record of 0.2 s lies between"),
    "rate": (Excitation(band=[50.0, 2560.0]), "needs a rate above 5120 Hz"),
    "no odd line": (Excitation(band=[50.0, 50.0 + 1], lines=LineChoice.odd), "has no odd line"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bands_without_lines_are_refused(name):
    excitation, said = REFUSED[name]
    with pytest.raises(UserError, match=said):
        excitation.design(RATE, SAMPLES)


@pytest.mark.parametrize(
    ("tones", "said"),
    [
        ([], "needs its frequencies"),
        ([197.0], "197 Hz is no line of a record of 0.2 s; lines are 5 Hz apart"),
        ([200.0, 200.0], "must differ"),
        ([2560.0], "lie between 0 and 2560 Hz"),
    ],
)
def test_tones_that_are_no_lines_are_refused(tones, said):
    with pytest.raises(UserError, match=said):
        Excitation(ExcitationKind.sine).design(RATE, SAMPLES, tones)


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        ({"amplitude": 0.0}, "e.amplitude"),
        ({"band": [50.0]}, "e.band"),
        ({"band": [500.0, 50.0]}, "e.band"),
        ({"seed": -1}, "e.seed"),
        ({"burst": 1.0}, "e.burst"),
        ({"decay": 0.1}, "e.decay"),
        ({"kind": ExcitationKind.chirp, "lines": LineChoice.odd}, "e.lines"),
    ],
)
def test_settings_that_cannot_be_are_named(settings, field):
    checks = Checks()
    Excitation(**settings).check(checks, "e")
    assert [problem.field for problem in checks.problems] == [field]
