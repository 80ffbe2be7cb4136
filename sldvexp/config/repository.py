"""Reads the files and schemas of configurations as Hydra does, but each once.

A composition asks for a file several times, and one process composes several times: for the run,
for sentences about mistakes, for the jobs of a sweep. What was read is kept by the file's state, so
that a changed file is read anew; what a plugin gives, by its class.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import yaml
from hydra._internal.config_repository import ConfigRepository
from hydra.core.config_store import ConfigStore
from hydra.core.object_type import ObjectType
from hydra.plugins.config_source import ConfigResult, ConfigSource
from omegaconf import _utils
from yaml.constructor import SafeConstructor
from yaml.resolver import Resolver

from sldvexp.config import registry
from sldvexp.config.hydra_plugin import PluginSource, group_and_name
from sldvexp.config.paths import conf_dir
from sldvexp.config.schema_table import SchemaTable


def copies_of(value: Any) -> Callable[[], Any]:
    """Make what gives a new copy at every call, faster than a deep copy where that is possible."""
    try:
        content = pickle.dumps(value)
    except (pickle.PicklingError, TypeError, AttributeError):
        return lambda: deepcopy(value)  # of a class that Hydra's search for plugins has made anew
    return lambda: pickle.loads(content)


@cache
def _compiled_loader() -> type:
    """Make OmegaConf's loader of YAML, its rules included, over the parser that is compiled."""
    usual = _utils.get_yaml_loader()
    if not hasattr(yaml, "CSafeLoader"):
        return usual

    class CompiledLoader(yaml.cyaml.CParser, usual):  # type: ignore[misc, valid-type]
        def __init__(self, stream: Any):
            yaml.cyaml.CParser.__init__(self, stream)
            SafeConstructor.__init__(self)
            Resolver.__init__(self)

    return CompiledLoader


@contextmanager
def _compiled_parser() -> Iterator[None]:
    """Parse YAML ten times faster while in it; OmegaConf has no setting for its loader."""
    usual = _utils.get_yaml_loader
    _compiled_loader()  # before it is asked for in place of the usual one, which it is made of
    _utils.get_yaml_loader = _compiled_loader
    try:
        yield
    finally:
        _utils.get_yaml_loader = usual


class Memory(dict[Any, Callable[[], Any]]):
    """Memory that goes to another process with every job: empty, and fills up there."""

    def __init__(self) -> None:
        self.name = uuid4().hex

    def __reduce__(self) -> tuple[Any, ...]:
        return _of_process, (self.name,)


@cache
def _of_process(name: str) -> Memory:
    """Return the part of a memory that a process has for itself."""
    return Memory()


class Same:
    """A key that is equal where it is of the same object, which it keeps."""

    def __init__(self, it: object):
        self.it = it

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and self.it is other.it

    def __hash__(self) -> int:
        return id(self.it)


#: What was read in this process, by what is read and the state it is in.
_read: dict[tuple[object, ...], Callable[[], Any]] = {}


class RememberingRepository(ConfigRepository):
    """Hydra's files and schemas, of which every one is read once; each reader gets its own copy.

    Attributes
    ----------
    table : SchemaTable, optional
        Of which the program's own are taken, for a composition that is shown and not run.
    """

    table: SchemaTable | None = None

    def load_config(self, config_path: str) -> ConfigResult | None:
        """See `ConfigRepository`."""
        source = self._find_object_source(config_path, ObjectType.CONFIG)
        if self.table is not None and source is not None and _is_own(source, config_path):
            name = f"{source.provider} {source.full_path()} {config_path}"
            kept: ConfigResult | None = self.table.read(name, lambda: self._load(config_path))
            return kept
        state = _state(source, config_path) if source else None
        if source is None or state is None:
            return self._load(config_path)
        key = source.scheme(), source.provider, source.path, config_path, *state
        if key not in _read:
            _read[key] = copies_of(self._load(config_path))
        known: ConfigResult | None = _read[key]()
        return known

    def _load(self, config_path: str) -> ConfigResult | None:
        """Read anew."""
        try:
            with _compiled_parser():
                return super().load_config(config_path)
        except yaml.YAMLError:  # the usual parser has the better words
            return super().load_config(config_path)

    def __deepcopy__(self, memo: dict[int, Any]) -> RememberingRepository:
        """Copy the sources, which Hydra's search path may set."""
        other = RememberingRepository.__new__(RememberingRepository)
        vars(other).update({**vars(self), "sources": list(self.sources)})
        return other


def _is_own(source: ConfigSource, config_path: str) -> bool:
    """Tell whether the state of the program alone decides the content of something."""
    if isinstance(source, PluginSource):
        group, name = group_and_name(config_path)
        return name in registry.BUILT_IN.get(group, {})
    return source.scheme() == "file" and Path(source.path) == conf_dir()


def _state(source: ConfigSource, config_path: str) -> tuple[object, ...] | None:
    """Tell what decides the content of something; None where that is not known."""
    if isinstance(source, PluginSource):
        return (registry.get(*group_and_name(config_path)),)
    file = f"{config_path.removesuffix('.yaml')}.yaml"
    if source.scheme() == "file":
        about = os.stat(os.path.join(source.path, file))
        return about.st_ino, about.st_size, about.st_mtime_ns, about.st_ctime_ns
    if source.scheme() == "structured":
        return (Same(ConfigStore.instance()._load(file)),)
    return () if source.provider == "hydra" else None
