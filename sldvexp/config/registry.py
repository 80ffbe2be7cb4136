"""Old place of `register`, from which packages of others import it.

A plugin is a dataclass whose fields are its configuration. `sldvexp.config.hydra_plugin` gives it
to
Hydra as ``<group>/schema/<name>``, which the files in ``conf/`` extend, and as ``<group>/<name>``
where there is no such file.
"""

from __future__ import annotations

import copy
import functools
import importlib
import sys
import warnings
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from enum import Enum
from importlib import metadata
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from omegaconf import DictConfig, OmegaConf

from sldvexp.config.experiment import FIELDS
from sldvexp.errors import ConfigError, Problem, UserError, nearest, words_of

ENTRY_POINTS = "sldvexp.plugins"

#: The built-in plugins of every group and the modules that register them.
BUILT_IN: dict[str, dict[str, str]] = {}
for _group in FIELDS.values():
    BUILT_IN.setdefault(_group.name, {}).update(_group.plugins)

GROUPS = tuple(BUILT_IN)

_plugins: dict[str, dict[str, type]] = {}

P = TypeVar("P", bound=type)


class PluginWarning(UserWarning):
    """A plugin of an installed package cannot be used."""


@dataclass(frozen=True)
class Package:
    """An installed package that has plugins.

    Parameters
    ----------
    name, version : str
    conf : Path or None
        Its folder of configuration files, ``conf`` beside the module that registers the plugins.
    """

    name: str
    version: str
    conf: Path | None


#: The packages that were looked for plugins, each with those it registered.
_packages: list[tuple[Package, list[type]]] = []


def register(group: str, name: str) -> Callable[[P], P]:
    """Make a dataclass known as `name` in a configuration group, as a decorator.

    Parameters
    ----------
    group : str
        One of `GROUPS`.
    name : str
        What a configuration selects, as in ``reconstruction=contravariant``.

    Raises
    ------
    UserError
        If there is no such group, or another class already has that name.
    """
    if group not in BUILT_IN:
        raise UserError(f"there is no group {group} for {name}; {nearest(group, BUILT_IN)}")

    def add(cls: P) -> P:
        first = _plugins.setdefault(group, {}).setdefault(name, cls)
        same = (first.__module__, first.__qualname__) == (cls.__module__, cls.__qualname__)
        owner = BUILT_IN.get(group, {}).get(name, first.__module__)
        if not same or owner != cls.__module__:
            if first is cls:
                del _plugins[group][name]
            raise UserError(
                f"two plugins are called {group}={name}: {owner} and {cls.__module__}; one of them "
                "must be renamed"
            )
        _take_names_of_members(cls)
        return cls

    return add


def _take_names_of_members(cls: type) -> None:
    """Let a plugin made in Python take names of enumerations' members, as configurations do.

    A text in the place of a member would equal none of them, and so decide nothing without a word.
    """

    def convert(self: Any) -> None:
        problems = []
        for name, kind in _enumerations(self.__class__).items():
            value = getattr(self, name)
            if isinstance(value, str) and value in kind.__members__:
                setattr(self, name, kind[value])
            elif value is not None and not isinstance(value, kind):
                told = f"cannot be {value}; {nearest(str(value), kind.__members__)}"
                problems.append(Problem(name, told))
        if problems:
            raise ConfigError(problems)

    checked = "__post_init__" if hasattr(cls, "__post_init__") else "__init__"
    original = getattr(cls, checked)

    @functools.wraps(original)
    def convert_and_check(self: Any, *values: Any, **named: Any) -> None:
        if checked == "__post_init__":
            convert(self)
        original(self, *values, **named)
        if checked == "__init__":
            convert(self)

    setattr(cls, checked, convert_and_check)


@functools.cache
def _enumerations(cls: type) -> dict[str, type[Enum]]:
    """Find the fields of a dataclass that are members of an enumeration, or None."""
    found = {}
    for name, hint in get_type_hints(cls).items():
        optional = get_origin(hint) in (Union, UnionType)
        kinds = [k for k in (get_args(hint) if optional else [hint]) if k is not type(None)]
        if len(kinds) == 1 and isinstance(kinds[0], type) and issubclass(kinds[0], Enum):
            found[name] = kinds[0]
    return {f.name: found[f.name] for f in fields(cls) if f.name in found}


def schema_of(cls: type) -> DictConfig:
    """Make the schema of a dataclass, in which tables of names take entries without a +."""
    return copy.deepcopy(_schema(cls))


def onto_schema(cls: type, settings: DictConfig) -> Any:
    """Merge settings onto the schema of a dataclass, which OmegaConf copies for that."""
    return OmegaConf.merge(_schema(cls), settings)


