"""Which argument of the command line, or which file, gave a setting its value."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from hydra._internal.utils import create_config_search_path, get_args_parser
from hydra.core.config_search_path import SearchPathQuery
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import MISSING, DictConfig, OmegaConf

from sldvexp.config import paths, registry
from sldvexp.config.naming_loader import NamingLoader
from sldvexp.config.paths import conf_dir, displayed

COMMAND_LINE = "command line"
NOTHING = object()


@dataclass(frozen=True)
class ConfigLayer:
    """Contribution of one argument or one file to the configuration.

    Parameters
    ----------
    source : str
        Its name in messages.
    package : str
        Where in the configuration it is put; empty for the root.
    values : dict, list or scalar
    outside : bool
        Whether it is a file that does not belong to the program.
    """

    source: str
    package: str
    values: Any
    outside: bool = False

    @property
    def of_user(self) -> bool:
        """True if it is none of the program's, or of a package's, own files."""
        return self.outside or self.source == COMMAND_LINE

    def value(self, key: str) -> Any:
        """Find what this gives to a dotted key, `NOTHING` if it does not."""
        package, parts = parts_of(self.package), parts_of(key)
        if parts[: len(package)] != package:
            return NOTHING
        value = self.values
        for part in parts[len(package) :]:
            if isinstance(value, list):
                value = dict(enumerate(value))
            named = {str(k): v for k, v in value.items()} if isinstance(value, dict) else {}
            value = named.get(part, NOTHING)
        return value


class Origins:
    """Layers of a configuration, in the order in which later ones win.

    Parameters
    ----------
    arguments : sequence of str
        The command line without the program's name.
    settings : sequence of str, optional
        Those of one job of a sweep, instead of those of the command line.
    """

    def __init__(self, arguments: Sequence[str], settings: Sequence[str] | None = None):
        self.arguments = arguments
        self._settings = settings

    @cached_property
    def options(self) -> Namespace:
        """Command line's options."""
        return get_args_parser().parse_known_args(list(self.arguments))[0]

    @cached_property
    def settings(self) -> list[str]:
        """Arguments that are no options."""
        return list(self.options.overrides if self._settings is None else self._settings)

    @property
    def unreadable(self) -> list[str]:
        """Arguments that cannot be read as settings."""
        return [text for text in self.settings if not _read(text)]

    @cached_property
    def overrides(self) -> list[Override]:
        """Arguments that can be read as settings."""
        read = (_read(text, self.loader) for text in self.settings)
        return [override for override in read if override]

    @cached_property
    def choices(self) -> list[Override]:
        """Settings that choose from a group, and do not set a value."""
        exists = self.loader.repository.group_exists
        found = [o for o in self.overrides if exists(o.key_or_group)]
        return [o for o in found if not isinstance(o.value(), dict)]

    def where(self, key: str) -> str:
        """Name a key after the argument or file that sets it; the key alone if none is found."""
        for layer in self._last_first():
            value = layer.value(key)
            if value is not NOTHING:
                left_open = value == MISSING and layer.source != COMMAND_LINE
                return key if left_open else f"{layer.source}: {key}"
        below = (x for x in self._last_first() if x.package.startswith(f"{key}."))
        return next((f"{layer.source}: {key}" for layer in below), key)

    def layers(self) -> list[ConfigLayer]:
        """List files, then arguments that set values; later ones win."""
        return [x for x in (*self._composed, *self.of_line) if x.values is not None]

    @property
    def of_line(self) -> list[ConfigLayer]:
        """Arguments that set values; later ones win."""
        setting = (o for o in self.overrides if o not in self.choices)
        return [ConfigLayer(COMMAND_LINE, o.key_or_group, o.value()) for o in setting]

    @property
    def may_have_others(self) -> bool:
        """True if files may be in it that are neither the program's nor a package's."""
        named = any(".." in text or "hydra.searchpath" in text for text in self.settings)
        return bool(self.options.config_dir or self.options.config_name or named)

    def _last_first(self) -> Iterator[ConfigLayer]:
        """Yield arguments that set values, then files, then arguments that choose."""
        yield from reversed(self.of_line)
        yield from reversed(self._composed)
        for o in reversed(self.choices):
            yield ConfigLayer(COMMAND_LINE, o.package or o.key_or_group, None)

    @cached_property
    def _composed(self) -> list[ConfigLayer]:
        """Compose the choices as Hydra does, to be changed at will."""
        try:
            return self.layers_of_files()
        except Exception:  # the configuration is broken, which is told with better words elsewhere
            return []

    def layers_of_files(self) -> list[ConfigLayer]:
        """List the files of the composition, also those from outside."""
        defaults = self.loader.compute_defaults_list(
            self.options.config_name or "config", self.settings, RunMode.RUN
        ).defaults
        # A package's code ran when it was loaded, so that its files may name some.
        trusted = [conf_dir(), *(p.conf.resolve() for p in registry.packages() if p.conf)]
        layers = []
        for default in defaults:
            found = self.loader.repository.load_config(default.config_path or "")
            if found is None or not found.path.startswith("file://"):
                continue
            folder = Path(found.path.removeprefix("file://"))
            file = (folder / f"{default.config_path}.yaml").resolve()
            outside = not any(file.is_relative_to(belonging) for belonging in trusted)
            values = OmegaConf.to_container(found.config)
            layers.append(ConfigLayer(displayed(file), default.package or "", values, outside))
        return layers

    def compose(self) -> DictConfig:
        """Compose the composed configuration, with Hydra's own."""
        name = self.options.config_name or "config"
        return self.loader.load_configuration(name, self.settings, RunMode.RUN)

    def options_of(self, group: str) -> set[str]:
        """List what can be chosen of a group, also in folders below it."""
        found = set(self.loader.repository.get_group_options(group))
        for folder in self.folders:
            below = (folder / group).rglob("*.yaml")
            found |= {
                str(f.relative_to(folder / group).with_suffix("")) for f in below if f.is_file()
            }
        return {o for o in found if not o.startswith("schema")}

    def where_chosen(self, group: str, name: str) -> str:
        """Find the argument or the one file that chooses `name` of a group.

        Empty if none is found.
        """
        for choice in (o for o in self.choices if o.key_or_group == group):
            swept = choice.sweep_string_iterator() if choice.is_sweep_override() else []
            if name in [*swept, *paths.names(choice.value())]:
                return COMMAND_LINE
        choosing = [f for f in self.files if name in paths.choices(f).get(group, [])]
        return displayed(choosing[0]) if len(choosing) == 1 else ""

    def file_with(self, *keys: str) -> str:
        """Show the one file of others whose defaults have an item that is written so."""
        others = (f for f in self.files if not f.resolve().is_relative_to(conf_dir()))
        found = [f for f in others if any(key in keys for key, _ in paths.items(f))]
        return displayed(found[0]) if len(found) == 1 else ""

    def shown(self, path: str, ending: str = ".yaml") -> str:
        """Show the file of a configuration such as ``pose/given``, for messages; empty if none."""
        files = [folder / f"{path}{ending}" for folder in self.folders]
        return next((displayed(f.resolve()) for f in files if f.is_file()), "")

    @property
    def files(self) -> list[Path]:
        """Find the configuration files of a group by what chooses them."""
        found = (file for folder in self.folders for file in folder.rglob("*.yaml"))
        return [file for file in found if file.is_file()]

    @property
    def folders(self) -> list[Path]:
        """List where configuration files are looked for.

        The user's folder wins over the program's.
        """
        sources = self.loader.repository.get_sources()
        return [Path(source.path) for source in sources if source.scheme() == "file"]

    @cached_property
    def folders_added(self) -> list[str]:
        """Folders that the command line adds to the program's own."""
        added = [self.options.config_dir] if self.options.config_dir else []
        for override in map(_read, self.settings):
            if override and override.key_or_group == "hydra.searchpath":
                added += paths.names(override.value())
        return [a.removeprefix("file://") for a in added if "://" not in a.removeprefix("file://")]

    @cached_property
    def loader(self) -> NamingLoader:
        """Hydra's, with the folders that the command line adds."""
        path = create_config_search_path(str(conf_dir()))
        before_schema = SearchPathQuery(provider="schema")
        for folder in self.folders_added:
            path.prepend("command-line", f"file://{Path(folder).absolute()}", before_schema)
        return NamingLoader(path)


def parts_of(key: str) -> list[str]:
    """Split ``a.b[0].c`` into ``[a, b, 0, c]``."""
    return [part for part in re.split(r"\.|\[(\d+)\]\.?", key) if part]


def _read(text: str, loader: NamingLoader | None = None) -> Override | None:
    """Read an argument as a setting, None if it cannot be read as one."""
    try:
        override = OverridesParser.create(loader).parse_overrides([text])[0]
    except (HydraException, ValueError, RecursionError):  # such as a number of 5000 digits
        return None
    return override if override.key_or_group else None
