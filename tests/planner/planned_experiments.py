"""Experiments for tests of plans, composed as the command does."""

from __future__ import annotations

from sldvexp.config.experiment import Experiment
from tests.composing import experiment

#: A field so coarse that its bounds take a moment.
SMALL = ("volume.shape=[9,7]", "volume.layers=3", "plan.candidates=300")


def composed(*settings: str) -> Experiment:
    """Compose an experiment, by default the plate."""
    return experiment(*settings)
