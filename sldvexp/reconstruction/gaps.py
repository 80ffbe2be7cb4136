"""Points that a view has not measured: solved with stand-ins, and blank in the result.

All points share one computation, array by array. A velocity that is missing is taken as zero, with
the standard error and direction that its view has elsewhere, and whatever comes out at that point
and frequency is made NaN and not observable: no estimate rests on a stand-in.
"""

from __future__ import annotations

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array


def gaps_of(line_of_sight: xr.Dataset) -> xr.DataArray:
    """Find the points and frequencies at which some view has no velocity.

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> gaps_of(xr.Dataset({"velocity": (("view", "point"), [[1.0, np.nan], [2.0, 3.0]])})).values
    array([False,  True])
    """
    velocity = line_of_sight["velocity"]
    lost = xr.apply_ufunc(lambda v: ~np.isfinite(v), velocity).any("view")
    if bool(lost.all()):
        raise UserError("line_of_sight: at every point some view has no velocity")
    return lost


def filled(line_of_sight: xr.Dataset) -> xr.Dataset:
    """Put stand-ins where there is no velocity."""
    velocity = line_of_sight["velocity"]
    made = line_of_sight.assign(velocity=velocity.where(np.isfinite(velocity), 0.0))
    cosines = line_of_sight["direction_cosines"].transpose("view", ..., "axis")
    made["direction_cosines"] = cosines.copy(data=np.array([_first(own) for own in cosines.values]))
    if "velocity_std" in line_of_sight:
        std = line_of_sight["velocity_std"].broadcast_like(velocity).transpose("view", ...)
        made["velocity_std"] = std.fillna(std.median(std.dims[1:]))
    return made


def _first(cosines: Array) -> Array:
    """Take a view's first known direction where there is none."""
    rows = np.atleast_2d(cosines)
    known = np.asarray(np.isfinite(rows).all(axis=1))
    return np.where(known[:, None], rows, rows[known.argmax()]).reshape(cosines.shape)


def blanked(point: xr.Dataset, lost: xr.DataArray) -> xr.Dataset:
    """Blank the results at points and frequencies that some view has not measured.

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> found = xr.Dataset({"velocity": ("point", [1.0, 2.0])})
    >>> blanked(found, xr.DataArray([False, True], dims="point"))["velocity"].values
    array([ 1., nan])
    """
    made = point.copy()
    for name, variable in point.data_vars.items():
        here = lost
        if "frequency" in lost.dims and "frequency" not in variable.dims:
            here = lost.all("frequency")
        if not here.dims or not set(here.dims) <= set(variable.dims):
            continue
        blank = np.nan if variable.dtype.kind in "fc" else 0
        kept = variable.where(~here, blank).transpose(*variable.dims)
        made[name] = kept.astype(variable.dtype).assign_attrs(variable.attrs)
    return made
