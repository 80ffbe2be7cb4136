"""Right models are rejected as often as promised and wrong ones nearly always, in many sessions.

The few repetitions of modal images by default are whole sessions, poses estimated in each, where
tests are `long`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from sldvexp.models import ModelFrame, ModelParameter, examine_frequencies
from sldvexp.models.estimate import examine_model
from sldvexp.models.skfem_plate import EdgeSide, PlateModel
from tests.models.made_models import (
    CENTER,
    LASER,
    POSE_STD,
    THICKNESS,
    Measured,
    closed_form,
    true_plate,
)
from tests.models.recorded_session import RecordedSession
from tests.models.test_verdict_on_models import MASS, source

#: Relative standard uncertainties of E and rho that leave 0.5 % of all frequencies in common.
KNOWN = {"E": 0.0092, "rho": 0.004}
THICKER = 1.02
MANY, FEW = 200, 6
#: 0.2 % of the plate's mass at a quarter point.
WASHER = "scene.plate.masses={washer: {mass: 0.0012, center: [-0.075, -0.0625]}}"


def drawn_frequencies_rejected(found, rng, thickness=1.0):
    """Test the frequencies of a model whose properties are off within their tolerances."""
    off = sum(
        found.data.sensitivity[name] * found.data.tolerance[name] * rng.normal()
        for name in found.data.sensitivity
    )
    data = replace(found.data, computed=thickness * found.data.computed * np.exp(off))
    return replace(found, data=data, frequencies=examine_frequencies(data)).frequencies_rejected


def told(examined, count):
    """Count rejections: of shapes, of right frequencies, of those of a thicker plate."""
    rng, found = np.random.default_rng(17), np.zeros(3, int)
    for seed in range(count):
        one = examined(seed)
        found += [
            one.shapes_rejected,
            drawn_frequencies_rejected(one, rng),
            drawn_frequencies_rejected(one, rng, THICKER),
        ]
    return found


def tolerances(values):
    return {
        name: ModelParameter(value, KNOWN[name] * value)
        for name, value in values.items()
        if name in KNOWN
    }


def clamped_plate():
    pytest.importorskip("skfem", reason="needs scikit-fem, pip install 'sldvexp[fe]'")
    frame = ModelFrame(origin=CENTER.tolist())
    return source(PlateModel(thickness=THICKNESS, frame=frame, clamped=[EdgeSide.left]).model())


def few(plate):
    return Measured(plate, views=3, shape=(11, 13))


@pytest.mark.whole
def test_few_right_models_are_accepted_and_thicker_ones_rejected_by_frequency():
    measured, known = few(true_plate()), tolerances({"E": 70e9, "rho": 2700.0})
    one = source(parameters=known)

    def examined(seed):
        return examine_model(measured.tree(seed, pose_std=POSE_STD), LASER, one)

    shapes, right, thick = told(examined, FEW)
    most = stats.binom.ppf(1 - 1e-3, FEW, 0.09)
    assert shapes <= most
    assert right <= most
    assert thick >= stats.binom.ppf(1e-3, FEW, 0.95)


@pytest.mark.whole
@pytest.mark.parametrize("wrong", ["mass", "edge"])
def test_few_wrong_models_are_rejected_by_their_shapes(wrong):
    measured = few(true_plate(MASS if wrong == "mass" else 0.0))
    one = source(closed_form()) if wrong == "mass" else clamped_plate()
    for seed in range(FEW):
        tree = measured.tree(seed, pose_std=POSE_STD)
        assert examine_model(tree, LASER, one).shapes_rejected


def repeated(session, model):
    return lambda seed: examine_model(session.repeated(seed), session.laser, model)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return RecordedSession(tmp_path_factory.mktemp("right"))


@pytest.mark.long
def test_right_model_is_rejected_in_one_of_twenty_sessions_and_a_thicker_one_in_nineteen(
    session, record_property
):
    model = session.made.model
    known = {name: p.value for name, p in model.parameters.items()}
    model = replace(model, parameters=tolerances(known), adjust={})
    found = told(repeated(session, model), MANY)
    record_property("rejected", found.tolist())
    shapes, right, thick = found
    assert 0.02 * MANY <= shapes <= 0.09 * MANY
    assert 0.02 * MANY <= right <= 0.09 * MANY
    assert thick >= 0.95 * MANY


@pytest.mark.long
def test_model_with_a_clamped_edge_is_rejected_in_every_session(session, record_property):
    examined = repeated(session, clamped_plate())
    found = sum(examined(seed).shapes_rejected for seed in range(MANY))
    record_property("rejected", int(found))
    assert found == MANY


@pytest.mark.long
def test_model_that_lacks_two_thousandths_of_mass_is_rejected_in_nineteen_of_twenty_sessions(
    tmp_path, record_property
):
    session = RecordedSession(tmp_path, WASHER)
    examined = repeated(session, session.made.model)
    found = sum(examined(seed).shapes_rejected for seed in range(MANY))
    record_property("rejected", int(found))
    assert found >= 0.95 * MANY
