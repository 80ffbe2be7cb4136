"""A run's dataset as the sections of its page read it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml
from matplotlib.figure import Figure as Drawn

from sldvexp import dataset
from sldvexp.dataset import read_yaml
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.plot import figures_of


@dataclass(frozen=True)
class Subject:
    """One run.

    Attributes
    ----------
    path : Path
        Its dataset.
    attributes : mapping
        Of the dataset's root.
    groups : mapping of str to xarray.Dataset
        Groups by their path, read when they are needed.
    config : dict
        The whole configuration.
    plugins : dict of str to str
        Which plugin each configuration group has.
    tree : xarray.DataTree
        All of it, for the figures.
    """

    path: Path
    attributes: Mapping[Any, Any]
    groups: Mapping[str, xr.Dataset]
    config: dict[str, Any]
    plugins: dict[str, str]
    tree: xr.DataTree

    @cached_property
    def drawable(self) -> dict[str, Callable[..., Drawn]]:
        """The figures that can be drawn of it."""
        return figures_of(self.tree)

    def below(self, name: str) -> dict[str, xr.Dataset]:
        """The groups below one, by the rest of their path."""
        own = f"{name}/"
        return {k.removeprefix(own): g for k, g in self.groups.items() if k.startswith(own)}

    @property
    def fields(self) -> dict[str, xr.Dataset]:
        """Velocity fields by the method's name, the chosen one first."""
        found = {"field": self.groups["field"]} if "field" in self.groups else {}
        others = self.below("compare").items()
        return found | {name: g for name, g in others if "element" in g.coords}


@contextmanager
def opened(path: Path) -> Iterator[Subject]:
    """A run's file, open as long as its page is made.

    Raises
    ------
    UserError
        If it is not a run's.
    """
    with dataset.load(path) as tree:
        nodes = {node.path.strip("/"): node for node in tree.subtree}
        groups = {p: n.to_dataset() for p, n in nodes.items() if p and n.has_data}
        config, plugins = (
            _table(path, tree.attrs, *of) for of in (("config", read_yaml), ("plugins", json.loads))
        )
        yield Subject(path, tree.attrs, groups, config, plugins, tree)


def _table(path: Path, attributes: Mapping[Any, Any], name: str, loads: Any) -> dict[str, Any]:
    """A table that an attribute of the root has as text."""
    if name not in attributes:
        raise UserError(f"{path}: has no attribute {name}; it is not the file of a run")
    try:
        found = loads(str(attributes[name]))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UserError(f"{path}: {name}: cannot be read: {' '.join(str(error).split())}") from None
    if not isinstance(found, dict):
        raise UserError(f"{path}: {name}: must be a table")
    return found
