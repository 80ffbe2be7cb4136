"""The few numbers that a run was made for, with their bounds: on the surface, not in the volume.

Of modes these are frequency and damping; of a field or of points the largest amplitude of every
component with the bound there, and root mean squares over the surface; of images the largest
amplitude; of poses where the instrument stood. A component that is nowhere above its bound is said
to be so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.dataset import FREQUENCY, VARIABLES, RunData
from sldvexp.lazy import xarray as xr
from sldvexp.report.modal_tables import POLES, level_of, poles
from sldvexp.report.numbers import bound_text, bounds_of, number, with_bound
from sldvexp.typing import Array

VELOCITY = VARIABLES["field"]["velocity"]
POSE = VARIABLES["pose"]
#: Beyond so many views a page has them only further down.
MOST_VIEWS = 6
#: Beyond so many modes as well.
MOST_MODES = 12
#: Surfaces of a sheet, by the words of the glossary.
FACE, MIDDLE = "measured face", "middle surface"
#: Part of its depth by which a layer may lie beside the face.
ON_FACE = 0.02


@dataclass(frozen=True)
class KeyNumbers:
    """A small table with a title; of a face with that of the middle surface beside it."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    beside: KeyNumbers | None = None  # the same of another surface


def on_surface(run: RunData, field: xr.Dataset) -> xr.Dataset:
    """Take the layer of a field that is nearest to the given surface.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> volume = group("volume", {}, depth=[-0.01, 0.0])
    >>> field = group("field", {}, position=[[0, 0, -0.01], [0, 0, 0.0]])
    >>> on_surface(RunData({"volume": volume}), field).sizes["node"]
    1
    """
    depths = run.groups["volume"]["depth"].values if run.has("volume", "depth") else np.zeros(1)
    nodes = field.sizes["node"]
    if nodes % len(depths):
        return field
    each, layer = nodes // len(depths), int(np.abs(depths).argmin())
    return field.isel(node=slice(layer * each, (layer + 1) * each))


def surface_name(field: xr.Dataset) -> str:
    """Name the surface that a field's volume is given by, where the field tells which it is.

    Along itself the middle surface of a bent plate rests where its face does not.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> surface_name(group("field", {}, position=[[0, 0, 0]]).assign_attrs(given_surface="middle"))
    'middle surface'
    """
    given = str(field.attrs.get("given_surface", ""))
    return {"middle": MIDDLE, "face": FACE}.get(given, "given surface")


def on_face(run: RunData, field: xr.Dataset) -> xr.Dataset | None:
    """Take the layer of a field on the measured face; None if it has none, or does not know.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> volume = group("volume", {}, depth=[0.0, 0.0015])
    >>> field = group("field", {}, position=[[0, 0, 0], [0, 0, 0.0015]])
    >>> run = RunData({"volume": volume})
    >>> on_face(run, field) is None, on_face(run, field.assign_attrs(face_depth=0.0015)).sizes
    (True, Frozen({'node': 1, 'axis': 3}))
    """
    if "face_depth" not in field.attrs or not run.has("volume", "depth"):
        return None
    depths, face = run.groups["volume"]["depth"].values, float(field.attrs["face_depth"])
    layer = int(np.abs(depths - face).argmin())
    if abs(depths[layer] - face) > ON_FACE * abs(face) or field.sizes["node"] % len(depths):
        return None
    each = field.sizes["node"] // len(depths)
    return field.isel(node=slice(layer * each, (layer + 1) * each))


