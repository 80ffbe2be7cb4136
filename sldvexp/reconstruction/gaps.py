"""Points that a view has not measured: solved from the other views, if these are three or more.

Points and frequencies at which the same views have a velocity are solved together, with the rows
that the method makes of these views alone; ``s`` and the bounds are those of the views that are
there. Where a view has a velocity at some frequencies of a point only, it is taken as zero at the
others while that set of views is solved, and whatever comes out there is not used: no estimate
rests on a stand-in. Where fewer views are left, or the method has no rows of them, results are NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.typing import BoolArray, IndexArray

#: Solution of a group of some views, whose places among all views are given.
Solve = Callable[["xr.Dataset", IndexArray], "xr.Dataset"]
#: Views that determine a velocity, which has three components.
LEAST = 3
#: Variables of points whose components are not all determined, and of rows, which each set has.
DEFICIENT, ROW = "deficient", "row"
#: Attributes of which the least of all sets' results counts.
LEAST_OF = ("rcond", "hadamard", "dof", "components")
#: Attributes that are made anew of variables, since those of a set have its stand-ins in them.
MADE_OF: dict[str, tuple[Callable[[np.ndarray], Any], tuple[str, ...]]] = {
    "s": (np.max, ("s",)),
    "sse": (np.sum, ("sse",)),
    "lowest_p_value": (np.min, ("chi2_p_value", "f_p_value")),
}


def gaps_of(line_of_sight: xr.Dataset) -> xr.DataArray:
    """Find the points and frequencies at which some view has no velocity.

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> gaps_of(xr.Dataset({"velocity": (("view", "point"), [[1.0, np.nan], [2.0, 3.0]])})).values
    array([False,  True])
    """
    return ~_seen(line_of_sight).all("view")


def _seen(line_of_sight: xr.Dataset) -> xr.DataArray:
    """Find where velocities are."""
    return xr.apply_ufunc(np.isfinite, line_of_sight["velocity"])


@dataclass(frozen=True)
class _Part:
    """Points and frequencies at which the same views have a velocity, and what comes out there.

    Parameters
    ----------
    views : ndarray of int, shape (view,)
        Places of these views.
    here : DataArray of bool, over point and frequency as far as there are any
    points : ndarray of int or None
        Places of the points that `found` is of; None if there is no such dimension.
    """

    views: IndexArray
    here: xr.DataArray
    points: IndexArray | None
    found: xr.Dataset


def solved_around(solve: Solve, line_of_sight: xr.Dataset) -> xr.Dataset:
    """Solve each point and frequency from the views that have a velocity there.

    Parameters
    ----------
    solve : callable
        From a group ``line_of_sight`` of some views without gaps, and their places among all, to
        the group ``point``.

    Raises
    ------
    UserError
        If nothing can be solved.
    """
    seen = _seen(line_of_sight)
    count = seen.sizes["view"]
    parts: list[_Part] = []
    for mask in _sets_of_views(seen):
        if mask.sum() < min(LEAST, count):
            continue
        here = (seen == xr.DataArray(mask, dims="view")).all("view")
        if mask.all():
            parts.append(_part(solve, line_of_sight, mask, here))
        else:  # the method may name rows that these views do not make
            with suppress(UserError):
                parts.append(_part(solve, line_of_sight, mask, here))
    if not parts:
        raise UserError(
            f"line_of_sight: no point has velocities of {LEAST} views that the method has rows of"
        )
    return _joined(line_of_sight, parts)


def _sets_of_views(seen: xr.DataArray) -> list[BoolArray]:
    """List which views are there together, the most views and then the most places first."""
    flat = np.moveaxis(seen.transpose("view", ...).values, 0, -1).reshape(-1, seen.sizes["view"])
    masks, places = np.unique(flat, axis=0, return_counts=True)
    order = np.lexsort((-places, -masks.sum(axis=1)))
    return [masks[k] for k in order]


def _part(
    solve: Solve,
    line_of_sight: xr.Dataset,
    mask: BoolArray,
    here: xr.DataArray,
) -> _Part:
    """Solve the points of one set of views."""
    views = np.flatnonzero(mask)
    own, points = line_of_sight.isel(view=views), None
    if "point" in here.dims:
        points = np.flatnonzero(here.any([d for d in here.dims if d != "point"]).values)
        own = own.isel(point=points)
    return _Part(views, here, points, solve(_filled(own), views))


def _filled(line_of_sight: xr.Dataset) -> xr.Dataset:
    """Put stand-ins where there is no velocity."""
    velocity = line_of_sight["velocity"]
    made = line_of_sight.assign(velocity=velocity.where(np.isfinite(velocity), 0.0))
    if "velocity_std" in line_of_sight:
        std = line_of_sight["velocity_std"].broadcast_like(velocity).transpose("view", ...)
        made["velocity_std"] = std.fillna(std.median(std.dims[1:]))
    return made


def _joined(line_of_sight: xr.Dataset, parts: list[_Part]) -> xr.Dataset:
    """Put the results of all sets of views together; what belongs to none is NaN, flags are 0."""
    first = parts[0].found
    made = first.drop_dims(DEFICIENT, errors="ignore")
    if parts[0].points is not None:
        made = made.reindex(point=line_of_sight["point"].values)
    for name, variable in made.data_vars.items():
        if ROW in variable.dims:
            made[name] = _where_placed(variable, parts[0].here)
        if not _is_placed(variable):
            continue
        dtype = first[name].dtype
        values: Any = np.full(variable.shape, np.nan if dtype.kind in "fc" else 0, dtype)
        done = xr.zeros_like(parts[0].here)
        for part in parts:
            if name in part.found:
                values = _taken(values, variable, part, done, part.found[name])
            done = done | part.here
        made[name] = variable.copy(data=values).assign_attrs(first[name].attrs)
    attributes = _attributes(made, line_of_sight, parts)
    return _with_deficient(made, parts).assign_attrs(attributes)


def _is_placed(variable: xr.DataArray) -> bool:
    """Tell whether a variable is of points or frequencies, and not of rows."""
    return bool({"point", "frequency"} & set(variable.dims)) and ROW not in variable.dims


def _where_placed(variable: xr.DataArray, here: xr.DataArray) -> xr.DataArray:
    """Blank what stand-ins made: a variable outside of the points and frequencies of its set."""
    kept = here.any([d for d in here.dims if d not in variable.dims])
    return variable.where(kept).transpose(*variable.dims) if kept.dims else variable


def _taken(
    values: np.ndarray, variable: xr.DataArray, part: _Part, done: xr.DataArray, own: xr.DataArray
) -> np.ndarray:
    """Take a part's results where it is the one; numbers of a point are of its first part."""
    here = part.here
    lost = [d for d in here.dims if d not in variable.dims]
    if lost:
        here = here.any(lost) & ~done.any(lost)
    own = own.transpose(*variable.dims)
    if part.points is not None and "point" in variable.dims:
        whole = np.zeros(values.shape, own.dtype)
        place: list[Any] = [slice(None)] * values.ndim
        place[variable.dims.index("point")] = part.points
        whole[tuple(place)] = own.values
    else:
        whole = own.values
    mask = here.broadcast_like(variable).transpose(*variable.dims).values
    return np.where(mask, whole, values)


