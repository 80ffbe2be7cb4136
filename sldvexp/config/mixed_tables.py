"""Tables that have a user's own entries beside those of an example, which nobody may have meant.

Hydra merges tables: views ``a`` and ``b`` of a user's scene come to the five of the example's. An
entry that has a name of the example's changes it; one of another name is beside all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import is_dataclass
from typing import Any

from omegaconf import DictConfig, OmegaConf

from sldvexp.config.sources import NOTHING, Origins


def mixed_tables(config: DictConfig, origins: Origins) -> Iterator[str]:
    """Say of each such table which entries are the example's, and how they are left out.

    Parameters
    ----------
    config : DictConfig
        The composed configuration.
    origins : Origins
        Of its settings.
    """
    # Files are composed again, which takes as long as it did, only where they can matter.
    given = origins.layers() if origins.may_have_others else origins.of_line
    users = [layer for layer in given if layer.of_user]
    candidates = [
        (key, table)
        for key, table in _tables(config, "")
        if any(layer.value(key) is not NOTHING for layer in users)
    ]
    layers = origins.layers() if candidates else []
    for key, table in candidates:
        examples, own = [], []
        for name in map(str, table):
            by = [x for x in layers if x.value(f"{key}.{name}") is not NOTHING]
            if by and all(layer.of_user for layer in by):
                own.append(name)
            elif by and not any(layer.of_user for layer in by):
                examples.append((name, by[-1].source))
        if examples and own:
            name, file = examples[0]
            yield (
                f"{key}: {', '.join(n for n, _ in examples)} come from {file}, beside "
                f"{', '.join(own)} of yours; ~{key}.{name} leaves one out"
            )


def _tables(node: Any, path: str) -> Iterator[tuple[str, DictConfig]]:
    """Yield the tables of a configuration whose entries a user names, with their dotted keys."""
    if not isinstance(node, DictConfig) or node._is_none() or node._is_missing():
        return
    if OmegaConf.get_type(node) is dict and is_dataclass(node._metadata.element_type):
        yield path, node
    for key, value in node.items_ex(resolve=False):
        yield from _tables(value, f"{path}.{key!s}" if path else str(key))
