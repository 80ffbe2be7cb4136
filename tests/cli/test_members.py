"""Plugins made in Python take the names of members, as configurations do, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import volume
from sldvexp.dataset import RunData
from sldvexp.errors import ConfigError
from sldvexp.reconstruction import Absolute, Model, Weights
from sldvexp.units import LengthUnit

DIRECTIONS = np.array([[0, 0, 1.0], [0.6, 0, 0.8], [-0.6, 0, 0.8], [0, 0.6, 0.8], [0, -0.6, 0.8]])
GIVEN = (DIRECTIONS, [1.0, 2, 3, 4, 5], [1, 1, 1, 0.1, 0.1])


@pytest.mark.parametrize("weights", Weights)
@pytest.mark.parametrize("model", Model)
def test_a_name_is_the_member(weights, model):
    one = Absolute(weights=weights, model=model).reconstruct(*GIVEN)
    two = Absolute(weights=weights.name, model=model.name).reconstruct(*GIVEN)
    np.testing.assert_array_equal(one.velocity, two.velocity)
    np.testing.assert_array_equal(one.confidence, two.confidence)


def test_names_decide():
    found = [Absolute(weights=w.name).reconstruct(*GIVEN).velocity[0, 0, 0] for w in Weights]
    assert found[0] != found[1]
    assert volume.Grid(unit="mm").unit is LengthUnit.mm


@pytest.mark.parametrize("wrong", ["nois", 1, ["noise"]])
def test_what_names_no_member_is_refused(wrong):
    with pytest.raises(ConfigError, match=r"weights: cannot be .*Valid: equal, noise"):
        Absolute(weights=wrong)


def test_a_result_is_a_run_of_its_own():
    found = Absolute().reconstruct(*GIVEN)
    run = RunData.from_source(found)
    assert list(run.groups) == ["point"]
    np.testing.assert_array_equal(run.groups["point"]["velocity"], found.to_dataset()["velocity"])
