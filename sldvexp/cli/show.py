"""`sldvexp show`: the page of an experiment or of a plugin, with every setting and its meaning."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from sldvexp.cli.list import EXPERIMENT, WIDTH, files, folders, origin
from sldvexp.config import Origins, docs, messages, registry
from sldvexp.config.docs import as_yaml
from sldvexp.config.experiment import SINGLE_GROUPS
from sldvexp.config.paths import conf_dir, displayed
from sldvexp.config.sources import ConfigLayer
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
        lines = experiment_lines(words[0], found[name], origins, _composed(origins))
    elif group in SINGLE_GROUPS:
        config = _composed(Origins(["~experiment", words[0], *options]))
        lines = plugin_lines(group, config[group], found.get(name))
    else:
        node = registry.schema_of(registry.get(group, name))
        lines = plugin_lines(group, node, None)
    print("\n".join([words[0], "", *lines]))
    return 0


def _composed(origins: Origins) -> DictConfig:
    try:
        return origins.compose()
    except Exception as error:  # Hydra's and OmegaConf's have no common base
        raise UserError(messages.of_composition(error, origins)) from error


def experiment_lines(
    choice: str, file: Path, origins: Origins, config: DictConfig
) -> Iterator[str]:
    """Yield the page, line by line.

    Parameters
    ----------
    choice : str
        ``experiment=name``.
    origins : Origins
        Of the configuration that chooses it.
    config : DictConfig
        That configuration, composed.
    """
    yield from [*docs.comment(file), ""]
    yield f"file  {displayed(file.resolve())}"
    yield from ["", "It chooses"]
    chosen = config.hydra.runtime.choices
    yield from (f"  {g}={chosen[g]}" for g in SINGLE_GROUPS if config[g] is not None)
    root = displayed(conf_dir() / "config.yaml")
    for layer in origins.layers_of_files():
        if layer.values and not layer.package and layer.source != root:
            yield from ["", f"{layer.source} sets", *_settings_of_file(layer)]
    yield from ["", f"sldvexp {choice} --cfg job shows all of what would run."]


def _settings_of_file(layer: ConfigLayer) -> Iterator[str]:
    """Yield what a file sets, a line for each setting of a plugin and each named table."""
    for key, value in layer.values.items():
        table = value.items() if isinstance(value, dict) else [("", value)]
        for name, inner in table:
            full = f"{key}.{name}".rstrip(".")
            told = _expected(inner) if key == "expect" else as_yaml(inner)
            yield docs.shortened(f"  {full}: {told}", WIDTH)


def _expected(table: dict[str, Any]) -> str:
    """Say how much an expectation compares, and with what."""
    compared = (len(table.get(kind, {})) for kind in ("published", "at_most", "at_least"))
    source = table.get("source")
    return f"{sum(compared)} compared{f' with {source}' if source else ''}"


def plugin_lines(group: str, node: DictConfig, file: Path | None) -> Iterator[str]:
    """Yield the page, line by line.

    Parameters
    ----------
    node : DictConfig
        What choosing it makes of the group.
    file : Path or None
        Its configuration file.
    """
    plugin: Any = OmegaConf.get_type(node)
    registered = registry.name_of(plugin)
    if registered is None:
        raise UserError(
            f"{displayed(file) if file else group}: has settings but no plugin; its defaults must "
            f"begin with schema/<plugin>@_here_; {nearest('', registry.names(group))}"
        )
    for paragraph in docs.description(plugin):
        yield from [*textwrap.wrap(paragraph, WIDTH), ""]
    package = origin(plugin) or f"sldvexp {version('sldvexp')}"
    yield f"plugin  {registered.partition('/')[2]}, {plugin.__module__} ({package})"
    if file:
        yield f"file    {displayed(file.resolve())}: {docs.of_file(file)}"
    yield from ["", "Settings:"]
    values: Any = OmegaConf.to_container(node, resolve=False, enum_to_str=True)
    for parameter in docs.parameters_of(plugin, values):
        yield from _setting(parameter)


def _setting(parameter: docs.Parameter) -> Iterator[str]:
    """Yield a setting as in a file, and below it what it means."""
    yield docs.shortened(f"  {parameter.key}: {parameter.value}", WIDTH)
    told = ". ".join(filter(None, [parameter.kind, parameter.meaning]))
    yield from textwrap.wrap(told, WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6)
