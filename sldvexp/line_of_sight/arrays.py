"""Line-of-sight velocities as named arrays, in netCDF or MATLAB files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.line_of_sight.table import LineOfSight
from sldvexp.units import VelocityUnit

REQUIRED = ("direction_cosines", "velocity")


def read_netcdf(path: Path, unit: VelocityUnit) -> LineOfSight:
    """Read a run's group ``line_of_sight``, or the same variables at the root of another file.

    The file's own unit of velocity must agree with `unit`.
    """
    with dataset.load(path) as tree:
        node = tree["line_of_sight"] if "line_of_sight" in tree.children else tree
        data = node.to_dataset().load()
    for name in REQUIRED:
        if name not in data:
            raise UserError(
                f"{path}: the variable {name} is missing; needed are {', '.join(REQUIRED)}"
            )
    stated = str(data["velocity"].attrs.get("units", unit.name)).replace("/", "_per_")
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
    values |= {d: data[d].values for d in ("view", "point", "frequency") if d in data.coords}
    return _from_arrays(values, path, unit)


def read_matlab(path: Path, unit: VelocityUnit) -> LineOfSight:
    """Read a MATLAB file (up to version 7) with arrays of these names.

    ``direction_cosines`` (views x 3, or views x points x 3), ``velocity`` (views x frequencies, or
    views x points x frequencies), and optionally ``std`` (as velocity), ``frequency`` and ``view``.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(path)
    except NotImplementedError:
        raise UserError(f"{path}: is a MATLAB 7.3 file; save it with the option -v7") from None
    except (MatReadError, ValueError, TypeError, OSError) as error:
        raise UserError(f"{path}: is not a readable MATLAB file ({error})") from None
    for name in REQUIRED:
        if name not in found:
            raise UserError(
                f"{path}: the array {name} is missing; needed are {', '.join(REQUIRED)}"
            )
    values = {k: v for k, v in found.items() if not k.startswith("__")}
    if "frequency" in values:
        values["frequency"] = values["frequency"].ravel()
    if "view" in values:
        values["view"] = [str(np.squeeze(v)).strip() for v in values["view"].ravel()]
    return _from_arrays(values, path, unit)


def _ordered(array: xr.DataArray, path: Path) -> np.ndarray:
    """Values with the dimensions in the order (view, point, axis or frequency)."""
    order = [d for d in ("view", "point", "axis", "frequency") if d in array.dims]
    if len(order) != array.ndim or "view" not in order:
        raise UserError(
            f"{path}: {array.name} has the dimensions {', '.join(map(str, array.dims))}; "
            "known are view, point, axis, frequency"
        )
    return array.transpose(*order).values


def _from_arrays(values: Mapping[str, Any], path: Path, unit: VelocityUnit) -> LineOfSight:
    """Give missing point and frequency dimensions length one and check the shapes."""
    cosines = np.asarray(values["direction_cosines"], float)
    velocity = np.asarray(values["velocity"])
    several = cosines.ndim == 3
    cosines = cosines if several else cosines[:, None]
    frequency = values.get("frequency")

    def cube(array: np.ndarray) -> np.ndarray:
        array = array if several else np.expand_dims(array, 1)
        return array if array.ndim == 3 else array[..., None]

    velocity = cube(velocity)
    views, points = cosines.shape[:2]
    if velocity.shape[:2] != (views, points) or cosines.shape[-1] != 3 or velocity.ndim != 3:
        raise UserError(
            f"{path}: velocity has the shape {velocity.shape} and direction_cosines {cosines.shape}; "
            "they must agree in views and points, and directions have 3 components"
        )
    if frequency is None and velocity.shape[2] > 1:
        raise UserError(
            f"{path}: velocities at {velocity.shape[2]} frequencies need an array frequency"
        )
    if frequency is not None and len(frequency) != velocity.shape[2]:
        raise UserError(
            f"{path}: there are {len(frequency)} frequencies but velocities at {velocity.shape[2]}"
        )
    std = values.get("std")
    labels = values.get("point")
    names = labels if labels is not None else range(1, points + 1)
    return LineOfSight(
        source=str(path),
        view=[str(v) for v in values.get("view", range(1, views + 1))],
        point=[str(p) for p in names] if several else None,
        frequency=None if frequency is None else np.asarray(frequency, float),
        direction_cosines=cosines,
        velocity=velocity * unit.value,
        std=None if std is None else cube(np.asarray(std, float)) * unit.value,
    )
