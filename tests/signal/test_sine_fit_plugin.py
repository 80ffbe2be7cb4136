"""`signal=sine_fit` as a configuration composes it: fields, refusals, the path to pixels."""

from __future__ import annotations

import numpy as np
import pytest
from omegaconf import OmegaConf

from sldvexp.errors import ConfigError, UserError
from sldvexp.signal import (
    Flag,
    FlagRules,
    Intercept,
    SineFit,
    demodulate,
    refine_frequencies,
    sine_model,
)
from tests.composing import part

TIMES = np.arange(256) / 2560.0
VOLT = 10.0 / 32768


def composed(*overrides):
    return OmegaConf.to_object(part("+signal=sine_fit", *overrides))["signal"]


def scan(frequency, pixels=100, offset=300.0):
    rng = np.random.default_rng(7)
    wave = np.exp(1j * (2 * np.pi * frequency * TIMES + rng.uniform(0, 6.3, (pixels, 1))))
    velocity = (np.linspace(0, 20000, pixels)[:, None] * np.exp(0.4j) * wave).real + offset
    clean = np.stack([velocity, 15000 * wave.real], axis=1)
    return np.rint(clean + 50 * rng.standard_normal(clean.shape)).astype(np.int16)


def test_the_file_has_the_defaults_of_the_class():
    assert composed() == SineFit()


def test_overrides_arrive():
    fit = composed(
        "signal.harmonics=2",
        "signal.hum=[50,150]",
        "signal.intercept=never",
        "signal.flags.poor_fit=1",
    )
    assert (fit.harmonics, fit.hum, fit.intercept) == (2, [50.0, 150.0], Intercept.never)
    assert fit.flags.poor_fit == 1.0


def test_a_scan_in_si():
    image = composed("signal.velocity_per_volt=-0.001").demodulate(
        scan(97.3), TIMES, [97.3], volts_per_count=VOLT
    )
    expected = -0.001 * VOLT * np.linspace(0, 20000, 100) * np.exp(0.4j)
    assert (np.abs(image.velocity[:, 0] - expected) < 6 * image.std[:, 0]).all()
    assert not image.flags.any()
    assert image.refined is None
    assert image.velocity_fit.intercept.all()


def test_every_setting_and_argument_counts():
    samples = scan(97.3)
    fit = SineFit(
        velocity_per_volt=0.5,
        harmonics=1,
        hum=[50.0],
        intercept=Intercept.test,
        confidence=0.6,
        flags=FlagRules(dropout_factor=1.02, reference_minimum=0.0, poor_fit=0.005),
        refine=True,
    )
    given = {
        "channel_axis": 0,
        "volts_per_count": [VOLT, 2 * VOLT],
        "limits": (-15050, 15050),
        "quality": np.arange(100) % 7 > 0,
    }
    image = fit.demodulate(np.moveaxis(samples, 1, 0), TIMES, [96.0], **given)
    good = ~(np.abs(samples) >= 15050).any(axis=(1, 2))
    assert 0 < good.sum() < 100
    refined = refine_frequencies(samples[good, 1], TIMES, [96.0], 1, [50.0])
    np.testing.assert_array_equal(image.refined.frequencies, refined.frequencies)
    direct = demodulate(
        np.moveaxis(samples, 1, 0),
        sine_model(TIMES, refined.frequencies, 1, [50.0]),
        velocity_per_volt=0.5,
        intercept=Intercept.test,
        confidence=0.6,
        rules=fit.flags,
        **given,
    )
    for name in ("velocity", "std", "flags"):
        np.testing.assert_array_equal(getattr(image, name), getattr(direct, name))
    np.testing.assert_array_equal(image.reference_fit.intercept, direct.reference_fit.intercept)
    assert set(np.unique(image.flags & Flag.dropped_out)) == {0, Flag.dropped_out}


def test_refinement_mends_a_wrong_frequency():
    samples = scan(97.3)
    samples[5, 1] = 32767
    wrong = SineFit().demodulate(samples, TIMES, [92.0], volts_per_count=VOLT)
    assert (np.delete(wrong.flags, 5) & Flag.poor_fit).all()
    mended = SineFit(refine=True, search=20.0).demodulate(
        samples, TIMES, [92.0], volts_per_count=VOLT
    )
    assert mended.flags[5] & Flag.saturated
    assert not np.delete(mended.flags, 5).any()
    assert abs(mended.refined.frequencies[0] - 97.3) < 5 * mended.refined.std[0] < 0.05
    np.testing.assert_array_equal(mended.frequencies, mended.refined.frequencies)


def test_refinement_needs_one_good_reference():
    samples = scan(97.3)
    samples[:, 1] = 32767
    with pytest.raises(UserError, match="no good reference record"):
        SineFit(refine=True).demodulate(samples, TIMES, [97.3])


@pytest.mark.parametrize(
    ("options", "field", "message"),
    [
        ({"velocity_per_volt": 0.0}, "velocity_per_volt", "must not be zero"),
        ({"velocity_per_volt": float("inf")}, "velocity_per_volt", "finite"),
        ({"harmonics": -1}, "harmonics", "zero or a positive"),
        ({"hum": [50.0, -1.0]}, "hum", "positive number, not -1"),
        ({"confidence": 1.0}, "confidence", "between 0 and 1"),
        ({"refine": True, "search": -2.0}, "search", "zero or a positive"),
        ({"search": 2.0}, "search", "no effect without refine"),
    ],
)
def test_refused_settings(options, field, message):
    with pytest.raises(ConfigError, match=message) as error:
        SineFit(**options)
    assert [p.field for p in error.value.problems] == [field]
