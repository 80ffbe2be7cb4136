"""What came out: the poses, the images and the velocity with bounds, a section each.

The velocity comes as the shape that moves, the tables and the figures.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sldvexp.dataset import COMPARED_STRAIN, FREQUENCY, VARIABLES, RunData
from sldvexp.lazy import xarray as xr
from sldvexp.plot import strains_of
from sldvexp.report.html import packing
from sldvexp.report.html.blocks import (
    Alternatives,
    HtmlTable,
    Lead,
    More,
    Section,
    Shape,
    Text,
    having,
)
from sldvexp.report.html.diagnostics import verdict_blocks
from sldvexp.report.html.figures import drawable, figures
from sldvexp.report.html.setup import views_table
from sldvexp.report.html.shape import shape_of, shape_of_points, size_of
from sldvexp.report.key_numbers import key_numbers, surface_name
from sldvexp.report.modal_tables import model_told
from sldvexp.report.numbers import PLACES, bounds_of, number, place_text, with_bound
from sldvexp.report.tables import (
    MOST_FREQUENCIES,
    field_tables,
    pose_methods,
    strain_tables,
    thickness_taken,
)
from sldvexp.report.terminal import estimates, shown_intrinsic

POSE = VARIABLES["pose"]
RESIDUALS = ("s", "residual_rms", "pointing_std", "dof")
#: Velocities in the table of points, which scrolls; the dataset has all.
MOST_VELOCITIES = 30
#: In the place of a shape that cannot be drawn.
NO_TRIANGLES = (
    "The motion of the surface cannot be drawn here, since no triangles join its nodes; its "
    "velocities are in the tables below and in run.nc."
)
#: What the moving shape shows, of runs that have both.
CHOSEN = ("shapes of the modes", "velocity at the lines")


def result_section(run: RunData) -> Section:
    """Show the first screen: verdicts, key numbers, and the shape that moves or what else there is.

    A run without anything to look at has the picture of where the instrument stood there.
    """
    told: list[Any] = list(verdict_blocks(run))
    if (numbers := key_numbers(run)) is not None:
        told += [
            HtmlTable(one.columns, one.rows, one.title)
            for one in filter(None, (numbers, numbers.beside))
        ]
    if model := model_told(run):
        told.append(Text(f"{model[:1].upper()}{model[1:]}, see Model below."))
    shown = shape_blocks(run)
    if not any(isinstance(block, Shape | Alternatives) for block in shown):
        shown = having(shown, having(figures(run, "first"))[:1])
    if not shown and not run.below("image"):
        shown = having(figures(run, "stand"))[:1]
    return Section("Result", [Lead(told, shown)], unseen=True)


def pose_section(run: RunData) -> Section | None:
    """Show where the instrument stood, what the views saw, and all parameters of the poses."""
    poses = {"": run.groups["pose"]} if "pose" in run.groups else {}
    poses |= run.below("compare_pose")
    views = views_table(run)
    if not poses:
        return Section("Views", [views]) if views else None
    known = run.fields() or run.groups.keys() & {"point", "image"} or run.below("image")
    blocks = having(figures(run, "stands") if known else None, views)
    for name, pose in poses.items():
        level = f"{float(pose.attrs.get('confidence_level', 0.95)):.0%}"
        by = f" by {name}" if name else ""
        blocks += [
            HtmlTable(*_pose_table(pose, of, more), _bounded(title, pose, of[0], level))
            for title, of, more in (
                (f"Origin{by}", ("origin", "axis"), RESIDUALS),
                (f"Euler angles{by}", ("euler", "angle_index"), ()),
            )
        ]
        blocks += _adjusted(pose)
    methods = [HtmlTable.from_table(pose_methods(g)) for g in run.groups.values() if "s_mean" in g]
    note = (
        "World to laser: P_laser = R (P_world - origin), R by Euler angles of the x-convention. "
        "s is the standard deviation of one mirror reading, estimated from the residuals."
    )
    if not any(_is_bounded(pose, "origin") for pose in poses.values()):
        note = f"The poses were given, and have no bounds. {note.partition(' s is')[0]}"
    circles = list(figures(run, "circles"))
    seen = More("Circles of the calibration object, view by view", circles) if circles else None
    drawn = having(figures(run, "pose"), seen, _residuals(run))
    return Section("Views and poses", having(blocks, Text(note, "small"), methods, drawn))


def _bounded(title: str, pose: xr.Dataset, name: str, level: str) -> str:
    return f"{title}, with {level} bounds" if _is_bounded(pose, name) else title


def _is_bounded(pose: xr.Dataset, name: str) -> bool:
    """Tell whether a variable has a bound in any view."""
    own = pose.get(f"{name}_confidence")
    return own is not None and bool(np.isfinite(own.values).any())


def _pose_table(
    pose: xr.Dataset, of: tuple[str, str], more: Sequence[str]
) -> tuple[list[str], list[list[str]]]:
    """Make columns, and one row a view: a variable along its dimension, and more of the pose."""
    name, dimension = of
    columns = ["view", *(POSE[name].titled(str(label)) for label in pose[dimension].values)]
    told = [name for name in more if name in pose and np.isfinite(pose[name].values).any()]
    known = {name: POSE[name].titled() for name in told}
    rows = []
    for view in pose["view"].values:
        one = pose.sel(view=view)
        bounded = _is_bounded(pose, name)
        row = [str(view), *(_with_bounds(one, name) if bounded else _given(one, name))]
        rows.append([*row, *(number(float(one[other]), 3) for other in known)])
    return [*columns, *known.values()], rows


def _given(view: xr.Dataset, name: str) -> Iterator[str]:
    for value in POSE[name].factor * view[name].values:
        angle = POSE[name].shown_unit == "deg"
        yield f"{value:.{PLACES}f}" if angle else place_text([value])


def _with_bounds(view: xr.Dataset, name: str) -> Iterator[str]:
    factor = POSE[name].factor
    values = factor * view[name].values
    bounds = bounds_of(view, name).values
    for value, bound in zip(values, factor * bounds, strict=True):
        yield with_bound(value, bound)


def _adjusted(pose: xr.Dataset) -> Iterator[HtmlTable]:
    """Make parameters of the instrument that were adjusted with the pose."""
    if "intrinsic" not in pose:
        return
    shared = list(json.loads(pose.attrs.get("shared", "{}")))
    rows = []
    for name in pose["adjusted"].values:
        views = pose["view"].values[:1] if name in shared else pose["view"].values
        for view in views:
            one = pose.sel(view=view, adjusted=name)
            factor, unit = shown_intrinsic(str(name))
            pair = (factor * float(one[n]) for n in ("intrinsic", "intrinsic_confidence"))
            where = "all" if name in shared else str(view)
            rows.append([str(name), where, with_bound(*pair), unit])
    columns = ["parameter", "view", "value ± bound", "unit"]
    yield HtmlTable(columns, rows, "Adjusted with the pose")


def _residuals(run: RunData) -> More | None:
    """Make residuals of points, of which there are few."""
    pose = run.groups.get("pose")
    if pose is None or "residual" not in pose:
        return None
    residual = pose["residual"].values
    rows = [
        [str(view), str(point), *(number(r, 3) for r in residual[i, j])]
        for i, view in enumerate(pose["view"].values)
        for j, point in enumerate(pose["point"].values)
        if np.isfinite(residual[i, j]).any()
    ]
    table = HtmlTable(["view", "point", "up-down", "left-right"], rows)
    return More(POSE["residual"].titled("Residuals of every point"), [table])


def images_section(run: RunData) -> Section | None:
    """Show how large, certain and complete the images are, and the images themselves."""
    images = run.below("image")
    pictures = list(figures(run, "image"))
    if not images and not pictures:
        return None
    speed, rows = VARIABLES["image"]["velocity"], []
    factor = speed.factor
    for view, image in images.items():
        good = image["flags"].values == 0  # read whole: to pick pixels out of the file takes longer
        size, std = (
            np.abs(image[name].transpose("pixel", ...).values.reshape(len(good), -1)[good])
            for name in ("velocity", "velocity_std")
        )
        hertz = (
            np.atleast_1d(image["frequency"].values) if "frequency" in image.coords else [np.nan]
        )
        grid = " × ".join(map(str, np.atleast_1d(image.attrs.get("shape", []))))
        largest = size.max(axis=0) if len(size) else np.full(size.shape[1], np.nan)
        for i in np.sort(np.argsort(-largest, kind="stable")[:MOST_FREQUENCIES]):
            row = [view, grid or str(image.sizes["pixel"]), number(hertz[i], 6)]
            row += [number(factor * largest[i], 3), number(factor * _median(std[:, i]), 2)]
            rows.append([*row, str(image.attrs.get("summary", ""))])
    columns = ["view", "pixels", FREQUENCY.units]
    columns += [speed.titled("largest"), speed.titled("median uncertainty"), "pixels of use"]
    table = HtmlTable(columns, rows, wide=(5,)) if rows else None
    return Section("Velocity images", having(table, pictures))


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if values.size else np.nan


def velocity_section(run: RunData) -> Section | None:
    """Show the field, or the velocity of points."""
    fields = run.fields()
    known = estimates(run, MOST_VELOCITIES)
    points = [list(row) for row in known if not row[0].startswith("pose ")]
    if not fields and not points:
        return None
    others = ("examined/", "strain", f"{COMPARED_STRAIN}/")
    own = {k: group for k, group in run.groups.items() if not k.startswith(others)}
    blocks = having([HtmlTable.from_table(table) for table in field_tables(RunData(own))])
    if points:
        shown = [row for row in points if not row[0].endswith(" more")]
        table = HtmlTable(["of", "velocity ± bound", "unit", "note"], shown, "At points", (3,))
        left_out = [Text(f"{r[0]} {r[1]}.", "small") for r in points if r[0].endswith(" more")]
        blocks += [table, *left_out]
    if coverage := "; ".join(str(f.attrs.get("coverage", "")) for f in list(fields.values())[:1]):
        blocks.append(Text(f"Coverage: {'; '.join(coverage.splitlines())}.", "small"))
    title = "Velocity field" if fields else "Velocity"
    return Section(title, having(blocks, figures(run, "field")))


def strain_section(run: RunData) -> Section | None:
    """Show the strain of the surface, and where it and the stress are largest."""
    tables = [HtmlTable.from_table(table) for table in strain_tables(run)]
    if not tables:
        return None
    note = (
        "s and t run along the surface as places of gages do, e_ss, e_tt and e_st are the strains "
        "along t1, t2 and the tensor's shear. The largest extension is that of a cycle in any "
        "direction. Hot spots are maxima that stand out by more than their bounds."
    )
    if any(thickness_taken(strain) for strain in strains_of(run).values()):
        note += " How well the thickness is known is said with material.tolerance.thickness."
    return Section("Strain", having(tables, Text(note, "small"), figures(run, "strain")))


def shape_blocks(run: RunData, name: str = "shape") -> list[Any]:
    """Make the shape that turns and moves, or why there is none.

    Of a run with mode shapes these come first, and the field at the lines can be chosen.

    Parameters
    ----------
    name : str
        With which the names of its controls begin.
    """
    modes = mode_shapes(run, f"{name}-modes")
    taken = sum(size_of(block.data) for block in modes if isinstance(block, Shape))
    lines = lines_shape(run, name, taken)
    modal, drawn = (any(isinstance(b, Shape) for b in blocks) for blocks in (modes, lines))
    both = Alternatives(f"{name}-of", "Shown", CHOSEN, (modes, lines)) if modal else None
    return having(both or lines or modes, figures(run, "shape") if drawn else None)


def mode_shapes(run: RunData, name: str) -> list[Any]:
    """Make the shapes of the modes that turn and move; none of a run without."""
    if not (run.has("modes/field", "velocity", "element") and "volume" in run.groups):
        return []
    strain = run.groups["modes/strain"] if run.has("modes/strain", "frame") else None
    data = shape_of(run.groups["modes/field"], run.groups["volume"], strain, _pose_of(run))
    if data is None:
        return [Text(NO_TRIANGLES)]
    known = run.groups["modes/field"]["frequency"].values.tolist()
    data["numbers"] = [1 + known.index(hertz) for hertz in data["frequencies"]]
    note = "Mode shapes as they are at resonance under the excitation of the run."
    return [Shape(data, name), Text(note + _notes_of(data), "small")]


def lines_shape(run: RunData, name: str, taken: int = 0) -> list[Any]:
    """Make the shape of the velocity at the lines, or why there is none.

    Parameters
    ----------
    taken : int
        Bytes that other shapes of the page take.
    """
    fields = run.fields()
    if fields and "volume" in run.groups:
        strain = run.groups["strain"] if run.has("strain", "frame") else None
        field = next(iter(fields.values()))
        data = shape_of(field, run.groups["volume"], strain, _pose_of(run), taken)
        note = f"The {surface_name(field)} is drawn."
    elif "surface" in drawable(run):
        data = shape_of_points(run.groups["point"], run.groups["line_of_sight"], _pose_of(run))
        ends = run.groups["line_of_sight"]
        joined = any(name in ends and ends[name].size for name in ("triangle", "line"))
        note = "Points are joined as their file says."
        if not joined:
            note = "Points are joined to triangles in their plane, as their file joins none."
    else:
        return []
    if data is None:
        return [Text(NO_TRIANGLES)]
    return [Shape(data, name), Text(note + _notes_of(data), "small")]


def _pose_of(run: RunData) -> xr.Dataset | None:
    return run.groups["pose"] if run.has("pose", "origin", "rotation") else None


def _notes_of(data: dict[str, Any]) -> str:
    """Say what is to be minded of a shape that is drawn."""
    note = ""
    if data["colourings"]:
        note += " Colours of strains are those of the drawn surface, as if it were displaced."
    note += " Black crosses: not determined."
    if few := data["few"]:
        note += (
            f" Drawn are {len(few['nodes'])} of {few['of']} nodes; each stands for those around "
            f"it, whose velocity is at most {few['off']} from its own."
        )
    if data["rounded"]:
        note += f" Velocities here are rounded to {packing.SHARE / 2:.0%} of their bounds."
    if data["left_out"]:
        shown = len(data["frequencies"])
        note += f" Of {shown + data['left_out']} frequencies the {shown} strongest are here."
    return note
