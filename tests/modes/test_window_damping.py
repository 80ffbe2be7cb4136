"""Damping that a hammer's exponential window adds is taken off the poles again."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import DAMPING, FREQUENCY, LINE, identified, image, plate_shapes, responses

from sldvexp import modes
from sldvexp.errors import UserError
from sldvexp.session.images import response_to_dataset
from sldvexp.signal import Excitation, ExcitationKind, Response

#: Time constant of the window, s.
DECAY = 0.2


def windowed(shape, noise, rng=None, frequency=FREQUENCY, damping=DAMPING, decay=DECAY):
    """Make an image of modes whose impulse responses decay by the window besides."""
    omega = 2 * np.pi * np.asarray(frequency)
    rate, damped = damping * omega, omega * np.sqrt(1 - damping**2)
    natural = np.hypot(rate + 1 / decay, damped)
    peak = shape * rate / (rate + 1 / decay)  # the residue stays, the resonance is lower
    seen = responses(LINE, natural / (2 * np.pi), (rate + 1 / decay) / natural, peak)
    return image(LINE, seen, noise, rng).assign_attrs(window_decay=decay)


def test_poles_and_shapes_are_those_without_the_window():
    shape = plate_shapes(60, 5)
    found = identified(windowed(shape, 1e-12))
    assert found.modes["natural_frequency"].values == pytest.approx(FREQUENCY, rel=1e-8)
    assert found.modes["damping_ratio"].values == pytest.approx(DAMPING, rel=1e-6)
    seen = found.images["view0"]["velocity"].values
    assert np.abs(seen - shape).max() < 1e-5 * np.abs(shape).max()


@pytest.mark.whole
def test_bounds_are_those_of_the_damping_that_is_left():
    """Half of the lowest mode's damping is the window's, so that its relative error is larger."""
    shape, errors, scales = plate_shapes(100, 5), [], []
    for seed in range(8):
        found = identified(windowed(shape, 2e-5, np.random.default_rng(seed)))
        modes = found.modes
        errors += [*(modes["natural_frequency"] - FREQUENCY) / modes["natural_frequency_std"]]
        errors += [*(modes["damping_ratio"] - DAMPING) / modes["damping_ratio_std"]]
        seen = found.images["view0"]["velocity"].values
        factor = (shape * seen.real).sum(axis=0) / (shape**2).sum(axis=0) - 1
        own = found.images["view0"]["velocity_std"].values
        own = np.sqrt((shape**2 * own**2).sum(axis=0)) / (shape**2).sum(axis=0)
        scales += [*factor / np.hypot(modes["scale_std"], own)]
    for values in (errors, scales):
        spread = float(np.mean(np.square(values)))
        assert abs(spread - 1) < 4 * np.sqrt(2 / len(values)), spread


def test_a_mode_that_only_the_window_damps_and_windows_that_differ_are_refused():
    shape = plate_shapes(60, 5)
    spoilt = windowed(shape, 1e-9).assign_attrs(window_decay=0.02)
    with pytest.raises(UserError, match="Hz is damped by the exponential window alone"):
        identified(spoilt)
    with pytest.raises(UserError, match=r"several time constants \(0\.1, 0\.2 s; 0 is none\)"):
        identified(windowed(shape, 1e-9), windowed(shape, 1e-9, decay=0.1))


#: Three modes of 1 %, of hits in records of 0.4 s with a window of 0.1 s.
HIT, RATE, SAMPLES = np.array([197.0, 439.0, 545.0]), 2560.0, 1024


def hit(seed, pixels=40, records=8):
    """Make the image of a hammer's records, with noise in the velocity."""
    played = Excitation(ExcitationKind.hammer, [100.0, 700.0], decay=0.1, force=0.02)
    made, rng = played.design(RATE, SAMPLES), np.random.default_rng(seed)
    blow = np.append(made.waveform(), np.zeros(7 * SAMPLES))
    line = np.fft.rfftfreq(len(blow), 1 / RATE)
    shape = plate_shapes(pixels, 3, seed)
    line[0] = line[1] / 2  # nothing moves at 0 Hz; the model divides by it
    moved = responses(line, HIT, np.full(3, 0.01), shape) * np.fft.rfft(blow)
    clean = np.fft.irfft(moved, len(blow))[:, None, :SAMPLES]
    size = (pixels, records, SAMPLES)
    seen = clean + 0.3 * np.sqrt((clean**2).mean()) * rng.standard_normal(size)
    both = np.stack([seen, np.broadcast_to(blow[:SAMPLES], size)], axis=2)
    signal = Response(velocity_per_volt=1.0)
    found = signal.image(signal.sums(both, made), made)
    return response_to_dataset(found, np.zeros((pixels, 2), int), np.zeros((pixels, 2))), shape


@pytest.mark.parametrize(
    "seeds", [pytest.param(2, marks=pytest.mark.whole), pytest.param(20, marks=pytest.mark.long)]
)
def test_bounds_hold_noise_that_a_window_makes_neighbouring_lines_share(seeds):
    """As if lines were independent, errors would be two to three times their bounds."""
    errors, spread = [], []
    for seed in range(seeds):
        image_, shape = hit(seed)
        found = modes.estimate_modes({"view0": image_}, modes.MostLikelyModes())
        assert "harmonics" not in [finding.kind for finding in found.findings]
        own = found.modes
        assert own["natural_frequency"].values == pytest.approx(HIT, rel=2e-3)  # and no false one
        errors += [*(own["natural_frequency"] - HIT) / own["natural_frequency_std"]]
        errors += [*(own["damping_ratio"] - 0.01) / own["damping_ratio_std"]]
        amplitude = np.sqrt(np.mean(image_["reference_amplitude"].values ** 2))
        seen = found.images["view0"]
        apart = (seen["velocity"].values - amplitude * shape) / seen["velocity_std"].values
        spread += [*apart.real.std(axis=0), *apart.imag.std(axis=0)]
    for squares in (np.mean(np.square(errors)), np.mean(np.square(spread))):
        assert abs(squares - 1) < 4 * np.sqrt(2 / len(errors)), squares
