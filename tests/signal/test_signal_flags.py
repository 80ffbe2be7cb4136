"""Every flag is raised by its own fault, by nothing else, and the pixel keeps its value."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.signal import (
    Flag,
    FlagRules,
    SineFit,
    demodulate,
    instrument_fault,
    sine_model,
)

F = 97.3
TIMES = np.arange(256) / 2560.0
VOLT = 10.0 / 32768
SICK = 17


def scan(seed=1, pixels=200, dtype=np.int16):
    """Healthy samples: amplitudes from a node to 8 V, noise of 0.5 % of full scale."""
    rng = np.random.default_rng(seed)
    amplitude = np.linspace(0, 26000, pixels)[rng.permutation(pixels), None]
    wave = np.exp(1j * (2 * np.pi * F * TIMES + rng.uniform(0, 6.3, (pixels, 1))))
    clean = np.stack([amplitude * wave.real, 10000 * wave.real], axis=1)
    noise = rng.standard_normal(clean.shape) * np.array([164.0, 5.0])[:, None]
    return np.rint(clean + noise).astype(dtype)


def look(samples, **options):
    return demodulate(samples, sine_model(TIMES, [F]), volts_per_count=VOLT, **options)


def assert_only_sick(image, flag):
    expected = np.zeros(len(image.flags), int)
    expected[SICK] = flag
    np.testing.assert_array_equal(image.flags, expected)


@pytest.mark.parametrize("pixels", [4_000, pytest.param(20_000, marks=pytest.mark.whole)])
def test_a_healthy_scan_has_no_flags_nodes_included(pixels):
    assert not look(scan(pixels=pixels)).flags.any()


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("dtype", [np.int16, float])
def test_a_scan_without_noise_has_no_flags(seed, dtype):
    rng = np.random.default_rng(seed)
    wave = np.exp(1j * (2 * np.pi * F * TIMES + rng.uniform(0, 6.3, (100, 1))))
    clean = np.stack([np.linspace(0, 9000, 100)[:, None] * wave.real, 9000 * wave.real], axis=1)
    assert not look(np.rint(clean).astype(dtype) if dtype is np.int16 else clean).flags.any()


@pytest.mark.parametrize("channel", [0, 1])
@pytest.mark.parametrize("limit", [-32768, 32767])
def test_saturated_at_the_limits_of_the_type(channel, limit):
    samples = scan()
    samples[SICK, channel, 3] = limit
    flags = look(samples).flags
    assert flags[SICK] & Flag.saturated
    assert not np.delete(flags, SICK).any()


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(("channel", "limit"), [(0, 20000), (1, 10005)])
def test_saturated_at_the_limits_of_each_channel(channel, limit, side):
    samples = scan(dtype=float)
    limits = np.array([(-32768, 32767), (-32768, 32767)])
    limits[channel, side] = (-limit, limit)[side]
    samples[:, channel] = np.clip(samples[:, channel], *limits[channel])
    assert not (look(samples).flags & Flag.saturated).any()
    clipped = (samples[:, channel] == limits[channel, side]).any(axis=1)
    assert 0 < clipped.sum() < 200
    saturated = look(samples, limits=limits).flags & Flag.saturated
    np.testing.assert_array_equal(saturated > 0, clipped)


def test_a_missing_sample_does_not_hide_a_saturated_neighbour():
    samples = scan(dtype=float)
    samples[3, 0, 0] = np.nan
    samples[SICK, 0, 0] = 40000.0
    flags = look(samples, limits=(-32768, 32767)).flags
    assert flags[3] == Flag.non_finite
    assert flags[SICK] & Flag.saturated


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("channel", [0, 1])
def test_non_finite(bad, channel):
    samples = scan(dtype=float)
    samples[SICK, channel, 100] = bad
    image = look(samples)
    assert image.flags[SICK] == Flag.non_finite
    assert_only_sick(image, Flag.non_finite)
    assert not np.isfinite(image.velocity[SICK, 0])
    assert np.isfinite(np.delete(image.velocity, SICK, axis=0)).all()


def test_dropped_out_by_a_burst_of_noise():
    samples = scan()
    burst = np.random.default_rng(5).integers(-9000, 9000, 60)
    samples[SICK, 0, 50:110] = burst
    image = look(samples)
    assert_only_sick(image, Flag.dropped_out)
    assert np.isfinite(image.velocity).all()
    assert image.std[SICK] > 5 * np.median(image.std)


@pytest.mark.parametrize("level", [0, 1234])
def test_dropped_out_by_a_dead_channel(level):
    samples = scan()
    samples[SICK, 0] = level
    assert_only_sick(look(samples), Flag.dropped_out)


def test_a_missing_sample_does_not_hide_a_dead_channel():
    samples = scan(dtype=float)
    samples[3, 0, 0] = np.nan
    samples[SICK, 0] = 0.0
    flags = look(samples).flags
    assert (flags[3], flags[SICK]) == (Flag.non_finite, Flag.dropped_out)


def test_dropped_out_by_the_instruments_word():
    quality = np.ones(200, bool)
    quality[SICK] = False
    assert_only_sick(look(scan(), quality=quality), Flag.dropped_out)
    with pytest.raises(UserError, match=r"quality has the shape \(3,\), but there are 200 pixels"):
        look(scan(), quality=[True] * 3)


def test_spoilt_pixels_do_not_move_the_median():
    """Most of the image saturates; the few good pixels still judge each other."""
    samples = scan()
    sick = np.arange(200) < 150
    samples[sick, 0] = np.where(samples[sick, 0] > 0, 32767, -32768)
    flags = look(samples).flags
    assert (flags[sick] & Flag.saturated).all()
    assert not flags[~sick].any()


@pytest.mark.parametrize("channels", [[0], [1], [0, 1]], ids=str)
@pytest.mark.parametrize("clip", [30, 1e9], ids=["clipped", "at one limit"])
def test_samples_at_full_scale_are_called_saturated_whatever_else_they_are(channels, clip):
    """Neither the missing sine nor the one that is cut is what is wrong with the instrument."""
    samples = scan().astype(float)
    for channel in channels:
        samples[:, channel] = samples[:, channel] * clip if clip < 1e9 else clip
    image = look(np.clip(samples, -32768, 32767).astype(np.int16))
    assert instrument_fault(image).startswith(
        f"{(image.flags & Flag.saturated != 0).sum()} of 200 pixels are saturated"
    )


def test_reference_missing():
    samples = scan()
    samples[SICK, 1] = np.random.default_rng(6).integers(-3, 4, 256)
    image = look(samples)
    assert image.flags[SICK] & Flag.reference_missing
    assert not np.delete(image.flags, SICK).any()
    # Its amplitude is right, its phase is not, and the standard error says so.
    good = look(scan())
    np.testing.assert_allclose(np.abs(image.velocity[SICK]), np.abs(good.velocity[SICK]))
    assert image.std[SICK] > 0.1 * np.abs(image.velocity[SICK])


@pytest.mark.parametrize("idle", [0.0, 164.0])
def test_generator_off(idle):
    samples = scan()
    noise = np.random.default_rng(9).standard_normal((200, 256))
    samples[:, 1] = np.rint(idle * noise)
    image = look(samples)
    assert (image.flags == Flag.reference_missing).all()
    assert np.isfinite(image.velocity).all()
    if not idle:
        assert (image.std >= np.abs(image.velocity) * np.sqrt(np.pi**2 / 6)).all()


def test_a_small_but_clean_reference_is_below_the_minimum():
    samples = scan()
    samples[SICK, 1] = samples[SICK, 1] // 50  # 60 mV
    assert look(samples).flags[SICK] & Flag.reference_missing
    rules = FlagRules(reference_minimum=0.01)
    assert not look(samples, rules=rules).flags[SICK] & Flag.reference_missing


def test_a_reference_in_its_noise_is_missing():
    samples = scan()
    sine = samples[SICK, 1] // 20  # 500 counts, 0.15 V, with a standard error of 440 counts
    samples[SICK, 1] = sine + np.rint(5000 * np.random.default_rng(2).standard_normal(256))
    assert look(samples).flags[SICK] == Flag.reference_missing | Flag.poor_fit
    rules = FlagRules(reference_snr=0.0)
    assert look(samples, rules=rules).flags[SICK] == Flag.poor_fit


def test_reference_missing_at_one_of_two_frequencies():
    image = demodulate(scan(), sine_model(TIMES, [F, 211.0]), volts_per_count=VOLT)
    assert (image.flags == Flag.reference_missing).all()


def test_poor_fit_of_a_reference_that_is_no_sine():
    samples = scan()
    samples[SICK, 1] = 10000 * np.sign(samples[SICK, 1])  # a square wave
    assert_only_sick(look(samples), Flag.poor_fit)


def test_poor_fit_everywhere_at_a_wrong_frequency():
    wrong = demodulate(scan(), sine_model(TIMES, [F + 6.0]), volts_per_count=VOLT)
    assert (wrong.flags & Flag.poor_fit).all()


def test_several_flags_at_once():
    samples = scan()
    samples[SICK, 0] = np.where(samples[SICK, 0] > 0, 32767, -32768)
    samples[SICK, 1] = 0
    flags = Flag(int(look(samples).flags[SICK]))
    assert flags == Flag.saturated | Flag.dropped_out | Flag.reference_missing


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"dropout_factor": 1.0}, "flags.dropout_factor"),
        ({"reference_minimum": -1.0}, "flags.reference_minimum"),
        ({"reference_snr": float("nan")}, "flags.reference_snr"),
        ({"poor_fit": 0.0}, "flags.poor_fit"),
    ],
)
def test_refused_thresholds(options, field):
    with pytest.raises(ConfigError) as error:
        SineFit(flags=FlagRules(**options))
    assert [p.field for p in error.value.problems] == [field]


def test_many_lines_without_a_reference_are_named_in_part():
    line, rng = np.arange(100.0, 1400.0, 100.0), np.random.default_rng(3)
    samples = 1e-3 * rng.standard_normal((50, 2, 256))
    told = instrument_fault(demodulate(samples, sine_model(np.arange(256) / 2560.0, line[:12])))
    assert told.startswith("the reference channel has no signal of 100, 200, 300 Hz and 9 others (")
