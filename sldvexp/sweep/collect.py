"""Collect the runs of a sweep into one dataset.

Of each run its headlines are taken: the few numbers that a comparison of runs looks at.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import nan, prod
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.check.field_pattern import OUT_OF_PLANE
from sldvexp.config.paths import RUN_FILE
from sldvexp.dataset import VERDICT
from sldvexp.dataset.run_data import RunData
from sldvexp.lazy import xarray as xr
from sldvexp.sweep import record
from sldvexp.sweep.plan import labels

#: Coordinate of every run: its folder, in a file from there.
FOLDER = "folder"
#: Dimension of runs that do not fill a table of keys.
RUN = "run"
#: A table of keys has at most so many cells a run.
MOST_EMPTY = 1.5


def collect(
    keys: Sequence[str],
    cells: Sequence[Sequence[str]],
    folders: Sequence[Path],
) -> xr.Dataset:
    """Collect all runs into one dataset.

    Parameters
    ----------
    keys : sequence of str
        What was swept.
    cells : sequence of sequence of str
        Values of the keys, one row a run.
    folders : sequence of Path
        Of the runs, in the same order; they need not exist.

    Returns
    -------
    xarray.Dataset
        Dimensions are the keys, then those of each result. ``state`` and ``reason`` say for every
        cell why it is empty, if it is; results of missing cells are NaN. The coordinate ``folder``
        says where each run lies.
    """
    records = [_record(folder) for folder in folders]
    runs = {
        i: RunHeadlines.from_file(folder / RUN_FILE)
        for i, (folder, r) in enumerate(zip(folders, records, strict=True))
        if r.state.finished and (folder / RUN_FILE).is_file()
    }
    results = {i: run.numbers for i, run in runs.items()}
    verdicts = {i: run.verdict for i, run in runs.items()}
    names = list(dict.fromkeys(name for found in results.values() for name in found))
    stacked: dict[str, xr.DataArray] = {n: _stack(n, results, len(cells)) for n in names}
    stacked |= {
        "state": xr.DataArray([str(r.state) for r in records], dims=RUN),
        "reason": xr.DataArray([r.reason or _why(r) for r in records], dims=RUN),
        VERDICT: xr.DataArray([verdicts.get(i, "") for i in range(len(cells))], dims=RUN),
        "seconds": xr.DataArray([r.seconds for r in records], dims=RUN, attrs={"units": "s"}),
    }
    columns = {k: labels([c[j] for c in cells]) for j, k in enumerate(keys)}
    whole = xr.Dataset(stacked, {FOLDER: (RUN, [str(folder) for folder in folders])})
    return _by_keys(whole, columns)


def _record(folder: Path) -> record.Record:
    """Read the record of a run; what its file tells, if it was none of a sweep's."""
    found = record.read(folder)
    path = folder / RUN_FILE
    if found.state is not record.State.waiting or not path.is_file():
        return found
    with dataset.load(path) as tree:
        met = "check" not in tree.children or bool(tree["check"].to_dataset()["passed"].all())
        begun, ended = (datetime.fromisoformat(tree.attrs[f"{k}_time"]) for k in ("start", "end"))
    state = record.State.done if met else record.State.missed
    took = (ended - begun).total_seconds()  # by the calendar's clock, which may be set back
    return record.Record(state, seconds=took if took >= 0 else nan)


def _why(found: record.Record) -> str:
    why = {record.State.running: "the run was cut off", record.State.waiting: "not begun"}
    return why.get(found.state, "")


def _stack(name: str, results: Mapping[int, dict[str, xr.DataArray]], count: int) -> xr.DataArray:
    """Stack one headline of all runs along `RUN`; NaN where a run does not have it."""
    having = [i for i, found in results.items() if name in found]
    arrays = [results[i][name] for i in having]
    joined = xr.concat(arrays, dim=RUN, join="outer", coords="minimal", compat="override")
    return joined.assign_coords({RUN: having}).reindex({RUN: np.arange(count)}).drop_vars(RUN)


def _by_keys(table: xr.Dataset, columns: Mapping[str, list[Any]]) -> xr.Dataset:
    """Turn the runs' dimension into one for each key, if the keys tell all runs apart."""
    rows = list(zip(*columns.values(), strict=True))
    cells = prod(len(set(v)) for v in columns.values())
    if not columns or len(set(rows)) < len(rows) or cells > MOST_EMPTY * len(rows):
        return table.assign_coords({k: (RUN, v) for k, v in columns.items()})
    if len(columns) == 1:
        (key,) = columns
        return table.rename({RUN: key}).assign_coords(dict(columns))
    order = {k: list(dict.fromkeys(v)) for k, v in columns.items()}
    table = table.assign_coords({k: (RUN, v) for k, v in columns.items()})
    unstacked = table.set_index({RUN: tuple(columns)}).unstack(RUN).reindex(order)
    empty = {"state": str(record.State.waiting), "reason": "not among the runs", VERDICT: ""}
    for name, value in empty.items():
        unstacked[name] = unstacked[name].fillna(value)
    unstacked = unstacked.assign_coords({FOLDER: unstacked[FOLDER].fillna("")})
    dims = [*columns, *(d for d in map(str, unstacked.dims) if d not in columns)]
    return unstacked.transpose(*dims)


