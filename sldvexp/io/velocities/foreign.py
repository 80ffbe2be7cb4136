"""The variables of others' netCDF files under the program's names, or what is wrong with these."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.io.velocities.layout import ORDER, Layout
from sldvexp.lazy import xarray as xr

DIMENSIONS = (*ORDER, "axis")
#: Dimensions that each variable may have; the first is needed.
ALLOWED = {
    "direction_cosines": ("view", "point", "axis"),
    "velocity": ("view", "point", "frequency"),
    "velocity_std": ("view", "point", "frequency"),
}
#: How others may call a dimension.
LIKE = {
    "axis": "xyz|ax[ie]s|comp|dir|coord|dim|cart",
    "frequency": "freq|^n?f$|hz|omega|line",
    "point": "point|node|grid|pixel|^p$|^n$",
    "view": "view|head|scan|look|station|pos",
}
#: Variables that must go together, and what they make.
PARTS = {"velocity": ("real", "imag"), "direction_cosines": ("dx", "dy", "dz")}


def renamed(data: xr.Dataset, layout: Layout, path: Path) -> tuple[xr.Dataset, dict[str, str]]:
    """The file's variables and dimensions with the program's names, put together of their parts.

    Parameters
    ----------
    data : Dataset
    layout : Layout
    path : Path

    Returns
    -------
    data : Dataset
    theirs : dict of str to str
        From the program's names to the file's, of dimensions where both have one.

    Raises
    ------
    UserError
        If the mapping names what is not there, calls two the same, or calls a dimension what is
        none.
    """
    layout.require([*data.variables, *data.dims], path)
    dims = {k: v for k, v in layout.mapping.items() if k in data.dims}
    others = {k: "velocity_std" if v == "std" else v for k, v in layout.mapping.items()}
    others = {k: v for k, v in others.items() if k in data.variables and k not in dims}
    for theirs, own in dims.items():
        if own not in DIMENSIONS:
            raise UserError(
                f"{path}: instrument.mapping calls {theirs} {own}, but it is a dimension, of "
                f"length {data.sizes[theirs]}; a dimension is one of {', '.join(DIMENSIONS)}"
            )
    for theirs, own in others.items():
        if own in DIMENSIONS:
            dims |= _dimension_of(data[theirs], own, dims, path)
    for group in (dims, others):
        for own in dict.fromkeys(group.values()):
            twins = [k for k, v in group.items() if v == own]
            if len(twins) > 1:
                raise UserError(
                    f"{path}: instrument.mapping calls both {twins[0]} and {twins[1]} {own}; it "
                    "can be one of them"
                )
    back = {own: theirs for theirs, own in (others | dims).items()}
    return _together(_with_names(data, dims, others), path), back


def _dimension_of(
    array: xr.DataArray, own: str, dims: dict[str, str], path: Path
) -> dict[str, str]:
    """The dimension whose entries a variable names: this says what the dimension is."""
    if array.ndim > 1 or own == "axis":
        has = f"has the dimensions {_sizes(array)}" if array.ndim > 1 else "is no dimension itself"
        raise UserError(
            f"{path}: instrument.mapping calls {array.name} {own}, but it {has}; {own} must be a "
            "dimension or have one"
        )
    along = {str(dim): own for dim in array.dims}
    for theirs in along:
        if dims.get(theirs, own) != own:
            raise UserError(
                f"{path}: instrument.mapping calls {array.name} {own} but its dimension {theirs} "
                f"{dims[theirs]}; both must be one, as {{{array.name}: {own}, {theirs}: {own}}}"
            )
    return along


def _with_names(data: xr.Dataset, dims: dict[str, str], others: dict[str, str]) -> xr.Dataset:
    """All arrays anew, under their names; a dimension keeps the entries that the file has of it."""
    made = {}
    for name, array in data.variables.items():
        own = others.get(str(name), dims.get(str(name), str(name)))
        if own in made and str(name) not in others:
            continue  # entries that the mapping takes from another variable
        made[own] = xr.Variable([dims.get(str(d), str(d)) for d in array.dims], array.values)
        made[own].attrs = array.attrs
    found = xr.Dataset()
    # One by one: others' entries must not be aligned.
    return found.assign({k: v for k, v in made.items() if k not in v.dims}).assign_coords(
        {k: v for k, v in made.items() if k in v.dims}
    )


def _together(data: xr.Dataset, path: Path) -> xr.Dataset:
    """Complex velocities of their parts, directions of their components."""
    for whole, parts in PARTS.items():
        there = [name for name in parts if name in data]
        if not there:
            continue
        if whole in data:
            raise UserError(
                f"{path}: has {whole} and {', '.join(there)}; instrument.mapping must call either "
                f"one of its variables {whole}, or others {', '.join(parts)}"
            )
        if there != list(parts) and there != ["real"]:
            lost = [name for name in parts if name not in there]
            raise UserError(
                f"{path}: has {', '.join(there)} but not {', '.join(lost)}, which instrument."
                "mapping must call another of its variables"
            )
        first = data[there[0]]
        for name in there[1:]:
            if set(data[name].dims) != set(first.dims):
                raise UserError(
                    f"{path}: {there[0]} has the dimensions {_sizes(first)} but {name} "
                    f"{_sizes(data[name])}; they must have the same"
                )
            units = [data[part].attrs.get("units") for part in (there[0], name)]
            if None not in units and units[0] != units[1]:
                raise UserError(
                    f"{path}: {there[0]} is in {units[0]} but {name} in {units[1]}; they must be "
                    "in the same unit"
                )
        if whole == "velocity":
            made = data["real"] + 1j * data["imag"] if "imag" in data else data["real"] + 0j
        else:
            made = xr.concat([data[name] for name in parts], "axis", coords="minimal")
        data[whole] = made.assign_attrs(first.attrs)
    return data


def ordered(data: xr.Dataset, name: str, theirs: dict[str, str], path: Path) -> np.ndarray:
    """A variable's values with the dimensions in the order (view, point, axis or frequency).

    Parameters
    ----------
    data : Dataset
    name : str
    theirs : dict of str to str
        See `renamed`.
    path : Path

    Raises
    ------
    UserError
        If it has others, or lacks one that it needs.
    """
    allowed = ALLOWED[name]
    array = data[name]
    strange = [str(d) for d in array.dims if d not in allowed]
    needed = {"direction_cosines": ("view", "axis"), "velocity": ("view",)}.get(name, ())
    lost = [d for d in needed if d not in array.dims]
    if strange or lost:
        free = lost + [d for d in allowed if d not in array.dims and d not in lost]
        raise UserError(
            f"{path}: {theirs.get(name, name)} has the dimensions {_sizes(array, theirs)}; {name} "
            f"is over {', '.join(allowed)}{_remedy(array, strange, free)}"
        )
    if "axis" in array.dims and array.sizes["axis"] != 3:
        raise UserError(f"{path}: {name} has {array.sizes['axis']} components; it needs x, y, z")
    if name == "velocity_std":
        array = array.broadcast_like(data["velocity"])
    if "axis" in array.coords:
        array = array.isel(axis=_xyz(array["axis"].values))
    return np.array(array.transpose(*(d for d in allowed if d in array.dims)))


def _remedy(array: xr.DataArray, strange: list[str], free: list[str]) -> str:
    """What to say so that the dimensions become those of the program, the needed ones first."""
    if not strange:
        return ", of which it lacks " + " and ".join(free)
    if not free:
        return f"; leave {', '.join(strange)} out of the file"
    pairs = _pairs(array, strange, free)
    example = ", ".join(f"{a}: {pairs[a]}" for a in strange if a in pairs)
    if not example:
        return f"; {' and '.join(strange)} cannot be {' or '.join(free)}, which has the length 3"
    which = "" if len(strange) == len(free) == 1 else "which is which, as in "
    return f"; say {which}instrument.mapping={{{example}}}"


def _pairs(array: xr.DataArray, strange: list[str], free: list[str]) -> dict[str, str]:
    """What each strange dimension may be: by its name and length, else as they stand."""
    pairs: dict[str, str] = {}
    for own in (d for d in LIKE if d in free):
        alike = [d for d in strange if d not in pairs and re.search(LIKE[own], d.lower())]
        if own == "axis":
            of_three = [d for d in strange if array.sizes[d] == 3]
            labelled = [d for d in of_three if d in array.coords and _tells_xyz(array[d].values)]
            named = [d for d in of_three if d in alike]
            alike = labelled or named or (of_three if len(of_three) == 1 else [])
        if alike:
            pairs[alike[0]] = own
    left = [d for d in strange if d not in pairs]
    three = any(array.sizes[d] == 3 for d in left)
    others = [d for d in free if d not in pairs.values() and (d != "axis" or three)]
    return pairs | dict(zip(left, others, strict=False))


def _tells_xyz(labels: np.ndarray) -> bool:
    """Whether labels end in x, y and z."""
    return sorted(str(label).strip().lower()[-1:] for label in labels) == list("xyz")


def _xyz(labels: np.ndarray) -> list[int]:
    """Places of x, y, z by the ends of the labels; as they stand if these do not tell."""
    ends = [str(label).strip().lower()[-1:] for label in labels]
    return [ends.index(c) for c in "xyz"] if sorted(ends) == list("xyz") else [0, 1, 2]


def _sizes(array: xr.DataArray, theirs: dict[str, str] | None = None) -> str:
    """Dimensions with their lengths, by the file's names."""
    names = [(theirs or {}).get(str(dim), str(dim)) for dim in array.dims]
    return ", ".join(f"{n} ({s})" for n, s in zip(names, array.shape, strict=True)) or "none"
