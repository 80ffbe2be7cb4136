"""Further files of one structure tell the error of its mesh, and how frequencies hang on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.models import ModelFile, ModelParameter, model_file, universal_text
from sldvexp.models.base import VariedModel
from sldvexp.models.estimate import examine_model
from sldvexp.models.readers import read_model
from tests.models.made_models import (
    CENTER,
    LASER,
    POSE_STD,
    THICKNESS,
    A,
    B,
    Measured,
    closed_form,
    true_plate,
)
from tests.models.test_reading_models import own_axes, source, written

FINE, COARSE = "conf://data/plate_model.uff", "conf://data/plate_model_coarse.uff"


def exact(orders=((1, 1), (2, 1), (1, 2), (2, 2), (3, 1), (1, 3)), nu=0.33):
    root = np.sqrt(70e9 * THICKNESS**2 / 12 / (1 - nu**2) / 2700.0)
    return np.sort([root * np.pi / 2 * ((p / A) ** 2 + (q / B) ** 2) for p, q in orders])


def test_error_of_a_mesh_is_told_by_one_half_as_fine():
    one = ModelFile(path=FINE, coarser=COARSE, order=4)
    model = one.read()
    error, told = model.frequency / exact() - 1, one.discretisation_of(model)
    assert np.all(error[1:] > 5e-6)  # that of the first is the file's last digit
    np.testing.assert_allclose(told[1:], error[1:], rtol=0.3)
    np.testing.assert_allclose(replace(one, order=2.0).discretisation_of(model), 5 * told)
    assert one.inputs() == [FINE, COARSE]


def test_mesh_that_is_no_coarser_or_of_another_structure_is_refused(tmp_path):
    model = own_axes()
    path = written(tmp_path, universal_text(model), "fine.uff")

    def refused(other, said):
        wrong = written(tmp_path, universal_text(other), "other.uff")
        one = source(path, coarser=wrong)
        with pytest.raises(UserError, match=said):
            one.discretisation_of(one.read())

    refused(model, "other.uff: its elements are 1 times as large")
    coarse = replace(closed_form((4, 3)), position=closed_form((4, 3)).position - CENTER)
    refused(
        replace(coarse, position=1e-3 * coarse.position),
        "mm beside one another; it must be the same",
    )
    fewer = coarse.with_modes(np.array([0, 1, 3, 4]))
    refused(fewer, r"has no mode of the shape of mode 3 \(551.14 Hz\)")


def varied(folder, name, value, other):
    path = written(folder, universal_text(other), f"{name}.uff")
    return VariedModel(path=path, value=value)


def test_sensitivities_are_told_by_files_with_another_value(tmp_path):
    model = own_axes()
    path = written(tmp_path, universal_text(model), "model.uff")
    stiff = replace(model, frequency=model.frequency * np.sqrt(1.03))
    turned = model.frequency * np.array([1.0, 1.004, 1.0, 1.001, 0.999])
    parameters = {
        "E": ModelParameter(70e9, 0.7e9, varied=varied(tmp_path, "E", 72.1e9, stiff)),
        "rho": ModelParameter(2700.0, 8.0),
        "spring": ModelParameter(
            1.0, 0.1, varied=varied(tmp_path, "k", 1.1, replace(model, frequency=turned))
        ),
    }
    one = source(path, parameters=parameters, adjust={"spring": 0.0}, discretisation=[1e-5])
    found = one.sensitivities(one.read())
    assert list(found) == ["E", "rho", "spring"]
    np.testing.assert_allclose(found["E"], 0.5, atol=5e-4)
    np.testing.assert_allclose(found["rho"], -0.5)
    wanted = np.log(turned / model.frequency) / np.log(1.1)
    np.testing.assert_allclose(found["spring"], wanted, atol=2e-4)
    assert len(one.inputs()) == 3
    # The structure's spring is a fifth stiffer: it is found, within its bound.
    measured = Measured(true_plate(), views=2, shape=(9, 11))
    tree = measured.tree(0, pose_std=POSE_STD)
    factor = np.exp(found["spring"] * np.log(1.2))
    modes = tree["modes"]
    modes["natural_frequency"] = modes["natural_frequency"] * factor
    updated = examine_model(tree, LASER, one).updated
    assert abs(np.log(updated.factor[0] / 1.2)) < 3 * updated.std[0]
    assert updated.std[0] < 0.01


def test_files_are_read_once_for_the_check_and_for_the_test(tmp_path, monkeypatch):
    model = own_axes()
    path = written(tmp_path, universal_text(model), "model.uff")
    stiff = replace(model, frequency=model.frequency * np.sqrt(1.03))
    parameters = {
        name: ModelParameter(70e9, 0.7e9, varied=varied(tmp_path, name, 72.1e9, stiff))
        for name in ("E", "G")
    }
    one, read = source(path, parameters=parameters), []

    def counted(place, *settings):
        read.append(place.name)
        return read_model(place, *settings)

    monkeypatch.setattr(model_file, "read_model", counted)
    one.check_further(one.model())
    checked = one.sensitivities(one.model())
    tree = Measured(true_plate(), views=2, shape=(9, 11)).tree(0, pose_std=POSE_STD)
    examined = examine_model(tree, LASER, one)
    assert sorted(read) == ["E.uff", "G.uff", "model.uff"]
    np.testing.assert_array_equal(examined.known.sensitivity["E"], checked["E"])


def test_modes_that_change_places_keep_their_sensitivity(tmp_path):
    model = own_axes()
    order = np.array([0, 2, 1, 3, 4])
    swapped = replace(
        model.with_modes(order), frequency=model.frequency * np.array([1, 1.1, 1.1, 1, 1])
    )
    path = written(tmp_path, universal_text(model), "model.uff")
    parameter = ModelParameter(1.0, 0.1, varied=varied(tmp_path, "k", 2.0, swapped))
    found = source(path, parameters={"k": parameter})
    told = found.sensitivities(found.read())["k"]
    wanted = np.log(swapped.frequency[order] / model.frequency) / np.log(2.0)
    np.testing.assert_allclose(told, wanted, atol=1e-4)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"k": ModelParameter(1.0, 0.1)}, "parameters.k.sensitivity: must be given, as in"),
        (
            {"k": ModelParameter(1.0, varied=VariedModel("a.uff", 1.0001))},
            "parameters.k.varied.value: must differ from 1 by 0.001 of it or more",
        ),
        ({"k": ModelParameter(1.0, varied=VariedModel("", 2.0))}, "path: must name a file"),
        (
            {"k": ModelParameter(1.0, 0.1, [1.0], VariedModel("a.uff", 2.0))},
            "is told by varied; give one of them",
        ),
    ],
)
def test_parameters_without_a_sensitivity_that_can_be_told_are_refused(settings, said):
    with pytest.raises(ConfigError, match=said):
        ModelFile(path=FINE, parameters=settings)


def test_error_of_a_mesh_is_given_once():
    with pytest.raises(ConfigError, match="discretisation: is told by coarser"):
        ModelFile(path=FINE, coarser=COARSE, discretisation=[1e-5])
