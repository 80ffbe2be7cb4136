"""Modal masses are those of the structure where the force is known, within their bounds."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.models.estimate import examine_model
from sldvexp.models.modal_mass import DrivePoint
from sldvexp.models.result import model_to_datasets
from sldvexp.models.wording import findings_about
from tests.models.made_models import (
    CENTER,
    LASER,
    ORDERS,
    POSE_STD,
    THICKNESS,
    A,
    B,
    Measured,
    closed_form,
    true_plate,
)
from tests.models.test_verdict_on_models import source

#: Modal mass of each mode of a supported plate whose shape is 1 at its largest, kg.
MASS = 2700.0 * THICKNESS * A * B / 4
POINT = np.array([0.21 * A, 0.16 * B])
FORCE, VOLT = 2.4, 0.3


@pytest.fixture(scope="module")
def measured():
    """Modal velocities of the plate as a force at one point drives them."""
    found = Measured(true_plate(), views=3, shape=(11, 13))
    x, y = POINT / [A, B] + 0.5
    at = np.array([np.sin(p * np.pi * x) * np.sin(q * np.pi * y) for p, q in ORDERS])
    driven = FORCE * VOLT * at / (2 * found.damping * 2 * np.pi * found.frequency * MASS)
    now = np.array([v[np.abs(v).argmax(axis=0), range(5)] for v in found.velocity])
    assert now.shape == (3, 5)
    peak = np.array([0.02, 0.02, -0.015, 0.01, 0.01])
    found.velocity = [v / peak * driven for v in found.velocity]
    return found


def drive(**settings):
    point = [*(CENTER[:2] + POINT), 0.0]
    known = {"point": point, "force": FORCE, "force_std": 0.01 * FORCE, "point_std": 5e-4}
    return DrivePoint(**known | settings)


def examined(measured, seed=0, reference=VOLT, **settings):
    tree = measured.tree(seed, noise=2e-5, pose_std=POSE_STD)
    if reference is not None:
        tree["modes"]["reference"] = reference
    model = closed_form((24, 20))
    return examine_model(tree, LASER, source(model, drive=drive(**settings)))


def test_modal_masses_are_those_of_the_plate(measured):
    found = examined(measured, force_std=0.0, point_std=0.0)
    mass, std = found.masses.mass, found.masses.std
    np.testing.assert_allclose(mass, MASS, rtol=5e-3)
    assert np.all(std < 5e-3 * MASS)
    assert np.all(np.abs(mass - MASS) < 4 * std)
    told = {f.kind: f.text for f in findings_about(found)}
    assert (
        "modal masses, for shapes that are 1 where it moves most: 0.15"
        in (told["model_modal_masses"])
    )
    assert "model_force_turned" not in told
    made = model_to_datasets(found, {})["model"]
    np.testing.assert_array_equal(made["modal_mass"].values, mass)


@pytest.mark.whole
def test_bounds_of_modal_masses_hold_those_of_force_and_place(measured):
    """The force and its place are off by what is said of them, again and again."""
    rng, off = np.random.default_rng(4), []
    for seed in range(6):
        beside, stronger = 5e-4 * rng.normal(size=2), 1 + 0.01 * rng.normal()
        point = [*(CENTER[:2] + POINT + beside), 0.0]
        found = examined(measured, seed, point=point, force=FORCE * stronger)
        off.append((found.masses.mass - MASS) / found.masses.std)
    spread = float(np.sqrt(np.mean(np.square(off))))
    assert 0.4 < spread < 1.6
    assert np.abs(off).max() < 4


def test_force_that_acts_the_other_way_or_late_is_told(measured):
    found = examined(measured, direction=[0.0, 0.0, -1.0])
    text = {f.kind: f.text for f in findings_about(found)}["model_force_turned"]
    assert "180 deg at 198.9 Hz" in text
    np.testing.assert_allclose(found.masses.mass, MASS, rtol=0.05)
    late = replace_phase(measured, 0.3)
    text = {f.kind: f.text for f in findings_about(examined(late))}["model_force_turned"]
    assert text.count("+17.") == 5


def replace_phase(measured, phase):
    made = Measured.__new__(Measured)
    made.__dict__ |= measured.__dict__
    made.velocity = [v * np.exp(1j * phase) for v in measured.velocity]
    return made


def test_force_beside_the_model_is_refused(measured):
    with pytest.raises(UserError, match="the force acts beside the model"):
        examined(measured, point=[0.0, 0.0, 0.0])
    for wrong, said in (
        ({"point": [0.1]}, "drive.point: must be 3 numbers"),
        ({"direction": [0.0, 0.0, 0.0]}, "drive.direction: must not be zero"),
        ({"force": 0.0}, "drive.force: must be a positive number"),
    ):
        with pytest.raises(ConfigError, match=said):
            source(drive=drive(**wrong))


def test_without_a_force_modal_masses_are_said_to_be_open(measured):
    tree = measured.tree(0, pose_std=POSE_STD)
    tree["modes"]["reference"] = VOLT
    for found, said in (
        (examine_model(tree, LASER, source()), "for one unit of the reference (model.drive)"),
        (examined(measured, reference=None), "which the images do not say"),
    ):
        assert found.masses is None
        limits = {f.kind: f.text for f in findings_about(found)}["model_limits"]
        assert limits.endswith(said)
        assert "modal_mass" not in model_to_datasets(found, {})["model"]
