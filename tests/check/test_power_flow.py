"""Power in a plate that a force drives: where it enters, where it goes, and that it adds up."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp.check import Examination
from sldvexp.check.power_flow import PointForce, PowerFlowCheck
from sldvexp.dataset import Severity, take_findings
from sldvexp.errors import ConfigError, UserError
from sldvexp.shell.forces import patch_places
from sldvexp.shell.power import dissipated, fed, intensity, leaving
from tests.check.test_lever_arm import most_by_chance
from tests.shell import simulated_physics as physics
from tests.shell import simulated_shell as lab

HERTZ, LOSS = 300.0, 0.1
PATCHES = (6, 5)
PLACE, ITS_PATCH = (0.025, 0.0), 3 * 5 + 2


def driven(place=PLACE, force=0.5):
    return physics.SinePlate({HERTZ: physics.forced(HERTZ, force, place, LOSS)})


def true_power(truth, place=PLACE, force=0.5):
    return 0.5 * (force * truth.derivative([place], HERTZ).conj()).real[0]


@pytest.fixture(scope="module")
def found():
    return physics.estimated(driven(), np.random.default_rng(0), (HERTZ,))


class Wave(physics.SinePlate):
    """Waves that run along s, of 10 mm/s."""

    def derivative(self, place, frequency, i=0, j=0, power=0):
        k = np.sqrt(2 * np.pi * frequency * np.sqrt(lab.SHEET.mass / lab.SHEET.bending_stiffness))
        s = np.asarray(place)[:, 0]
        return (0.01 * (-1j * k) ** i * np.exp(-1j * k * s)) if j == 0 else np.zeros(len(s))


def test_a_running_wave_carries_what_theory_says():
    """``D k^3 |V|^2 / omega`` along s, and nothing across."""
    wave = Wave({HERTZ: None})
    found = physics.estimated(wave, np.random.default_rng(1), (HERTZ,))
    omega, (stiff, mass) = 2 * np.pi * HERTZ, (lab.SHEET.bending_stiffness, lab.SHEET.mass)
    k = np.sqrt(omega * np.sqrt(mass / stiff))
    flow = intensity(found, np.array([[0.0, 0.0], [0.05, -0.04], [-0.06, 0.03]]), 0, 0.0)
    wanted = stiff * k**3 * 1e-4 / omega
    assert flow.power[:, 0] == pytest.approx(wanted, rel=0.05)
    assert np.all(np.abs(flow.power[:, 0] - wanted) < 4 * flow.std[:, 0])
    assert np.all(np.abs(flow.power[:, 1]) < 4 * flow.std[:, 1])


@pytest.mark.whole
def test_bounds_are_those_of_products():
    """Against draws of the coefficients, of the noise alone."""
    wave = Wave({HERTZ: None})
    found = physics.estimated(wave, np.random.default_rng(2), (HERTZ,))
    places = np.array([[0.02, 0.01]])
    own = intensity(found, places, 0, 0.03)
    rng, values = np.random.default_rng(3), []
    for _ in range(8):
        again = physics.estimated(wave, rng, (HERTZ,))
        values.append(intensity(again, places, 0, 0.03).power[0])
    spread = np.std(values, axis=0, ddof=1)
    assert np.all(spread < 1.6 * own.std[0])
    assert np.all(spread > 0.2 * own.std[0])


@pytest.mark.whole
def test_power_enters_where_the_force_acts(found):
    places, sides = patch_places(found.fit, PATCHES)
    flow = leaving(found, places, sides, 0, LOSS)
    assert int(np.argmax(flow.power / flow.std)) == ITS_PATCH
    assert flow.power[ITS_PATCH] > 5 * flow.std[ITS_PATCH]


def test_energy_adds_up(found):
    """Fed, what leaves a window of 0.2 m and what damping takes in it."""
    truth, place, sides = true_power(driven()), np.array([PLACE]), np.array([0.2, 0.2])
    put_in = fed(found, place, np.array([0.5 + 0j]), 0)
    assert put_in.power[0] == pytest.approx(truth, rel=0.1)
    goes = leaving(found, place, sides, 0, LOSS)
    lost = dissipated(found, place, sides, 0, LOSS)
    whole = goes.power[0] + lost[0]
    assert abs(whole - truth) < 3 * np.hypot(goes.std[0], 0.15 * truth)
    assert lost[0] > 0.1 * truth


def examined(monkeypatch, found, **settings):
    monkeypatch.setattr("sldvexp.check.on_surface.reconstruct_surface", lambda *_: found)
    experiment = SimpleNamespace(
        laser=None, volume=None, material=None, reconstruction=lab.method(), compare={}
    )
    run = Examination({}, rng=np.random.default_rng(0), experiment=experiment)
    return PowerFlowCheck(loss_factor=LOSS, **settings).examine(run)


def force(**settings):
    return PointForce(**{"place": list(PLACE), "amplitude": [0.5], "phase": [0.0], **settings})


@pytest.mark.whole
def test_the_check_compares_forces(monkeypatch, found):
    right = examined(monkeypatch, found, forces={"shaker": force()})
    where, balance = take_findings({"examined/power_flow": right})
    assert "power enters the plate around [25, 0] mm" in where.text
    assert balance.severity is Severity.note
    wrong = examined(monkeypatch, found, forces={"shaker": force(amplitude=[1.5])})
    *_, balance = take_findings({"examined/power_flow": wrong})
    assert balance.severity is Severity.doubtful
    assert "the balance of energy does not hold" in balance.text


@pytest.mark.parametrize("trials", [1, pytest.param(3, marks=pytest.mark.whole)])
def test_nothing_enters_a_plate_in_one_mode(monkeypatch, trials):
    hertz = physics.FIRST_MODE
    truth, entered = physics.SinePlate({hertz: physics.mode(1, 1)}), 0
    for seed in range(trials):
        found = physics.estimated(truth, np.random.default_rng(10 + seed), (hertz,))
        places, sides = patch_places(found.fit, PATCHES)
        flow = leaving(found, places, sides, 0, 0.0)
        entered += (flow.power / flow.std).max() > 2.94  # 5 % in 30 patches
        assert np.abs(flow.power / flow.std).max() < 4.5
    assert entered <= most_by_chance(trials, 0.05)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"place": [0.5, 0.0]}, "the window of shaker is not on the surface as a whole"),
        ({"amplitude": [1.0, 2.0], "phase": [0.0, 0.0]}, "must have 1 numbers, one for each"),
    ],
)
def test_forces_that_cannot_be_compared(monkeypatch, found, settings, told):
    with pytest.raises(UserError, match=told):
        examined(monkeypatch, found, forces={"shaker": force(**settings)})


@pytest.mark.parametrize(
    "settings",
    [
        {"patches": [4]},
        {"loss_factor": -0.1},
        {"forces": {"a": PointForce()}},
        {"forces": {"a": PointForce(place=[0.0, 0.0], amplitude=[1.0])}},
    ],
)
def test_settings_that_cannot_be(settings):
    with pytest.raises(ConfigError):
        PowerFlowCheck(**settings)


@pytest.mark.long
def test_size_and_power_in_forty_sessions():
    """Poses drawn; the force at three places, its power against what leaves."""
    entered, placed, off = 0, 0, []
    hertz, pose_std = physics.FIRST_MODE, (3e-6, 4e-6)
    still = physics.SinePlate({hertz: physics.mode(1, 1)})
    for seed in range(40):
        rng = np.random.default_rng(7000 + seed)
        found = physics.estimated(still, rng, (hertz,), pose_std=pose_std)
        places, sides = patch_places(found.fit, PATCHES)
        flow = leaving(found, places, sides, 0, 0.0)
        entered += (flow.power / flow.std).max() > 2.94
        place = [(0.025, 0.0), (-0.03, 0.02), (0.0, -0.02)][seed % 3]
        found = physics.estimated(driven(place), rng, (HERTZ,), pose_std=pose_std)
        flow = leaving(found, places, sides, 0, LOSS)
        near = np.argmin(np.linalg.norm(places - place, axis=1))
        placed += np.argmax(flow.power / flow.std) == near
        around, window = np.array([place]), np.array([0.2, 0.2])
        goes = leaving(found, around, window, 0, LOSS)
        truth = true_power(driven(place), place)
        error = goes.power[0] + dissipated(found, around, window, 0, LOSS)[0] - truth
        off.append([error / truth, error / np.hypot(goes.std[0], 0.15 * truth)])
    relative, z = np.array(off).T
    print(entered / 40, placed / 40, relative.mean(), relative.std(), (np.abs(z) < 1.96).mean())
    assert entered / 40 <= 0.10
    assert placed / 40 >= 0.6
    assert (np.abs(z) < 1.96).mean() >= 0.9
