"""`sldvexp show group=name`: what a choice is, what it sets, and what each setting means."""

from __future__ import annotations

from omegaconf import DictConfig

from sldvexp.cli import experiment_page, plugin_page
from sldvexp.cli.list import EXPERIMENT, files, folders
from sldvexp.config import Origins, messages, registry
from sldvexp.config.experiment import SINGLE_GROUPS
from sldvexp.errors import UserError, nearest


def run(words: list[str], config_dir: str | None) -> int:
    """Print the page about one choice.

    Raises
    ------
    UserError
        If the words are not one choice of a group, or its files cannot be composed.
    """
    if len(words) != 1 or "=" not in words[0]:
        told = f", not {' '.join(words)}" if words else ""
        raise UserError(
            f"command line: show takes one group=name, as in reconstruction=absolute{told}; "
            "sldvexp list lists them"
        )
    group, _, name = words[0].partition("=")
    groups = (*registry.GROUPS, EXPERIMENT)
    if group not in groups:
        raise UserError(f"command line: there is no group {group}; {nearest(group, groups)}")
    found = files(group, folders(config_dir))
    choices = {*found, *registry.names(group)}
    if name not in choices:
        raise UserError(f"command line: there is no {group}={name}; {nearest(name, choices)}")
    options = ["--config-dir", config_dir] if config_dir else []
    if group == EXPERIMENT:
        origins = Origins([words[0], *options])
        lines = experiment_page.lines(words[0], found[name], origins, _composed(origins))
    elif group in SINGLE_GROUPS:
        config = _composed(Origins(["~experiment", words[0], *options]))
        lines = plugin_page.lines(group, config[group], found.get(name))
    else:
        node = registry.schema_of(registry.get(group, name))
        lines = plugin_page.lines(group, node, None)
    print("\n".join([words[0], "", *lines]))
    return 0


def _composed(origins: Origins) -> DictConfig:
    try:
        return origins.compose()
    except Exception as error:  # Hydra's and OmegaConf's have no common base
        raise UserError(messages.of_composition(error, origins)) from error
