"""Experiments for tests of plans, composed as the command does."""

from __future__ import annotations

from pathlib import Path

from sldvexp.config.experiment import Experiment
from tests.composing import experiment

#: A field so coarse that its bounds take a moment.
SMALL = ("volume.shape=[9,7]", "volume.layers=3", "plan.candidates=300")


def composed(*settings: str, config_dir: str | Path | None = None) -> Experiment:
    """Compose an experiment, by default the plate."""
    return experiment(*settings, config_dir=config_dir)
