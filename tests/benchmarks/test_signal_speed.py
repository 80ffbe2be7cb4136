"""Speed of the sine fit: 100,000 pixels x 2 channels x 512 samples of int16, with standard errors.

Run with ``pytest tests/benchmarks/test_signal_speed.py --benchmark-enable``; otherwise a small
image is checked for correctness only.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from sldvexp.signal import Intercept, demodulate, sine_model

FREQUENCY = 97.3
TIMES = np.arange(512) / 5120.0
ROUNDS = 15


@pytest.fixture(scope="module")
def samples(request):
    """Counts of shape (pixel, channel, sample): 200 MB, or 1 % of that without benchmarks."""
    pixels = 100_000 if request.config.getoption("--benchmark-enable") else 1000
    rng = np.random.default_rng(21)
    wave = np.exp(2j * np.pi * FREQUENCY * TIMES)
    counts = np.empty((pixels, 2, TIMES.size), np.int16)
    for first in range(0, pixels, 1000):
        start = np.exp(1j * rng.uniform(0, 2 * np.pi, (1000, 1)))
        velocity = rng.uniform(0, 20000, (1000, 1)) * (np.exp(0.5j) * start * wave).real
        clean = np.stack([velocity, 20000 * (start * wave).real], axis=1)
        noise = rng.standard_normal(clean.shape, dtype=np.float32) * np.float32(164)
        counts[first : first + 1000] = np.rint(clean + noise)
    return counts


def fast(samples):
    """Pixels, standard errors and flags."""
    image = demodulate(samples, sine_model(TIMES, [FREQUENCY]), intercept=Intercept.always)
    return image.velocity[:, 0], image.std[:, 0], image.flags


def one_by_one(samples):
    """The same by one call of lstsq a record."""
    angle = 2 * np.pi * FREQUENCY * TIMES
    design = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(TIMES)])
    factor = np.trace(np.linalg.inv(design.T @ design)[:2, :2]) / 2
    dof = TIMES.size - 3
    pixels = []
    for pair in samples:
        (v, v_sse), (r, r_sse) = (np.linalg.lstsq(design, record)[:2] for record in pair)
        reference = r[0] - 1j * r[1]
        pixel = (v[0] - 1j * v[1]) * np.conj(reference) / abs(reference)
        turned = abs(pixel / reference) ** 2 / 2 * r_sse[0]  # half: only across the pixel
        pixels.append((0.01 * pixel, 0.01 * np.sqrt((v_sse[0] + turned) * factor / dof)))
    return np.array(pixels).T


def seconds(work, *arguments):
    start = time.perf_counter()
    work(*arguments)
    return time.perf_counter() - start


def test_it_is_the_same_as_one_by_one(samples):
    velocity, std, flags = fast(samples[:200])
    slow_velocity, slow_std = one_by_one(samples[:200])
    np.testing.assert_allclose(velocity, slow_velocity, rtol=1e-10)
    # The loop takes both parts to be alike, which a record of 9.7 periods is to a percent.
    np.testing.assert_allclose(std, slow_std.real, rtol=0.01)
    assert not flags.any()


def test_demodulation(benchmark, samples):
    velocity, _, _ = benchmark(fast, samples)
    assert velocity.shape == (len(samples),)


def test_speed_against_a_plain_sum_and_a_loop(request, samples):
    """At most twice `samples.sum()`, at least 60 times faster than a loop over lstsq."""
    if not request.config.getoption("--benchmark-enable"):
        pytest.skip("timed only with --benchmark-enable")
    fast(samples)
    rounds = [(seconds(samples.sum), seconds(fast, samples)) for _ in range(ROUNDS)]
    plain, ours = np.min(rounds, axis=0)
    loop = seconds(one_by_one, samples[:2000]) * len(samples) / 2000
    print(f"\nsum {plain:.4f} s, sine fit {ours:.4f} s, loop {loop:.2f} s (extrapolated)")
    print(f"sine fit / sum {ours / plain:.2f}, loop / sine fit {loop / ours:.0f}")
    assert ours <= 2 * plain
    assert loop >= 60 * ours
