"""Configurations of this repository, composed as fast as the command composes them."""

from __future__ import annotations

from pathlib import Path

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


def experiment(*overrides: str, config_dir: str | Path | None = None) -> Experiment:
    """Compose an experiment, with files of one's own folder too, and make its plugins."""
    return schema.build(config(*overrides, config_dir=config_dir))


def config(*overrides: str, config_dir: str | Path | None = None) -> DictConfig:
    """Compose an experiment whose plugins are not made yet."""
    return _composed("config", overrides, config_dir)


def _composed(
    name: str | None, overrides: tuple[str, ...], config_dir: str | Path | None = None
) -> DictConfig:
    path = create_config_search_path(str(conf_dir()))
    if config_dir is not None:
        path.prepend("command-line", f"file://{config_dir}")
    loader = RememberingLoader(path)
    composed = loader.load_configuration(name, [*overrides], RunMode.RUN)
    with open_dict(composed):
        del composed["hydra"]
    return composed