@functools.cache
def _schema(cls: type) -> DictConfig:
    """Make a schema once, since making one takes several times as long as copying it."""
    schema: DictConfig = OmegaConf.structured(cls)
    _open_tables(schema)
    return schema


def _open_tables(node: DictConfig) -> None:
    """Let tables of names take entries, also those of tables of settings."""
    for key in node:
        child = node._get_node(key)
        if isinstance(child, DictConfig) and OmegaConf.get_type(child) is dict:
            OmegaConf.set_struct(child, False)
        elif isinstance(child, DictConfig) and not child._is_none():
            _open_tables(child)


@functools.cache
def load_installed() -> bool:
    """Import the plugins of installed packages, once; a broken one only warns.

    Looking for them takes longer than everything else at the start, so it is done when a name is
    not built in.

    Returns
    -------
    bool
        Whether there are any.
    """
    _packages.clear()
    entries = metadata.entry_points(group=ENTRY_POINTS)
    for entry in entries:
        name, version = (entry.dist.name, entry.dist.version) if entry.dist else (entry.value, "")
        before = _others()
        try:
            entry.load()
            for plugin in _others(before):
                schema_of(plugin)
        except (Exception, SystemExit) as error:  # a stranger's package must not end the program
            warnings.warn(
                f"the plugin {entry.name} of the package {name} cannot be loaded: "
                f"{words_of(error)}",
                PluginWarning,
                stacklevel=2,
            )
            _forget(_others(before))
            continue
        conf = _conf_beside(entry.value.partition(":")[0])
        _packages.append((Package(name, version, conf), _others(before)))
    return bool(entries)


def looked_for_packages() -> bool:
    """Tell whether a name that is not built in was asked for in this process."""
    return load_installed.cache_info().currsize > 0


def _others(before: Collection[type] = ()) -> list[type]:
    """List the plugins that are registered by now, not built in, and were not there before."""
    registered = (p for members in _plugins.values() for p in members.values())
    return [p for p in registered if not is_built_in(p) and p not in before]


def _forget(plugins: Collection[type]) -> None:
    """Let none of a package's plugins be chosen."""
    for members in _plugins.values():
        for name in [name for name, plugin in members.items() if plugin in plugins]:
            del members[name]


def _conf_beside(module: str) -> Path | None:
    """Find the folder ``conf`` of the package that a module belongs to, if there is one."""
    package = getattr(sys.modules.get(module), "__package__", None)
    paths = getattr(sys.modules.get(package or ""), "__path__", ())
    return next((Path(p) / "conf" for p in paths if (Path(p) / "conf").is_dir()), None)


def packages() -> list[Package]:
    """List the installed packages with plugins, as far as `load_installed` has loaded them."""
    return list(dict.fromkeys(package for package, _ in _packages))


def package_of(plugin: type) -> Package | None:
    """Find the installed package that a plugin comes from, None if it is built in."""
    return next((package for package, plugins in _packages if plugin in plugins), None)


def package_at_fault(error: BaseException) -> Package | None:
    """Find the installed package whose code an error went through, None if there is none.

    If there is no such code, the package of a plugin that was asked for something on the way: what
    it gave may not be what it should.
    """
    owners = {p: package for package, plugins in _packages for p in plugins}
    modules = {p.__module__.partition(".")[0]: package for p, package in owners.items()}
    trace, ran, asked = error.__traceback__, None, None
    while owners and trace is not None:
        frame = trace.tb_frame
        top = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        ran = modules.get(top, ran)
        there = (owners[type(v)] for v in frame.f_locals.values() if type(v) in owners)
        asked = next(there, asked)
        trace = trace.tb_next
    return ran or asked


def is_built_in(plugin: type) -> bool:
    """Tell whether a plugin is this program's own."""
    return plugin.__module__.startswith(f"{__package__.partition('.')[0]}.")


def get(group: str, name: str) -> type:
    """Get the plugin class of that name, or a `UserError` that lists the valid ones."""
    if not known(group, name):
        load_installed()
    if not known(group, name):
        raise UserError(f"there is no {group}={name}; {nearest(name, names(group))}")
    if name not in _plugins.get(group, {}):
        importlib.import_module(BUILT_IN[group][name])
    return _plugins[group][name]


def known(group: str, name: str) -> bool:
    """Tell whether a plugin is built in, or of an installed package that was loaded already."""
    return name in BUILT_IN.get(group, {}) or name in _plugins.get(group, {})


def names(group: str) -> list[str]:
    """List the names of a group's plugins, sorted."""
    load_installed()
    return sorted({*BUILT_IN.get(group, {}), *_plugins.get(group, {})})


def name_of(cls: Any) -> str | None:
    """Name a registered class as ``group/name``; None for any other class."""
    for group, members in _plugins.items():
        for name, member in members.items():
            if member is cls:
                return f"{group}/{name}"
    return None
