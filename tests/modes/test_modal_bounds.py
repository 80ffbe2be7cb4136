"""Bounds of poles and modal images hold as often as they say, and are as small as can be."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import DAMPING, FREQUENCY, LINE, identified, plate_shapes, responses, session

from sldvexp import modes
from sldvexp.modes.model import basis, poles_of, split


def errors(seeds, noise, pixels):
    """Errors over their standard errors: of poles, of the scales of shapes, of pixels."""
    poles, scales, seen = [], [], []
    for seed in seeds:
        view, shape = session(seed, noise, pixels)
        found = identified(view)
        assert len(found.modes["mode"]) == 5, seed
        for name, truth in (("natural_frequency", FREQUENCY), ("damping_ratio", DAMPING)):
            own = found.modes[name].values - truth
            poles.append(own / found.modes[f"{name}_std"].values)
        modal = found.images["view0"]
        velocity, std = modal["velocity"].values, modal["velocity_std"].values
        power = (shape**2).sum(axis=0)
        scale = (shape * velocity).sum(axis=0) / power - 1
        chance = ((shape * std) ** 2).sum(axis=0) / power**2
        for part, name in ((scale.real, "scale_std"), (scale.imag, "phase_std")):
            scales.append(part / np.sqrt(found.modes[name].values ** 2 + chance))
        left = velocity - (1 + scale) * shape
        seen.append(np.mean(np.abs(left) ** 2 / std**2 / 2))
    return np.array(poles), np.array(scales), np.array(seen)


def check_bounds(poles, scales, seen, pixels):
    """Compare with what chance leaves, 3.3 standard errors either way."""
    for found in (poles, scales):
        count = found.size
        share = np.mean(np.abs(found) < 1.96)
        assert abs(share - 0.95) < 3.3 * np.sqrt(0.95 * 0.05 / count) + 0.5 / count
        assert abs(found.std() - 1) < 3.3 / np.sqrt(2 * count)
        assert abs(found.mean()) < 3.3 / np.sqrt(count)
    expected = 1 - 1 / pixels  # a scale of each mode was taken off
    assert abs(seen.mean() - expected) < 3.3 / np.sqrt(len(seen) * pixels * 5)


@pytest.mark.whole
@pytest.mark.parametrize("noise", [0.02, 0.5])
def test_bounds_hold_in_some_sessions(noise):
    check_bounds(*errors(range(5), noise, 150), 150)


@pytest.mark.long
@pytest.mark.parametrize("noise", [0.005, 0.05, 0.2, 0.5, 1.0])
def test_bounds_hold_in_sixty_sessions(noise):
    check_bounds(*errors(range(100, 160), noise, 600), 600)


def test_bounds_of_poles_are_those_of_cramer_and_rao():
    """Fisher's information of all pixels' lines, their residues and rests unknown."""
    view, _ = session(3, 0.05, 120)
    shape = plate_shapes(120, 5, 3)
    pole, omega = poles_of(2 * np.pi * FREQUENCY, DAMPING), 2 * np.pi * LINE
    unitary = np.linalg.qr(basis(pole, omega))[0]
    noise = view["velocity_std"].values[:, 0]

    def lines(unknowns):
        frequency, damping = np.exp(unknowns[:5]), np.exp(unknowns[5:])
        # Of fixed residues: v = R i w_d / (zeta w).
        own = modes.model.velocity_per_residue(poles_of(frequency, damping))
        true = modes.model.velocity_per_residue(pole)
        return split(responses(LINE, frequency, damping, shape * np.abs(own / true)).T)

    start = np.log([*FREQUENCY, *DAMPING])
    step = 1e-6 * np.eye(10)
    slopes = [(lines(start + h) - lines(start - h)) / 2e-6 / noise for h in step]
    slopes = np.array([(s - unitary @ (unitary.T @ s)).ravel() for s in slopes])
    least = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)))
    found = np.sqrt(np.diag(identified(view).modes["pole_covariance"].values))
    assert np.all(found / least > 0.97)  # at poles that were found, not at the true ones
    assert np.all(found / least < 1.03)


@pytest.mark.whole
def test_shares_of_a_neighbour_are_as_uncertain_as_told():
    """Mixing of close modes, over sessions; noise is so small that poles alone decide."""
    frequency, shares, told = np.array([545.0, 549.0]), [], []
    for seed in range(12):
        view, shape = session(seed, 0.05, 200, frequency=frequency, damping=0.01)
        found = identified(view)
        velocity = found.images["view0"]["velocity"].values
        std = found.images["view0"]["velocity_std"].values
        share = np.linalg.lstsq(shape, velocity, rcond=None)[0].T - np.eye(2)
        chance = np.linalg.inv(shape.T @ shape)
        noise = np.sqrt((std**2).mean(axis=0)[:, None] * np.diag(chance))
        mixing = found.projection.mixing(found.fit.covariance)
        shares.append(np.stack([share.real, share.imag]) / np.hypot(mixing, noise))
        told.append(mixing / noise)
    parts = np.array(shares)
    assert np.mean(told) > 1
    assert abs(parts.std() - 1) < 3.3 / np.sqrt(parts.size)
