"""Bounds that are honest: the estimator's variance, its standard errors and its F-test."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.signal import Intercept, demodulate, refine_frequencies, sine_model

F = 97.3
TRIALS = 10_000
TIMES = np.arange(128) / 1280.0
UNEVEN = np.sort(np.random.default_rng(8).uniform(0, 0.1, 128))

#: Four standard deviations of what a mean of trials may be off.
FOUR = 4.0


def counts(rng, times, velocity, reference, sigma, offset=0.0, trials=TRIALS):
    """int16 samples (pixel, channel, sample) with a start phase of their own and white noise."""
    start = np.exp(1j * rng.uniform(0, 2 * np.pi, (trials, 1)))
    wave = start * np.exp(2j * np.pi * F * times)
    clean = np.stack([(velocity * wave).real + offset, (reference * wave).real], axis=1)
    noise = rng.standard_normal(clean.shape, dtype=np.float32) * np.array(sigma)[:, None]
    return np.rint(clean + noise).astype(np.int16)


def rounded(sigma):
    """Noise of a sample after rounding to whole counts."""
    return np.sqrt(sigma**2 + 1 / 12)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("times", [TIMES, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize(
    "intercept", [Intercept.always, pytest.param(Intercept.never, marks=pytest.mark.long)]
)
def test_variance_reaches_the_cramer_rao_bound(times, intercept):
    rng = np.random.default_rng(11)
    sigma = 164.0  # 0.5 % of full scale
    samples = counts(rng, times, 6000.0, 20000.0, (sigma, 1e-3))
    image = demodulate(samples, sine_model(times, [F]), velocity_per_volt=1, intercept=intercept)
    angle = 2 * np.pi * F * times
    design = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(times)])
    design = design if intercept is Intercept.always else design[:, :2]
    covariance = rounded(sigma) ** 2 * np.linalg.inv(design.T @ design)[:2, :2]
    ratio = np.mean(np.abs(image.velocity - 6000.0) ** 2) / np.trace(covariance)
    # Variance of |e|^2 for a normal e: twice the sum of the squared eigenvalues.
    spread = np.sqrt(2 * np.trace(covariance @ covariance) / TRIALS) / np.trace(covariance)
    assert abs(ratio - 1) < FOUR * spread
    assert ratio <= 1.02


@pytest.mark.whole
def test_variance_with_a_noisy_reference_reaches_the_joint_bound():
    """The reference's phase noise adds |V|^2 var(phase) across the pixel, and nothing along it."""
    rng = np.random.default_rng(12)
    sigma, reference, pixel = (50.0, 400.0), 8000.0, 6000.0 * np.exp(0.6j)
    samples = counts(rng, TIMES, pixel, reference, sigma)
    image = demodulate(
        samples, sine_model(TIMES, [F]), velocity_per_volt=1, intercept=Intercept.always
    )
    error = (image.velocity[:, 0] - pixel) * np.exp(-0.6j)
    along, across = np.mean(error.real**2), np.mean(error.imag**2)
    # The start phases are spread evenly, so both directions see the mean of both parts.
    factor = np.trace(_parts_covariance(TIMES)) / 2
    v, r = (factor * rounded(s) ** 2 for s in sigma)
    tolerance = FOUR * np.sqrt(2 / TRIALS)
    assert abs(along / v - 1) < tolerance
    assert abs(across / (v + (6000.0 / reference) ** 2 * r) - 1) < tolerance
    real, imag = np.mean(error_parts(image.velocity[:, 0] - pixel), axis=1)
    stated = [np.mean(s**2) for s in image.std_parts]
    np.testing.assert_allclose([real, imag], stated, rtol=tolerance)
    np.testing.assert_allclose(np.mean(image.std**2), (real + imag) / 2, rtol=tolerance)


