"""Page that `sldvexp show experiment=plate` prints: what it chooses, sets and expects."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from sldvexp.cli.list import WIDTH
from sldvexp.config import Origins, docs
from sldvexp.config.docs import as_yaml
from sldvexp.config.experiment import SINGLE_GROUPS
from sldvexp.config.paths import conf_dir, displayed
from sldvexp.config.sources import ConfigLayer


def lines(choice: str, file: Path, origins: Origins, config: DictConfig) -> Iterator[str]:
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
            yield from ["", f"{layer.source} sets", *_settings(layer)]
    yield from ["", f"sldvexp {choice} --cfg job shows all of what would run."]


def _settings(layer: ConfigLayer) -> Iterator[str]:
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
