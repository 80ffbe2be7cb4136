"""Line-of-sight velocities as named arrays in netCDF and MATLAB files, the program's or others'.

Others' variables and dimensions come under the program's names by a mapping that the user gives.
What a name or a length tells of the rest is only used to word the error, never to guess: a cube of
three views, three points and three components would be read wrong without a word.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.io.questions import Questions
from sldvexp.io.tables import AXES
from sldvexp.io.velocities.attributes import (
    frequency_factor,
    length_factor,
    require_errors_alike,
    stated_length,
    velocity_units,
)
from sldvexp.io.velocities.headings import HeadingUnits, read_headings
from sldvexp.io.velocities.matlab import read_arrays
from sldvexp.io.velocities.orders import (
    ALLOWED,
    all_agree,
    cubes,
    fitting_orders,
    in_order,
    orders_that_fit,
    require_plausible,
    shapes_agree,
    told_shapes,
)
from sldvexp.io.velocities.table import (
    DIMENSIONS,
    KNOWN,
    ORDER,
    OWN,
    UNSTATED_FREQUENCY,
    UNSTATED_LENGTH,
    UNSTATED_VELOCITY,
    FileLayout,
    LineOfSight,
)
from sldvexp.io.velocities.texts import compare_texts, texts_of_arrays, texts_of_attributes
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array
from sldvexp.units import VelocityUnit

REQUIRED = ("direction_cosines", "velocity")
JOINED = ("triangle", "line")
#: Arrays that a message lists.
MOST_LISTED = 12
#: How others may call a dimension.
LIKE = {
    "axis": "xyz|ax[ie]s|comp|dir|coord|dim|cart",
    "frequency": "freq|^n?f$|hz|omega|line",
    "point": "point|node|grid|pixel|^p$|^n$",
    "view": "view|head|look|station",
}
#: Variables that must go together, and what they make.
PARTS = {"velocity": ("real", "imag"), "direction_cosines": ("dx", "dy", "dz")}


def read_netcdf(path: Path, unit: VelocityUnit | None, layout: FileLayout = OWN) -> LineOfSight:
    """Read a run's group ``line_of_sight``, or the same variables of another file.

    These are at the root or in the layout's group, and may have other names of variables and
    dimensions. The file's own unit of velocity must agree with `unit`, if that is set.
    """
    raw = _group(path, layout)
    layout.require([*raw.variables, *raw.dims], path)
    raw = raw.drop_vars(layout.ignored, errors="ignore")
    layout = replace(layout, mapping=_used(layout))
    data, theirs = _renamed(raw, layout, path)
    names = {str(k): layout.mapping.get(str(k), str(k)) for k in raw.variables}
    units, questions = HeadingUnits(), Questions()
    with questions.noting(path):
        units = read_headings(names, unit, layout, path)
    for name in REQUIRED:
        if name not in data:
            others = [str(n) for n in data.data_vars if n not in KNOWN]
            there = f"; there are {', '.join(others)}, of which instrument.mapping may call one so"
            raise UserError(
                f"{path}: the variable {name} is missing; needed are {', '.join(REQUIRED)}"
                f"{there if others else ''}"
            )
    factor = UNSTATED_VELOCITY.value
    with questions.noting(path):
        factor, amplitude = velocity_units(data["velocity"], unit, units, layout, path)
        require_errors_alike(data, factor, amplitude, unit, layout, path)
        stated = factor if data["velocity"].attrs.get("units") else units.velocity
        units = replace(units, velocity=stated, amplitude=amplitude)
    values: dict[str, Any] = {}
    for name, key in (
        ("direction_cosines", "direction_cosines"),
        ("velocity", "velocity"),
        ("velocity_std", "std"),
    ):
        if name in data:
            values[key] = _in_order(data, name, theirs, path)
    if ("point" in data["velocity"].dims) != ("point" in data["direction_cosines"].dims):
        raise UserError(f"{path}: velocity and direction_cosines must both have a dimension point")
    values |= {d: data[d].values for d in ORDER if d in data.variables}
    if "frequency" in values:
        hertz = frequency_factor(data["frequency"], units.frequency, path)
        values["frequency"] = hertz * _numbers(values, "frequency", path)
    values |= _places(data, theirs, layout, path, units.length)
    units = replace(units, length=stated_length(data, path) or units.length)
    texts = texts_of_attributes(data.assign_attrs(raw.attrs))
    odd = compare_texts(texts, unit, units, layout, path, questions)
    return replace(_asked(questions, values, path, factor, layout, units), odd=odd)


def _asked(
    questions: Questions,
    values: Mapping[str, Any],
    path: Path,
    factor: float,
    layout: FileLayout,
    units: HeadingUnits,
) -> LineOfSight:
    """Check arrays, and ask all that is open."""
    with questions.noting(path, "incomplete"):
        found = from_arrays(values, path, factor, layout)
    questions.done()
    return replace(found, amplitude=units.amplitude)


def _places(
    data: xr.Dataset,
    theirs: dict[str, str],
    layout: FileLayout,
    path: Path,
    named: float | None,
) -> dict[str, NDArray]:
    """Find positions, m, and the triangles and lines between points, from 0."""
    there: dict[str, NDArray] = {}
    if "position" not in data and all(c in data and data[c].dims == ("point",) for c in AXES):
        data = data.assign(position=xr.concat([data[c] for c in AXES], "axis", coords="minimal"))
        data["position"].attrs = dict(data["x"].attrs)
        units = [str(data[c].attrs.get("units", "")) or "no unit" for c in AXES]
        if len(set(units)) > 1:
            message = f"x, y and z are in {', '.join(units)}; they must be in the same unit"
            raise UserError(f"{path}: {message}")
    if "position" in data:
        unit = length_factor(data["position"], layout.length, named, path)
        there["position"] = unit * _in_order(data, "position", theirs, path)
    for name in ("triangle", "line"):
        if name in data and name not in data.dims:
            there[name] = data[name].values - int(data[name].attrs.get("start_index", 0))
        elif name in data:
            there[name] = data[name].values
    return there


def read_matlab(path: Path, unit: VelocityUnit | None, layout: FileLayout = OWN) -> LineOfSight:
    """Read a MATLAB file with arrays of these names, or of those that the layout maps to them.

    ``direction_cosines`` (views x 3, or views x points x 3), ``velocity`` (views x frequencies, or
    views x points x frequencies) or ``real`` and ``imag``, and optionally ``std`` (as velocity),
    ``frequency``, ``view``, ``point``, ``position`` (points x 3), and ``triangle`` and ``line`` of
    points counted from 1; they may be fields of a struct. The layout's order is that of all arrays.
    """
    found = read_arrays(path)
    layout.require(found, path)
    found = {name: array for name, array in found.items() if name not in layout.ignored}
    layout = replace(layout, mapping=_used(layout))
    values: dict[str, Any] = _with_parts({layout.mapping.get(k, k): v for k, v in found.items()})
    names = {k: layout.mapping.get(k, k) for k in found}
    if not any(name in values for name in REQUIRED):
        struct, fields = _one_struct(values, path)
        values |= fields
        names |= {f"{struct}.{field}": field for field in fields}
    for name in REQUIRED:
        if name not in values:
            raise UserError(
                f"{path}: the array {name} is missing; needed are {', '.join(REQUIRED)}; the file "
                f"has {_contents(found)}, of which instrument.mapping may call one so"
            )
    units, questions = HeadingUnits(), Questions()
    with questions.noting(path):
        units = read_headings(names, unit, layout, path)
    stored = values
    if layout.order:
        values = in_order(values, layout.order, path)
    if not shapes_agree(values) or (not all_agree(values) and orders_that_fit(stored)):
        raise UserError(f"{path}: {told_shapes(values)}: {fitting_orders(stored, layout.order)}")
    if not layout.order and "view" not in values:
        with questions.noting(path, "order"):
            require_plausible(values, stored, path)
    if "frequency" in values:
        values["frequency"] = np.asarray(values["frequency"]).ravel()
        hertz = units.frequency or UNSTATED_FREQUENCY
        values["frequency"] = hertz * _numbers(values, "frequency", path)
    for name in {"view", "point"} & set(values):
        values[name] = _names(values[name])
    if "position" in values:
        length = units.length or (layout.length or UNSTATED_LENGTH).value
        values["position"] = length * _numbers(values, "position", path)
    for name in set(JOINED) & set(values):
        values[name] = np.atleast_2d(_numbers(values, name, path)) - 1
    factor = units.velocity or UNSTATED_VELOCITY.value
    odd = compare_texts(texts_of_arrays(found, names), unit, units, layout, path, questions)
    return replace(_asked(questions, values, path, factor, layout, units), odd=odd)


def _used(layout: FileLayout) -> dict[str, str]:
    """List the names that are of use."""
    return {k: v for k, v in layout.mapping.items() if k not in layout.ignored}


def _names(values: Any) -> list[str]:
    """Read names, whole numbers without a decimal point."""
    found = np.atleast_1d(np.asarray(values)).ravel()
    if found.dtype.kind == "f" and (found == np.round(found)).all():
        found = found.astype(np.int64)
    return [str(np.squeeze(name)).strip() for name in found]


def _one_struct(values: dict[str, NDArray], path: Path) -> tuple[str, dict[str, NDArray]]:
    """Find the one struct that has what is needed, with its fields; empty if there is none."""
    structs = list(dict.fromkeys(name.rpartition(".")[0] for name in values if "." in name))
    fields = {
        struct: {
            name.removeprefix(f"{struct}."): value
            for name, value in values.items()
            if name.startswith(f"{struct}.")
        }
        for struct in structs
    }
    whole = {
        struct: made
        for struct, own in fields.items()
        if set(REQUIRED) <= set(made := _with_parts(own))
    }
    if len(whole) > 1:
        raise UserError(
            f"{path}: the structs {' and '.join(whole)} have all that is needed; say which with "
            f"instrument.mapping={{{next(iter(whole))}.velocity: velocity, ...}}"
        )
    return next(iter(whole.items()), ("", {}))


def _contents(found: Mapping[str, NDArray]) -> str:
    """List the arrays of a file with their sizes."""
    kinds = {"c": "complex", "O": "cells", "U": "text"}
    listed = [
        f"{name} ({' x '.join(map(str, array.shape)) or 1}"
        f"{' ' if array.dtype.kind in kinds else ''}{kinds.get(array.dtype.kind, '')})"
        for name, array in found.items()
    ]
    more = [f"{len(listed) - MOST_LISTED} more"] if len(listed) > MOST_LISTED else []
    return ", ".join(listed[:MOST_LISTED] + more) or "nothing"


def from_arrays(
    values: Mapping[str, Any], path: Path, unit: float, layout: FileLayout = OWN
) -> LineOfSight:
    """Give missing point and frequency dimensions length one and check the shapes.

    Parameters
    ----------
    values : mapping of str to array
        ``direction_cosines``, ``velocity``, and perhaps ``std``, ``view``, ``point``,
        ``frequency``, ``position`` in m, and ``triangle`` and ``line``, from 0.
    path : Path
        Of the file, for messages.
    unit : float
        One of that of velocities and standard errors in m/s.
    """
    cosines = _numbers(values, "direction_cosines", path)
    velocity = _numbers(values, "velocity", path)
    several = cosines.ndim == 3
    if not shapes_agree(values):
        raise UserError(f"{path}: {told_shapes(values)}")
    cosines, velocity = cubes(cosines, velocity)
    views, points = cosines.shape[:2]
    frequency = _frequencies(values, velocity.shape[2], path)
    std = None
    if "std" in values:
        std = (
            cubes(values["direction_cosines"], _numbers(values, "std", path).astype(float))[1]
            * unit
        )
        try:
            std = np.broadcast_to(std, velocity.shape)
        except ValueError:
            raise UserError(
                f"{path}: the standard errors have the shape {std.shape}, the velocities "
                f"{velocity.shape}; they must agree, or have length 1 where they stay the same"
            ) from None
    missing = np.isnan(velocity) if layout.gaps else np.zeros(velocity.shape, bool)
    if std is not None and layout.gaps:
        missing |= np.isnan(std)
        std = np.where(missing, np.nan, std)
    named = several or "position" in values
    joined = {k: _numbers(values, k, path).astype(np.int64) for k in JOINED if k in values}
    return LineOfSight(
        source=str(path),
        view=_labels(values, "view", views, path),
        point=_labels(values, "point", points, path) if named else None,
        frequency=frequency,
        direction_cosines=cosines.astype(float),
        velocity=np.where(missing, np.nan, velocity) * unit,
        std=std,
        missing=missing if missing.any() else None,
        position=np.atleast_2d(values["position"]) if "position" in values else None,
        triangle=joined.get("triangle"),
        line=joined.get("line"),
    )


def _numbers(values: Mapping[str, Any], name: str, path: Path) -> NDArray:
    """Complain unless an array holds numbers, along views at least."""
    array = np.asarray(values[name])
    if array.dtype.kind not in ("biuf" if name != "velocity" else "biufc"):
        raise UserError(f"{path}: {name} must hold {'' if name == 'velocity' else 'real '}numbers")
    if array.ndim < 1 + (name == "direction_cosines"):
        raise UserError(f"{path}: {name} must have an entry for every view")
    return array


def _labels(values: Mapping[str, Any], dim: str, size: int, path: Path) -> list[str]:
    """Name views or points; by numbers from 1 if there are no names."""
    names = [str(name) for name in values.get(dim, range(1, size + 1))]
    if len(names) != size:
        raise UserError(f"{path}: there are {len(names)} names of {dim}s, but {size} {dim}s")
    return names


def _frequencies(values: Mapping[str, Any], size: int, path: Path) -> Array | None:
    """Find the frequencies of the velocities; None for a single one that is not stated."""
    if "frequency" not in values:
        if size > 1:
            raise UserError(f"{path}: velocities at {size} frequencies need an array frequency")
        return None
    frequency = _numbers(values, "frequency", path).astype(float)
    if len(frequency) != size:
        raise UserError(f"{path}: there are {len(frequency)} frequencies but velocities at {size}")
    return frequency


def _with_parts(values: dict[str, NDArray]) -> dict[str, NDArray]:
    """Put arrays together of their parts: ``real`` and ``imag``, ``dx, dy, dz`` and ``x, y, z``."""
    made = dict(values)
    if "velocity" not in made and "real" in made:
        made["velocity"] = np.asarray(made["real"])
        if "imag" in made:
            made["velocity"] = made["velocity"] + 1j * np.asarray(made["imag"])
    for whole, parts in (("direction_cosines", PARTS["direction_cosines"]), ("position", AXES)):
        if whole in made or not set(parts) <= set(made):
            continue
        own = [np.squeeze(made[part]) for part in parts]
        if len({one.shape for one in own}) == 1:
            made[whole] = np.stack(own, axis=-1)
    return made


def _group(path: Path, layout: FileLayout) -> xr.Dataset:
    """Read the file's group into memory."""
    with dataset.readable(path), dataset.load(path) as tree:
        name = layout.group or ("line_of_sight" if "line_of_sight" in tree.children else "/")
        if name.strip("/") not in ("", *(n.path.strip("/") for n in tree.descendants)):
            groups = ", ".join(n.path.strip("/") for n in tree.descendants) or "none"
            raise UserError(f"{path}: has no group {name}; there are {groups}")
        return tree[name].to_dataset().load()


