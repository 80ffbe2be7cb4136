"""Line-of-sight velocities in netCDF files, the program's own or others'."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.io.velocities.foreign import ordered, renamed
from sldvexp.io.velocities.from_arrays import REQUIRED, from_arrays
from sldvexp.io.velocities.layout import KNOWN, ORDER, OWN, Layout
from sldvexp.io.velocities.table import LineOfSight
from sldvexp.lazy import xarray as xr
from sldvexp.units import VelocityUnit


def read_netcdf(path: Path, unit: VelocityUnit, layout: Layout = OWN) -> LineOfSight:
    """Read a run's group ``line_of_sight``, or the same variables of another file.

    These are at the root or in the layout's group, and may have other names of variables and
    dimensions. The file's own unit of velocity must agree with `unit`.
    """
    data, theirs = renamed(_group(path, layout), layout, path)
    for name in REQUIRED:
        if name not in data:
            others = [str(n) for n in data.data_vars if n not in KNOWN]
            there = f"; there are {', '.join(others)}, of which instrument.mapping may call one so"
            raise UserError(
                f"{path}: the variable {name} is missing; needed are {', '.join(REQUIRED)}"
                f"{there if others else ''}"
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
            values[key] = ordered(data, name, theirs, path)
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


def _unit_name(text: str) -> str:
    """``m_per_s`` for ``m/s``, ``m s-1`` and ``m s^-1``."""
    return text.replace(" s-1", "/s").replace(" s^-1", "/s").replace("/", "_per_")
