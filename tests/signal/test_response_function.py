"""Response functions of sums over records, against other programs and against theory."""

from __future__ import annotations

import csv
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import scipy.signal

from sldvexp.errors import UserError
from sldvexp.signal import (
    Estimator,
    Excitation,
    ExcitationKind,
    Response,
    ResponseSums,
    response_function,
)

ORACLE = Path(__file__).parent / "oracle"
RATE, SAMPLES = 64.0, 64


@pytest.fixture(scope="module")
def stored():
    """Records of reference and response, shape (record, 2, sample)."""
    with (ORACLE / "records.csv").open() as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    return np.array(rows, float).reshape(-1, 2, SAMPLES)


def summed(stored, kind):
    design = Excitation(kind, band=[1.0, 31.0]).design(RATE, SAMPLES)
    sums = ResponseSums.zeros(1, design.frequency)
    sums.add(design.spectra(stored[None, :, 0]), design.spectra(stored[None, :, 1]))
    return sums


def test_all_estimators_and_the_coherence_are_those_of_pyfrf(stored):
    with (ORACLE / "pyfrf.csv").open() as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    frequency, *parts, coherence = np.array(rows, float).T
    sums = summed(stored, ExcitationKind.pseudo_random)
    np.testing.assert_allclose(sums.frequency, frequency, rtol=1e-14)
    for k, estimator in enumerate((Estimator.h1, Estimator.h2, Estimator.hv)):
        found = response_function(sums, estimator)
        expected = parts[2 * k] + 1j * parts[2 * k + 1]
        np.testing.assert_allclose(found.response[0], expected, rtol=1e-12)
        np.testing.assert_allclose(found.coherence[0], coherence, rtol=1e-12)


def test_hann_is_that_of_scipy(stored):
    found = response_function(summed(stored, ExcitationKind.random))
    x, y = (stored[:, channel].ravel() for channel in (0, 1))
    how = {"fs": RATE, "window": "hann", "nperseg": SAMPLES, "noverlap": 0}
    _, cross = scipy.signal.csd(x, y, **how)
    _, auto = scipy.signal.welch(x, **how)
    _, coherence = scipy.signal.coherence(x, y, **how)
    np.testing.assert_allclose(found.response[0], (cross / auto)[1:-1], rtol=1e-12)
    np.testing.assert_allclose(found.coherence[0], coherence[1:-1], rtol=1e-12)


def noisy(pixels, records, gnn, gmm, seed=1):
    """Sums of lines whose true response is 2 - 1i, with noise powers over Gxx = 1, |H|^2."""
    rng = np.random.default_rng(seed)
    draw = rng.standard_normal((3, pixels, records, 1, 2)) @ [1, 1j] / np.sqrt(2)
    x, n, m = draw
    sums = ResponseSums.zeros(pixels, [10.0])
    y = (2 - 1j) * (x + np.sqrt(gmm) * m)
    sums.add(x + np.sqrt(gnn) * n, y)
    return sums


@pytest.mark.parametrize("gnn", [0.0, 0.1])
@pytest.mark.parametrize("gmm", [0.0, 0.1])
def test_bias_of_each_estimator_is_that_of_theory(gnn, gmm):
    sums, pixels, records = noisy(4000, 50, gnn, gmm), 4000, 50
    expected = {Estimator.h1: 1 / (1 + gnn), Estimator.h2: 1 + gmm, Estimator.hv: 1.0}
    for estimator, factor in expected.items():
        if estimator is Estimator.hv and gnn * gmm == 0:
            continue
        # Of Hv the ratio of the noise powers is in units of y^2 / x^2, and |H|^2 is 5.
        found = response_function(sums, estimator, noise_ratio=5.0).response / (2 - 1j)
        scatter = np.std(found) / np.sqrt(pixels)
        # What is left of the order 1 / n in the ratio's mean, besides four standard errors.
        assert np.mean(found).real == pytest.approx(factor, abs=4 * scatter + 0.1 / records)
        assert np.mean(found).imag == pytest.approx(0, abs=4 * scatter)


def test_wrong_noise_ratio_leaves_a_bias_of_its_own():
    sums = noisy(4000, 50, 0.1, 0.1)
    found = np.mean(response_function(sums, Estimator.hv).response / (2 - 1j)).real
    assert 1.02 < found < 1.1  # nearer to H2 than to H1, with a ratio of 1 for 5


def test_extreme_noise_ratios_are_the_other_estimators():
    sums = noisy(20, 10, 0.1, 0.2)
    h1, h2 = (response_function(sums, e).response for e in (Estimator.h1, Estimator.h2))
    most = response_function(sums, Estimator.hv, noise_ratio=1e12).response
    least = response_function(sums, Estimator.hv, noise_ratio=1e-12).response
    np.testing.assert_allclose(most, h1, rtol=1e-9)
    np.testing.assert_allclose(least, h2, rtol=1e-9)


