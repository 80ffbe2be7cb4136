"""Results of many runs as one dataset whose dimensions are the swept keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.runner import RUN_FILE
from sldvexp.sweep import record
from sldvexp.sweep.headlines import headlines
from sldvexp.sweep.plan import labels

#: Dimension of runs that do not fill a table of keys.
RUN = "run"


def collect(
    keys: Sequence[str],
    cells: Sequence[Sequence[str]],
    folders: Sequence[Path],
) -> xr.Dataset:
    """One dataset of all runs.

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
        cell why it is empty, if it is; results of missing cells are NaN.
    """
    records = [record.read(folder) for folder in folders]
    results = {
        i: headlines(_opened(folder / RUN_FILE))
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
    return _by_keys(xr.Dataset(stacked), columns)


def _why(found: record.Record) -> str:
    return "" if found.state.finished else f"the run is {found.state}"


def _opened(path: Path) -> xr.DataTree:
    tree = dataset.load(path)
    loaded = tree.load()
    tree.close()
    return loaded


def _stack(name: str, results: Mapping[int, dict[str, xr.DataArray]], count: int) -> xr.DataArray:
    """One headline of all runs along `RUN`; NaN where a run does not have it."""
    having = [i for i, found in results.items() if name in found]
    arrays = [results[i][name] for i in having]
    joined = xr.concat(arrays, dim=RUN, join="outer", coords="minimal", compat="override")
    return joined.assign_coords({RUN: having}).reindex({RUN: np.arange(count)}).drop_vars(RUN)


def _by_keys(table: xr.Dataset, columns: Mapping[str, list[Any]]) -> xr.Dataset:
    """The runs' dimension turned into one for each key, if the keys tell all runs apart."""
    rows = list(zip(*columns.values(), strict=True))
    if not columns or len(set(rows)) < len(rows):
        return table.assign_coords({k: (RUN, v) for k, v in columns.items()})
    if len(columns) == 1:
        (key,) = columns
        return table.rename({RUN: key}).assign_coords(dict(columns))
    order = {k: list(dict.fromkeys(v)) for k, v in columns.items()}
    table = table.assign_coords({k: (RUN, v) for k, v in columns.items()})
    unstacked = table.set_index({RUN: list(columns)}).unstack(RUN).reindex(order)
    empty = {"state": str(record.State.waiting), "reason": ""}
    for name, value in empty.items():
        unstacked[name] = unstacked[name].fillna(value)
    dims = [*columns, *(d for d in map(str, unstacked.dims) if d not in columns)]
    return unstacked.transpose(*dims)


def require_runs(folders: Sequence[Path]) -> None:
    """UserError naming the first folder that holds no run."""
    for folder in folders:
        if not (folder / RUN_FILE).is_file():
            raise UserError(f"{folder}: has no {RUN_FILE}; give folders of finished runs")
