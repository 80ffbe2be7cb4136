"""What a figure shows: the groups of a run, from whatever the user has in hand.

Plugins of a run as its own file records them, for what a figure computes anew.

What a figure cannot do without, said in one sentence.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import yaml
from omegaconf import OmegaConf

from sldvexp import dataset
from sldvexp.config import registry
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import xarray as xr

#: What all figures take: an opened run.nc, the groups of a run by their path, or a sweep's dataset.
Source: TypeAlias = "xr.DataTree | Mapping[str, xr.Dataset] | xr.Dataset | str | Path"


@dataclass(frozen=True, eq=False)
class RunData:
    """The groups of a run by their path, such as ``image/1``.

    Parameters
    ----------
    groups : mapping of str to Dataset
        A sweep's dataset is under the empty path.
    attributes : mapping
        Of the root.
    folder : Path or None
        Of the run; its scan lines are there, if they were kept.
    """

    groups: Mapping[str, xr.Dataset] = field(repr=False)  # thousands of lines at a prompt
    attributes: Mapping[Any, Any] = field(default_factory=dict, repr=False)
    folder: Path | None = None

    def has(self, name: str, *variables: str) -> bool:
        """Whether there is a group with these variables."""
        return name in self.groups and all(v in self.groups[name] for v in variables)

    def below(self, parent: str) -> dict[str, xr.Dataset]:
        """Groups below another, by the rest of their path."""
        start = f"{parent}/"
        return {k.removeprefix(start): g for k, g in self.groups.items() if k.startswith(start)}

    def below_with(self, parent: str, *variables: str) -> dict[str, xr.Dataset]:
        """Those groups below another that have these variables."""
        return {k: g for k, g in self.below(parent).items() if all(v in g for v in variables)}


def shown(source: Source | RunData, folder: str | Path | None = None) -> RunData:
    """The groups of a run or a sweep.

    Parameters
    ----------
    source : DataTree, mapping of str to Dataset, Dataset, str, Path or RunData
        An opened run.nc, its path, the groups of a run by their path, or a sweep's dataset.
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
    if isinstance(source, xr.Dataset):
        return RunData({"": source}, source.attrs)
    if isinstance(source, xr.DataTree):
        found = {
            n.path.strip("/"): n.to_dataset(inherit=False) for n in source.subtree if n.has_data
        }
        path = source.root.encoding.get("source")
        where = Path(path).parent if path else None
        return RunData(found, source.root.attrs, Path(folder) if folder else where)
    return RunData(dict(source), {}, Path(folder) if folder else None)


@functools.lru_cache(maxsize=4)
def _opened(path: Path, changed: int) -> xr.DataTree:
    """A run's file, opened once: netCDF4 may crash if it is opened again before it is closed."""
    return dataset.load(path)


def one_of(name: str | None, valid: Iterable[str], figure: str, what: str) -> str:
    """The one that was asked for, or the first.

    Raises
    ------
    UserError
        If there is none of that name.
    """
    valid = list(valid)
    if name is None:
        return valid[0]
    if str(name) not in valid:
        raise UserError(f"plot: {figure}: there is no {what} {name}; {nearest(str(name), valid)}")
    return str(name)


def at_frequency(
    group: xr.Dataset, figure: str, frequency: float | None = None
) -> tuple[xr.Dataset, str]:
    """A group at one frequency, and what to call it.

    Parameters
    ----------
    group : Dataset
        With ``velocity``.
    figure : str
        For messages.
    frequency : float, Hz, optional
        The nearest that there is; without it the one of largest r.m.s. velocity.

    Returns
    -------
    group : Dataset
        Without the dimension.
    text : str
        ``197 Hz``, or empty if the run does not tell a frequency.

    Raises
    ------
    UserError
        If the frequency is not within those of the run.
    """
    if "frequency" not in group.dims:
        return group, ""
    hertz = group["frequency"].values
    if frequency is None:
        others = [d for d in group["velocity"].dims if d != "frequency"]
        index = int(np.argmax((abs(group["velocity"]) ** 2).mean(others).values))
    elif not hertz.min() <= frequency <= hertz.max():
        raise UserError(
            f"plot: {figure}: the frequencies go from {hertz.min():g} to {hertz.max():g} Hz; "
            f"{frequency:g} Hz is none of them"
        )
    else:
        index = int(np.abs(hertz - frequency).argmin())
    return group.isel(frequency=index), f"{hertz[index]:g} Hz"


def settings(run: RunData, figure: str) -> dict[str, Any]:
    """The configuration that the run's file records.

    Raises
    ------
    UserError
        If there is none, or it refers to something else: a run's file has values only.
    """
    if "config" not in run.attributes:
        raise UserError(f"plot: {figure}: needs the run's configuration; give an opened run.nc")
    text = str(run.attributes["config"])
    if "${" in text:
        raise UserError(f"plot: {figure}: the run's configuration refers to something; it must not")
    found: dict[str, Any] = as_read(text)
    return found


def as_read(text: str) -> Any:
    """What a text in YAML says; no object of a class is made, and libyaml reads if it is there."""
    return yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def plugin(run: RunData, group: str, figure: str) -> Any:
    """The plugin of one group with its settings; only registered ones can be named.

    Raises
    ------
    UserError
        If the run had none.
    """
    names = json.loads(str(run.attributes.get("plugins", "{}")))
    if group not in names:
        raise UserError(f"plot: {figure}: the run has no {group}")
    schema = registry.schema_of(registry.get(group, names[group]))
    return OmegaConf.to_object(OmegaConf.merge(schema, settings(run, figure)[group] or {}))


def require(figure: str, missing: str) -> None:
    """Refuse a figure whose data is missing.

    Parameters
    ----------
    figure : str
    missing : str
        What is missing; empty if nothing is.

    Raises
    ------
    UserError
        If anything is missing.
    """
    if missing:
        raise UserError(f"plot: {figure}: {missing}")
