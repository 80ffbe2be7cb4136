"""Line-of-sight velocities as named arrays, of whatever file they come from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.errors import UserError
from sldvexp.io.velocities.table import LineOfSight
from sldvexp.typing import Array
from sldvexp.units import VelocityUnit

REQUIRED = ("direction_cosines", "velocity")


def with_velocity(values: dict[str, Any]) -> dict[str, Any]:
    """The arrays with ``velocity`` where there are ``real`` and ``imag`` instead."""
    if "velocity" in values or "real" not in values:
        return values
    velocity = np.asarray(values["real"])
    if "imag" in values:
        velocity = velocity + 1j * np.asarray(values["imag"])
    return values | {"velocity": velocity}


def from_arrays(values: Mapping[str, Any], path: Path, unit: VelocityUnit) -> LineOfSight:
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


def _frequencies(values: Mapping[str, Any], size: int, path: Path) -> Array | None:
    """The frequencies of the velocities; None for a single one that is not stated."""
    if "frequency" not in values:
        if size > 1:
            raise UserError(f"{path}: velocities at {size} frequencies need an array frequency")
        return None
    frequency = _numbers(values, "frequency", path).astype(float)
    if len(frequency) != size:
        raise UserError(f"{path}: there are {len(frequency)} frequencies but velocities at {size}")
    return frequency
