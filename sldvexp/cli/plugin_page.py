"""Page that `sldvexp show pose=edge` prints: a plugin's purpose, source and settings."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from sldvexp.cli.list import WIDTH, origin
from sldvexp.config import docs, registry
from sldvexp.config.paths import displayed
from sldvexp.errors import UserError, nearest


def lines(group: str, node: DictConfig, file: Path | None) -> Iterator[str]:
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
