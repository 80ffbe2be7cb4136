"""Configurations of this repository, each composed once for all tests of a process."""

from __future__ import annotations

import copy
import functools

from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, open_dict

from sldvexp.config import Origins, hydra_plugin, schema
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import conf_dir

hydra_plugin.install()


@functools.cache
def part(*overrides: str) -> DictConfig:
    """Compose groups by themselves, as ``+group=choice``; nobody changes what is given."""
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return compose(overrides=list(overrides))


@functools.cache
def _whole(overrides: tuple[str, ...]) -> DictConfig:
    config = Origins(list(overrides)).compose()
    with open_dict(config):
        del config["hydra"]
    return config


def experiment(*overrides: str) -> Experiment:
    """Compose an experiment as the command does, and make its plugins anew."""
    return schema.build(copy.deepcopy(_whole(overrides)))
