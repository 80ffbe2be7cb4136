"""Where the instrument stood, with bounds and residuals."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping

import numpy as np

from sldvexp.lazy import xarray as xr
from sldvexp.report.html.blocks import HtmlTable, More, Section, Text, having
from sldvexp.report.html.figures import figures
from sldvexp.report.html.page_data import Subject
from sldvexp.report.numbers import number, with_bound
from sldvexp.report.pose_tables import pose_methods

MILLI = 1e3
RESIDUALS = {"s": "s, DAC steps", "residual_rms": "residual r.m.s., DAC steps", "dof": "dof"}


def section(run: Subject) -> Section | None:
    """Origins and angles of all views, by the chosen method and those it is compared with."""
    poses = {"": run.groups["pose"]} if "pose" in run.groups else {}
    poses |= run.below("compare_pose")
    if not poses:
        return None
    blocks = []
    for name, pose in poses.items():
        level = f"{float(pose.attrs.get('confidence_level', 0.95)):.0%}"
        by = f" by {name}" if name else ""
        blocks += [
            HtmlTable(*_table(pose, of, more), f"{title}, with {level} bounds")
            for title, of, more in (
                (f"Origin{by}", ("origin", "axis", "mm"), RESIDUALS),
                (f"Euler angles{by}", ("euler", "angle_index", "mrad"), {}),
            )
        ]
        blocks += _adjusted(pose)
    methods = [HtmlTable.from_table(pose_methods(g)) for g in run.groups.values() if "s_mean" in g]
    note = (
        "World to laser: P_laser = R (P_world - origin), R by Euler angles of the x-convention. "
        "s is the standard deviation of one mirror reading, estimated from the residuals."
    )
    circles = list(figures(run, "circles"))
    seen = More("Circles of the calibration object, view by view", circles) if circles else None
    drawn = having(figures(run, "pose"), seen, _residuals(run))
    return Section("Pose", having(blocks, Text(note, "small"), methods, drawn))


def _table(
    pose: xr.Dataset, of: tuple[str, str, str], more: Mapping[str, str]
) -> tuple[list[str], list[list[str]]]:
    """Columns, and one row a view: a variable along its dimension in a unit, and more of it."""
    name, dimension, unit = of
    columns = ["view", *(f"{label}, {unit}" for label in pose[dimension].values)]
    known = {name: title for name, title in more.items() if name in pose}
    rows = []
    for view in pose["view"].values:
        one = pose.sel(view=view)
        row = [str(view), *_with_bounds(one, name)]
        rows.append([*row, *(number(float(one[other]), 3) for other in known)])
    return [*columns, *known.values()], rows


def _with_bounds(view: xr.Dataset, name: str) -> Iterator[str]:
    values = MILLI * view[name].values
    bounds = view.get(f"{name}_confidence", xr.full_like(view[name], np.nan)).values
    for value, bound in zip(values, MILLI * bounds, strict=True):
        yield with_bound(value, bound)


def _adjusted(pose: xr.Dataset) -> Iterator[HtmlTable]:
    """Parameters of the instrument that were adjusted with the pose."""
    if "intrinsic" not in pose:
        return
    shared = list(json.loads(pose.attrs.get("shared", "{}")))
    rows = []
    for name in pose["adjusted"].values:
        views = pose["view"].values[:1] if name in shared else pose["view"].values
        for view in views:
            one = pose.sel(view=view, adjusted=name)
            told = with_bound(float(one["intrinsic"]), float(one["intrinsic_confidence"]))
            rows.append([str(name), "all" if name in shared else str(view), told])
    yield HtmlTable(["parameter", "view", "value ± bound (SI)"], rows, "Adjusted with the pose")


def _residuals(run: Subject) -> More | None:
    """Residuals of points, of which there are few."""
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
    return More("Residuals of every point, DAC steps", [table])
