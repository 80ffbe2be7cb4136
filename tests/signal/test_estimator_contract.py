"""Promises of `SignalEstimator`, for every estimator that is registered."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.config import registry
from sldvexp.errors import UserError
from sldvexp.signal import Flag, SignalEstimator

TIMES = np.arange(512) / 5120.0
FREQUENCY = 200.0
VOLT = 10.0 / 32768


@pytest.fixture(params=registry.names("signal"))
def estimator(request):
    made = registry.get("signal", request.param)()
    assert isinstance(made, SignalEstimator)
    return made


def samples(noise, pixels=400):
    """Counts of known sines: the velocity leads the reference by 0.4 rad."""
    rng = np.random.default_rng(3)
    wave = np.exp(1j * (2 * np.pi * FREQUENCY * TIMES + rng.uniform(0, 6.3, (pixels, 1))))
    amplitude = np.linspace(2000, 20000, pixels)
    clean = np.stack([(amplitude[:, None] * np.exp(0.4j) * wave).real, 15000 * wave.real], axis=1)
    counts = np.rint(clean + noise * rng.standard_normal(clean.shape)).astype(np.int16)
    return counts, amplitude * VOLT * np.exp(0.4j)


def test_amplitude_and_phase(estimator):
    counts, volts = samples(noise=100)
    image = estimator.demodulate(counts, TIMES, [FREQUENCY], volts_per_count=VOLT)
    truth = estimator.velocity_per_volt * volts
    error = np.concatenate(
        [(image.velocity[:, 0] - truth).real, (image.velocity[:, 0] - truth).imag]
    )
    std = np.tile(image.std[:, 0], 2)
    # Its mean square is one within four standard errors, each error within five.
    assert np.mean((error / std) ** 2) == pytest.approx(1, abs=4 * np.sqrt(2 / len(error)))
    assert np.abs(error / std).max() < 5
    assert not image.flags.any()


def test_either_order_of_the_axes(estimator):
    counts, _ = samples(noise=100, pixels=20)
    one = estimator.demodulate(counts, TIMES, [FREQUENCY])
    two = estimator.demodulate(counts.swapaxes(0, 1), TIMES, [FREQUENCY], channel_axis=0)
    np.testing.assert_array_equal(one.velocity, two.velocity)


def test_pixels_that_cannot_be_trusted_are_flagged_and_kept(estimator):
    counts, _ = samples(noise=100, pixels=40)
    counts[3, 0, 10:20] = np.iinfo(np.int16).max
    quality = np.ones(40, bool)
    quality[5] = False
    image = estimator.demodulate(counts, TIMES, [FREQUENCY], quality=quality)
    assert image.velocity.shape == (40, 1)
    assert np.isfinite(image.velocity).all()
    assert image.flags[3] & Flag.saturated
    assert image.flags[5]
    assert np.flatnonzero(image.flags).tolist() == [3, 5]


def test_bits_of_a_pixel_are_its_own(estimator):
    counts, _ = samples(noise=100, pixels=30)
    whole = estimator.demodulate(counts, TIMES, [FREQUENCY])
    alone = estimator.demodulate(counts[7:8], TIMES, [FREQUENCY])
    np.testing.assert_array_equal(whole.velocity[7], alone.velocity[0])


@pytest.mark.parametrize("wrong", [np.zeros((4, 3, 512)), np.zeros((4, 2, 100))])
def test_samples_that_do_not_fit_are_refused(estimator, wrong):
    with pytest.raises(UserError):
        estimator.demodulate(wrong, TIMES, [FREQUENCY])
