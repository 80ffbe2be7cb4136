"""Line-of-sight velocities as named arrays, in netCDF or MATLAB files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.line_of_sight.table import LineOfSight
from sldvexp.units import VelocityUnit

REQUIRED = ("direction_cosines", "velocity")


def read_netcdf(path: Path, unit: VelocityUnit) -> LineOfSight:
    """Read a run's group ``line_of_sight``, or the same variables at the root of another file.

    The file's own unit of velocity must agree with `unit`.
    """
    try:
        with dataset.load(path) as tree:
            node = tree["line_of_sight"] if "line_of_sight" in tree.children else tree
            data = node.to_dataset().load()
    except RuntimeError:  # the netCDF library's word for data that its own index contradicts
        raise UserError(f"{path}: is a damaged netCDF-4 file") from None
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
    if ("point" in data["velocity"].dims) != ("point" in data["direction_cosines"].dims):
        raise UserError(f"{path}: velocity and direction_cosines must both have a dimension point")
    values |= {d: data[d].values for d in ("view", "point", "frequency") if d in data.coords}
    return _from_arrays(values, path, unit)


def read_matlab(path: Path, unit: VelocityUnit) -> LineOfSight:
    """Read a MATLAB file (up to version 7) with arrays of these names.

    ``direction_cosines`` (views x 3, or views x points x 3), ``velocity`` (views x frequencies, or
    views x points x frequencies), and optionally ``std`` (as velocity), ``frequency`` and ``view``.
    """
    from scipy.io import loadmat

    try:
        found = loadmat(path)
    except NotImplementedError:
        raise UserError(f"{path}: is a MATLAB 7.3 file; save it with the option -v7") from None
    except Exception:  # whatever the reader stumbles over in a file that is none, or is damaged
        raise UserError(f"{path}: is not a readable MATLAB file") from None
    for name in REQUIRED:
        if name not in found:
            raise UserError(
                f"{path}: the array {name} is missing; needed are {', '.join(REQUIRED)}"
            )
    values = {k: v for k, v in found.items() if not k.startswith("__")}
    if "frequency" in values:
        values["frequency"] = values["frequency"].ravel()
    for name in {"view", "point"} & set(values):
        values[name] = [str(np.squeeze(v)).strip() for v in values[name].ravel()]
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
    cosines = _numbers(values, "direction_cosines", path)
    velocity = _numbers(values, "velocity", path)
    several = cosines.ndim == 3
    cosines = cosines if several else cosines[:, None]

    def cube(array: np.ndarray) -> np.ndarray:
        array = array if several else np.expand_dims(array, 1)
        return array if array.ndim == 3 else array[..., None]

    velocity = cube(velocity)
    views, points = cosines.shape[:2]
    if velocity.shape[:2] != (views, points) or cosines.shape[2:] != (3,) or velocity.ndim != 3:
        raise UserError(
            f"{path}: velocity has the shape {velocity.shape} and direction_cosines "
            f"{cosines.shape}; they must agree in views and points, and directions need 3 numbers"
        )
    frequency = _frequencies(values, velocity.shape[2], path)
    std = None
    if "std" in values:
        std = cube(_numbers(values, "std", path).astype(float)) * unit.value
        try:
            std = np.broadcast_to(std, velocity.shape)
        except ValueError:
            raise UserError(
                f"{path}: the standard errors have the shape {std.shape}, the velocities "
                f"{velocity.shape}; they must agree, or have length 1 where they stay the same"
            ) from None
    return LineOfSight(
        source=str(path),
        view=_labels(values, "view", views, path),
        point=_labels(values, "point", points, path) if several else None,
        frequency=frequency,
        direction_cosines=cosines.astype(float),
        velocity=velocity * unit.value,
        std=std,
    )


def _numbers(values: Mapping[str, Any], name: str, path: Path) -> np.ndarray:
    """An array that must hold numbers, along views at least."""
    array = np.asarray(values[name])
    if array.dtype.kind not in ("biuf" if name != "velocity" else "biufc"):
        raise UserError(f"{path}: {name} must hold {'' if name == 'velocity' else 'real '}numbers")
    if array.ndim < 1 + (name == "direction_cosines"):
        raise UserError(f"{path}: {name} must have an entry for every view")
    return array


def _labels(values: Mapping[str, Any], dim: str, size: int, path: Path) -> list[str]:
    """The names of views or points; numbers from 1 if there are none."""
    names = [str(name) for name in values.get(dim, range(1, size + 1))]
    if len(names) != size:
        raise UserError(f"{path}: there are {len(names)} names of {dim}s, but {size} {dim}s")
    return names


def _frequencies(values: Mapping[str, Any], size: int, path: Path) -> NDArray[np.float64] | None:
    """The frequencies of the velocities; None for a single one that is not stated."""
    if "frequency" not in values:
        if size > 1:
            raise UserError(f"{path}: velocities at {size} frequencies need an array frequency")
        return None
    frequency = _numbers(values, "frequency", path).astype(float)
    if len(frequency) != size:
        raise UserError(f"{path}: there are {len(frequency)} frequencies but velocities at {size}")
    return frequency
