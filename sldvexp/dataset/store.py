"""The one place that knows a run's groups, variables, dimensions, units, and how it is stored."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.config.paths import RUN_FILE
from sldvexp.dataset.variables import EXAMINED, STAGES, Variable
from sldvexp.errors import UserError
from sldvexp.files import whole_or_nothing
from sldvexp.lazy import netCDF4
from sldvexp.lazy import xarray as xr

UNREADABLE = "is not a readable netCDF-4 file"

#: Coordinates that mean the same in every group.
AXES: dict[str, tuple[str, ...]] = {
    "axis": ("x", "y", "z"),
    "laser_axis": ("x", "y", "z"),
    "component": ("x", "y", "z"),
    "mirror": ("up_down", "left_right"),
    "angle_index": ("phi1", "phi2", "phi3"),
}

CONVENTIONS = {
    "amplitude_convention": "peak",
    "time_convention": "exp(+i omega t)",
    "phase_reference": "reference channel",
    "line_of_sight_convention": "positive towards the instrument",
    "euler_convention": "x-convention (z-x'-z'')",
}

VARIABLES: dict[str, dict[str, Variable]] = {**STAGES, **EXAMINED}


def group(name: str, coords: Mapping[str, ArrayLike], **arrays: ArrayLike | None) -> xr.Dataset:
    """Make one stage's group: arrays get their dimensions, units and meaning from `VARIABLES`.

    Parameters
    ----------
    name : str
        A key of `VARIABLES`.
    coords : mapping of str to array_like
        Coordinates besides `AXES`. An optional dimension is present if it has a coordinate here.
    **arrays : array_like or None
        The variables; None is left out.

    Returns
    -------
    xarray.Dataset
    """
    known = VARIABLES[name]
    data: dict[str, Any] = {}
    for variable, values in arrays.items():
        if values is None:
            continue
        spec = known[variable]
        dims = _dims(spec, coords)
        attributes = {"units": spec.units, "long_name": spec.long_name}
        array = np.asarray(values, order="C")  # as it comes back from a file, to the last bit
        data[variable] = (dims, array.astype(np.int8) if array.dtype == bool else array, attributes)
    used = {d for dims, _, _ in data.values() for d in dims}
    axes = {d: list(AXES[d]) for d in AXES if d in used}
    given = {d: np.asarray(v) for d, v in coords.items() if d in used}
    dataset = xr.Dataset(data, coords={**axes, **given})
    if "frequency" in dataset.coords:
        dataset["frequency"].attrs["units"] = "Hz"
    return dataset


def _dims(spec: Variable, coords: Mapping[str, ArrayLike]) -> tuple[str, ...]:
    """Dimensions of a variable: all required ones, and the optional ones that have a coordinate."""
    parts = [(d.strip("[]"), d.startswith("[")) for d in spec.dims.split()]
    return tuple(d for d, optional in parts if not optional or d in coords)


def save(tree: Mapping[str, xr.Dataset], attributes: Mapping[str, Any], path: Path) -> None:
    """Write the run beside its final name and rename it: a file of that name is always whole.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        Group path (``pose``, ``compare/method_1``) to its dataset.
    attributes : mapping
        Of the root.
    path : Path
    """
    root = xr.Dataset(attrs={**CONVENTIONS, **attributes})
    groups = {f"/{k}": _double(v) for k, v in tree.items()}
    whole = xr.DataTree.from_dict({"/": root, **groups})
    with whole_or_nothing(path) as beside:
        whole.to_netcdf(beside, engine="netcdf4", auto_complex=True)


def _double(group: xr.Dataset) -> xr.Dataset:
    """The group with complex numbers in double precision.

    Beside one of double precision netCDF4 1.7.5 writes a complex variable of single precision wrong
    (its type is taken for the other), mostly without an error.
    """
    single = [name for name, v in group.data_vars.items() if v.dtype == np.complex64]
    if not single:
        return group
    return group.assign({n: group[n].astype(np.complex128).drop_encoding() for n in single})


def load(path: Path) -> xr.DataTree:
    """Open a run's file, lazily.

    Raises
    ------
    UserError
        If it is missing or is not a run's netCDF-4 file.
    """
    _require(path)
    try:
        return xr.open_datatree(path, engine="netcdf4", auto_complex=True)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: {UNREADABLE} ({error})") from None


def _require(path: Path) -> None:
    if not path.is_file():
        raise UserError(f"{path}: there is no such file; a run's dataset is called {RUN_FILE}")


def load_some(path: Path, names: Collection[str]) -> xr.DataTree:
    """Some groups of a run's file and those below them, in memory; the others cost nothing.

    Raises
    ------
    UserError
        See `load`.
    """
    _require(path)
    try:
        with netCDF4.Dataset(path, auto_complex=True) as file:
            found = [file[name] for name in names if name in file.groups]
            groups = {g.path: _in_memory(g) for top in found for g in _with_those_below(top)}
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: {UNREADABLE} ({error})") from None
    return xr.DataTree.from_dict(groups)


def _with_those_below(group: Any) -> Iterator[Any]:
    yield group
    for below in group.groups.values():
        yield from _with_those_below(below)


def _in_memory(group: Any) -> xr.Dataset:
    return xr.open_dataset(xr.backends.NetCDF4DataStore(group)).load()


def save_table(table: xr.Dataset, path: Path) -> None:
    """Write one dataset without groups, such as a sweep's, whole or not at all."""
    with whole_or_nothing(path) as beside:
        table.to_netcdf(beside, engine="netcdf4", auto_complex=True)