def _with_deficient(made: xr.Dataset, parts: list[_Part]) -> xr.Dataset:
    """Add what is determined at points whose views leave components open."""
    listed, done = [], xr.zeros_like(parts[0].here)
    for part in parts:
        if DEFICIENT in part.found.dims:
            names = [n for n, v in part.found.data_vars.items() if DEFICIENT in v.dims]
            own = part.found[names].drop_vars(["point", ROW], errors="ignore")
            here = part.here
            if part.points is not None:
                others = [d for d in part.here.dims if d != "point"]
                places = part.points[own["deficient_point"].values]
                kept = ~(done.any(others).values[places])
                own["deficient_point"] = own["deficient_point"].copy(data=places)
                here = here.isel(point=xr.DataArray(places, dims=DEFICIENT))
                here = here.drop_vars("point", errors="ignore")
                own, here = own.isel({DEFICIENT: kept}), here.isel({DEFICIENT: kept})
            for name, variable in own.data_vars.items():
                if "frequency" in variable.dims:
                    own[name] = _where_placed(variable, here)
            listed.append(own)
        done = done | part.here
    if parts[0].points is None:
        listed = listed[:1]
    return made.merge(xr.concat(listed, DEFICIENT)) if listed else made


def _attributes(made: xr.Dataset, line_of_sight: xr.Dataset, parts: list[_Part]) -> dict[str, Any]:
    """Join the headline numbers and the notes."""
    found = dict(parts[0].found.attrs)
    for name in LEAST_OF:
        values = [part.found.attrs[name] for part in parts]
        found[name] = min((v for v in values if np.isfinite(v)), default=found[name])
    for name, (join, variables) in MADE_OF.items():
        if name in found:
            whole = np.concatenate([np.ravel(made[v].values) for v in variables if v in made])
            known = whole[np.isfinite(whole)]
            found[name] = float(join(known)) if known.size else np.nan
    notes = [line for part in parts for line in str(part.found.attrs["notes"]).splitlines()]
    counted = _counted(parts, line_of_sight.sizes["view"])
    found["notes"] = "\n".join(dict.fromkeys([*notes, counted]))
    return found


def _counted(parts: list[_Part], whole: int) -> str:
    """Say how many points, or frequencies of a single one, have how many of `whole` views."""
    dims = parts[0].here.dims
    along = "point" if "point" in dims else "frequency"
    others = [d for d in dims if d != along]
    what = {"point": "points", "frequency": "frequencies"}[along]
    fewer: dict[int, int] = {}
    for part in parts:
        views = len(part.views)
        fewer[views] = fewer.get(views, 0) + int(part.here.any(others).sum())
    counts = [f"{n} from {views}" for views, n in fewer.items() if views < whole]
    solved = xr.concat([part.here for part in parts], "part").any("part")
    lost = int((~solved.any(others)).sum())
    none = f"; {lost} without a result, as too few are left" if lost else ""
    told = f"{what} that not all {whole} views have measured are determined from fewer: "
    return f"{told}{', '.join(counts) or 'none'}{none}"
