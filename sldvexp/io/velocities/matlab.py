"""Line-of-sight velocities as arrays in MATLAB files, up to version 7 and of version 7.3."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.errors import UserError
from sldvexp.io.velocities.from_arrays import REQUIRED, from_arrays, with_velocity
from sldvexp.io.velocities.layout import ORDER, OWN, Layout
from sldvexp.io.velocities.table import LineOfSight
from sldvexp.lazy import netCDF4, scipy
from sldvexp.units import VelocityUnit


def read_matlab(path: Path, unit: VelocityUnit, layout: Layout = OWN) -> LineOfSight:
    """Read a MATLAB file with arrays of these names, or of those that the layout maps to them.

    ``direction_cosines`` (views x 3, or views x points x 3), ``velocity`` (views x frequencies, or
    views x points x frequencies) or ``real`` and ``imag``, and optionally ``std`` (as velocity),
    ``frequency``, ``view`` and ``point``. The layout's order is that of the velocities.
    """
    found = _arrays(path)
    layout.require(found, path)
    values = with_velocity({layout.mapping.get(k, k): v for k, v in found.items()})
    for name in REQUIRED:
        if name not in values:
            raise UserError(
                f"{path}: the array {name} is missing; needed are {', '.join(REQUIRED)}"
            )
    if layout.order:
        values = _ordered(values, layout.order, path)
    if "frequency" in values:
        values["frequency"] = np.asarray(values["frequency"]).ravel()
    for name in {"view", "point"} & set(values):
        values[name] = [str(np.squeeze(v)).strip() for v in np.asarray(values[name]).ravel()]
    return from_arrays(values, path, unit)


def _arrays(path: Path) -> dict[str, Any]:
    """The file's arrays by name."""
    try:
        found = scipy.io.loadmat(path)
    except NotImplementedError:
        return _of_version_7_3(path)
    except Exception:  # whatever the reader stumbles over in a file that is none, or is damaged
        raise UserError(f"{path}: is not a readable MATLAB file") from None
    return {k: v for k, v in found.items() if not k.startswith("__")}


def _of_version_7_3(path: Path) -> dict[str, Any]:
    """Arrays of numbers and of characters of a file of version 7.3, which is one of HDF5.

    MATLAB writes the last dimension first there, complex numbers as pairs, and text as numbers.
    Cells are not among what the netCDF library reads.
    """
    try:
        with netCDF4.Dataset(path, auto_complex=True) as file:
            file.set_auto_mask(False)
            return {
                name: _text(variable[:]) if _is_text(variable) else np.asarray(variable[:]).T
                for name, variable in file.variables.items()
            }
    except (OSError, RuntimeError, ValueError):
        raise UserError(f"{path}: is not a readable MATLAB 7.3 file") from None


def _is_text(variable: Any) -> bool:
    return getattr(variable, "MATLAB_class", "") == "char" and variable.ndim == 2


def _text(codes: np.ndarray) -> np.ndarray:
    """The rows of a matrix of characters, which stand in columns."""
    return np.array(["".join(map(chr, row)).strip() for row in codes.T])


def _ordered(values: dict[str, Any], order: tuple[str, ...], path: Path) -> dict[str, Any]:
    """Arrays with the dimensions in the order (view, point, frequency), or (.., axis)."""
    values = dict(values)
    for name in ("velocity", "std", "direction_cosines"):
        if name not in values:
            continue
        own = [d for d in order if d != "frequency" or name != "direction_cosines"]
        array = np.asarray(values[name])
        axes = [own.index(d) for d in ORDER if d in own]
        if name == "direction_cosines":
            axes.append(len(own))
        if array.ndim != len(axes):
            raise UserError(
                f"{path}: {name} has {array.ndim} dimensions, but instrument.order says "
                f"{len(axes)}: {', '.join([*own, 'axis'][: len(axes)])}"
            )
        values[name] = array.transpose(axes)
    return values
