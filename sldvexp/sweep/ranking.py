"""Runs of a sweep in order of merit, on the terminal and as a plain table."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from sldvexp.dataset import VERDICT
from sldvexp.dataset.run_data import ABOUT
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import xarray as xr
from sldvexp.report import LARGEST, first, fitted, number
from sldvexp.sweep import collect
from sldvexp.sweep.collect import FOLDER
from sldvexp.writing import whole_or_nothing

#: What runs are ranked by unless the user says: the first of these that they have.
PREFERRED = (
    "examined.truth.relative_error",
    "field.residual_std",
    "point.velocity_std",
    "pose.s",
)
#: Of fields, the columns of Table 5.7, and how many of its units are 1 in SI.
FIELD_COLUMNS = {
    "unknowns": ("field.dof", 1),
    "rows": ("field.samples", 1),
    "residual std, mm/s": ("field.residual_std", 1000),
    "SSE": ("field.sse", 1),
    "cond": ("field.cond", 1),
    "std in plane, mm/s": ("field.std_in_plane", 1000),
    "out of plane, mm/s": ("field.std_out_of_plane", 1000),
}


def ranked_by(table: xr.Dataset, wanted: str = "") -> str:
    """Name of the headline that runs are ranked by; empty if none has any.

    Parameters
    ----------
    table : xarray.Dataset
        See `sldvexp.sweep.collect.collect`.
    wanted : str
        The user's choice.

    Raises
    ------
    UserError
        If no run has what is wanted.
    """
    names = [str(n) for n in table.data_vars if n not in ABOUT]
    if wanted and wanted not in names:
        raise UserError(f"sweep.rank: no run has {wanted}; {nearest(wanted, names)}")
    ordered = [n for n in (*PREFERRED, *names) if n in names]
    return wanted or next((n for n in ordered if _ranks(table[n])), next(iter(ordered), ""))


def _ranks(result: xr.DataArray) -> bool:
    """Tell whether a result says anything about which run is better: zeros alone do not."""
    if result.dtype.kind not in "fciub":
        return False
    size = np.abs(result.values.astype(complex))
    return bool((size[np.isfinite(size)] > 0).any())


def rows(table: xr.Dataset, keys: Sequence[str], by: str) -> list[dict[str, Any]]:
    """List every run with its keys, state and the number it is ranked by, the best first."""
    found = []
    for cell in cells(table, keys):
        row: dict[str, Any] = {k: cell[k].item() for k in keys}
        row |= {name: cell[name].item() for name in (*ABOUT, FOLDER) if name in cell.variables}
        row[by] = collect.headline_number(cell[by]) if by else float("nan")
        row |= {n: collect.headline_number(cell[n]) for n, _ in FIELD_COLUMNS.values() if n in cell}
        found.append(row)
    sign = -1 if first(by) == LARGEST else 1
    return sorted(found, key=lambda row: (np.isnan(row[by]), sign * row[by]))


def cells(table: xr.Dataset, keys: Sequence[str]) -> Iterator[xr.Dataset]:
    """Yield the single runs of a sweep's dataset."""
    dims = [d for d in keys if d in table.dims] or [str(d) for d in table["state"].dims]
    shape = [table.sizes[d] for d in dims]
    for index in np.ndindex(*shape):
        yield table.isel(dict(zip(dims, index, strict=True)))


def units(table: xr.Dataset, name: str) -> str:
    """Find the unit of a headline; empty if it has none."""
    unit = str(table[name].attrs.get("units", "1")) if name else "1"
    return "" if unit == "1" else unit


def terminal_table(
    ranking: Sequence[dict[str, Any]], keys: Sequence[str], by: str, unit: str, width: int
) -> Table:
    """Make the ranking for a terminal of so many columns.

    Failed runs come last, with their reasons.
    """
    title = f"{len(ranking)} runs by {by}, {first(by)} first" if by else f"{len(ranking)} runs"
    numbers = {t: c for t, c in FIELD_COLUMNS.items() if any(c[0] in row for row in ranking)}
    name = ", ".join(filter(None, (by or "result", unit)))
    if by not in dict(numbers.values()):
        numbers = {name: (by, 1)} | numbers
    shown = Table(title=title, title_justify="left")
    for column in ("", *keys, *numbers, "seconds"):
        shown.add_column(column, no_wrap=True)
    shown.add_column(VERDICT, no_wrap=True)
    shown.add_column("state")
    for place, row in enumerate(ranking, 1):
        state = f"{row['state']}: {row['reason']}" if row["reason"] else row["state"]
        cells = [str(place) if np.isfinite(row[by]) else "", *(str(row[k]) for k in keys)]
        cells += [_shown(scale * row[of]) for of, scale in numbers.values()]
        cells += [number(row["seconds"], 3), row.get(VERDICT, ""), state]
        shown.add_row(*map(escape, cells))
    ranked = next(t for t, (of, _) in numbers.items() if of == by)
    return fitted(shown, width, {"", *keys[:1], ranked, VERDICT, "state"}, "sweep.csv")


def _shown(value: float) -> str:
    if not np.isfinite(value):
        return ""
    return f"{value:.0f}" if float(value).is_integer() else number(value, 4)  # counts in full


def write_csv(table: xr.Dataset, keys: Sequence[str], path: Path) -> None:
    """Write every number of every run, one row a run, one column a number as ``pose.s[view=1]``.

    The first columns are the swept `keys`, the run's state, seconds and the like, and its folder.
    """
    written = []
    for cell in cells(table, keys):
        row: dict[str, Any] = {k: cell[k].item() for k in keys}
        row |= {name: cell[name].item() for name in (*ABOUT, FOLDER) if name in cell.variables}
        for name, variable in cell.data_vars.items():
            if name not in ABOUT:
                row |= _numbers(str(name), variable)
        written.append(row)
    columns = list(dict.fromkeys(column for row in written for column in row))
    with whole_or_nothing(path) as beside, beside.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        writer.writerows(written)


def _numbers(name: str, variable: xr.DataArray) -> dict[str, Any]:
    """Name a variable's single numbers by name."""
    found = {}
    for index in np.ndindex(*variable.shape):
        at = dict(zip(variable.dims, index, strict=True))
        single = variable.isel(at)
        where = ", ".join(
            f"{d}={variable[d].values[i] if d in variable.coords else i}" for d, i in at.items()
        )
        found[f"{name}[{where}]" if where else name] = single.item()
    return found
