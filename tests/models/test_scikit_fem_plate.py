"""Plates of finite elements are those of the closed form, and wrong ones are found by the test."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from sldvexp.config.paths import locate
from sldvexp.errors import ConfigError, UserError
from sldvexp.models import ModelFile, ModelFrame
from sldvexp.models.estimate import examine_model
from sldvexp.models.skfem_plate import EdgeSide, PlateMass, PlateModel, PlateTolerance
from tests.models.made_models import (
    CENTER,
    LASER,
    POSE_STD,
    THICKNESS,
    Measured,
    closed_form,
    true_plate,
)

#: 0.2 % of the plate's mass, kg.
MASS = 0.002 * 2700 * 0.003 * 0.3 * 0.25
#: Tolerances that leave 0.5 % of all frequencies open in common.
KNOWN = PlateTolerance(E=0.009 * 70e9, rho=0.004 * 2700)


def plate(**settings):
    pytest.importorskip("skfem", reason="needs scikit-fem, pip install 'sldvexp[fe]'")
    frame = ModelFrame(origin=CENTER.tolist())
    settings = {"thickness": THICKNESS, "frame": frame, "tolerance": KNOWN} | settings
    return PlateModel(**settings)


@pytest.mark.whole
def test_error_of_its_frequencies_is_that_of_a_mesh_half_as_fine():
    source = plate(modes=5)
    model, exact = source.model(), closed_form().frequency
    error, told = model.frequency / exact - 1, source.discretisation_of(model)
    assert np.all(error > 0)
    np.testing.assert_allclose(told, error, rtol=0.05)


@pytest.mark.whole
def test_sensitivities_are_those_of_a_thin_plate():
    source = plate(modes=5, elements=[8, 8])
    found = source.sensitivities(source.model())
    for name, power in (("E", 0.5), ("rho", -0.5), ("thickness", 1.0)):
        np.testing.assert_allclose(found[name], power, atol=1e-5)
    np.testing.assert_allclose(found["nu"], 0.33**2 / (1 - 0.33**2), atol=1e-4)
    np.testing.assert_allclose(found["length"] + found["width"], -2.0, atol=1e-4)


@pytest.mark.whole
def test_right_plate_is_accepted_and_four_wrong_ones_are_told():
    measured = Measured(true_plate()).tree(0, pose_std=POSE_STD)
    right = examine_model(measured, LASER, plate())
    assert not right.shapes_rejected
    assert right.frequency_verdict == "accepted"
    clamped = examine_model(measured, LASER, plate(clamped=[EdgeSide.left]))
    assert clamped.shapes.p_value == 0
    assert clamped.frequency_verdict == "rejected"
    heavy = {"washer": PlateMass([-0.075, -0.0625], MASS)}
    loaded = examine_model(measured, LASER, plate(masses=heavy))
    assert loaded.shapes.p_value < 1e-12
    thick = examine_model(measured, LASER, plate(thickness=1.02 * THICKNESS))
    assert not thick.shapes_rejected
    assert thick.frequency_verdict == "rejected"
    # A model of the loaded plate is right for a loaded plate.
    washer = Measured(true_plate(MASS)).tree(0, pose_std=POSE_STD)
    assert not examine_model(washer, LASER, plate(masses=heavy)).shapes_rejected


def test_shipped_file_is_a_plate_of_scikit_fem():
    shipped = ModelFile(path="conf://data/plate_model.uff").read()
    assert locate("conf://data/plate_model.uff").is_file()
    made = plate().read()
    np.testing.assert_allclose(shipped.frequency, made.frequency, rtol=1e-5)
    largest = np.abs(made.translation).max(axis=(0, 1))
    np.testing.assert_allclose(
        np.abs(shipped.translation), np.abs(made.translation / largest), atol=1e-5
    )


def test_scikit_fem_that_is_missing_is_asked_for(monkeypatch):
    monkeypatch.setitem(sys.modules, "skfem", None)
    with pytest.raises(UserError, match=r"pip install 'sldvexp\[fe\]'"):
        PlateModel(thickness=THICKNESS).model()


def test_plates_that_there_are_not_are_refused():
    with pytest.raises(ConfigError, match="thickness: must be a positive number"):
        PlateModel()
    with pytest.raises(ConfigError, match="elements: must be two even numbers"):
        PlateModel(thickness=THICKNESS, elements=[7, 8])
