"""A run's configuration as its own file tells it. Files come from anyone: they are only data."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sldvexp.config import registry, security
from sldvexp.config.experiment import SINGLE_GROUPS, Experiment
from sldvexp.config.refusals import refusal
from sldvexp.config.sources import ConfigLayer
from sldvexp.errors import UserError
from sldvexp.limits import load_yaml


@dataclass(frozen=True)
class Recorded:
    """Origin of a run as its file tells it.

    Attributes
    ----------
    path : Path
        The file.
    values : dict
        The whole configuration.
    plugins : dict of str to str
        Which plugin each group has.
    inputs : dict of str to str
        Digests of the files that it read, by the names that the configuration has for them.
    packages : dict of str to str
        Versions.
    """

    path: Path
    values: dict[str, Any]
    plugins: dict[str, str]
    inputs: dict[str, str]
    packages: dict[str, str]

    def config(self) -> DictConfig:
        """Make the configuration, typed as Hydra would compose it.

        Raises
        ------
        UserError
            If it names code, or what no schema knows.
        """
        security.check_layer(ConfigLayer(str(self.path), "", self.values, outside=True))
        for key, text in _texts(self.values):
            if "${" in text:
                raise UserError(
                    f"{self.path}: config: {key} refers to something, {text}; a run's file has "
                    "values only"
                )
        config = registry.schema_of(Experiment)
        try:
            for key, value in self.values.items():
                if key in SINGLE_GROUPS and value is not None:
                    OmegaConf.update(config, key, self._plugin(key, value), merge=False)
                else:
                    OmegaConf.update(config, key, value)
        except OmegaConfBaseException as error:
            where = error.full_key or error.key
            raise UserError(f"{self.path}: config: {where} {refusal(error)}") from None
        return config

    def _plugin(self, group: str, value: Any) -> Any:
        if not isinstance(name := self.plugins.get(group), str):
            raise UserError(f"{self.path}: plugins: does not say which plugin {group} has")
        try:
            schema = registry.schema_of(registry.get(group, name))
        except UserError as error:
            raise UserError(f"{self.path}: plugins: {group}: {error}") from None
        return OmegaConf.merge(schema, value)


def read(path: Path, attributes: Mapping[Any, Any]) -> Recorded:
    """Read what the root's attributes of a run's file say.

    Parameters
    ----------
    path : Path
        Of the file, for messages.
    attributes : mapping
        Of its root, see `sldvexp.pipeline.provenance.attributes`.

    Raises
    ------
    UserError
        If one is missing or is not what it should be.
    """
    found = {}
    for name, loads in (
        ("config", load_yaml),
        ("plugins", json.loads),
        ("inputs_sha256", json.loads),
        ("packages", json.loads),
    ):
        if name not in attributes:
            raise UserError(f"{path}: has no attribute {name}; it is not the file of a run")
        try:
            found[name] = loads(str(attributes[name]))
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            told = " ".join(str(error).split())
            raise UserError(f"{path}: {name}: cannot be read: {told}") from None
        entries = found[name] if isinstance(found[name], dict) else {0: 0}
        if not all(isinstance(key, str) for key in entries):
            raise UserError(f"{path}: {name}: must be a table of names")
    return Recorded(path, *found.values())


def _texts(node: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Yield every text of a configuration, keys among them, with its dotted key."""
    if isinstance(node, str):
        yield path, node
    elif isinstance(node, dict | list):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            full = f"{path}.{key}" if path else str(key)
            yield full, str(key)
            yield from _texts(value, full)
