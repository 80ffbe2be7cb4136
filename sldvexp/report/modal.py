"""Modes as a table, and as a part of a sentence, with intervals of 95 %."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from sldvexp.dataset import RunData
from sldvexp.lazy import xarray as xr
from sldvexp.report.numbers import with_bound
from sldvexp.statistics import student_factor

#: Half-width of an interval in standard errors.
LEVEL = 0.95
PERCENT = 100.0


def modes_table(modes: xr.Dataset) -> Table:
    """Show natural frequencies, damping and complexity with their intervals, a row a mode.

    Parameters
    ----------
    modes : xarray.Dataset
        The group ``modes``.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> numbers = dict(natural_frequency=[197.0], natural_frequency_std=[0.01])
    >>> numbers |= dict(damping_ratio=[0.01], damping_ratio_std=[1e-4], phase=[0.0])
    >>> found = group("modes", {"mode": [1]}, **numbers, complexity=[0.0], complexity_std=[1e-3])
    >>> [list(column.cells)[0] for column in modes_table(found).columns]
    ['1', '197.000 ± 0.020', '1.000 ± 0.020', '0.0000 ± 0.0020', '0.0']
    """
    table = Table("mode", title="Modes", title_justify="left")
    for title in ("natural frequency, Hz", "damping, %", "complexity", "phase, deg"):
        table.add_column(title)
    for k in range(modes.sizes["mode"]):
        one = modes.isel(mode=k)
        table.add_row(
            str(int(one["mode"])),
            _interval(one, "natural_frequency"),
            _interval(one, "damping_ratio", PERCENT),
            _interval(one, "complexity"),
            f"{round(np.degrees(float(one['phase'])), 1) + 0.0:.1f}",  # of -0.0 too
        )
    return table


def _interval(one: xr.Dataset, name: str, factor: float = 1.0) -> str:
    """Write a value of one mode with the half-width of its interval."""
    bound = float(student_factor(LEVEL, np.inf)) * float(one[f"{name}_std"])
    return with_bound(factor * float(one[name]), factor * bound)


def modes_text(run: RunData) -> str:
    """Say how many modes there are, and the lowest and the highest; empty without modes.

    Examples
    --------
    >>> modes_text(RunData({}))
    ''
    """
    if not run.has("modes", "natural_frequency"):
        return ""
    modes = run.groups["modes"]
    count = modes.sizes["mode"]
    ends = [_interval(modes.isel(mode=k), "natural_frequency") for k in (0, count - 1)]
    if count == 1:
        return f"one mode, {ends[0]} Hz"
    return f"{count} modes, {ends[0]} to {ends[1]} Hz"
