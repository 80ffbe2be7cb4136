"""Copies of configurations, equal to those of OmegaConf, in a tenth to a fifth of the time.

OmegaConf copies every node by `copy.deepcopy`, metadata included, of which a composition with its
run makes tens of thousands. What a node is made of is known: its values cannot be changed, and its
metadata are types, flags and a cache.

After every merge of two tables it tells all that is in them, however deep, which table it is in:
of a composition of fifty files a quarter of the time. Here the same is told without looking up
classes, and only to what does not know it.

Text of a configuration, of which a run writes four, comes from the library in C that PyYAML has
with it on most machines, in a quarter of the time.
"""

from __future__ import annotations

import copy
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

import omegaconf.omegaconf
import yaml
from omegaconf import DictConfig, ListConfig
from omegaconf._utils import get_omega_conf_dumper
from omegaconf.base import Box
from omegaconf.nodes import ValueNode

#: What OmegaConf copies a container by.
_USUAL = {kind: kind.__deepcopy__ for kind in (DictConfig, ListConfig)}
#: How OmegaConf tells nodes what they are in.
_TOLD: Any = Box._re_parent
#: What OmegaConf writes text by, and the emitter in C, if there is one.
_WRITER: Any = get_omega_conf_dumper()
_EMITTER: Any = getattr(yaml, "CDumper", None)
#: Who uses quick copies, of which each thread may be one.
_users = 0
_counting = Lock()


@contextmanager
def quick_copies() -> Iterator[None]:
    """Let containers of OmegaConf be copied quickly while in it; it has no setting for that."""
    _count(1)
    try:
        yield
    finally:
        _count(-1)


def _count(change: int) -> None:
    global _users
    with _counting:
        _users += change
        for kind, usual in _USUAL.items():
            setattr(kind, "__deepcopy__", _deepcopy if _users else usual)  # noqa: B010
        setattr(Box, "_re_parent", _tell_parents if _users else _TOLD)  # noqa: B010
        writer = _quick_writer if _users and _EMITTER else get_omega_conf_dumper
        omegaconf.omegaconf.get_omega_conf_dumper = writer


def _quick_writer() -> Any:
    """Make what writes the same, by the emitter in C."""
    return type("QuickWriter", (_EMITTER,), {"yaml_representers": _WRITER.yaml_representers})


def _tell_parents(node: Box) -> None:
    """Tell all nodes in a container which one they are in, and let them forget its flags."""
    if type(node) not in _USUAL:
        _TOLD(node)
        return
    content = node.__dict__["_content"]
    if not isinstance(content, dict | list):  # missing, none, or refers to another one
        return
    for child in content.values() if isinstance(content, dict) else content:
        if child is None:
            continue
        state = child.__dict__
        state["_parent"] = node
        if state["_flags_cache"] is not None:
            child._invalidate_flags_cache()
        if "_content" in state:
            _tell_parents(child)


def _deepcopy(node: DictConfig | ListConfig, memo: dict[int, Any]) -> Any:
    """Copy a container, which keeps its parent as it is."""
    return _copy(node, node.__dict__["_parent"], memo)


def _copy(node: Any, parent: Any, memo: dict[int, Any]) -> Any:
    """Copy a node, to be one of `parent`."""
    kind = type(node)
    if kind in _USUAL:
        made = _like(node, parent)
        state = made.__dict__
        state["_flags_cache"] = _copied(state["_flags_cache"])
        content = state["_content"]
        if isinstance(content, dict):
            state["_content"] = {key: _copy(child, made, memo) for key, child in content.items()}
        elif isinstance(content, list):
            state["_content"] = [_copy(child, made, memo) for child in content]
        return made
    if isinstance(node, ValueNode):
        made = _like(node, parent)
        made.__dict__["_flags_cache"] = None
        return made
    held = node.__dict__["_parent"]
    try:
        node.__dict__["_parent"] = None
        made = copy.deepcopy(node, memo)
    finally:
        node.__dict__["_parent"] = held
    made.__dict__["_parent"] = parent
    return made


def _like(node: Any, parent: Any) -> Any:
    """Make a node of the same state, with metadata of its own."""
    made, about = object.__new__(type(node)), object.__new__(type(node._metadata))
    made.__dict__.update(node.__dict__)
    about.__dict__.update(node._metadata.__dict__)
    about.flags = _copied(about.flags)
    found = about.resolver_cache
    about.resolver_cache = copy.deepcopy(found) if found else defaultdict(dict)
    made.__dict__.update(_metadata=about, _parent=parent)
    return made


def _copied(flags: dict[str, Any] | None) -> dict[str, Any] | None:
    """Copy flags; `copy.copy` takes several times as long to find out how."""
    return None if flags is None else dict(flags)
