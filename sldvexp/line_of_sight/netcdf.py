"""Line-of-sight velocities in netCDF files, the program's own or others'."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.line_of_sight.arrays import REQUIRED, from_arrays
from sldvexp.line_of_sight.layout import ORDER, OWN, Layout
from sldvexp.line_of_sight.table import LineOfSight
from sldvexp.units import VelocityUnit


def read_netcdf(path: Path, unit: VelocityUnit, layout: Layout = OWN) -> LineOfSight:
    """Read a run's group ``line_of_sight``, or the same variables of another file.

    These are at the root or in the layout's group, and may have other names of variables and
    dimensions. The file's own unit of velocity must agree with `unit`.
    """
    data = _renamed(_group(path, layout), layout, path)
    for name in REQUIRED:
        if name not in data:
            raise UserError(
                f"{path}: the variable {name} is missing; needed are {', '.join(REQUIRED)}"
            )
    stated = _unit_name(str(data["velocity"].attrs.get("units", unit.name)))
    if stated != unit.name:
        raise UserError(
            f"{path}: the file states velocities in {data['velocity'].attrs['units']}, the "
            f"configuration instrument.unit={unit.name}; they must agree"
        )
    values: dict[str, Any] = {}
    for name, key in (
        ("direction_cosines", "direction_cosines"),
        ("velocity", "velocity"),
        ("velocity_std", "std"),
    ):
        if name in data:
            values[key] = _ordered(data[name], path)
    if ("point" in data["velocity"].dims) != ("point" in data["direction_cosines"].dims):
        raise UserError(f"{path}: velocity and direction_cosines must both have a dimension point")
    values |= {d: data[d].values for d in ORDER if d in data.variables}
    return from_arrays(values, path, unit)


def _group(path: Path, layout: Layout) -> xr.Dataset:
    """The file's group, in memory."""
    try:
        with dataset.load(path) as tree:
            name = layout.group or ("line_of_sight" if "line_of_sight" in tree.children else "/")
            if name.strip("/") not in ("", *(n.path.strip("/") for n in tree.descendants)):
                groups = ", ".join(n.path.strip("/") for n in tree.descendants) or "none"
                raise UserError(f"{path}: has no group {name}; there are {groups}")
            return tree[name].to_dataset().load()
    except RuntimeError:  # the netCDF library's word for data that its own index contradicts
        raise UserError(f"{path}: is a damaged netCDF-4 file") from None


def _renamed(data: xr.Dataset, layout: Layout, path: Path) -> xr.Dataset:
    """Variables and dimensions with the program's names, complex velocities of their parts."""
    if not layout.mapping:
        return data
    layout.require([*data.variables, *data.dims], path)
    dims = {k: v for k, v in layout.mapping.items() if k in data.dims and k not in data.coords}
    both = {k: v for k, v in layout.mapping.items() if k not in dims}
    data = data.rename_dims(dims).rename(both)
    data = data.set_coords([name for name in ORDER if name in data.variables])
    if "velocity" not in data and "real" in data:
        data["velocity"] = data["real"].astype(complex)
        if "imag" in data:
            data["velocity"] = data["real"] + 1j * data["imag"]
        data["velocity"].attrs = data["real"].attrs
    return data


def _unit_name(text: str) -> str:
    """``m_per_s`` for ``m/s``, ``m s-1`` and ``m s^-1``."""
    return text.replace(" s-1", "/s").replace(" s^-1", "/s").replace("/", "_per_")


def _ordered(array: xr.DataArray, path: Path) -> np.ndarray:
    """Values with the dimensions in the order (view, point, axis or frequency)."""
    order = [d for d in ("view", "point", "axis", "frequency") if d in array.dims]
    if len(order) != array.ndim or "view" not in order:
        raise UserError(
            f"{path}: {array.name} has the dimensions {', '.join(map(str, array.dims))}; "
            "known are view, point, axis, frequency"
        )
    return array.transpose(*order).values
