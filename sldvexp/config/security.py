"""Guard: a configuration file that is not the program's must not make Hydra run code.

Hydra calls what its own settings name (callbacks, launchers, loggers), before a job begins.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from sldvexp.config.refusals import NO_CODE, names_code
from sldvexp.config.sources import COMMAND_LINE, ConfigLayer, Origins, parts_of
from sldvexp.errors import UserError

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
    """Yield one configuration for every combination of choices that a sweep makes."""
    swept = [o for o in origins.choices if o.is_sweep_override()]
    lines = [line for line in origins.settings if line not in [s.input_line for s in swept]]
    values = [[f"{s.get_key_element()}={v}" for v in s.sweep_string_iterator()] for s in swept]
    for combination in product(*values):
        yield Origins(origins.arguments, [*lines, *combination])


def check_layer(layer: ConfigLayer) -> None:
    """Refuse a file that names code, or that sets more of Hydra than is harmless."""
    content = _whole(layer.package, layer.values)
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


def check_recorded(source: str, lines: Iterable[Any]) -> None:
    """Refuse recorded arguments of a command line that are more than settings of a run.

    Parameters
    ----------
    source : str
        The file that has them, for messages.
    lines : iterable
        Anyone may have written them. Hydra records only settings of the run here, never options
        and none of its own settings.

    Raises
    ------
    UserError
        At the first that is an option, no setting, a setting of Hydra's, names code, or has a
        value that is yet to be looked up.
    """
    for line in lines:
        told = f"{source}: {line!r}"
        if not isinstance(line, str) or line.startswith("-"):
            raise UserError(f"{told} is no setting of a run, as key=value is")
        try:
            setting = OverridesParser.create().parse_override(line)
        except HydraException:
            raise UserError(f"{told} is no setting of a run, as key=value is") from None
        if "${" in line:
            raise UserError(
                f"{told} refers to something that is looked up when the run begins; leave it out "
                "there and give it behind resume="
            )
        if setting.is_sweep_override():
            raise UserError(f"{told} is for a sweep, and a run has one value of each setting")
        content = _whole(setting.key_or_group, None if setting.is_delete() else setting.value())
        package = parts_of(setting.package or "")
        if "hydra" in (next(iter(content)).split("/")[0], *package[:1]):
            raise UserError(f"{told} is refused: a run's folder cannot set anything of Hydra's")
        for key in (*package, *_keys(content)):
            if names_code(key.rsplit(".", 1)[-1]):
                raise UserError(f"{told} {NO_CODE}")


def _whole(package: str, values: Any) -> Any:
    """Make the configuration in which nothing but `values` stand at a dotted place."""
    for part in reversed(parts_of(package)):
        values = {part: values}
    return values


def _keys(node: Any, path: str = "") -> Iterator[str]:
    """Yield dotted keys of all settings, those of tables before what is in them."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        full = f"{path}.{key}" if path else str(key)
        yield full
        if isinstance(value, dict | list):
            yield from _keys(value, full)
