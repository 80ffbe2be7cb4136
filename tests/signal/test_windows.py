"""Overlapping stretches, force windows and hum: what they are worth, and what is said of them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from sldvexp.dataset import Severity
from sldvexp.errors import Checks, ConfigError
from sldvexp.scan import Sampling
from sldvexp.signal import (
    Excitation,
    ExcitationKind,
    LineChoice,
    Response,
    ResponseSums,
    find_response_findings,
    response_function,
)
from sldvexp.signal.response_sums import OVERLAPPED
from sldvexp.statistics import student_factor

RATE, SAMPLES = 64.0, 64
PLAIN = Response(velocity_per_volt=1.0)


def design(overlap, samples=SAMPLES):
    played = Excitation(ExcitationKind.random, band=[4.0, 28.0], overlap=overlap)
    return played.design(RATE, samples)


def records(pixels, count, seed, noise=0.3):
    """Records of white noise without a gap, of a structure that does nothing; noise in it."""
    rng = np.random.default_rng(seed)
    x, m = rng.standard_normal((2, pixels, count * SAMPLES))
    both = np.stack([x + noise * m, x], axis=1)
    return np.moveaxis(both.reshape(pixels, 2, count, SAMPLES), 1, 2)


def test_overlapping_stretches_are_those_of_scipy():
    made, seen = design(overlap=True), records(1, 9, 1)
    sums = PLAIN.sums(seen, made)
    assert (sums.count.tolist(), sums.between.tolist()) == ([9], [8])
    y, x = np.moveaxis(seen[0], 1, 0).reshape(2, -1)
    how = {"fs": RATE, "window": "hann", "nperseg": SAMPLES, "noverlap": SAMPLES // 2}
    frequency, cross = scipy.signal.csd(x, y, **how)
    _, auto = scipy.signal.welch(x, **how)
    at = np.isin(frequency, sums.frequency)
    np.testing.assert_allclose(response_function(sums).response[0], (cross / auto)[at], rtol=1e-10)


def test_what_overlapping_stretches_are_worth_follows_from_the_window():
    window = design(overlap=True).window
    half = len(window) // 2
    shared = (window[half:] * window[:half]).sum() / (window**2).sum()
    assert pytest.approx(shared**2, rel=1e-3) == OVERLAPPED
    sums = PLAIN.sums(records(2, 10, 2), design(overlap=True))
    assert sums.averages == pytest.approx(19**2 / (19 + 36 * shared**2), rel=1e-4)
    assert PLAIN.sums(records(2, 10, 2), design(overlap=False)).averages.tolist() == [10, 10]


@pytest.mark.parametrize("pixels", [300, pytest.param(4000, marks=pytest.mark.long)])
def test_bounds_of_overlapping_stretches_are_the_scatter_of_repetitions(pixels):
    seen = records(pixels, 10, 3)
    error, spread, dof = {}, {}, {}
    for overlap in (False, True):
        made = design(overlap)
        found = response_function(PLAIN.sums(seen, made))
        inner = slice(1, -1)  # whose neighbours' power is the same
        error[overlap] = (found.response - 1)[:, inner]
        spread[overlap] = found.std[:, inner]
        half = student_factor(0.95, found.dof)[:, None] * spread[overlap]
        inside = np.stack([np.abs(error[overlap].real) < half, np.abs(error[overlap].imag) < half])
        # Neighbouring lines share part of their noise: as if there were half as many.
        chance = np.sqrt(0.95 * 0.05 / (inside.size / 2))
        assert inside.mean() == pytest.approx(0.95, abs=4 * chance)
        dof[overlap] = found.dof[0]
    told = np.sqrt(np.mean(spread[True] ** 2) / np.mean(spread[False] ** 2))
    true = np.sqrt(np.mean(np.abs(error[True]) ** 2) / np.mean(np.abs(error[False]) ** 2))
    assert told == pytest.approx(true, rel=4 / np.sqrt(error[True].size / 2))
    assert told == pytest.approx(np.sqrt(dof[False] / dof[True]), rel=0.03)
    assert told < 0.75  # what is gained


def test_a_spoilt_record_costs_the_stretches_that_it_is_part_of():
    seen = records(1, 6, 4)
    good = np.ones((1, 6), bool)
    good[0, 2] = False
    sums = PLAIN.sums(seen, design(overlap=True), good=good)
    assert (sums.count.tolist(), sums.between.tolist()) == ([5], [3])
    parts = [PLAIN.sums(seen[:, span], design(overlap=True)) for span in np.split(np.arange(6), 2)]
    both = parts[0].merged(parts[1])
    assert (both.count.tolist(), both.between.tolist()) == ([6], [4])
    old = {k: v for k, v in both.to_arrays().items() if k != "between"}
    assert ResponseSums.from_arrays(old).averages.tolist() == [6]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"overlap": True, "excitation": ExcitationKind.chirp}, "overlap: is of random"),
        ({"force": 0.1, "excitation": ExcitationKind.random}, "force: is the window of a hammer"),
        ({"force": 1e-4, "excitation": ExcitationKind.hammer}, "force: must hold the pulse"),
    ],
)
def test_windows_of_other_excitations_are_refused(settings, said):
    checks = Checks()
    Sampling(rate=5120.0, samples=1024, **settings).check(checks, "scan.sampling")
    with pytest.raises(ConfigError, match=said):
        checks.done()


def hits(force, noise=0.01, pixels=100, count=10):
    """Response functions of a hammer on one mode, its channel noisy; and the truth."""
    made = Excitation(ExcitationKind.hammer, [20.0, 400.0], 1.0, force=force).design(2048.0, 2048)
    rng = np.random.default_rng(5)
    blow = made.waveform()
    lines = np.fft.rfftfreq(2048, 1 / 2048.0)
    r = lines / 100.0
    true = 2j * 0.05 * r / (1 - r**2 + 2j * 0.05 * r)
    seen = np.fft.irfft(true * np.fft.rfft(blow), 2048)
    both = np.broadcast_to(np.stack([seen, blow]), (pixels, count, 2, 2048)).copy()
    both[:, :, 1] += noise * rng.standard_normal((pixels, count, 2048))
    found = response_function(PLAIN.sums(both, made))
    return found, true[made.lines]


def test_a_force_window_keeps_the_pulse_and_leaves_the_noise_behind_it_out():
    without, true = hits(0.0)
    held, _ = hits(0.02)
    peak = int(np.argmin(abs(without.frequency - 100)))
    bias = [np.abs(found.response.mean(axis=0) / true - 1)[peak] for found in (without, held)]
    clean, _ = hits(0.02, noise=0.0, pixels=1)
    # The pulse is whole in the window: nothing changes without noise.
    assert np.abs(clean.response[0] / true - 1).max() < 1e-3
    scatter = [found.response[:, peak].std() / abs(true[peak]) for found in (without, held)]
    # White noise in a window of 0.02 s and half of .02 s before the pulse, of a record of 1 s.
    assert scatter[1] < 0.3 * scatter[0]
    assert bias[1] < 0.2 * bias[0] + 4 * scatter[1] / np.sqrt(100)


def humming(lines, size, hertz=50.0, seed=6, pixels=30, kind=ExcitationKind.multisine):
    """Findings of records whose velocity hums with two harmonics, in any phase."""
    choice = {} if kind is not ExcitationKind.multisine else {"lines": lines}
    made = Excitation(kind, [20.0, 460.0], **choice).design(1280.0, 256)
    rng = np.random.default_rng(seed)
    seen = np.tile(made.waveform(), (pixels, 10, 2, 1)).reshape(pixels, 10, 2, 256)
    seen = seen + 0.05 * rng.standard_normal(seen.shape)
    time = rng.uniform(0, 1, (pixels, 10, 1)) + np.arange(256) / 1280.0
    for order, share in ((1, 1.0), (3, 0.5)):
        seen[:, :, 0] += size * share * np.cos(2 * np.pi * order * hertz * time)
    return find_response_findings(PLAIN.sums(seen, made), made, "left")


@pytest.mark.parametrize("hertz", [50.0, 60.0])
@pytest.mark.parametrize("lines", list(LineChoice))
def test_hum_is_named_by_its_mains_on_lines_that_are_excited_or_not(lines, hertz):
    (found,) = humming(lines, 0.1, hertz)
    assert (found.kind, found.severity) == ("hum", Severity.note)
    assert f"mains of {hertz:g} Hz hum at {hertz:g}, {3 * hertz:g} Hz" in found.text
    # Of unexcited lines no result is made; both frequencies are even multiples of 5 Hz.
    at = "" if lines is not LineChoice.every else f"{hertz:g},{3 * hertz:g}"
    assert found.remedy == (f"modal.leave_out=[{at}]" if at else "")


def test_without_hum_none_is_said_nor_where_other_lines_hum():
    for seed in range(20):
        for lines in LineChoice:
            assert humming(lines, 0.0, seed=seed, pixels=3) == []
    assert [f.kind for f in humming(LineChoice.every, 0.1, hertz=45.0)] == []
