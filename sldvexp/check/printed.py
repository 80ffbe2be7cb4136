"""`check=printed`: numbers of Section 5.2 by the conventions that explain the print."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examined
from sldvexp.check.conventions import printed_f, printed_half_width, sample_std
from sldvexp.check.linpack import linpack_rcond
from sldvexp.config.registry import register
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr


@register("check", "printed")
@dataclass
class Printed(Check):
    """LINPACK's condition estimate, sample deviations, F and half-widths as they were printed.

    Parameters
    ----------
    partial, full : str
        Groups of the model without and with the intercept, for Eq 5.17.
    decimals : int
        Eq 5.17 is computed from numbers as tabulated, with so many decimals.
    """

    partial: str = "point"
    full: str = ""
    decimals: int = 4

    def examine(self, run: Examined) -> xr.Dataset:
        """One entry of each for every reconstruction of the run."""
        methods = [name for name in run.tree if name.split("/")[0] in ("point", "compare")]
        for name in (self.partial, self.full):
            if name and name not in methods:
                raise UserError(f"check.printed: there is no {name}; {nearest(name, methods)}")
        rows = {name: _conventions(run.tree[name]) for name in methods}
        columns = {
            key: np.array([row[key] for row in rows.values()]) for key in next(iter(rows.values()))
        }
        more = {}
        if self.full:
            partial, full = run.tree[self.partial], run.tree[self.full]
            tabulated = partial.attrs["sse"], full.attrs["sse"], rows[self.full]["std"]
            more["f_statistic"] = printed_f(*(round(x, self.decimals) for x in tabulated))
            more["f_critical"] = float(scipy.special.fdtri(1, full.sizes["row"] - 1, 0.95))
        return dataset.group("examined/printed", {"method": methods}, **columns, **more)


def _conventions(point: xr.Dataset) -> dict[str, Any]:
    """The printed numbers of one reconstruction of a single point."""
    if "matrix" not in point:
        raise UserError("check=printed is for a single point's reconstruction")
    matrix = point["matrix"].values
    residual = point["residual"].values
    least_squares = len(residual) > len(matrix)
    nothing = np.full(3, np.nan)
    std, width = np.nan, nothing
    if least_squares:
        std = sample_std(residual)
    if least_squares and len(matrix) == 3:
        v_ii = np.diag(np.linalg.inv(matrix))
        width = printed_half_width(std, v_ii)
    return {
        "linpack_rcond": linpack_rcond(matrix),
        "std": std,
        "half_width": width,
    }
