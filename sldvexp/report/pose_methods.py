"""The table of pose methods, in the manner of Table 4.3."""

from __future__ import annotations

from rich.table import Table

from sldvexp.lazy import xarray as xr
from sldvexp.report.numbers import number


def pose_methods(found: xr.Dataset) -> Table:
    """One row a method.

    Parameters
    ----------
    found : xarray.Dataset
        As ``check=pose_methods`` makes it.
    """
    table = Table(title="Pose methods", title_justify="left")
    errors = {"origin_error": ("origin off by, mm", 1e3), "rotation_error": ("axes by, mrad", 1e3)}
    errors = {name: of for name, of in errors.items() if name in found}
    titles = [title for title, _ in errors.values()]
    for column in ("method", "views", "s, DAC steps", "std", *titles):
        table.add_column(column)
    for method in found["pose_method"].values:
        row = found.sel(pose_method=method)
        cells = [number(float(row[name]), 3) for name in ("s_mean", "s_std")]
        cells += [number(scale * float(row[name]), 3) for name, (_, scale) in errors.items()]
        table.add_row(str(method), str(int(row["views"])), *cells)
    return table