def test_standard_errors_of_each_part_of_a_short_record():
    """Little more than one period from a fixed start: the parts differ, in both channels."""
    rng = np.random.default_rng(20)
    times, pixel = np.arange(32) / 2560.0, 6000.0 * np.exp(0.3j)
    wave = np.exp(2j * np.pi * F * times + 1.1j)
    clean = np.stack([(pixel * wave).real, 9000.0 * wave.real])
    samples = clean + rng.standard_normal((TRIALS, 2, 32)) * np.array([30.0, 90.0])[:, None]
    image = demodulate(
        samples, sine_model(times, [F]), velocity_per_volt=1, intercept=Intercept.always
    )
    found = np.mean(error_parts(image.velocity[:, 0] - pixel), axis=1)
    stated = [np.mean(s**2) for s in image.std_parts]
    assert max(found) > 2 * min(found)
    np.testing.assert_allclose(found, stated, rtol=FOUR * np.sqrt(2 / TRIALS))


def error_parts(error):
    """Squared errors of the real and of the imaginary part, shape (2, pixel)."""
    return np.stack([error.real**2, error.imag**2])


def _parts_covariance(times):
    angle = 2 * np.pi * F * times
    design = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(times)])
    return np.linalg.inv(design.T @ design)[:2, :2]


@pytest.mark.one_in(3)
@pytest.mark.parametrize("intercept", list(Intercept))
@pytest.mark.parametrize("samples_per_record", [8, 128])
def test_standard_errors_cover(intercept, samples_per_record):
    """Student's t with the fit's own degrees of freedom covers 95 %, for both parts."""
    from scipy.special import stdtrit

    rng = np.random.default_rng(13)
    times = np.sort(rng.uniform(0, 0.1, samples_per_record))
    pixel = 500.0 * np.exp(2.1j)
    samples = counts(rng, times, pixel, 20000.0, (164.0, 1e-3))
    image = demodulate(samples, sine_model(times, [F]), velocity_per_volt=1, intercept=intercept)
    t = stdtrit(image.velocity_fit.dof, 0.975)
    error = image.velocity[:, 0] - pixel
    std = image.std_parts
    parts = (error.real, error.imag)
    inside = [np.mean(np.abs(e) <= t * s[:, 0]) for e, s in zip(parts, std, strict=True)]
    slack = FOUR * np.sqrt(0.95 * 0.05 / TRIALS)
    # A decision made by the data costs some coverage where the records are very short.
    cost = 0.01 if intercept is Intercept.test and samples_per_record == 8 else 0.0
    assert min(inside) > 0.95 - slack - cost
    assert max(inside) < 0.95 + slack


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    "confidence", [0.95, *(pytest.param(c, marks=pytest.mark.long) for c in (0.9, 0.99))]
)
@pytest.mark.parametrize("samples_per_record", [6, 128])
def test_size_of_the_intercepts_f_test(confidence, samples_per_record):
    """Without an offset the intercept is kept in 1 - confidence of the pixels."""
    rng = np.random.default_rng(14)
    times = np.sort(rng.uniform(0, 0.1, samples_per_record))
    samples = counts(rng, times, 6000.0, 20000.0, (164.0, 164.0))
    image = demodulate(samples, sine_model(times, [F]), confidence=confidence)
    alpha = 1 - confidence
    for fit in (image.velocity_fit, image.reference_fit):
        assert abs(fit.intercept.mean() - alpha) < FOUR * np.sqrt(alpha * confidence / TRIALS)
        np.testing.assert_array_equal(fit.intercept_test(confidence).reject, fit.intercept)
        p = fit.intercept_test(confidence).p_value
        assert abs(p.mean() - 0.5) < FOUR / np.sqrt(12 * TRIALS)


@pytest.mark.whole
def test_power_of_the_intercepts_f_test():
    """An offset of five of its standard errors is kept nearly always, and unbiases the pixel."""
    rng = np.random.default_rng(15)
    offset = 5.0 * 164.0 / np.sqrt(128)
    samples = counts(rng, TIMES, 6000.0, 20000.0, (164.0, 1e-3), offset)
    image = demodulate(samples, sine_model(TIMES, [F]), velocity_per_volt=1)
    # Normal approximation: P(|z + 5| > 1.98) = 0.9987.
    assert image.velocity_fit.intercept.mean() > 0.998


