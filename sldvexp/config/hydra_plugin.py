"""Gives the root's schema to Hydra, and those of registered plugins, each when it is asked for.

Hydra's ConfigStore would need every plugin imported before anything is composed, which takes as
long as all the rest of the command's start.
"""

from __future__ import annotations

import builtins
from pathlib import Path

from hydra._internal.core_plugins import file_config_source as hydras
from hydra._internal.sources_registry import SourcesRegistry
from hydra.core.config_search_path import ConfigSearchPath, SearchPathQuery
from hydra.core.config_store import ConfigStore
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin

from sldvexp.config import registry
from sldvexp.config.experiment import FIELDS, SINGLE_GROUPS, Experiment
from sldvexp.config.paths import OTHER_ENDING, conf_dir, displayed, require_bounded, wrong
from sldvexp.errors import UserError
from sldvexp.limits import SHOWN, shown

SCHEMA = "schema"

ConfigStore.instance().store(
    name="experiment_schema", node=registry.schema_of(Experiment), provider="sldvexp"
)
#: Every group of which one plugin is chosen, with what is chosen where nothing else is said.
ConfigStore.instance().store(
    name="experiment_groups",
    node={"defaults": [{name: FIELDS[name].chosen} for name in SINGLE_GROUPS]},
    provider="sldvexp",
)


class PluginSource(ConfigSource):
    """``<group>/schema/<name>`` for every plugin, ``<group>/<name>`` for those without a file."""

    @staticmethod
    def scheme() -> str:
        return "sldvexp"

    def available(self) -> bool:
        return True

    def load_config(self, config_path: str) -> ConfigResult:
        group, name = group_and_name(config_path)
        return ConfigResult(
            provider=self.provider,
            path=self.full_path(),
            config=registry.schema_of(registry.get(group, name)),
            header={"package": None},
        )

    def is_group(self, config_path: str) -> bool:
        return config_path.strip("/").removesuffix(f"/{SCHEMA}") in registry.GROUPS

    def is_config(self, config_path: str) -> bool:
        group, name = group_and_name(config_path)
        if not registry.known(group, name):
            return False
        folders = [conf_dir(), *(package.conf for package in registry.packages() if package.conf)]
        has_file = any((folder / group / f"{name}.yaml").is_file() for folder in folders)
        return _is_schema(config_path) or not has_file

    def list(self, config_path: str, results_filter: ObjectType | None) -> builtins.list[str]:
        path = config_path.strip("/")
        group = path.removesuffix(f"/{SCHEMA}")
        if group not in registry.GROUPS:
            return []
        found = [n for n in registry.names(group) if self.is_config(f"{path}/{n}")]
        groups = [SCHEMA] if path == group else []
        if results_filter is ObjectType.CONFIG:
            return found
        return groups if results_filter is ObjectType.GROUP else sorted([*found, *groups])


class FileConfigSource(hydras.FileConfigSource):
    """Files of configuration, those of others only if they are bounded.

    In a worker of a sweep Hydra registers its own source again, and leaves one of that name as it
    is; another name it refuses.
    """

    def load_config(self, config_path: str) -> ConfigResult:
        """See `ConfigSource`."""
        file = Path(self.path, f"{config_path.removesuffix('.yaml')}.yaml")
        if file.is_file():
            require_bounded(file)
            if told := wrong(file):
                raise UserError(f"{displayed(file)}: {told}")
        try:
            return super().load_config(config_path)
        except (OverflowError, ValueError) as error:  # such as a date with month 99
            if isinstance(error, UnicodeDecodeError):
                raise
            told = shown(str(error).splitlines()[0], SHOWN)
            raise UserError(f"{displayed(file)}: has a value that cannot be read: {told}") from None

    def is_config(self, config_path: str) -> bool:
        """See `ConfigSource`; the ending .yml is none, which is told elsewhere."""
        return not config_path.endswith(OTHER_ENDING) and super().is_config(config_path)

    def list(self, config_path: str, results_filter: ObjectType | None) -> builtins.list[str]:
        """See `ConfigSource`."""
        folder = Path(self.path, config_path)
        found = super().list(config_path, results_filter) if folder.is_dir() else []
        return [n for n in found if not (folder / f"{n}{OTHER_ENDING}").is_file()]


class PluginSearchPath(SearchPathPlugin):
    """Order in which files are looked for: the user's, the program's, those of packages.

    Hydra puts the user's folder before the first source of the provider "schema".
    """

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        plugins = f"{PluginSource.scheme()}://plugins"
        search_path.prepend(provider=SCHEMA, path=plugins, anchor=SearchPathQuery("main"))
        for package in registry.packages():
            if package.conf:
                search_path.append(provider=package.name, path=f"file://{package.conf}")


def install() -> None:
    """Make Hydra ask `PluginSource`; once a process is enough, more does no harm."""
    plugins = Plugins.instance()
    for plugin in (PluginSource, PluginSearchPath):
        plugins.register(plugin)
    SourcesRegistry.instance().types[FileConfigSource.scheme()] = FileConfigSource


def others_search() -> bool:
    """Tell whether an installed package says where configurations are looked for."""
    found = Plugins.instance().discover(SearchPathPlugin)
    return any(plugin is not PluginSearchPath for plugin in found)


def _is_schema(config_path: str) -> bool:
    return config_path.strip("/").split("/")[-2:-1] == [SCHEMA]


def group_and_name(config_path: str) -> tuple[str, str]:
    """Split ``group/name`` or ``group/schema/name``, with or without ending, into the two."""
    group, _, name = config_path.strip("/").removesuffix(".yaml").rpartition("/")
    return group.removesuffix(f"/{SCHEMA}"), name
