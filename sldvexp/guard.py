"""What a configuration file that does not belong to the program may not do: make Hydra run code.

Hydra calls what its own settings name (callbacks, launchers, loggers), before a job begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

from sldvexp.errors import UserError
from sldvexp.origins import COMMAND_LINE, Layer, Origins, parts_of
from sldvexp.wording import NO_CODE, names_code

#: Hydra's settings that hold no code.
HARMLESS = ("run", "sweep", "mode", "verbose", "job.name")


def check(origins: Origins) -> None:
    """Refuse files from outside that name code, in any job of a sweep.

    Raises
    ------
    UserError
        At the first such file, or folder that is not there.
    """
    for folder in origins.folders_added:
        if not Path(folder).is_dir():
            raise UserError(f"{COMMAND_LINE}: there is no folder {folder}")
    for job in _jobs(origins):
        for layer in job.layers_of_files():
            if layer.outside:
                check_layer(layer)


def _jobs(origins: Origins) -> Iterator[Origins]:
    """One configuration for every combination of choices that a sweep makes."""
    swept = [o for o in origins.choices if o.is_sweep_override()]
    lines = [line for line in origins.settings if line not in [s.input_line for s in swept]]
    values = [[f"{s.get_key_element()}={v}" for v in s.sweep_string_iterator()] for s in swept]
    for combination in product(*values):
        yield Origins(origins.arguments, [*lines, *combination])


def check_layer(layer: Layer) -> None:
    """Refuse a file that names code, or that sets more of Hydra than is harmless."""
    content = layer.values
    for part in reversed(parts_of(layer.package)):
        content = {part: content}
    if not isinstance(content, dict):
        return
    for key in _keys(content):
        if names_code(key.rsplit(".", 1)[-1]):
            raise UserError(f"{layer.source}: {key} {NO_CODE}")
    of_hydra = content.get("hydra", {})
    for key in _keys(of_hydra) if isinstance(of_hydra, dict) else [""]:
        below = any(key == h or key.startswith(f"{h}.") for h in HARMLESS)
        above = any(h.startswith(f"{key}.") for h in HARMLESS)
        if not (below or above):
            raise UserError(
                f"{layer.source}: {f'hydra.{key}'.rstrip('.')} is refused: a file that does not "
                f"belong to the program may set only these of hydra: {', '.join(HARMLESS)}"
            )


def _keys(node: Any, path: str = "") -> Iterator[str]:
    """Dotted keys of all settings, those of tables before what is in them."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        full = f"{path}.{key}" if path else str(key)
        yield full
        if isinstance(value, dict | list):
            yield from _keys(value, full)
