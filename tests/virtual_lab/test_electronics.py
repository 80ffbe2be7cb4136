"""Noise, drop-outs, converter, tones: what the electronics make of a velocity."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from sldvexp.instrument import Acquisition, Status
from sldvexp.virtual_lab.ahead import Stretch, drawn
from sldvexp.virtual_lab.electronics import PixelNoise

PIXELS = 400
SAMPLES = 512
SIGMA = 5.0  # one false alarm in two million

NOISE = "scene.vibrometer.noise=0.005"


def at_rest(n=PIXELS):
    """Pixels far beside every object."""
    return np.full((n, 2), 3000)


def volts(samples):
    return samples.counts * samples.volts_per_count[:, None]


def resting(lab, rate=10000.0, excitation=()):
    lab.configure(Acquisition(rate, SAMPLES, excitation))
    return volts(lab.scan(at_rest()))


def test_noise_level_is_half_a_percent_of_full_scale(quiet):
    v = resting(quiet("calibration", NOISE, "scene.digitizer.reference_noise=0.01"))
    relative = SIGMA / np.sqrt(2 * PIXELS * SAMPLES)
    assert v[:, 0].std() == pytest.approx(0.005 * 0.1 * 100, rel=relative)
    assert v[:, 1].std() == pytest.approx(0.01, rel=relative)
    error_of_mean = 0.05 / np.sqrt(PIXELS * SAMPLES)
    assert abs(v[:, 0].mean()) < SIGMA * error_of_mean


@pytest.mark.one_in(2)
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_scene_has_a_factor_of_all_noise(quiet, factor):
    settings = (NOISE, "scene.digitizer.reference_noise=0.05")
    once = resting(quiet("calibration", *settings))
    more = resting(quiet("calibration", *settings, f"scene.noise={factor}"))
    np.testing.assert_allclose(more.std(axis=(0, 2)), factor * once.std(axis=(0, 2)), rtol=1e-4)


def test_noise_is_normal_white_and_independent(quiet):
    v = resting(quiet("calibration", NOISE, "scene.digitizer.reference_noise=0.05"))
    n = PIXELS * SAMPLES
    assert abs(stats.skew(v[:, 0].ravel())) < SIGMA * np.sqrt(6 / n)
    assert abs(stats.kurtosis(v[:, 0].ravel())) < SIGMA * np.sqrt(24 / n)
    assert abs(np.corrcoef(v[:, 0].ravel(), v[:, 1].ravel())[0, 1]) < SIGMA / np.sqrt(n)
    between_pixels = np.corrcoef(v[1:, 0].ravel(), v[:-1, 0].ravel())[0, 1]
    assert abs(between_pixels) < SIGMA / np.sqrt(n)
    power = (np.abs(np.fft.rfft(v[:, 0])) ** 2).mean(axis=0)[1:-1] / (SAMPLES * 0.05**2)
    bounds = stats.chi2.ppf(stats.norm.cdf([-SIGMA, SIGMA]), 2 * PIXELS) / (2 * PIXELS)
    assert ((power > bounds[0]) & (power < bounds[1])).all()


def test_noise_ends_at_the_bandwidth_if_sampling_can_show_it(quiet):
    v = resting(quiet("calibration", NOISE), rate=100000.0)[:, 0]
    kept = 205  # lines of 512 samples up to 20 kHz
    assert v.std() == pytest.approx(0.05, rel=SIGMA / np.sqrt(2 * PIXELS * kept))
    power = (np.abs(np.fft.rfft(v)) ** 2).mean(axis=0) / SAMPLES
    frequency = np.fft.rfftfreq(SAMPLES, 1e-5)
    count = 10 / 2**15
    assert power[frequency > 20000].max() < 2 * count**2 / 12
    passband = power[1:][frequency[1:] <= 20000]
    expected = 0.05**2 * SAMPLES / kept
    np.testing.assert_allclose(passband, expected, rtol=SIGMA / np.sqrt(PIXELS))


def test_the_converter_saturates_and_says_so(quiet):
    lab = quiet("calibration", "scene.digitizer.velocity_range=0.5")
    hole = np.rint(lab.true_dac(lab.calibration_object.center[0])).astype(int)
    s = lab.scan(np.stack([hole, [3000, 3000]]))
    assert s.counts[0, 0].min() == -(2**15)
    assert s.counts[0, 0].max() == 2**15 - 1
    assert (np.abs(s.counts[0, 0].astype(int)) >= 2**15 - 1).mean() > 0.3
    assert s.status.tolist() == [Status.over_range, Status.good]
    np.testing.assert_allclose(s.volts_per_count, [0.5 / 2**15, 5 / 2**15])


def test_a_count_is_rounded_not_cut(quiet):
    """At rest with noise of 0.3 counts the mean count is 0, not -1/2."""
    lab = quiet("calibration", "scene.digitizer.reference_noise=5e-5")
    lab.configure(Acquisition(10000.0, SAMPLES, ()))
    counts = lab.scan(at_rest()).counts[:, 1]
    assert set(np.unique(counts)) == {-1, 0, 1}
    assert abs(counts.mean()) < SIGMA * 0.4 / np.sqrt(counts.size)


def hole_pixels(lab, n):
    """The same pixel in the middle of circle 1, n times, and its speaker's n . D."""
    truth = lab.calibration_object
    hole = np.rint(lab.true_dac(truth.center[0])).astype(int)
    away = lab.true_pose("1")[1] - truth.center[0]
    return np.tile(hole, (n, 1)), away[2] / np.linalg.norm(away)


