"""Experiments made from the configuration files, as a run makes them."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from sldvexp.config.experiment import Experiment
from tests.composing import experiment

#: Two places in front of the plate and the calibration object.
VIEWS = (
    "scene.views={a: {euler: [0.024, 2.910, -3.117], origin: [0.290, 0.530, 1.655]},"
    " b: {euler: [2.075, 2.988, -1.072], origin: [0.073, 0.015, 1.680]}}"
)


@pytest.fixture(scope="session")
def composed() -> Callable[..., Experiment]:
    """The plugins of a configuration: the virtual plate from two views, and what is chosen."""

    def made(*overrides: str) -> Experiment:
        chosen = ["scene=plate", VIEWS, "target=dissertation", "signal=sine_fit"]
        chosen = ["~experiment", *chosen, "instrument=simulated", *overrides]
        return experiment(*chosen)

    return made
