"""Harmonics that are fitted only while significant: level, power, and the bound that is left."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import stdtrit

from sldvexp.session.images import image_to_dataset
from sldvexp.signal import Intercept, SineFit, demodulate, sine_model

F = 97.3
TIMES = np.arange(128) / 1280.0  # 9.7 periods: a harmonic leaks into the fundamental
ALPHA = 0.05
TRIALS = 6_000
#: Standard errors of a share of trials that it may be off.
THREE = 3.0
SLACK = THREE * np.sqrt(ALPHA * (1 - ALPHA) / TRIALS)


def records(rng, times, harmonics=(), sigma=1.0, trials=TRIALS):
    """Velocity of 100 +- 1 with harmonics, reference of 300, each from a phase of its own."""
    start = rng.uniform(0, 2 * np.pi, (trials, 1))
    turn = 2 * np.pi * F * times + start
    velocity = 100 * np.cos(turn + 0.4)
    for h, size in enumerate(harmonics, start=2):
        velocity += size * np.cos(h * turn)
    clean = np.stack([velocity, 300 * np.cos(turn)], axis=1)
    return clean + sigma * rng.standard_normal(clean.shape)


def fitted(samples, times=TIMES, frequencies=(F,), **settings):
    settings = {"harmonics": 3, "incremental": True, "velocity_per_volt": 1.0, **settings}
    return SineFit(**settings).demodulate(samples, times, frequencies)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("intercept", list(Intercept))
@pytest.mark.parametrize("samples_per_record", [24, 128])
def test_a_harmonic_is_found_in_one_record_of_twenty_that_has_none(intercept, samples_per_record):
    rng = np.random.default_rng(31)
    times = np.sort(rng.uniform(0, 0.1, samples_per_record))
    image = fitted(records(rng, times), times, intercept=intercept)
    for fit in (image.velocity_fit, image.reference_fit):
        p_value = fit.harmonics.p_value
        assert np.all(np.abs(np.mean(p_value < ALPHA, axis=0) - ALPHA) < SLACK)
        assert np.all(np.abs(p_value.mean(axis=0) - 0.5) < THREE / np.sqrt(12 * TRIALS))
        assert abs(np.mean(fit.harmonics.used > 0) - ALPHA) < SLACK


def coverage(image, pixel, factor):
    """Shares of the bounds of both parts that hold the truth."""
    error = image.velocity[:, 0] - pixel
    parts = zip((error.real, error.imag), image.std_parts, strict=True)
    return [np.mean(np.abs(e) <= factor * std[:, 0]) for e, std in parts]


def test_a_second_harmonic_is_found_and_the_fundamental_has_its_bound():
    """A harmonic of 3 % is found in every record; left out it makes the bound far too wide."""
    rng = np.random.default_rng(32)
    samples, pixel = records(rng, TIMES, harmonics=[3.0]), 100 * np.exp(0.4j)
    image = fitted(samples)
    used = image.velocity_fit.harmonics.used
    assert used.min() >= 1
    assert abs(np.mean(used > 1) - ALPHA) < SLACK
    factor = stdtrit(image.velocity_fit.dof, 1 - ALPHA / 2)
    for covered in coverage(image, pixel, factor):
        assert abs(covered - (1 - ALPHA)) < SLACK
    blind = fitted(samples, harmonics=0, incremental=False)
    assert blind.velocity_fit.sample_variance.mean() > 1 + 0.9 * 3.0**2 / 2
    assert min(coverage(blind, pixel, factor)) > 1 - ALPHA + 3 * SLACK


def test_a_fundamental_without_harmonics_keeps_its_bound():
    rng = np.random.default_rng(33)
    image = fitted(records(rng, TIMES))
    factor = stdtrit(image.velocity_fit.dof, 1 - ALPHA / 2)
    for covered in coverage(image, 100 * np.exp(0.4j), factor):
        assert abs(covered - (1 - ALPHA)) < SLACK


@pytest.mark.parametrize("intercept", list(Intercept))
def test_each_pixel_is_as_if_fitted_with_its_harmonics(intercept):
    """Hum and two frequencies besides: the largest model's pass serves the smaller ones."""
    rng = np.random.default_rng(34)
    times = np.sort(rng.uniform(0, 0.1, 128))
    samples = records(rng, times, trials=300)
    samples[100:, 0] += np.cos(2 * np.pi * 2 * F * times) + 0.5
    samples[200:, 0] += np.cos(2 * np.pi * 3 * 211.0 * times)
    settings = {"hum": [50.0], "intercept": intercept, "velocity_per_volt": 1.0}
    image = SineFit(harmonics=2, incremental=True, **settings).demodulate(samples, times, [F, 211])
    fit = image.velocity_fit
    assert set(fit.harmonics.used) == {0, 1, 2}
    for h in range(3):
        mine = fit.harmonics.used == h
        alone = SineFit(harmonics=h, **settings).demodulate(samples[mine], times, [F, 211])
        for name in ("phasor", "sample_variance", "variance", "pseudo_variance", "f_intercept"):
            np.testing.assert_allclose(
                getattr(fit, name)[mine], getattr(alone.velocity_fit, name), rtol=1e-9
            )
        for name in ("intercept", "dof"):
            np.testing.assert_array_equal(
                getattr(fit, name)[mine], getattr(alone.velocity_fit, name)
            )


