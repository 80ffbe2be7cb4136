"""Experiments for tests of plans, composed as the command does."""

from __future__ import annotations

from omegaconf import open_dict

from sldvexp.config import Origins, hydra_plugin, schema
from sldvexp.config.experiment import Experiment

#: A field so coarse that its bounds take a moment.
SMALL = ("volume.shape=[9,7]", "volume.layers=3", "plan.candidates=300")


def composed(*settings: str) -> Experiment:
    """Compose an experiment, by default the plate."""
    hydra_plugin.install()
    config = Origins(list(settings)).compose()
    with open_dict(config):
        del config["hydra"]
    return schema.build(config)
