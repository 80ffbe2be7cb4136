"""Which packaged choice a stage's settings are, where several choices share a plugin."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sldvexp.config import docs
from sldvexp.config.paths import conf_dir
from sldvexp.dataset import read_yaml


def preset(group: str, plugin: str, values: Mapping[str, Any]) -> tuple[str, str]:
    """Name and first sentence of a choice that builds on the plugin's own; empty if it is none.

    Parameters
    ----------
    group, plugin : str
    values : mapping
        The stage's settings. They have all that the choice sets, such as ``rows: all``.
    """
    for file in sorted((conf_dir() / group).glob("*.yaml")):
        own = read_yaml(file.read_text(encoding="utf-8")) or {}
        defaults = own.pop("defaults", [])
        if own and _root(file, defaults) == plugin and _has(values, own):
            return file.stem, docs.of_file(file)
    return "", ""


def _root(file: Path, defaults: list[Any]) -> str:
    """The choice at the root of those that a file builds on; empty if it builds on a schema."""
    found = ""
    while based := [d for d in defaults if isinstance(d, str) and d.isidentifier() and d[0] != "_"]:
        found = based[0]
        defaults = read_yaml(file.with_stem(found).read_text(encoding="utf-8")).get("defaults", [])
    return found


def _has(values: Any, own: Any) -> bool:
    """Whether settings are among others."""
    if isinstance(own, Mapping) and isinstance(values, Mapping):
        return all(key in values and _has(values[key], each) for key, each in own.items())
    return bool(values == own)
