"""Names to plugins, one namespace per configuration group.

A plugin is a dataclass whose fields are its configuration. `sldvexp.config_source` gives it to
Hydra as ``<group>/schema/<name>``, which the files in ``conf/`` extend, and as ``<group>/<name>``
where there is no such file.
"""

from __future__ import annotations

import functools
import importlib
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

from omegaconf import DictConfig, OmegaConf

from sldvexp.errors import UserError, nearest

ENTRY_POINTS = "sldvexp.plugins"

#: The built-in plugins of every configuration group and the modules that register them. A module is
#: imported when one of its plugins is chosen.
BUILT_IN: dict[str, dict[str, str]] = {
    "target": {
        "circles": "sldvexp.target.circles",
        "points": "sldvexp.target.points",
    },
    "laser": {"two_mirror": "sldvexp.laser.two_mirror"},
    "scene": {
        "calibration": "sldvexp.virtual_lab.scene_calibration",
        "plate": "sldvexp.virtual_lab.scene_plate",
    },
    "scan": {"calibration": "sldvexp.scan.calibration"},
    "instrument": {
        "file": "sldvexp.instrument.file",
        "replay": "sldvexp.instrument.replay",
        "simulated": "sldvexp.virtual_lab.simulated",
        "visa": "sldvexp.instrument.visa",
    },
    "signal": {"sine_fit": "sldvexp.signal.sine_fit"},
    "pose": {
        "bitangent": "sldvexp.pose.bitangent",
        "digitizer": "sldvexp.pose.digitizer",
        "edge": "sldvexp.pose.edge",
        "given": "sldvexp.pose.given",
        "manual": "sldvexp.pose.manual",
        "registration": "sldvexp.pose.registration",
    },
    "reconstruction": {
        "absolute": "sldvexp.reconstruction.absolute",
        "combined": "sldvexp.reconstruction.combined",
        "contravariant": "sldvexp.reconstruction.contravariant",
        "relative": "sldvexp.reconstruction.relative",
    },
    "check": {
        "bitangents": "sldvexp.check.bitangents",
        "cross_ratio": "sldvexp.check.cross_ratio",
        "pose_equivalence": "sldvexp.check.pose_equivalence",
        "pose_repeats": "sldvexp.check.pose_repeats",
        "printed": "sldvexp.check.printed",
        "repeatability": "sldvexp.check.repeatability",
    },
}

GROUPS = tuple(BUILT_IN)

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
    if not known(group, name):
        load_installed()
    if not known(group, name):
        raise UserError(f"there is no {group}={name}; {nearest(name, names(group))}")
    if name not in _plugins.get(group, {}):
        importlib.import_module(BUILT_IN[group][name])
    return _plugins[group][name]


def known(group: str, name: str) -> bool:
    """Whether a plugin is built in, or of an installed package that was loaded already."""
    return name in BUILT_IN.get(group, {}) or name in _plugins.get(group, {})


def names(group: str) -> list[str]:
    """The names of a group's plugins, sorted."""
    load_installed()
    return sorted({*BUILT_IN.get(group, {}), *_plugins.get(group, {})})


def name_of(cls: Any) -> str | None:
    """``group/name`` of a registered class, None for any other class."""
    for group, members in _plugins.items():
        for name, member in members.items():
            if member is cls:
                return f"{group}/{name}"
    return None
