"""Configurations of this repository, composed as fast as the command composes them."""

from __future__ import annotations

from hydra._internal.utils import create_config_search_path
from hydra.types import RunMode
from omegaconf import DictConfig, open_dict

from sldvexp.config import hydra_plugin, schema
from sldvexp.config.cached_loader import RememberingLoader
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import conf_dir

hydra_plugin.install()


def part(*overrides: str) -> DictConfig:
    """Compose groups by themselves, as ``+group=choice``."""
    return _composed(None, overrides)


def experiment(*overrides: str) -> Experiment:
    """Compose an experiment, and make its plugins."""
    return schema.build(_composed("config", overrides))


def _composed(name: str | None, overrides: tuple[str, ...]) -> DictConfig:
    loader = RememberingLoader(create_config_search_path(str(conf_dir())))
    config = loader.load_configuration(name, [*overrides], RunMode.RUN)
    with open_dict(config):
        del config["hydra"]
    return config
