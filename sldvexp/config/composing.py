"""A configuration composed and checked outside of a run, as the command would compose it."""

from __future__ import annotations

from collections.abc import Sequence

from hydra.errors import MissingConfigException
from omegaconf import DictConfig, open_dict

from sldvexp.config import hydra_plugin, messages, registry, schema, security
from sldvexp.config.experiment import Experiment
from sldvexp.config.sources import COMMAND_LINE, Origins
from sldvexp.errors import UserError


def made_from(settings: Sequence[str], config_dir: str | None = None) -> Experiment:
    """Make the plugins of settings and, if there is one, of a folder of the user's own.

    Files of that folder are held to what `sldvexp.config.security` says, as those of a run are.

    Parameters
    ----------
    settings : sequence of str
        As `sldvexp` takes them.
    config_dir : str, optional

    Raises
    ------
    UserError
        If something is wrong with them.
    """
    options = ["--config-dir", config_dir] if config_dir else []
    security.require_bounded_line(COMMAND_LINE, [*settings, *options])
    origins = Origins([*settings, *options])
    hydra_plugin.install()
    try:
        if origins.may_have_others:
            security.check(origins)
        try:
            config = origins.compose()
        except MissingConfigException:
            # Perhaps a choice of an installed package, which only now are looked for.
            if not registry.load_installed():
                raise
            config = Origins(origins.arguments).compose()
    except UserError:
        raise
    except Exception as error:  # Hydra's and OmegaConf's have no common base
        raise UserError(messages.of_composition(error, origins)) from error
    try:
        return schema.build(_without_hydra(config))
    except Exception as error:
        if told := messages.sentence(error, origins):
            raise UserError(told) from error
        raise


def _without_hydra(config: DictConfig) -> DictConfig:
    with open_dict(config):
        config.pop("hydra", None)
    return config
