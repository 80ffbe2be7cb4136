"""Plugins of a run as its own file records them, for what a figure computes anew."""

from __future__ import annotations

import json
from typing import Any

import yaml
from omegaconf import OmegaConf

from sldvexp.config import registry
from sldvexp.dataset.run_data import Shown
from sldvexp.errors import UserError


def settings(run: Shown, figure: str) -> dict[str, Any]:
    """The configuration that the run's file records.

    Raises
    ------
    UserError
        If there is none, or it refers to something else: a run's file has values only.
    """
    if "config" not in run.attributes:
        raise UserError(f"plot: {figure}: needs the run's configuration; give an opened run.nc")
    text = str(run.attributes["config"])
    if "${" in text:
        raise UserError(f"plot: {figure}: the run's configuration refers to something; it must not")
    found: dict[str, Any] = as_read(text)
    return found


def as_read(text: str) -> Any:
    """What a text in YAML says; no object of a class is made, and libyaml reads if it is there."""
    return yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def plugin(run: Shown, group: str, figure: str) -> Any:
    """The plugin of one group with its settings; only registered ones can be named.

    Raises
    ------
    UserError
        If the run had none.
    """
    names = json.loads(str(run.attributes.get("plugins", "{}")))
    if group not in names:
        raise UserError(f"plot: {figure}: the run has no {group}")
    schema = registry.schema_of(registry.get(group, names[group]))
    return OmegaConf.to_object(OmegaConf.merge(schema, settings(run, figure)[group] or {}))