def _renamed(data: xr.Dataset, layout: FileLayout, path: Path) -> tuple[xr.Dataset, dict[str, str]]:
    """Give variables and dimensions the program's names, and put them together of their parts.

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
    """Find the dimension whose entries a variable names: this says what the dimension is."""
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
    """Make all arrays anew, under their names; a dimension keeps the file's entries of it."""
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
    """Put velocities together of their complex parts, directions of their components."""
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


def _in_order(data: xr.Dataset, name: str, theirs: dict[str, str], path: Path) -> NDArray:
    """Put a variable's dimensions in the order (view, point, axis or frequency).

    Raises
    ------
    UserError
        If it has others, or lacks one that it needs.
    """
    allowed = ALLOWED[name]
    array = data[name]
    strange = [str(d) for d in array.dims if d not in allowed]
    whole = {"direction_cosines": ("view", "axis"), "velocity": ("view",)}
    needed = (whole | {"position": ("point", "axis")}).get(name, ())
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
    """Say how the dimensions become those of the program, the needed ones first."""
    if not strange:
        return ", of which it lacks " + " and ".join(free)
    if not free:
        return f"; leave {', '.join(strange)} out of the file"
    pairs = _pairs(array, strange, free)
    if not any(own == "axis" for own in pairs.values()) and free == ["axis"]:
        return f"; {' and '.join(strange)} cannot be axis, which has the length 3"
    example = ", ".join(f"{a}: {pairs.get(a, '')}" for a in strange)
    if len(strange) == len(free) == 1:
        return f"; say instrument.mapping={{{example}}}"
    return f"; say which is which of {', '.join(free)} with instrument.mapping={{{example}}}"


