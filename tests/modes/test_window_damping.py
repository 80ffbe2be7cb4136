"""Damping that a hammer's exponential window adds is taken off the poles again."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import DAMPING, FREQUENCY, LINE, identified, image, plate_shapes, responses

from sldvexp.errors import UserError

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


def test_bounds_are_those_of_the_damping_that_is_left():
    """Half of the lowest mode's damping is the window's, so that its relative error is larger."""
    seeds, shape, errors, scales = 20, plate_shapes(100, 5), [], []
    for seed in range(seeds):
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