def key_numbers(run: RunData) -> KeyNumbers | None:
    """Find what a person looks for first; None if the run has nothing of the kind.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> found = group("point", {}, velocity=[0.02, 1e-5, 0], confidence=[1e-4, 2e-4, 1e-4])
    >>> key_numbers(RunData({"point": found})).rows[:2]
    [['x', '20.00 ± 0.10'], ['y', 'not above its bound, ± 0.20']]
    """
    if run.has("modes", "natural_frequency", "damping_ratio"):
        return _of_modes(run.groups["modes"])
    for field in run.fields().values():
        given = surface_name(field)
        own = _of_places(on_surface(run, field), "node", f"Velocity on the {given}")
        face = on_face(run, field) if given == MIDDLE else None
        if face is None:
            return own
        # It is the face that the beam meets; along itself the middle surface of a bent plate rests.
        return replace(_of_places(face, "node", f"Velocity on the {FACE}"), beside=own)
    point = run.groups.get("point")
    if point is not None and "confidence" in point:
        many = point.sizes.get("point", 1) > 1
        return _of_places(point, "point", "Velocity of the points" if many else "Velocity")
    if run.has("pose", "origin"):
        return _of_poses(run.groups["pose"])
    return None


def _of_modes(modes: xr.Dataset) -> KeyNumbers:
    """Show frequency and damping of the modes, with bounds."""
    rows = [[str(n), *row] for n, row in zip(modes["mode"].values, poles(modes), strict=True)]
    more = f"; {len(rows) - MOST_MODES} more below" if len(rows) > MOST_MODES else ""
    title = f"Modes, with {100 * level_of(modes):g} % bounds{more}"
    return KeyNumbers(title, ["mode", *POLES], rows[:MOST_MODES])


def _of_places(group: xr.Dataset, place: str, title: str) -> KeyNumbers:
    """Show the largest and the usual size of every component at the strongest frequency."""
    unit, factor = VELOCITY.shown_unit, VELOCITY.factor
    if "frequency" in group.dims:
        others = [d for d in group["velocity"].dims if d != "frequency"]
        size = (abs(group["velocity"]) ** 2).sum(others).values
        count, group = group.sizes["frequency"], group.isel(frequency=int(np.argmax(size)))
        title += f" at {float(group['frequency']):g} {FREQUENCY.units}"
        title += f", the strongest of {count} frequencies" * (count > 1)
    level = f"{float(group.attrs.get('confidence_level', 0.95)):.0%} bound"
    many = group.sizes.get(place, 1) > 1
    names = ["component", f"largest ± {level}, {unit}" if many else f"amplitude ± {level}, {unit}"]
    names += [f"r.m.s., {unit}", f"r.m.s. of bounds, {unit}"] * many
    rows = []
    for component in group["component"].values:
        one = group.sel(component=component)
        values = factor * np.abs(np.atleast_1d(one["velocity"].values))
        bounds = factor * np.atleast_1d(np.asarray(one["confidence"].values, float))
        row = [str(component), _largest(values, bounds)]
        row += [number(_rms(values), 3), number(_rms(bounds), 2)] * many
        rows.append(row)
    return KeyNumbers(title, names, rows)


def _largest(values: Array, bounds: Array) -> str:
    """Write the largest value that is above its bound; say so if none is."""
    if not np.isfinite(values).any():
        return "not determined"
    above = np.nan_to_num(values) > np.nan_to_num(bounds, nan=0.0)
    if not above.any():
        return f"not above its bound, {bound_text(float(np.nanmax(bounds)))}"
    at = int(np.nanargmax(np.where(above, values, -1.0)))
    return with_bound(float(values[at]), float(bounds[at]))


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _of_poses(pose: xr.Dataset) -> KeyNumbers:
    """Show where the instrument stood, with bounds."""
    views = [str(v) for v in pose["view"].values]
    origin = POSE["origin"]
    names = ["view", *(origin.titled(str(axis)) for axis in pose["axis"].values)]
    rows = []
    for view in views[:MOST_VIEWS]:
        one = pose.sel(view=view)
        bounds = bounds_of(one, "origin").values
        pairs = zip(one["origin"].values, bounds, strict=True)
        rows.append([view, *(with_bound(*(origin.factor * v for v in pair)) for pair in pairs)])
    told = f"Where the instrument stood, of {len(views)} views" if len(views) > 1 else ""
    first = f", the first {MOST_VIEWS}" * (len(views) > MOST_VIEWS)
    return KeyNumbers((told or "Where the instrument stood") + first, names, rows)
