"""Registration data as netCDF: the group ``/registration`` of a run, or a dataset of its own.

Variables: ``object_point (view, point, axis)``, ``angle (view, point, mirror)`` and
``dac (view, point, mirror)``, with their units as attributes, and ``object_point_std (view, point,
axis)`` in the unit of `object_point` where that is known; the coordinates `view` and `point` hold
names and numbers. Where a view lacks a point its angle and DAC steps are NaN. Everything is written
in SI units; a distance guess has no place here and is not written.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sldvexp import dataset as run
from sldvexp.errors import UserError
from sldvexp.io.registration.table import RegistrationTable
from sldvexp.io.tables import stated_or_given
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, BoolArray
from sldvexp.units import AngleUnit, LengthUnit, unit_named

GROUP = "registration"

IMAGE = ("angle", "dac")
STD = "object_point_std"
#: Variable to the table's array and how many numbers a point has there.
ARRAYS = {
    "object_point": ("object_point", 3),
    STD: ("object_std", 3),
    "angle": ("angle", 2),
    "dac": ("dac", 2),
}


def read(path: Path, unit: LengthUnit | None = None) -> list[RegistrationTable]:
    """Read every view of a file; see `sldvexp.io.registration.read`."""
    with run.readable(path), run.load(path) as tree:
        node = tree[GROUP] if GROUP in tree.children else tree
        dataset = node.to_dataset().load()
    return from_dataset(dataset, str(path), unit)


def write(path: Path, tables: Sequence[RegistrationTable]) -> None:
    """Write all views into one dataset; see `sldvexp.io.registration.write`."""
    to_dataset(tables).to_netcdf(path, engine="netcdf4")


def to_dataset(
    tables: Sequence[RegistrationTable], used: Sequence[BoolArray] | None = None
) -> xr.Dataset:
    """Make registration data of several views the group ``/registration`` of a run.

    Parameters
    ----------
    tables : sequence of RegistrationTable
        With different names. Points are the union of the views' points in order of appearance.
    used : sequence of ndarray of bool, shape (points of the view,), optional
        Points of each view that its pose rests on; all without it.

    Returns
    -------
    xarray.Dataset
        In SI units; NaN, and `used` 0, where a view lacks a point.

    Raises
    ------
    UserError
        If two views have the same name.

    Examples
    --------
    >>> table = RegistrationTable("front", np.array([7]), np.eye(3)[:1], dac=np.array([[30, -60]]))
    >>> to_dataset([table])["dac"].values.tolist()
    [[[30.0, -60.0]]]
    """
    names = [table.name for table in tables]
    if len(set(names)) < len(names):
        raise UserError(f"registration data: two of the views {', '.join(names)} have one name")
    numbers = list(dict.fromkeys(int(n) for table in tables for n in table.number))
    arrays: dict[str, Array] = {}
    for name, (source, size) in ARRAYS.items():
        values = np.full((len(tables), len(numbers), size), np.nan)
        for row, table in zip(values, tables, strict=True):
            if getattr(table, source) is not None:
                row[[numbers.index(n) for n in table.number]] = getattr(table, source)
        if not np.isnan(values).all():
            arrays[name] = values
    kept = [t.number for t in tables]
    if used is not None:
        kept = [number[own] for number, own in zip(kept, used, strict=True)]
    marks = [np.isin(numbers, own) for own in kept]
    return run.group(GROUP, {"view": names, "point": numbers}, **arrays, used=marks)


def from_dataset(
    dataset: xr.Dataset, source: str, unit: LengthUnit | None = None
) -> list[RegistrationTable]:
    """Read registration data of every view of a dataset with the variables of ``/registration``.

    Parameters
    ----------
    dataset : xarray.Dataset
        With dimensions point and, of several views, view.
    source : str
        What it is called in messages.
    unit : LengthUnit, optional
        Of `object_point`, if it has no attribute `units`.

    Returns
    -------
    list of RegistrationTable
        One a view; points that a view lacks are left out.

    Raises
    ------
    UserError
        If a variable, a dimension or a unit is missing or unknown, or a number is not finite.

    Examples
    --------
    >>> table = RegistrationTable("front", np.array([7]), np.eye(3)[:1], dac=np.array([[30, -60]]))
    >>> from_dataset(to_dataset([table]), "memory")
    [<RegistrationTable of view front: 1 point with DAC steps>]
    """
    if "view" not in dataset.dims:
        dataset = dataset.expand_dims(view=[Path(source).stem])
    point = _variable(dataset, "object_point", "axis", source)
    stated = point.attrs.get("units")
    length = stated_or_given(
        unit_named(LengthUnit, stated, f"{source}, object_point") if stated else None,
        unit,
        source,
        "an attribute units to object_point",
    )
    image = {}
    for name in IMAGE:
        if name in dataset:
            variable = _variable(dataset, name, "mirror", source)
            image[name] = variable.values * (_radians(variable, source) if name == "angle" else 1.0)
    known = None
    if STD in dataset:
        known = _variable(dataset, STD, "axis", source).values * length.value
    tables = []
    for i, view in enumerate(dataset["view"].values):
        seen = {name: v[i] for name, v in image.items() if not np.isnan(v[i]).all()}
        lacking = [np.isnan(v).all(axis=1) for v in seen.values()]
        there = ~np.all(lacking, axis=0) if lacking else slice(None)
        tables.append(
            RegistrationTable(
                name=str(view),
                number=dataset["point"].values[there].astype(np.int64),
                object_point=point.values[i][there] * length.value,
                **{name: v[there] for name, v in seen.items()},
                unit=length,
                source=source,
                object_std=None if known is None or np.isnan(known[i]).all() else known[i][there],
            )
        )
    return tables


def _variable(dataset: xr.Dataset, name: str, last: str, source: str) -> xr.DataArray:
    """Give a variable the dimensions view, point and `last` in this order, `last` sorted."""
    if name not in dataset:
        there = ", ".join(str(v) for v in dataset.data_vars) or "no variables"
        raise UserError(
            f"{source}: the variable {name} is missing, in the group /{GROUP} or at the root; "
            f"there are {there}"
        )
    variable = dataset[name]
    dims = ("view", "point", last)
    if set(variable.dims) != set(dims):
        raise UserError(
            f"{source}: {name} must have the dimensions {', '.join(dims)}, "
            f"not {', '.join(str(d) for d in variable.dims)}"
        )
    if "point" not in variable.coords:
        raise UserError(f"{source}: the coordinate point with the points' numbers is missing")
    members = run.AXES[last]
    have = tuple(str(m) for m in variable[last].values) if last in variable.coords else ()
    if sorted(have) != sorted(members):
        raise UserError(
            f"{source}: the coordinate {last} of {name} must be {', '.join(members)}, "
            f"not {', '.join(have) or 'missing'}"
        )
    return variable.sel({last: list(members)}).transpose(*dims)


def _radians(angle: xr.DataArray, source: str) -> float:
    """Find the unit of angles in rad."""
    stated = angle.attrs.get("units")
    if stated is None:
        valid = ", ".join(AngleUnit.__members__)
        raise UserError(f"{source}: angle has no attribute units; add one of {valid}")
    return unit_named(AngleUnit, stated, f"{source}, angle").value
