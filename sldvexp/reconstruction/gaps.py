"""Points that a view has not measured: blank in the result, and without a say elsewhere.

Points that lack a velocity at every frequency are left out while the others are solved. Where one
is missing at some frequencies only, it is taken as zero there, with the standard error that its
view has elsewhere, and whatever comes out at that point and frequency is made NaN: no estimate
rests on a stand-in.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr


def gaps_of(line_of_sight: xr.Dataset) -> xr.DataArray:
    """Find the points and frequencies at which some view has no velocity.

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> gaps_of(xr.Dataset({"velocity": (("view", "point"), [[1.0, np.nan], [2.0, 3.0]])})).values
    array([False,  True])
    """
    velocity = line_of_sight["velocity"]
    return xr.apply_ufunc(lambda v: ~np.isfinite(v), velocity).any("view")


def solved_around(
    solve: Callable[[xr.Dataset], xr.Dataset], line_of_sight: xr.Dataset, lost: xr.DataArray
) -> xr.Dataset:
    """Solve where all views have a velocity, and blank the rest.

    Parameters
    ----------
    solve : callable
        From a group ``line_of_sight`` without gaps to the group ``point``.
    lost : xarray.DataArray, over point and frequency as far as there are any
        True where some view has no velocity.

    Raises
    ------
    UserError
        If that is everywhere.
    """
    if bool(lost.all()):
        raise UserError("line_of_sight: at every point some view has no velocity")
    if "point" not in lost.dims:
        return _blanked(solve(_filled(line_of_sight)), lost)
    gone = (lost.all("frequency") if "frequency" in lost.dims else lost).values
    kept = np.flatnonzero(~gone)
    found = _blanked(solve(_filled(line_of_sight.isel(point=kept))), lost.isel(point=kept))
    made = found.reindex(point=line_of_sight["point"].values)
    for name, variable in found.data_vars.items():
        if variable.dtype.kind not in "fc":
            made[name] = made[name].fillna(0).astype(variable.dtype)
        made[name].attrs = variable.attrs
    if "deficient_point" in made:  # indices of points
        made["deficient_point"] = made["deficient_point"].copy(data=kept[made["deficient_point"]])
    return made


def _filled(line_of_sight: xr.Dataset) -> xr.Dataset:
    """Put stand-ins where there is no velocity."""
    velocity = line_of_sight["velocity"]
    made = line_of_sight.assign(velocity=velocity.where(np.isfinite(velocity), 0.0))
    if "velocity_std" in line_of_sight:
        std = line_of_sight["velocity_std"].broadcast_like(velocity).transpose("view", ...)
        made["velocity_std"] = std.fillna(std.median(std.dims[1:]))
    return made


def _blanked(point: xr.Dataset, lost: xr.DataArray) -> xr.Dataset:
    """Blank the results at points and frequencies that some view has not measured."""
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