@pytest.mark.parametrize("amplitude", [0.5, 2.0])
def test_phase_is_that_of_exp_plus_iwt_relative_to_the_reference(quiet, phasors, amplitude):
    """A speaker at cos(wt + 0.7) towards the instrument has the phasor exp(+0.7i)."""
    lab = quiet("calibration", "scene.speaker={velocity: 0.01, phase: 0.7}")
    lab.configure(Acquisition(10000.0, SAMPLES, (450.0, 1230.0), amplitude))
    pixels, cosine = hole_pixels(lab, 50)
    found = phasors(lab.scan(pixels), 450.0, 1230.0)
    np.testing.assert_allclose(np.abs(found[:, 1]), amplitude, rtol=1e-4)
    velocity = found[:, 0] / found[:, 1]
    np.testing.assert_allclose(velocity, 100 * 0.01 * cosine * np.exp(0.7j), rtol=5e-4)


def test_every_pixel_starts_at_an_arbitrary_phase(quiet, phasors):
    lab = quiet("calibration")
    phase = np.angle(phasors(lab.scan(at_rest()), 450.0)[:, 1])
    assert stats.kstest(phase, stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 1e-4


def test_harmonics_hum_and_what_the_generator_really_plays(quiet, phasors):
    lab = quiet(
        "calibration",
        "scene.vibrometer.harmonics=[0.1, 0.05]",
        "scene.vibrometer.hum=0.03",
        "scene.speaker.phase=0.4",
        "scene.generator_error=0.01",
    )
    f = 450 * 1.01
    pixels, cosine = hole_pixels(lab, 20)
    found = phasors(lab.scan(pixels), f, 2 * f, 3 * f, 50.0)
    velocity, turn = found[:, 0], found[:, 1, 0]
    for n, part in ((1, 1.0), (2, 0.1), (3, 0.05)):
        expected = part * cosine * np.exp(0.4j * n)
        np.testing.assert_allclose(velocity[:, n - 1] / turn**n, expected, rtol=5e-3)
    np.testing.assert_allclose(np.abs(velocity[:, 3]), 0.03, rtol=5e-3)
    assert np.abs(found[:, 1, 1:]).max() < 1e-4  # the reference has none of it


def test_with_the_generator_off_nothing_moves(quiet):
    lab = quiet("plate", "scene.residual=0.001")
    pixels = [lab.calibration_object.center[0], lab.plate.center, [0, 0, 0]]
    dac = np.rint(lab.true_dac(pixels)).astype(int)
    assert (np.abs(lab.scan(dac).counts).max(axis=2) > 100).all()
    lab.configure(Acquisition(10000.0, SAMPLES, ()))
    assert (lab.scan(dac).counts == 0).all()


def test_what_should_rest_may_move_a_little(quiet, phasors):
    lab = quiet("calibration", "scene.residual=0.002")
    edge = lab.calibration_object.edge(1, np.array([0.0]))
    rim = edge + np.array([0.004, 0, 0])
    pixels = np.rint(lab.true_dac(np.concatenate([rim, [[0.0, 0.0, 0.0]]]))).astype(int)
    found = phasors(lab.scan(pixels), 450.0)
    assert (found[:, 0] / found[:, 1]).real == pytest.approx(0.17, abs=0.005)


def test_drop_outs(quiet):
    lab = quiet("calibration", "scene.vibrometer.drop_out=0.3")
    lab.configure(Acquisition(10000.0, SAMPLES, ()))
    s = lab.scan(at_rest(2000))
    lost = s.status == Status.dropped_out
    assert abs(lost.sum() - 600) < SIGMA * np.sqrt(2000 * 0.3 * 0.7)
    noisy = volts(s)[:, 0] != 0
    assert not noisy[~lost].any()
    length = noisy.sum(axis=1)[lost] / SAMPLES  # between two uniform numbers: a third on average
    assert abs(length.mean() - 1 / 3) < SIGMA * np.sqrt(1 / 18 / 600) + 1 / SAMPLES
    first, last = noisy[lost].argmax(axis=1), SAMPLES - noisy[lost][:, ::-1].argmax(axis=1)
    assert (last - first - noisy[lost].sum(axis=1) <= 2).all()  # one burst each
    level = volts(s)[:, 0][lost][noisy[lost]].std()
    assert level == pytest.approx(0.2 * 0.1 * 100, rel=SIGMA / np.sqrt(2 * 100 * SAMPLES))


def test_drop_outs_that_the_instrument_does_not_report(quiet):
    settings = ["scene.vibrometer.drop_out=1", "scene.vibrometer.drop_out_reported=false"]
    s = quiet("calibration", *settings).scan(at_rest(50))
    assert (s.status == Status.good).all()
    assert (s.counts[:, 0] != 0).any(axis=1).all()


@pytest.mark.parametrize("how", ["no backdrop", "shutter"])
def test_without_light_there_is_only_noise(quiet, how):
    lab = quiet("calibration", f"scene.backdrop={how == 'shutter'}")
    lab.shutter_open = how != "shutter"
    hole = np.rint(lab.true_dac(lab.calibration_object.center[0])).astype(int)
    s = lab.scan(np.stack([[3000, 3000], hole]))
    dark = [True, how == "shutter"]
    assert (s.status == Status.dropped_out).tolist() == dark
    level = volts(s)[:, 0].std(axis=1)
    assert level[0] == pytest.approx(2.0, rel=SIGMA / np.sqrt(2 * SAMPLES))
    assert (level[1] > 1.5) == dark[1]


def test_random_numbers_use_all_their_levels():
    uniform, normal = PixelNoise([3], "1").draw(5, 0, 2000, 64)
    assert stats.kstest(uniform.ravel(), "uniform").pvalue > 1e-4
    assert stats.kstest(normal.ravel()[::7], "norm").pvalue > 1e-4
    assert normal.max() == pytest.approx(4.33, abs=0.35)
    assert normal.min() == pytest.approx(-4.33, abs=0.35)


def test_pixels_of_several_lines_are_drawn_as_each_line_alone():
    noise, stretches = PixelNoise([3], "1"), [Stretch(5, 0, 7), Stretch(6, 2, 1), Stretch(9, 0, 4)]
    each = [noise.draw(*stretch, 64) for stretch in stretches]
    for together, alone in zip(drawn(noise, stretches, 64), zip(*each, strict=True), strict=True):
        np.testing.assert_array_equal(together, np.concatenate(alone))