def _pairs(array: xr.DataArray, strange: list[str], free: list[str]) -> dict[str, str]:
    """Find which dimension each strange one is, if its name, entries or length leave no other.

    Others are for the user to say, as an example that somebody copied would be a guess.
    """
    pairs: dict[str, str] = {}
    for own in (d for d in LIKE if d in free):
        alike = [d for d in strange if d not in pairs and re.search(LIKE[own], d.lower())]
        if own == "axis":
            of_three = [d for d in strange if array.sizes[d] == 3]
            labelled = [d for d in of_three if d in array.coords and _tells_xyz(array[d].values)]
            named = [d for d in of_three if d in alike]
            alike = labelled or named or (of_three if len(of_three) == 1 else [])
        if len(alike) == 1:
            pairs[alike[0]] = own
    left = [d for d in strange if d not in pairs]
    others = [d for d in free if d not in pairs.values()]
    if len(left) == len(others) == 1 and (others != ["axis"] or array.sizes[left[0]] == 3):
        pairs[left[0]] = others[0]
    return pairs


def _ends(labels: NDArray) -> list[str]:
    """List the last letters of labels."""
    return [str(label).strip().lower()[-1:] for label in labels]


def _tells_xyz(labels: NDArray) -> bool:
    """Tell whether labels end in x, y and z."""
    return sorted(_ends(labels)) == list("xyz")


def _xyz(labels: NDArray) -> list[int]:
    """Find x, y, z by the ends of the labels; as they stand if these do not tell."""
    return [_ends(labels).index(c) for c in "xyz"] if _tells_xyz(labels) else [0, 1, 2]


def _sizes(array: xr.DataArray, theirs: dict[str, str] | None = None) -> str:
    """List dimensions with their lengths, by the file's names."""
    names = [(theirs or {}).get(str(dim), str(dim)) for dim in array.dims]
    return ", ".join(f"{n} ({s})" for n, s in zip(names, array.shape, strict=True)) or "none"
