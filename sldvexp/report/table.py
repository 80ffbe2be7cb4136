"""The table that closes a run on the terminal."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sldvexp.report.field_text import field_tables
from sldvexp.report.image_text import image_text
from sldvexp.report.numbers import number, with_bound
from sldvexp.report.pose_methods import pose_methods

#: Velocities shown on the terminal of those of many points and frequencies; the file has all.
MOST_VELOCITIES = 4
NARROWEST = 132


def closing_table(tree: Mapping[str, xr.Dataset], files: Sequence[Path]) -> None:
    """Print what was estimated, what was published, what passed, what to mind, where the files lie.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
    files : sequence of Path
    """
    console = Console()
    if not console.is_terminal:
        console = Console(width=max(console.width, NARROWEST))
    table = Table(
        "estimated", "value ± bound", "unit", "note", title="Estimates", title_justify="left"
    )
    for row in estimates(tree):
        table.add_row(*map(escape, row))
    if table.row_count:
        console.print(table)
    if images := image_text(tree):
        console.print(escape(images), highlight=False)
    for group in tree.values():
        if "s_mean" in group:
            console.print(pose_methods(group))
    for fields in field_tables(tree):
        console.print(fields)
    if "check" in tree:
        console.print(published(tree["check"]))
    notes = [n for g in tree.values() for n in str(g.attrs.get("notes", "")).splitlines()]
    for note in dict.fromkeys(notes):
        console.print(f"[yellow]note:[/] {escape(note)}", highlight=False)
    for file in files:
        console.print(str(file), soft_wrap=True, highlight=False)


def estimates(
    tree: Mapping[str, xr.Dataset], most: int = MOST_VELOCITIES
) -> Iterator[tuple[str, str, str, str]]:
    """Rows of all groups that hold estimates, at most so many velocities of each."""
    for name, group in tree.items():
        if name == "pose":
            shared = list(json.loads(group.attrs.get("shared", "{}")))
            own = [n for n in group["adjusted"].values if n not in shared] if shared else None
            for view in group["view"].values:
                each = group.sel(view=view)
                yield from _pose_rows(str(view), each if own is None else each.sel(adjusted=own))
            if shared:
                one = group.isel(view=0).sel(adjusted=shared)
                yield from _pose_rows("all views", one[["intrinsic", "intrinsic_confidence"]])
        elif name.split("/")[0] in ("point", "compare") and "element" not in group.coords:
            yield from _point_rows(name, group, most)


def _pose_rows(view: str, pose: xr.Dataset) -> Iterator[tuple[str, str, str, str]]:
    """Euler angles, origin, intrinsics and residual of one view."""
    columns = (
        ("euler", "angle_index", "rad"),
        ("origin", "axis", "m"),
        ("intrinsic", "adjusted", None),
    )
    for variable, dim, unit in columns:
        if variable not in pose:
            continue
        for label in pose[dim].values:
            value = float(pose[variable].sel({dim: label}))
            bounds = pose.get(f"{variable}_confidence")
            bound = float(bounds.sel({dim: label})) if bounds is not None else np.nan
            yield f"pose {view}: {label}", with_bound(value, bound), unit or _unit(label), ""
    if "s" in pose:
        note = f"SSE {number(float(pose['sse']))} deg²" if "sse" in pose else ""
        yield f"pose {view}: s", number(float(pose["s"])), "DAC steps", note


def _unit(intrinsic: str) -> str:
    """A gain is relative to the calibration."""
    return {"mirror": "m", "zero": "rad"}.get(str(intrinsic).partition("_")[0], "")


def _point_rows(name: str, point: xr.Dataset, most: int) -> Iterator[tuple[str, str, str, str]]:
    """Velocity components of the first points and frequencies, and what stands behind them."""
    cases = [d for d in ("point", "frequency") if d in point["velocity"].dims]
    stacked = (
        point["velocity"].stack(case=cases) if cases else point["velocity"].expand_dims("case")
    )
    bounds = (
        point["confidence"].stack(case=cases) if cases else point["confidence"].expand_dims("case")
    )
    shown = min(stacked.sizes["case"], most)
    for i in range(shown):
        value, bound = stacked.isel(case=i), bounds.isel(case=i)
        labels = [
            f"{d} {value[d].item():g}" if d == "frequency" else f"{d} {value[d].item()}"
            for d in cases
        ]
        label = ", ".join([name.replace("compare/", ""), *labels])
        for component in point["component"].values:
            text = with_bound(
                complex(value.sel(component=component)), float(bound.sel(component=component))
            )
            at = {d: value[d].item() for d in cases} | {"component": component}
            yield f"{label}: V_{component}", text, "m/s", _merit(point, at)
    if stacked.sizes["case"] > shown:
        rest = stacked.sizes["case"] - shown
        yield f"{name}: {rest} more", f"in run.nc, group {name}", "", ""


def _merit(point: xr.Dataset, at: Mapping[str, Any]) -> str:
    """Efficiency and observability of the component, point and frequency `at`."""

    def value(name: str) -> float:
        variable = point[name]
        return float(variable.sel({d: label for d, label in at.items() if d in variable.dims}))

    if "observable" in point and not value("observable"):
        return "not determined by these views"
    if "efficiency" not in point:
        return ""
    return f"efficiency {number(value('efficiency'), 2)}, rcond {number(value('rcond'), 3)}"


def published(check: xr.Dataset) -> Table:
    """Published numbers beside this run's."""
    correct = bool(np.isfinite(np.asarray(check["correct"])).any())
    passed = int(check["passed"].sum())
    table = Table(
        title=f"Expected: {passed} of {check.sizes['quantity']} met", title_justify="left"
    )
    for column in ("quantity", "", "expected", "computed", *(["correct formula"] * correct)):
        table.add_column(column, no_wrap=True)
    for column in ("tolerance", "met", "source"):
        table.add_column(column, overflow="fold")
    for i, name in enumerate(check["quantity"].values):
        row = check.isel(quantity=i)
        cells = [escape(str(name)), str(row["relation"].item()), number(row["published"].item(), 5)]
        cells.append(number(row["computed"].item(), 5))
        cells += [number(row["correct"].item(), 5)] * correct
        met = "[green]yes[/]" if bool(row["passed"]) else "[red bold]NO[/]"
        cells += [number(row["tolerance"].item(), 2), met, escape(str(row["source"].item()))]
        table.add_row(*cells)
    return table
