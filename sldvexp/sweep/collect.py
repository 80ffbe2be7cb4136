"""Results of many runs as one dataset whose dimensions are the swept keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from math import nan, prod
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.config.paths import RUN_FILE
from sldvexp.lazy import xarray as xr
from sldvexp.sweep import record
from sldvexp.sweep.headlines import PARENTS, headlines
from sldvexp.sweep.plan import labels
from sldvexp.sweep.ranking import FOLDER

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
    results = {
        i: _headlines(folder / RUN_FILE)
        for i, (folder, r) in enumerate(zip(folders, records, strict=True))
        if r.state.finished and (folder / RUN_FILE).is_file()
    }
    names = list(dict.fromkeys(name for found in results.values() for name in found))
    stacked: dict[str, xr.DataArray] = {n: _stack(n, results, len(cells)) for n in names}
    stacked |= {
        "state": xr.DataArray([str(r.state) for r in records], dims=RUN),
        "reason": xr.DataArray([r.reason or _why(r) for r in records], dims=RUN),
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


def _headlines(path: Path) -> dict[str, xr.DataArray]:
    """Read a run's headlines, without its images and samples."""
    return headlines(dataset.load_some(path, PARENTS))


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
    empty = {"state": str(record.State.waiting), "reason": "not among the runs"}
    for name, value in empty.items():
        unstacked[name] = unstacked[name].fillna(value)
    unstacked = unstacked.assign_coords({FOLDER: unstacked[FOLDER].fillna("")})
    dims = [*columns, *(d for d in map(str, unstacked.dims) if d not in columns)]
    return unstacked.transpose(*dims)
