"""A run as figures, checks and pages read it: its groups by path, whatever one has in hand.

An opened ``run.nc``, its path, groups in memory and a sweep's table all become a `RunData`. Groups
of a file are read when they are used.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeAlias, runtime_checkable

import yaml

from sldvexp.dataset.findings import VERDICT
from sldvexp.dataset.store import load
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.limits import load_yaml


@runtime_checkable
class Result(Protocol):
    """Result of a room on arrays, which knows the group of a run that it would be."""

    GROUP: ClassVar[str]

    def to_dataset(self) -> xr.Dataset:
        """Make that group."""


#: Variables that a sweep's dataset has of every run, besides its results.
ABOUT = ("state", "reason", VERDICT, "seconds")
#: Where the strains of compared methods lie.
COMPARED_STRAIN = "compare_strain"

#: What a run can be given as: an opened run.nc, its path, the groups of a run by their path, the
#: result of a room (a pose, a field), or a sweep's dataset.
Source: TypeAlias = "xr.DataTree | Mapping[str, xr.Dataset] | Result | xr.Dataset | str | Path"


@dataclass(frozen=True, eq=False, repr=False)
class RunData:
    """The groups of a run by their path, such as ``image/front``.

    Attributes
    ----------
    groups : mapping of str to Dataset
        A sweep's dataset is under the empty path.
    attributes : mapping
        Of the root.
    path : Path or None
        Of the run's file, if it is known.
    folder : Path or None
        Of the run; its scan lines are there, if they were kept.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> run = RunData({"image/front": group("image", {}, velocity=[0.01, 0.02j])})
    >>> run.has("image/front", "velocity"), list(run.below("image"))
    (True, ['front'])
    >>> run
    <RunData of 1 group: image/front>
    """

    groups: Mapping[str, xr.Dataset]
    attributes: Mapping[Any, Any] = field(default_factory=dict)
    path: Path | None = None
    folder: Path | None = None

    def __repr__(self) -> str:
        count = len(self.groups)
        of = f"{count} group{'s' * (count != 1)}: {', '.join(self.groups)}"
        return f"<{type(self).__name__} of {of}>"

    @classmethod
    def from_source(cls, source: Source | RunData, folder: str | Path | None = None) -> RunData:
        """Take a run or a sweep as whatever it is given.

        Parameters
        ----------
        folder : str or Path, optional
            Of the run, if `source` is not a file in it.

        Raises
        ------
        UserError
            If a path is no readable file.
        """
        if isinstance(source, RunData):
            return source
        if isinstance(source, str | Path):
            file = Path(source)
            source = _opened(file.absolute(), file.stat().st_mtime_ns if file.is_file() else 0)
        known = Path(folder) if folder else None
        if isinstance(source, Result):
            source = {source.GROUP: source.to_dataset()}
        if isinstance(source, xr.Dataset):
            return RunData({"": source}, source.attrs)
        if isinstance(source, xr.DataTree):
            nodes = {n.path.strip("/"): n for n in source.subtree if n.has_data}
            groups = {name: node.to_dataset(inherit=False) for name, node in nodes.items()}
            own = source.root.encoding.get("source")
            path = Path(own) if own else None
            return RunData(groups, source.root.attrs, path, known or (path and path.parent))
        return RunData(dict(source), {}, None, known)

    def has(self, name: str, *variables: str) -> bool:
        """Tell whether there is a group with these variables."""
        return name in self.groups and all(v in self.groups[name] for v in variables)

    def below(self, parent: str, *variables: str) -> dict[str, xr.Dataset]:
        """Find the groups below another that have these variables, by the rest of their path."""
        start = f"{parent}/"
        found = {k.removeprefix(start): g for k, g in self.groups.items() if k.startswith(start)}
        return {k: g for k, g in found.items() if all(v in g for v in variables)}

    def fields(self) -> dict[str, xr.Dataset]:
        """Find the velocity fields by name: ``field`` first, then those it is compared with."""
        own = {"field": self.groups["field"]} if self.has("field", "velocity", "element") else {}
        return own | self.below("compare", "velocity", "element")

    @functools.cached_property
    def config(self) -> dict[str, Any]:
        """The whole configuration, which the root records as YAML; UserError if it does not."""
        return self._table("config", read_yaml)

    @functools.cached_property
    def plugins(self) -> dict[str, str]:
        """The plugin that each configuration group has; UserError if the root has no such table."""
        return self._table("plugins", json.loads)

    def _table(self, name: str, loads: Callable[[str], Any]) -> dict[str, Any]:
        """Read a table that an attribute of the root has as text."""
        if name not in self.attributes:
            raise UserError(f"{self.path}: has no attribute {name}; it is not the file of a run")
        try:
            found = loads(str(self.attributes[name]))
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            told = " ".join(str(error).split())
            raise UserError(f"{self.path}: {name}: cannot be read: {told}") from None
        if not isinstance(found, dict):
            raise UserError(f"{self.path}: {name}: must be a table")
        return found


@functools.lru_cache(maxsize=4)
def _opened(path: Path, changed: int) -> xr.DataTree:
    """Open a run's file once: netCDF4 may crash if it is opened again before it is closed."""
    return load(path)


def read_yaml(text: str) -> Any:
    """Read YAML of a bounded size without making objects of classes.

    Examples
    --------
    >>> read_yaml("{noise: 1.0e-3, rows: all}")
    {'noise': 0.001, 'rows': 'all'}
    """
    return load_yaml(text)
