"""Plates on which forces act, and others: size and power of the plate equation's residual."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp.check import Examination
from sldvexp.check.equilibrium import Equilibrium, told
from sldvexp.dataset import Severity, take_findings
from sldvexp.errors import ConfigError, UserError
from sldvexp.shell import Isotropic
from sldvexp.shell.forces import covariance_of, patch_forces, patch_places, window_rows
from sldvexp.shell.material import Tolerance
from tests.check.test_lever_arm import most_by_chance
from tests.shell import simulated_physics as physics
from tests.shell import simulated_shell as lab

RESONANCE, BESIDE = physics.FIRST_MODE, 300.0
PATCHES = (6, 5)
#: Where the force acts, and the number of its patch.
PLACE, ITS_PATCH = (0.025, -0.05), 3 * 5 + 1


def free():
    return physics.SinePlate({RESONANCE: physics.mode(1, 1)})


def driven(force):
    return physics.SinePlate({BESIDE: physics.forced(BESIDE, force, PLACE)})


def forces_of(truth, seed, level=0.05, **settings):
    (hertz,) = truth.amplitude
    found = physics.estimated(truth, np.random.default_rng(seed), (hertz,), **settings)
    return patch_forces(found, *patch_places(found.fit, PATCHES), 0, level)


def rejected(forces, level=0.05):
    return forces.acted.any() or forces.p_whole < level


def test_the_residual_of_known_motion(at_rest):
    """Of sines with k^4 instead of kappa^4, at windows of patches and of the whole plate."""
    found = at_rest
    fit, (places, sides) = found.fit, patch_places(found.fit, PATCHES)
    k4 = found.material.mass * (2 * np.pi * RESONANCE) ** 2 / found.material.bending_stiffness
    middle, size = (fit.outline.low + fit.outline.high) / 2, fit.outline.high - fit.outline.low
    for window in ((places[7], sides, 1, 20), (middle, size, 4, 48)):
        bent, still = window_rows(fit, *window)
        node, weight = np.polynomial.legendre.leggauss(40)
        at = np.stack(np.meshgrid(node, node, indexing="ij"), axis=-1).reshape(-1, 2)
        share = np.outer(weight * (1 - node**2) ** 4, weight * (1 - node**2) ** 4).ravel()
        w = free().derivative(window[0] + at * window[1] / 2, RESONANCE)
        values, covariance = covariance_of(fit, np.concatenate([bent / k4, still]))
        mean = (share @ w) / share.sum()
        count = len(bent)
        std = np.sqrt(covariance[0, 0].diagonal())
        assert abs(values[count, 0] - mean) < 4 * std[count]
        assert abs(values[0, 0] - mean) < 4 * std[0]


def test_covariances_are_those_of_sums(at_rest):
    found = at_rest
    rows = np.random.default_rng(2).normal(size=(3, found.fit.shell.coefficients))
    _, covariance = covariance_of(found.fit, rows)
    weights = np.array([1.0, -2.0, 0.5])
    _, own, others = found.fit.evaluate((weights @ rows)[None])
    wanted = (own + others)[:, 0, 0]
    got = np.einsum("i,pij,j->p", weights, covariance[:, 0], weights)
    assert got == pytest.approx(wanted, rel=1e-6)


@pytest.mark.whole
def test_no_force_is_found_where_none_acts():
    trials = 3
    found = [forces_of(free(), 10 + seed) for seed in range(trials)]
    assert sum(map(rejected, found)) <= most_by_chance(trials, 0.05)
    for one in found:
        assert one.gamma.real == pytest.approx(1.0, abs=4 * one.gamma_std[0])
        assert one.gamma.imag == pytest.approx(0.0, abs=4 * one.gamma_std[1])


def test_a_force_is_found_in_its_patch():
    """Half a newton beside resonance; other patches show the loss factor of 2 %."""
    found = forces_of(driven(0.5), 20)
    assert found.acted[ITS_PATCH]
    assert found.acted.sum() <= 3
    assert int(np.argmin(found.p_value)) == ITS_PATCH
    assert abs(found.pressure[ITS_PATCH]) > 8 * found.std[:, ITS_PATCH].max()
    assert -found.gamma.imag == pytest.approx(0.02, abs=4 * found.gamma_std[1])


@pytest.mark.whole
def test_a_small_force_is_felt_and_not_placed():
    """A thirtieth of a newton, at which the plate moves 0.2 mm/s."""
    found = forces_of(driven(0.033), 21, level=0.01)
    assert not found.acted.any()
    assert found.p_whole < 1e-3


def said(found, sheet=lab.SHEET):
    places, sides = patch_places(found.fit, PATCHES)
    one = patch_forces(replace(found, material=sheet), places, sides, 0, 0.01)
    (finding,) = told([one], found.frequency, places, sheet.wave_uncertainty, 0.01)
    return finding


@pytest.fixture(scope="module")
def at_rest():
    """A plate in resonance that nothing touches."""
    return physics.estimated(free(), np.random.default_rng(30), (RESONANCE,))


@pytest.fixture(scope="module")
def pushed():
    return physics.estimated(driven(0.5), np.random.default_rng(40), (BESIDE,))


@pytest.mark.whole
def test_sentences_and_how_much_they_weigh(at_rest, pushed):
    assert said(at_rest).severity is Severity.note
    wrong = said(at_rest, Isotropic(thickness=0.003, rho=2900.0))
    assert wrong.severity is Severity.doubtful
    assert "bending waves are longer than material and thickness say" in wrong.text
    vague = Isotropic(thickness=0.003, rho=2900.0, tolerance=Tolerance(rho=100.0))
    assert said(at_rest, vague).severity is Severity.note
    force = said(pushed)
    assert force.severity is Severity.note
    assert "most around [25, -50] mm" in force.text
    felt = physics.estimated(driven(0.033), np.random.default_rng(32), (BESIDE,))
    assert "not in any one patch" in said(felt).text


def examined(monkeypatch, found, **settings):
    monkeypatch.setattr("sldvexp.check.on_surface.reconstruct_surface", lambda *_: found)
    experiment = SimpleNamespace(
        laser=None, volume=None, material=None, reconstruction=lab.method(), compare={}
    )
    run = Examination({}, rng=np.random.default_rng(0), experiment=experiment)
    return Equilibrium(**settings).examine(run)


def test_the_check_leaves_a_map(monkeypatch, pushed):
    group = examined(monkeypatch, pushed)
    assert group["acted"].values[ITS_PATCH, 0]
    assert group["place_s"].values[ITS_PATCH] == pytest.approx(0.025)
    assert group["place_t"].values[ITS_PATCH] == pytest.approx(-0.05)
    (finding,) = take_findings({"examined/equilibrium": group})
    assert finding.subject == "300 Hz"
    with pytest.raises(UserError, match=r"1 of 1 x 1 patches lie on the structure as a whole"):
        examined(monkeypatch, pushed, patches=[1, 1])


def test_a_curved_panel_is_refused(monkeypatch):
    views = lab.views(lab.plate(0.5), np.random.default_rng(41))
    found = physics.field_of(views, lab.volume(0.5), (lab.FREQUENCY,))
    with pytest.raises(UserError, match=r"^check=equilibrium needs a flat plate"):
        examined(monkeypatch, found)


@pytest.mark.parametrize("settings", [{"patches": [4]}, {"lines": 0}, {"level": 0.0}])
def test_settings_that_cannot_be(settings):
    with pytest.raises(ConfigError):
        Equilibrium(**settings)


@pytest.mark.long
@pytest.mark.parametrize(
    ("truth", "least", "most"),
    [(free(), 0.0, 0.10), (driven(0.033), 0.95, 1.0), (driven(0.5), 1.0, 1.0)],
)
def test_size_and_power_in_sixty_sessions(truth, least, most):
    found = [forces_of(truth, 5000 + seed, pose_std=(3e-6, 4e-6)) for seed in range(60)]
    share = np.mean([rejected(one) for one in found])
    z = np.array([(one.gamma.real - 1) / one.gamma_std[0] for one in found])
    placed = np.mean([one.acted[ITS_PATCH] for one in found])
    print(share, placed, z.mean(), z.std(), [one.p_whole for one in found[:5]])
    assert least <= share <= most