def test_the_first_harmonic_that_is_not_significant_ends_it():
    """Only 3 f is there: its test says so, and it is not fitted where 2 f is not significant."""
    rng = np.random.default_rng(35)
    image = fitted(records(rng, TIMES, harmonics=[0.0, 5.0], trials=1000))
    found = image.velocity_fit.harmonics
    assert np.all(found.p_value[:, 1] < 1e-6)
    np.testing.assert_array_equal(found.used == 0, found.p_value[:, 0] >= ALPHA)


def test_a_harmonic_that_is_wanted_is_fitted_and_not_tested():
    """As hum it is in both models; of two frequencies the other's harmonic alone is tested."""
    rng = np.random.default_rng(36)
    samples = records(rng, TIMES, harmonics=[0.0, 5.0], trials=50)
    model, without = (sine_model(TIMES, [F], count, [2 * F]) for count in (1, 0))
    found = demodulate(samples, model, simpler=[without]).velocity_fit.harmonics
    assert np.isnan(found.p_value).all()
    assert np.all(found.used == 1)
    of_two = fitted(samples, harmonics=2, frequencies=[F, 2 * F]).velocity_fit.harmonics
    assert np.isfinite(of_two.p_value[:, 0]).all()  # of 4 f
    assert np.all(of_two.p_value[:, 1] < 1e-6)  # of 3 f and 6 f


def test_records_without_anything_have_no_harmonics():
    rng = np.random.default_rng(37)
    samples = records(rng, TIMES, trials=4)
    samples[1, 0], samples[2, 0, 7] = 0.0, np.nan
    image = fitted(samples)
    np.testing.assert_array_equal(image.velocity_fit.harmonics.used[1:3], 0)
    assert image.flags[2]


def test_bits_of_a_pixel_do_not_depend_on_the_others():
    rng = np.random.default_rng(38)
    samples = records(rng, TIMES, harmonics=[0.3], trials=57)
    whole, alone = fitted(samples), fitted(samples[11:12])
    for name in ("velocity", "std"):
        np.testing.assert_array_equal(getattr(whole, name)[11:12], getattr(alone, name))


def test_the_image_keeps_how_many_there_are_and_each_test():
    rng = np.random.default_rng(39)
    samples = records(rng, TIMES, harmonics=[3.0], trials=30)
    dac = np.zeros((30, 2), int)
    group = image_to_dataset(fitted(samples), dac, np.radians(dac), [F])
    assert group["harmonic_p_value"].dims == ("pixel", "channel", "harmonic")
    assert list(group["harmonic"].values) == [2, 3, 4]
    assert np.all(group["harmonics"].sel(channel="velocity") >= 1)
    assert np.all(group["harmonic_p_value"].sel(channel="velocity", harmonic=2) < 1e-6)
    without = image_to_dataset(fitted(samples, incremental=False), dac, np.radians(dac), [F])
    assert "harmonics" not in without
    assert "harmonic" not in without.dims
