"""Names to plugins, one namespace per configuration group.

A plugin is a dataclass whose fields are its configuration. Registering it puts it into this table
and into Hydra's ConfigStore as ``<group>/schema/<name>``, which the files in ``conf/`` extend. A
plugin of another package, which has no file there, is stored as ``<group>/<name>`` too.
"""

from __future__ import annotations

import functools
import importlib
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf

from sldvexp.errors import UserError, nearest

ENTRY_POINTS = "sldvexp.plugins"

#: The configuration groups that hold plugins.
GROUPS = (
    "target",
    "laser",
    "scene",
    "scan",
    "instrument",
    "signal",
    "pose",
    "reconstruction",
    "check",
)

#: The modules that register the built-in plugins. None of them imports anything heavy.
BUILT_IN = (
    "sldvexp.target.circles",
    "sldvexp.target.points",
    "sldvexp.laser.two_mirror",
    "sldvexp.virtual_lab.scene_calibration",
    "sldvexp.virtual_lab.scene_plate",
    "sldvexp.scan.calibration",
    "sldvexp.instrument.file",
    "sldvexp.instrument.visa",
    "sldvexp.virtual_lab.simulated",
    "sldvexp.signal.sine_fit",
    "sldvexp.pose.registration",
    "sldvexp.pose.bitangent",
    "sldvexp.pose.edge",
    "sldvexp.pose.digitizer",
    "sldvexp.pose.given",
    "sldvexp.reconstruction.absolute",
    "sldvexp.reconstruction.relative",
    "sldvexp.reconstruction.combined",
    "sldvexp.reconstruction.contravariant",
    "sldvexp.check.bitangents",
    "sldvexp.check.cross_ratio",
    "sldvexp.check.pose_equivalence",
    "sldvexp.check.pose_repeats",
    "sldvexp.check.printed",
)

_plugins: dict[str, dict[str, type]] = {}

P = TypeVar("P", bound=type)


def register(group: str, name: str) -> Callable[[P], P]:
    """Class decorator: make a dataclass known as `name` in a configuration group.

    Parameters
    ----------
    group : str
        One of `GROUPS`.
    name : str
        What a configuration selects, as in ``reconstruction=contravariant``.

    Raises
    ------
    UserError
        If another class already has that name.
    """

    def add(cls: P) -> P:
        known = _plugins.setdefault(group, {}).setdefault(name, cls)
        if (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise UserError(
                f"two plugins are called {group}={name}: {known.__module__} and {cls.__module__}; "
                "one of them must be renamed"
            )
        store = ConfigStore.instance()
        schema = schema_of(cls)
        store.store(group=f"{group}/schema", name=name, node=schema, provider="sldvexp")
        if not cls.__module__.startswith("sldvexp."):
            store.store(group=group, name=name, node=schema, provider=cls.__module__)
        return cls

    return add


def schema_of(cls: type) -> DictConfig:
    """The schema of a dataclass, in which entries can be added to tables of names without a +."""
    schema: DictConfig = OmegaConf.structured(cls)
    for key in schema:
        child = schema._get_node(key)
        if isinstance(child, DictConfig) and OmegaConf.get_type(child) is dict:
            OmegaConf.set_struct(child, False)
    return schema


def load() -> None:
    """Import the built-in plugins."""
    for module in BUILT_IN:
        importlib.import_module(module)


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
    from importlib.metadata import entry_points

    entries = entry_points(group=ENTRY_POINTS)
    for entry in entries:
        try:
            entry.load()
        except Exception as error:  # a stranger's package must not take the program down
            package = entry.dist.name if entry.dist else entry.value
            warnings.warn(
                f"the plugin {entry.name} of the package {package} cannot be loaded: "
                f"{type(error).__name__}: {error}",
                stacklevel=2,
            )
    return bool(entries)


def get(group: str, name: str) -> type:
    """The plugin class of that name, or a `UserError` that lists the valid ones."""
    load()
    if name not in _plugins.get(group, {}):
        load_installed()
    try:
        return _plugins[group][name]
    except KeyError:
        raise UserError(f"there is no {group}={name}; {nearest(name, names(group))}") from None


def names(group: str) -> list[str]:
    """The names of a group's plugins, sorted."""
    load()
    load_installed()
    return sorted(_plugins.get(group, {}))


def name_of(cls: Any) -> str | None:
    """``group/name`` of a registered class, None for any other class."""
    for group, members in _plugins.items():
        for name, member in members.items():
            if member is cls:
                return f"{group}/{name}"
    return None
