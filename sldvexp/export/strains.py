"""Strains of a surface as exports take them, beside the velocities that they follow from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.dataset.run_data import RunData
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array

#: How the name of a file of strains ends, before its suffix.
STRAIN = "_strain"
#: Results with three components along the surface, and real ones.
TENSORS = (
    *("strain", "middle_strain", "bending_strain", "back_strain", "stress"),
    *("membrane_force", "bending_moment"),
)
REAL = ("principal_strain", "principal_direction", "von_mises")


def strain_of(run: RunData) -> xr.Dataset | None:
    """Take the strain of the run's field, if there is one; frequency is the last dimension.

    Examples
    --------
    >>> strain_of(RunData({})) is None
    True
    """
    if not run.has("strain", "frame"):
        return None
    strain = run.groups["strain"]
    return strain if "frequency" in strain.dims else strain.expand_dims("frequency", -1)


def beside(path: Path) -> Path:
    """Name the file of the strains beside that of the velocities.

    Examples
    --------
    >>> beside(Path("velocity.csv")).name
    'velocity_strain.csv'
    """
    return path.with_name(f"{path.stem}{STRAIN}{path.suffix}")


def at_frequency(strain: xr.Dataset, i: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Collect everything known at one frequency, real and imaginary parts apart."""
    one = strain.isel(frequency=i)
    for name in (n for n in TENSORS if n in one):
        values = one[name].values
        yield f"{name}_real", values.real
        yield f"{name}_imag", values.imag
        if (std := f"{name}_std") in one:
            yield std, one[std].values
    for name in (n for n in REAL if n in one):
        yield name, one[name].values
        yield f"{name}_std", one[f"{name}_std"].values
    yield "principal_vector", principal_vector(one)


def principal_vector(strain: xr.Dataset) -> Array:
    """Make the largest extension as a vector along it in the world, shape (place, 3)."""
    angle, frame = np.radians(strain["principal_direction"].values), strain["frame"].values
    way = np.cos(angle)[:, None] * frame[:, 0] + np.sin(angle)[:, None] * frame[:, 1]
    return np.asarray(strain["principal_strain"].values[:, :1] * way)


def symmetric_tensor(components: NDArray[Any]) -> NDArray[Any]:
    """Order ss, tt, st of places, (place, 3), as xx, xy, yy, xz, yz, zz; none out of the surface.

    Examples
    --------
    >>> symmetric_tensor(np.array([[1.0, 2.0, 3.0]])).tolist()
    [[1.0, 3.0, 2.0, 0.0, 0.0, 0.0]]
    """
    ss, tt, st = components.T
    none = np.zeros_like(ss)
    return np.stack([ss, st, tt, none, none, none], axis=1)
