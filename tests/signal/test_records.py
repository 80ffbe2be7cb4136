"""Records of a structure of five modes: faults, findings, and bounds that hold the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.dataset import Severity
from sldvexp.errors import ConfigError, UserError
from sldvexp.signal import (
    Estimator,
    Excitation,
    ExcitationKind,
    Flag,
    LineChoice,
    RecordFault,
    Response,
    find_response_findings,
)
from sldvexp.signal.response_findings import coherence_at_resonance
from sldvexp.statistics import student_factor

RATE = 5120.0
PERIODIC = (ExcitationKind.multisine, ExcitationKind.chirp, ExcitationKind.pseudo_random)


def design(kind, seconds=0.2, **more):
    return Excitation(kind, **more).design(RATE, round(seconds * RATE))


def coverage(modes, made, pixels, records=10, seed=1, settings=None):
    """Relative bias at each peak, and how many bounds of 95 % hold the truth, by peak."""
    estimator = settings or Response()
    rng = np.random.default_rng(seed)
    found = estimator.response(modes.sums(estimator, made, records, rng, pixels), made)
    peaks = modes.peaks(found.frequency)
    true = modes.response(found.frequency[peaks])
    error = found.response[:, peaks] - true
    half = student_factor(0.95, found.dof)[:, None] * found.std[:, peaks]
    inside = np.stack([np.abs(error.real) < half, np.abs(error.imag) < half])
    return np.abs(error.mean(axis=0) / true), inside.mean(axis=(0, 1)), found


def within(share, count):
    """Largest deviation of a share of `count` draws that one test in 10,000 has by chance."""
    return 3.9 * np.sqrt(share * (1 - share) / count)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("kind", PERIODIC)
@pytest.mark.parametrize("pixels", [60, pytest.param(800, marks=pytest.mark.long)])
def test_periodic_excitation_has_no_bias_and_honest_bounds(five_modes, kind, pixels):
    bias, share, found = coverage(five_modes, design(kind), pixels)
    scatter = np.median(found.std / np.abs(five_modes.response(found.frequency)), axis=0)
    peaks = five_modes.peaks(found.frequency)
    assert (bias < 0.003 + 4 * scatter[peaks] / np.sqrt(pixels)).all()
    assert share.mean() == pytest.approx(0.95, abs=within(0.95, 2 * pixels * len(peaks)))
    assert find_response_findings_of(five_modes, design(kind)) == []


def find_response_findings_of(modes, made, pixels=20, records=10, seed=2):
    rng = np.random.default_rng(seed)
    return find_response_findings(modes.sums(Response(), made, records, rng, pixels), made, "left")


@pytest.mark.parametrize("pixels", [40, pytest.param(400, marks=pytest.mark.long)])
def test_leakage_of_random_excitation_is_said_with_lines_and_a_record_that_would_do(
    five_modes, pixels
):
    made = design(ExcitationKind.random)
    bias, share, _ = coverage(five_modes, made, pixels)
    assert bias[0] > 0.3
    assert share[0] < 0.8  # the bounds do not hold it
    (found,) = find_response_findings_of(five_modes, made, pixels)
    assert (found.kind, found.severity) == ("leakage", Severity.void)
    for line in ("195", "440", "545", "840", "1100"):
        assert line in found.text
    # Bias as it is, within the scatter of the mean of as many pixels.
    assert found.size == pytest.approx(bias[0], abs=4 * 0.16 / np.sqrt(pixels) + 0.03)
    # 1 % takes T = 1 / (zeta f_n sqrt(3 * 0.01)) = 2.93 s; that of now tells it to a quarter.
    seconds = float(found.text.split("take records of ")[1].split(" s")[0])
    assert seconds == pytest.approx(2.93, rel=0.25)


@pytest.mark.whole
def test_noise_is_no_part_of_what_leaks(five_modes):
    noisy, made = (
        replace(five_modes, noise=(3.0, 0.001)),
        design(ExcitationKind.random, seconds=0.8),
    )
    rng = np.random.default_rng(1)
    sums = noisy.sums(Response(), made, 10, rng, 60)
    peaks = noisy.peaks(made.frequency)
    lost = 1 - Response().response(sums, made).coherence[:, peaks[0]].mean()
    (found,) = find_response_findings(sums, made, "left")
    assert lost > 0.2
    assert found.size == pytest.approx(0.11, abs=0.04)
    assert found.severity is Severity.doubtful  # as much as one standard error


def test_records_as_long_as_was_said_leak_no_more(five_modes):
    made = design(ExcitationKind.random, seconds=3.2)
    assert find_response_findings_of(five_modes, made, pixels=5) == []


def test_noise_is_not_taken_for_leakage(five_modes):
    noisy = replace(five_modes, noise=(15.0, 0.001))
    made = design(ExcitationKind.random, seconds=3.2)
    rng = np.random.default_rng(1)
    sums = noisy.sums(Response(), made, 10, rng, 4)
    coherence = Response().response(sums, made).coherence
    assert np.median(coherence[:, noisy.peaks(made.frequency)]) < 0.9
    assert find_response_findings(sums, made, "left") == []


def test_coherence_tells_the_bias_of_a_window():
    """With the measured pairs of T zeta f and bias of single resonances."""
    products = np.array([3.15, 7.0])
    left = coherence_at_resonance(products, np.hanning(2000))
    np.testing.assert_allclose(1 - left, 1 / (3 * products**2), rtol=0.1)
    # A record of a burst's length without a window: (1 - exp(-a)) / a of the response is lost.
    rate = 2 * np.pi * 0.4
    rectangle = coherence_at_resonance(np.array([0.4]), np.ones(2000))[0]
    assert 1 - rectangle == pytest.approx((1 - np.exp(-rate)) / rate, abs=1e-3)


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("seconds", "noise", "kinds"),
    [
        (0.2, 0.05, [Severity.void]),  # 16 % at 197 Hz
        (0.2, 0.4, [Severity.void]),  # as much, and its end lies below the noise of the samples
        (0.8, 0.02, [Severity.doubtful]),  # 0.1 %, of a standard error of 0.1 %
        (0.8, 0.1, [Severity.note]),  # of one of 0.45 %
        (1.6, 0.05, []),
    ],
)
def test_tail_of_a_burst_that_is_cut_off_is_said(five_modes, seconds, noise, kinds):
    noisy = replace(five_modes, noise=(noise, 0.001))
    found = find_response_findings_of(noisy, design(ExcitationKind.burst_random, seconds))
    assert [one.severity for one in found] == kinds
    if seconds == 0.2:
        assert found[0].kind == "tail"
        # 6.9 / (zeta omega_n) = 0.56 s of the slowest mode after a burst of as much.
        wanted = float(found[0].text.split("take records of ")[1].split(" s")[0])
        assert wanted == pytest.approx(1.11, rel=0.4)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("kind", "amplitude"),
    [
        (ExcitationKind.burst_random, 1.0),
        (ExcitationKind.hammer, 2.0),
        (ExcitationKind.hammer, 50.0),
    ],
)
def test_error_that_a_tail_leaves_is_told(five_modes, kind, amplitude):
    made = design(kind, amplitude=amplitude)
    bias, _, _ = coverage(five_modes, made, pixels=30)
    (found,) = find_response_findings_of(five_modes, made, pixels=30)
    assert found.kind == "tail"
    assert bias[0] > 0.08
    assert 0.5 * bias[0] < found.size < 2 * bias[0]


def test_hammer_gives_the_response(five_modes):
    made = design(ExcitationKind.hammer, seconds=1.0, amplitude=100.0)
    bias, share, _ = coverage(five_modes, made, pixels=20)
    assert (bias < 0.003).all()
    assert share.mean() == pytest.approx(0.95, abs=within(0.95, 2 * 20 * 5))
    assert find_response_findings_of(five_modes, made) == []


def test_exponential_window_raises_the_damping_by_what_is_told(five_modes):
    made = design(ExcitationKind.hammer, seconds=1.0, amplitude=100.0, decay=0.1)
    quiet = replace(five_modes, noise=(0.0, 0.0))
    _, _, found = coverage(quiet, made, pixels=1)
    added = made.added_damping(197.0)
    peak = np.abs(found.response[0, quiet.peaks(found.frequency)[0]])
    expected = np.abs(quiet.response([197.0]))[0] * 0.01 / (0.01 + added)
    assert peak == pytest.approx(expected, rel=0.02)


def test_a_second_hit_and_a_missed_trigger_cost_their_record(five_modes):
    made = design(ExcitationKind.hammer, seconds=1.0, amplitude=10.0)
    records = five_modes.records(made, 4, np.random.default_rng(1), 3)
    records[1, 2, 1] += 0.3 * np.roll(made.waveform(), 400)
    records[2, 0, 1] = 1e-3
    sums = Response().sums(records, made)
    expected = np.zeros((3, len(RecordFault)), int)
    expected[1, list(RecordFault).index(RecordFault.double_hit)] = 1
    expected[2, list(RecordFault).index(RecordFault.reference_missing)] = 1
    np.testing.assert_array_equal(sums.left_out, expected)
    assert sums.count.tolist() == [4, 3, 3]


def spoil(records, rng):
    """Spoil a tenth of the records, each in one of four ways; also what the instrument says."""
    hit = rng.random(records.shape[:2]) < 0.1
    good = np.ones(hit.shape, bool)
    n = records.shape[-1]
    for k, (pixel, record) in enumerate(np.argwhere(hit)):
        velocity = records[pixel, record, 0]
        piece = slice(start := int(rng.integers(n // 2)), start + n // 4)
        match k % 4:
            case 0:
                velocity[piece] = rng.uniform(-50, 50, n // 4)  # the light is lost
            case 1:
                velocity[piece] = 1e3
            case 2:
                velocity[start] = np.nan
            case 3:
                good[pixel, record] = False
                velocity += 100.0
    return hit, good


def test_a_tenth_of_the_records_hit_costs_records_and_no_pixel(five_modes):
    pixels, made = 60, design(ExcitationKind.multisine)
    rng = np.random.default_rng(3)
    records = five_modes.records(made, 10, rng, pixels)
    hit, good = spoil(records, rng)
    estimator = Response()
    sums = estimator.sums(records, made, limits=(-1e3, 1e3), good=good)
    np.testing.assert_array_equal(sums.count, (~hit).sum(axis=1))
    image = estimator.image(sums, made)
    assert (image.flags != 0).mean() < 0.01
    found = estimator.response(sums, made)
    peaks = five_modes.peaks(found.frequency)
    error = found.response[:, peaks] - five_modes.response(found.frequency[peaks])
    half = student_factor(0.95, found.dof)[:, None] * found.std[:, peaks]
    share = np.mean([np.abs(error.real) < half, np.abs(error.imag) < half])
    assert share == pytest.approx(0.95, abs=within(0.95, 2 * pixels * len(peaks)))
    (said,) = find_response_findings(sums, made, "left")
    assert (said.kind, said.severity) == ("records", Severity.note)
    assert said.text.startswith(f"in view left {hit.sum()} of 600 records are left out (")


def test_a_pixel_without_two_records_is_flagged_for_its_fault(five_modes):
    made = design(ExcitationKind.multisine)
    records = five_modes.records(made, 3, np.random.default_rng(1), 3)
    records[0, :2, 0, 5] = np.inf
    records[1, 0, 0, 5] = np.inf
    image = Response().image(Response().sums(records, made), made)
    assert image.flags.tolist() == [Flag.non_finite, 0, 0]
    assert image.records.tolist() == [1, 2, 3]
    assert np.isnan(image.std[0]).all()


@pytest.mark.parametrize("noise", [0.05, 0.1])
def test_distortion_shows_on_lines_that_are_not_excited(five_modes, noise):
    odd = design(ExcitationKind.multisine, lines=LineChoice.sparse)
    noisy = replace(five_modes, noise=(noise, 0.001))
    assert find_response_findings_of(noisy, odd) == []
    (found,) = find_response_findings_of(replace(noisy, cubic=0.01), odd)
    assert found.kind == "distortion"
    assert " at odd ones" in found.text
    assert "even" not in found.text
    assert 0.001 < found.size < 0.1


def test_lines_without_energy_are_named(five_modes):
    made = design(ExcitationKind.pseudo_random)
    sums = five_modes.sums(Response(), made, 10, np.random.default_rng(1), 5)
    sums.sxx[:, :3] *= 1e-9
    (found,) = find_response_findings(sums, made, "left")
    assert "no energy at 50, 55, 60 Hz" in found.text


def test_velocity_is_the_response_to_the_nominal_amplitude(five_modes):
    made = design(ExcitationKind.multisine)
    estimator = Response(velocity_per_volt=0.01)
    sums = five_modes.sums(estimator, made, 10, np.random.default_rng(1), 5)
    image = estimator.image(sums, made)
    h = estimator.response(sums, made)
    np.testing.assert_allclose(image.velocity / image.reference_amplitude, h.response, rtol=1e-14)
    np.testing.assert_allclose(image.reference_amplitude, np.sqrt(2 / len(made.lines)), rtol=1e-9)
    assert image.reference_amplitude.shape == made.frequency.shape
    assert repr(image) == "5 complex pixels at 259 lines, 0 flagged"


def test_counts_are_read_as_volts(five_modes):
    made = design(ExcitationKind.multisine)
    volts = five_modes.records(made, 3, np.random.default_rng(1), 2)
    per_count = np.array([0.01, 1e-4])
    counts = np.rint(volts / per_count[:, None]).astype(np.int16)
    one = Response().sums(counts, made, volts_per_count=per_count)
    two = Response().sums(volts, made)
    np.testing.assert_allclose(one.sxy, two.sxy, atol=2e-3 * np.abs(two.sxy).max())


def test_records_of_another_length_are_refused():
    with pytest.raises(UserError, match=r"shape \(pixel, record, 2, 1024\)"):
        Response().sums(np.zeros((1, 2, 2, 1000)), design(ExcitationKind.multisine))


@pytest.mark.parametrize(
    "settings", [{"noise_ratio": 2.0}, {"noise_ratio": 0.0, "estimator": Estimator.hv}]
)
def test_noise_ratio_that_cannot_be_is_refused(settings):
    with pytest.raises(ConfigError, match="noise_ratio"):
        Response(**settings)
