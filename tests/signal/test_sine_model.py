"""The sine fit against signals that are known exactly: recovery, conventions, refused records."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.signal import Intercept, demodulate, sine_model

TIMES = np.arange(512) / 5120.0
UNEVEN = np.sort(np.random.default_rng(3).uniform(0, 0.1, 512))


def record(times, frequency, phasor, offset=0.0):
    """Real part of ``phasor exp(+i w t)``, shape (pixel, sample)."""
    wave = np.exp(2j * np.pi * frequency * times)
    return (np.atleast_1d(phasor)[:, None] * wave).real + offset


def both(velocity, reference):
    """Samples of shape (pixel, channel, sample)."""
    return np.stack([velocity, reference], axis=1)


def test_a_lead_is_a_positive_phase():
    # cos(wt + 0.7) against a reference cos(wt): exp(+i w t) makes the phase +0.7, not -0.7.
    velocity = 2.0 * np.cos(2 * np.pi * 97.0 * TIMES + 0.7)[None]
    reference = np.cos(2 * np.pi * 97.0 * TIMES)[None]
    image = demodulate(both(velocity, reference), sine_model(TIMES, [97.0]))
    np.testing.assert_allclose(image.velocity, [[0.02 * np.exp(0.7j)]], rtol=1e-12)


def test_the_dissertation_stores_the_conjugate():
    # V = A cos + B sin; Eq 3.9 makes it A + i B, exp(+i w t) makes it A - i B.
    angle = 2 * np.pi * 97.0 * TIMES
    v = 3.0 * np.cos(angle) + 4.0 * np.sin(angle)
    image = demodulate(both(v[None], np.cos(angle)[None]), sine_model(TIMES, [97.0]))
    np.testing.assert_allclose(image.uncorrected, [[0.03 - 0.04j]], rtol=1e-12)


@settings(max_examples=50, deadline=None)
@given(
    phase=st.floats(-3.1, 3.1),
    starts=st.lists(st.floats(0, 6.3), min_size=2, max_size=6),
    amplitude=st.floats(1e-3, 1e3),
    offset=st.floats(-5, 5),
    times=st.sampled_from([TIMES, UNEVEN, TIMES + 7.0]),
)
def test_the_start_of_a_record_does_not_matter(phase, starts, amplitude, offset, times):
    start = np.exp(1j * np.array(starts))
    velocity = record(times, 97.3, amplitude * np.exp(1j * phase) * start, offset)
    reference = record(times, 97.3, 1.5 * start, -offset)
    # Without noise the F-test would drop an offset below what double precision resolves.
    image = demodulate(
        both(velocity, reference),
        sine_model(times, [97.3]),
        velocity_per_volt=1.0,
        intercept=Intercept.always,
    )
    # Where zero of time lies at 7 s, an angle of 4300 rad rounds at 5e-13.
    error = np.abs(image.velocity - amplitude * np.exp(1j * phase))
    assert error.max() <= 1e-11 * (amplitude + abs(offset))


def test_scale_sign_and_volts_of_each_channel():
    counts = both(record(TIMES, 97.0, [3000.0]), record(TIMES, 97.0, [20000.0]))
    image = demodulate(
        counts,
        sine_model(TIMES, [97.0]),
        volts_per_count=[1e-3, 5e-4],
        velocity_per_volt=-0.01,
    )
    np.testing.assert_allclose(image.velocity, [[-0.03]], rtol=1e-12)
    np.testing.assert_allclose(np.abs(image.reference_fit.phasor), [[10.0]], rtol=1e-12)


@pytest.mark.parametrize("times", [TIMES, UNEVEN], ids=["even", "uneven"])
def test_several_frequencies_harmonics_and_hum_at_once(times):
    wanted = {97.0: 1.0 + 2.0j, 233.0: -0.5 + 0.1j}
    others = {194.0: 0.7, 291.0: -0.2j, 466.0: 0.3 + 0.1j, 699.0: 0.05, 50.0: 1.5j, 150.0: -0.4}
    velocity = sum(record(times, f, z) for f, z in {**wanted, **others}.items()) + 0.3
    reference = sum(record(times, f, 1j) for f in wanted)
    model = sine_model(times, list(wanted), harmonics=2, hum=[50.0, 150.0])
    np.testing.assert_allclose(sorted(model.nuisance), sorted(others))
    image = demodulate(both(velocity, reference), model, velocity_per_volt=1.0)
    np.testing.assert_allclose(image.velocity[0] * 1j, list(wanted.values()), rtol=1e-10)


def test_a_harmonic_that_is_wanted_is_not_fitted_twice():
    model = sine_model(TIMES, [97.0, 194.0], harmonics=1, hum=[97.0])
    np.testing.assert_allclose(model.nuisance, [388.0])


def test_what_is_left_out_disturbs():
    """The counterpart: without its column, hum leaks into a record of no whole period."""
    velocity = record(TIMES, 97.0, 1.0) + record(TIMES, 50.0, 1.0)
    samples = both(velocity, record(TIMES, 97.0, 1.0))
    off = [
        abs(demodulate(samples, sine_model(TIMES, [97.0], hum=h)).velocity[0, 0] - 0.01)
        for h in ([], [50.0])
    ]
    assert off[0] > 1e-4
    assert off[1] < 1e-13


def test_columns_are_orthonormal_and_span_the_sines():
    model = sine_model(UNEVEN, [97.0, 211.0], harmonics=1, hum=[50.0])
    np.testing.assert_allclose(model.columns.T @ model.columns, np.eye(11), atol=1e-13)
    sines = record(UNEVEN, 211.0, [1.0, 1j])
    np.testing.assert_allclose((sines @ model.columns) @ model.columns.T, sines, atol=1e-12)


def test_with_and_without_the_intercept_against_lstsq():
    rng = np.random.default_rng(5)
    t = TIMES[:61]
    v = record(t, 97.0, [1.0 + 0.5j]) + 0.4 + 0.1 * rng.standard_normal((1, 61))
    r = record(t, 97.0, [1.0])
    angle = 2 * np.pi * 97.0 * t
    full = np.column_stack([np.cos(angle), np.sin(angle), np.ones(61)])
    for intercept, design in ((Intercept.always, full), (Intercept.never, full[:, :2])):
        image = demodulate(
            both(v, r), sine_model(t, [97.0]), velocity_per_volt=1.0, intercept=intercept
        )
        (a, b, *_), sse, *_ = np.linalg.lstsq(design, v[0])
        fit = image.velocity_fit
        np.testing.assert_allclose(fit.phasor[0, 0], a - 1j * b, rtol=1e-12)
        s2 = sse[0] / (61 - design.shape[1])
        covariance = s2 * np.linalg.inv(design.T @ design)
        np.testing.assert_allclose(fit.noise[0] ** 2, s2, rtol=1e-11)
        np.testing.assert_allclose(fit.dof[0], 61 - design.shape[1])
        parts = fit.variance[0, 0] + np.array([1, -1]) * fit.pseudo_variance[0, 0].real
        np.testing.assert_allclose(parts / 2, np.diag(covariance)[:2], rtol=1e-10)
        # cov(A, -B) is half the imaginary part of E e^2.
        np.testing.assert_allclose(
            fit.pseudo_variance[0, 0].imag / 2, -covariance[0, 1], rtol=1e-10
        )


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("channel_axis", [0, 1])
def test_layouts_and_types_give_the_same_numbers(dtype, channel_axis):
    rng = np.random.default_rng(1)
    counts = rng.integers(20000, 30000, (70, 2, 512))
    samples = counts.astype(dtype)
    if channel_axis == 0:
        samples = np.ascontiguousarray(np.moveaxis(samples, 1, 0))
    image = demodulate(samples, sine_model(TIMES, [97.0]), channel_axis=channel_axis)
    fit = demodulate(counts, sine_model(TIMES, [97.0]), limits=(0, 65535)).velocity_fit
    np.testing.assert_allclose(image.velocity_fit.phasor, fit.phasor, rtol=1e-12)


def test_a_pixel_does_not_depend_on_its_neighbours():
    """To the bit: a scan that was resumed line by line gives the image of one that was not."""
    rng = np.random.default_rng(2)
    samples = rng.integers(-9999, 9999, (1501, 2, 512)).astype(np.int16)
    model = sine_model(TIMES, [97.0, 211.0])
    whole = demodulate(samples, model)
    for threads, size in ((1, 1501), (2, 700), (3, 44), (1, 1)):
        parts = range(0, 1501 if size > 1 else 20, size)
        pieces = [demodulate(samples[i : i + size], model, threads=threads) for i in parts]
        for name in ("velocity", "variance", "pseudo_variance", "std"):
            joined = np.concatenate([getattr(p, name) for p in pieces])
            np.testing.assert_array_equal(joined, getattr(whole, name)[: len(joined)])


@pytest.mark.parametrize("ratio", [1e1, 1e3, 1e5])
def test_noise_far_below_the_signal_is_still_right(ratio):
    """SSE = |V|^2 - |Q^T V|^2 cancels; what is left is compared with explicit residuals."""
    rng = np.random.default_rng(4)
    v = record(TIMES, 97.0, np.exp(1j * rng.uniform(0, 6, 50))) * ratio + 0.3 * ratio
    v += rng.standard_normal(v.shape)
    model = sine_model(TIMES, [97.0])
    fit = demodulate(both(v, v), model, velocity_per_volt=1.0, intercept=Intercept.always)
    residual = v - (v @ model.columns) @ model.columns.T
    expected = np.sqrt((residual**2).sum(axis=1) / model.dof)
    # |V|^2 rounds at a few 1e-16 of itself, which is ratio^2 of the noise.
    np.testing.assert_allclose(fit.velocity_fit.noise, expected, rtol=1e-13 + 1e-15 * ratio**2)


@pytest.mark.parametrize(
    ("times", "arguments", "message"),
    [
        (TIMES[::-1], ([97.0],), "one increasing row"),
        (np.append(TIMES, np.nan), ([97.0],), "one increasing row"),
        (TIMES, ([0.0],), "positive number of Hz, not 0"),
        (TIMES, ([],), "positive number of Hz, not none"),
        (TIMES, ([97.0], 0, [-50.0]), "positive number of Hz, not -50"),
        (TIMES[:7], ([97.0], 2), "7 samples cannot determine 7 coeff.*at least 8 samples"),
        (TIMES, ([2600.0],), "2600 Hz cannot be sampled at 5120 Hz; sample above 5200 Hz"),
        (TIMES, ([97.0, 97.1],), "over 0.0998 s cannot tell 97 Hz from 97.1 Hz"),
        (TIMES, ([50.1], 0, [50.0]), "cannot tell 50.1 Hz from 50 Hz"),
        (TIMES, ([0.4],), "cannot tell 0.4 Hz from the offset"),
        (TIMES, ([2500.0], 1, [120.0]), "cannot tell 5000 Hz from 120 Hz"),
    ],
)
def test_refused_models(times, arguments, message):
    with pytest.raises(UserError, match=message):
        sine_model(times, *arguments)


@pytest.mark.parametrize(
    ("samples", "channel_axis", "message"),
    [
        (np.zeros((5, 512)), 1, r"shape \(pixel, channel, sample\)"),
        (np.zeros((5, 3, 512)), 1, r"two channels velocity and reference, not \(5, 3, 512\)"),
        (np.zeros((5, 2, 512)), 0, r"shape \(channel, pixel, sample\)"),
        (np.zeros((5, 2, 512), complex), 1, "real numbers.*not complex128"),
        (np.zeros((5, 2, 500)), 1, "each record has 500 samples, but 512 sample times"),
    ],
)
def test_refused_samples(samples, channel_axis, message):
    with pytest.raises(UserError, match=message):
        demodulate(samples, sine_model(TIMES, [97.0]), channel_axis=channel_axis)