#: Variables of each group, and its attributes behind an @; dimensions such as view are kept.
HEADLINES: dict[str, tuple[str, ...]] = {
    "pose": ("s", "sse", "origin_std", "euler_std"),
    "point": ("velocity", "velocity_std", "sse", "s", "rcond", "efficiency"),
    "field": (
        *("@residual_std", "@sse", "@cond", "@rcond", "@dof", "@samples"),
        "residual_std_by_view",
    ),
    "check": ("@passed", "@quantities"),
}


#: Groups that headlines are in, or in groups below them.
PARENTS = (*HEADLINES, "examined", "compare")
#: A headline has at most so many numbers: points or frequencies by the thousand are no headline.
MOST_NUMBERS = 100


@dataclass(frozen=True, eq=False)
class RunHeadlines:
    """Numbers of a run that a comparison looks at, and its verdict; empty if it has none."""

    numbers: dict[str, xr.DataArray]
    verdict: str

    @classmethod
    def from_groups(cls, groups: Mapping[str, xr.Dataset]) -> RunHeadlines:
        """Pick them from the groups of a run by their path."""
        found = {name: array.copy() for name, array in headlines(groups).items()}
        verdict = str(groups[VERDICT].attrs[VERDICT]) if VERDICT in groups else ""
        return cls(found, verdict)

    @classmethod
    def from_file(cls, path: Path) -> RunHeadlines:
        """Read them, unless this process made the file and knows them."""
        if known := _known.get(_state(path)):
            return known
        tree = dataset.load_some(path, (*PARENTS, VERDICT))
        return cls.from_groups({n.path.strip("/"): n.to_dataset() for n in tree.subtree})

    def keep(self, path: Path) -> None:
        """Keep them for the end of a sweep, as those of the run's file."""
        if sum(len(run.numbers) for run in _known.values()) < MOST_KEPT:
            _known[_state(path)] = self


#: Headlines that are kept, some 100 MB of them.
MOST_KEPT = 30_000
#: Of files that this process made.
_known: dict[tuple[int, ...], RunHeadlines] = {}


def _state(path: Path) -> tuple[int, ...]:
    """Tell a file from others, and from what it was."""
    found = path.stat()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def headlines(groups: Mapping[str, xr.Dataset]) -> dict[str, xr.DataArray]:
    """Pick the headlines of one run.

    Parameters
    ----------
    groups : mapping of str to xarray.Dataset
        Of the run, by their path.

    Returns
    -------
    dict of str to xarray.DataArray
        ``pose.s``, ``field.residual_std``, ``examined.truth.error`` and so on.
    """
    return {name: array for name, array in _all(groups) if array.size <= MOST_NUMBERS}


def _all(groups: Mapping[str, xr.Dataset]) -> Iterator[tuple[str, xr.DataArray]]:
    for group, names in HEADLINES.items():
        if group in groups:
            yield from _of_group(groups[group], group, names)
    if "field" in groups:
        yield from _of_field(groups["field"], "field")
    for parent, like in (("examined", None), ("compare", "point")):
        for name, child in RunData(groups).below(parent).items():
            prefix = f"{parent}.{name}"
            if like and "element" in child.coords:
                yield from _of_group(child, prefix, HEADLINES["field"])
                yield from _of_field(child, prefix)
                continue
            wanted = HEADLINES[like] if like else tuple(map(str, child.data_vars))
            yield from _of_group(child, prefix, wanted)


def _of_group(
    group: xr.Dataset, prefix: str, names: tuple[str, ...]
) -> Iterator[tuple[str, xr.DataArray]]:
    for name in names:
        key = name.removeprefix("@")
        if name.startswith("@") and key in group.attrs:
            # pooled from the variable of its name, if there is one, and in its units
            about = group[key].attrs if key in group.data_vars else {"units": "1"}
            yield f"{prefix}.{key}", xr.DataArray(float(group.attrs[key]), attrs=about)
        elif name in group.data_vars and group[name].dtype.kind in "iufcb":
            array = group[name].load()
            kept = [c for c in array.coords if c in array.dims]
            yield f"{prefix}.{name}", array.drop_vars([c for c in array.coords if c not in kept])


def _of_field(field: xr.Dataset, prefix: str) -> Iterator[tuple[str, xr.DataArray]]:
    """Yield what Table 5.7 says by equation, and the standard errors in the surface and out of it.

    Root mean squares over frequencies, and standard errors over nodes too.
    """
    for name, combine in (("residual_std", _root_mean_square), ("sse", np.sum)):
        if name in field:
            array = field[name].load()
            others = [d for d in array.dims if d != "equation"]
            found = array.reduce(combine, others, keep_attrs=True)
            yield f"{prefix}.{name}_by_equation", found
    if "velocity_std" in field:
        std = field["velocity_std"].load()
        out = field["component"].isin(OUT_OF_PLANE)
        for name, which in (("std_in_plane", ~out), ("std_out_of_plane", out)):
            found = std.sel(component=which).reduce(_root_mean_square, keep_attrs=True)
            yield f"{prefix}.{name}", found


def _root_mean_square(values: np.ndarray, axis: int | tuple[int, ...] | None = None) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.nanmean(np.square(values), axis=axis))


def headline_number(array: xr.DataArray) -> float:
    """Reduce a headline to one number: the root mean square of its entries."""
    values = np.abs(np.asarray(array, complex)).ravel()
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