def test_frequency_reaches_its_bound_and_says_so():
    """Pooled over records of any phase: variance, standard error and a wrong start."""
    rng = np.random.default_rng(16)
    repeats, records, sigma, amplitude = 60, 20, 500.0, 6000.0
    samples = counts(rng, TIMES, amplitude, amplitude, (sigma, sigma), 30.0, repeats * records)
    found = [
        refine_frequencies(r, TIMES, [F + 3.0]) for r in samples[:, 0].reshape(repeats, records, -1)
    ]
    estimates = np.array([f.frequencies[0] for f in found])
    stated = np.array([f.std[0] for f in found])
    # The known bound of one sine of unknown amplitude, phase and frequency, over the records. It
    # neglects terms of one over the number of periods.
    n, rate = len(TIMES), 1280.0
    snr = records * amplitude**2 / (2 * rounded(sigma) ** 2)
    bound = 12 * rate**2 / ((2 * np.pi) ** 2 * snr * n * (n**2 - 1))
    tolerance = FOUR * np.sqrt(2 / repeats)
    assert abs(estimates.mean() - F) < FOUR * np.sqrt(bound / repeats)
    assert abs(estimates.var() / bound - 1) < tolerance + 0.01
    np.testing.assert_allclose(np.mean(stated**2), bound, rtol=0.02)


def test_two_frequencies_with_harmonics_and_hum_are_refined_together():
    rng = np.random.default_rng(17)
    times = np.sort(rng.uniform(0, 0.5, 700))
    phase = np.exp(1j * rng.uniform(0, 6.3, (30, 5, 1)))
    waves = {61.37: 1.0, 143.21: 0.5, 122.74: 0.2, 50.0: 0.3, 286.42: 0.1}
    clean = sum(
        (a * phase[:, k] * np.exp(2j * np.pi * f * times)).real
        for k, (f, a) in enumerate(waves.items())
    )
    noisy = clean + 0.02 * rng.standard_normal(clean.shape)
    found = refine_frequencies(noisy, times, [60.0, 145.0], 1, [50.0], search=5.0)
    assert np.all(np.abs(found.frequencies - [61.37, 143.21]) < FOUR * found.std)
    assert np.all(found.std < 1e-3)
    exact = refine_frequencies(clean, times, [61.5, 143.0], 1, [50.0])
    np.testing.assert_allclose(exact.frequencies, [61.37, 143.21], rtol=1e-9)


def test_a_wrong_frequency_costs_amplitude_but_not_phase():
    rng = np.random.default_rng(18)
    pixel = 6000.0 * np.exp(0.9j)
    samples = counts(rng, TIMES, pixel, 20000.0, (1.0, 1.0), trials=500)
    off = demodulate(samples, sine_model(TIMES, [F + 2.0]), velocity_per_volt=1)
    assert np.abs(np.angle(off.velocity) - 0.9).max() < 0.02
    assert np.abs(off.velocity).max() < 0.98 * 6000.0


@pytest.mark.parametrize(
    ("start", "search", "message"),
    [
        (300.0, 50.0, r"no clear frequency within 60\.\d+ Hz of 300 Hz"),
        (120.0, 15.0, "no clear frequency within 15 Hz of 120 Hz"),
        *((F + off, 0.0, "no clear frequency within 10.08 Hz") for off in (8, 12, 20, 45)),
    ],
)
def test_a_frequency_that_is_not_there(start, search, message):
    rng = np.random.default_rng(19)
    samples = counts(rng, TIMES, 6000.0, 20000.0, (30.0, 30.0), trials=50)
    with pytest.raises(UserError, match=message):
        refine_frequencies(samples[:, 1], TIMES, [start], search=search)


def test_no_record_to_refine_from():
    with pytest.raises(UserError, match="no good reference record"):
        refine_frequencies(np.zeros((0, 128)), TIMES, [F])
