"""Values in configuration files that would be the same if the file did not give them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.base import Node

from sldvexp.config import hydra_plugin, registry
from sldvexp.config.paths import conf_dir
from sldvexp.config.schema import NAMED_GROUPS, Expectation
from sldvexp.config.sources import Origins

EXPERIMENT = "experiment"

#: The names that lead to a value, from the outside in.
Key = tuple[Any, ...]


def configuration_files(conf: Path) -> list[Path]:
    """List the files of a folder such as ``conf/`` that set up a plugin or an experiment.

    Profiles of instruments and matrices of runs set up neither.
    """
    groups = (*registry.GROUPS, EXPERIMENT)
    return sorted(file for group in groups for file in (conf / group).rglob("*.yaml"))


def repeated_defaults(file: Path, conf: Path | None = None) -> list[str]:
    """List the dotted keys that a file gives the values they have without it.

    What the file builds on counts with its own files, so that a preset may return from them to the
    plugin's default. In a table of named entries, such as modes with a frequency and a damping
    each, an entry may give a default if another entry gives a different value for the same key.

    Parameters
    ----------
    file : Path
        In `conf`.
    conf : Path, optional
        A folder that comes before the program's own.
    """
    own = yaml.safe_load(file.read_text(encoding="utf-8")) or {}
    own.pop("defaults", None)
    name = file.relative_to(conf or conf_dir()).with_suffix("").as_posix()
    group, _, choice = name.partition("/")
    is_experiment = group == EXPERIMENT
    loader = _loader(conf)
    choices = [f"{group}={choice}", *([] if is_experiment else [f"~{EXPERIMENT}"])]
    parts = [
        part
        for part in loader.compute_defaults_list("config", choices, RunMode.RUN).defaults
        if str(part.config_path).partition("/")[0] not in ("hydra", "config")  # none of a plugin
    ]
    complete, without = (
        _typed(loader._compose_config_from_defaults_list(chosen, loader.repository))
        for chosen in (parts, [part for part in parts if part.config_path != name])
    )
    if not is_experiment:
        own = {group: own} if own else {}
    return [".".join(map(str, key)) for key in _repeated(own, complete, without)]


@cache
def _loader(conf: Path | None) -> ConfigLoaderImpl:
    """Make a loader, which reads every file once."""
    hydra_plugin.install()
    return Origins(["--config-dir", str(conf)] if conf else []).loader


def _typed(config: DictConfig) -> DictConfig:
    """Merge the entries of `compare`, `check`, `expect`... onto the schemas they have in a run."""
    for key, group in (*NAMED_GROUPS.items(), ("expect", "")):
        for name, entry in config[key].items_ex(resolve=False):
            schema = registry.get(group, entry.plugin) if group else Expectation
            settings = OmegaConf.masked_copy(entry, [k for k in entry if k != "plugin"])
            config[key][name] = OmegaConf.merge(OmegaConf.structured(schema), settings)
    return config


def _repeated(own: dict[Any, Any], complete: DictConfig, without: Node | None) -> Iterator[Key]:
    """Find the values of a file that are the same in two configurations, with and without it.

    A table that only the complete one has is compared with the defaults of its dataclass.
    """
    if not isinstance(without, DictConfig) or without._is_none():
        kind = OmegaConf.get_type(complete)
        without = OmegaConf.structured(kind) if is_dataclass(kind) else OmegaConf.create()
    below: dict[Any, list[Key]] = {}
    for key, value in own.items():
        here, default = (t._get_node(key, validate_access=False) for t in (complete, without))
        if here is not None and default is not None and _plain(here) == _plain(default):
            below[key] = list(_leaves(value))
        elif isinstance(here, DictConfig) and isinstance(value, dict):
            below[key] = list(_repeated(value, here, default))
    if is_dataclass(complete._metadata.element_type):
        differing = {k for key in own for k in _leaves(own[key]) if k not in below.get(key, ())}
        below = {key: [k for k in keys if k not in differing] for key, keys in below.items()}
    for key, keys in below.items():
        yield from ((key, *k) for k in keys)


def _leaves(value: Any) -> Iterator[Key]:
    """List the keys of single values; a list counts as one, and so does what is empty."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from ((key, *k) for k in _leaves(inner))
    else:
        yield ()


def _plain(node: Any) -> Any:
    return OmegaConf.to_container(node) if OmegaConf.is_config(node) else node._value()