@pytest.mark.parametrize("estimator", Estimator)
def test_standard_errors_are_the_scatter_of_repetitions(estimator):
    pixels, records = 20000, 10
    sums = noisy(pixels, records, 0.0 if estimator is Estimator.h1 else 0.02, 0.02)
    found = response_function(sums, estimator, noise_ratio=5.0)
    scatter = np.mean([np.var(found.response.real), np.var(found.response.imag)])
    # A variance of as many parts is known to sqrt(2 / (2 pixels)); the errors' tails are a bit
    # longer than a normal's. With n for n - 1 the ratio would be 0.9.
    ratio = np.mean(found.std**2) / scatter
    assert ratio == pytest.approx(1, abs=5 * np.sqrt(1 / pixels))
    assert (found.dof == 2 * (records - 1)).all()


def test_coherence_is_biased_as_theory_says():
    pixels, records = 4000, 50
    coherence = response_function(noisy(pixels, records, 0.0, 1.0)).coherence
    true = 0.5
    scatter = np.std(coherence) / np.sqrt(pixels)
    assert np.mean(coherence) == pytest.approx(true + (1 - true) ** 2 / records, abs=4 * scatter)


def test_pieces_in_any_order_are_the_whole():
    rng = np.random.default_rng(4)
    x, y = rng.standard_normal((2, 7, 12, 3, 2)) @ [1, 1j]
    whole = ResponseSums.zeros(7, [1.0, 2.0, 3.0])
    whole.add(x, y)
    by_record = ResponseSums.zeros(7, [1.0, 2.0, 3.0])
    for part in np.split(np.arange(12), 4):
        by_record.add(x[:, part], y[:, part])
    by_pixel = ResponseSums.zeros(7, [1.0, 2.0, 3.0])
    by_pixel.add(x[4:], y[4:], pixels=slice(4, 7))
    by_pixel.add(x[:4], y[:4], pixels=slice(0, 4))
    first = ResponseSums.zeros(3, [1.0, 2.0, 3.0])
    first.add(x[:3], y[:3])
    rest = ResponseSums.zeros(4, [1.0, 2.0, 3.0])
    rest.add(x[3:, :5], y[3:, :5])
    more = ResponseSums.zeros(4, [1.0, 2.0, 3.0])
    more.add(x[3:, 5:], y[3:, 5:])
    kept = ResponseSums.from_arrays(rest.to_arrays())
    joined = ResponseSums.concatenated([first, kept.merged(more)])
    for sums in (by_record, by_pixel, joined):
        np.testing.assert_allclose(sums.sxy, whole.sxy, rtol=1e-13)
        np.testing.assert_allclose(sums.sxx, whole.sxx, rtol=1e-14)
        np.testing.assert_array_equal(sums.count, whole.count)


def test_sums_that_do_not_belong_together_are_refused():
    one, two = ResponseSums.zeros(2, [1.0]), ResponseSums.zeros(2, [2.0])
    with pytest.raises(UserError, match="different lines"):
        one.merged(two)
    with pytest.raises(UserError, match="different pixels"):
        one.merged(ResponseSums.zeros(3, [1.0]))
    with pytest.raises(UserError, match="do not belong to 2 pixels and 1 lines"):
        one.add(np.ones((2, 4, 3)), np.ones((2, 4, 3)))


@pytest.mark.parametrize("pixels", [100, pytest.param(2000, marks=pytest.mark.long)])
def test_memory_does_not_grow_with_the_records(pixels):
    """Sums of 2,000 pixels, 256 lines and 50 records take 16 MB, and with all work below 100 MB."""
    lines, records, at_once, step = 256, 50, 20, 5.0
    design = Excitation(band=[step, lines * step], kind=ExcitationKind.multisine).design(
        rate=3000.0, samples=600
    )
    assert len(design.lines) == lines
    estimator, rng = Response(), np.random.default_rng(1)
    wave = np.tile(design.waveform(records).reshape(records, 1, -1), (1, 2, 1))

    def counts(k):
        noise = np.random.default_rng(k).standard_normal((at_once, *wave.shape), np.float32)
        return np.rint(3000 * wave + 30 * noise).astype(np.int16)

    tracemalloc.start()
    parts = [
        estimator.sums(counts(k), design, volts_per_count=1e-3) for k in range(pixels // at_once)
    ]
    sums = ResponseSums.concatenated(parts)
    image = estimator.image(sums, design)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 100e6
    assert image.velocity.shape == (pixels, lines)
    assert sum(a.nbytes for a in sums.to_arrays().values()) < 33 * pixels * lines
    k = int(rng.integers(pixels // at_once))
    volts = counts(k)[3] * [[1e-5], [1e-3]]
    y, x = np.moveaxis(design.spectra(volts), 1, 0)
    np.testing.assert_allclose(sums.sxy[k * at_once + 3], (np.conj(x) * y).sum(axis=0), rtol=1e-12)
