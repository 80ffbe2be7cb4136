"""The tables that close a run on the terminal, of whatever width it is.

Columns are left out before a number or a name is cut, see `fitted`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table
from rich.text import Text

from sldvexp.dataset import FREQUENCY, RunData, Source, is_void
from sldvexp.lazy import xarray as xr
from sldvexp.limits import shown
from sldvexp.report.base import notes, verdict_text
from sldvexp.report.modal_tables import modal_tables
from sldvexp.report.numbers import bounds_of, number, with_bound
from sldvexp.report.tables import POSE, VELOCITY, field_tables, image_text, pose_methods

#: Velocities shown on the terminal of those of many points and frequencies; the file has all.
MOST_VELOCITIES = 4
NARROWEST = 132
#: Where that can be read which a terminal has no room for.
RUN = "run.nc"
#: Cosine to an axis above which a direction is that axis.
ALONG_AXIS = 1 - 1e-9


def closing_table(source: Source | RunData, files: Sequence[Path]) -> None:
    """Print the verdict, what was estimated, published and met, and where the files lie.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> pose = group("pose", {"view": ["front"]}, s=[0.2]).assign_attrs(notes="few points")
    >>> closing_table({"image": pose}, [Path("run.nc")])
    note: few points
    run.nc
    """
    run = RunData.from_source(source)
    console = Console()
    if not console.is_terminal:
        console = Console(width=max(console.width, NARROWEST))
    _print_verdict(run, console)
    for modal in modal_tables(run):
        console.print(fitted(modal, console.width, ("mode", "pair"), RUN))
    table = Table("estimated", title="Estimates", title_justify="left")
    for column in ("value ± bound", "unit"):
        table.add_column(column, no_wrap=True)
    table.add_column("note")
    for row in estimates(run):
        table.add_row(*map(escape, row))
    width = console.width
    if table.row_count:
        console.print(fitted(table, width, ("estimated", "value ± bound"), RUN))
    if images := image_text(run):
        console.print(_words(images), highlight=False)
    for group in run.groups.values():
        if "s_mean" in group:
            console.print(fitted(pose_methods(group), width, (), RUN))
    for fields in field_tables(run):
        console.print(fitted(fields, width, (), RUN))
    if "check" in run.groups:
        console.print(fitted(published(run.groups["check"]), width, ("quantity", "met"), RUN))
    said = [finding.text for finding in verdict_text(run)[1]]
    for note in notes(run):
        if any(text in note for text in said):
            continue
        console.print(f"[yellow]note:[/] {_words(note)}", highlight=False)
    for file in files:
        console.print(str(file), soft_wrap=True, highlight=False)


def _words(text: str) -> str:
    """Write a text that may come from a file: nothing in it is a mark, or acts on a terminal."""
    return escape(shown(text, len(text)))


#: Colours of a verdict and of a finding's severity.
COLOURS = {"trusted": "green", "doubtful": "yellow", "void": "red"}


def _print_verdict(run: RunData, console: Console) -> None:
    """Print the verdict, then one line for each finding, with its remedy."""
    line, findings = verdict_text(run)
    if not line:
        return
    colour = COLOURS[line.partition(":")[0]]
    console.print(f"[bold {colour}]verdict: {escape(line)}[/]", highlight=False)
    for finding in findings:
        remedy = f" (remedy: {finding.remedy})" if finding.remedy else ""
        console.print(
            f"[{COLOURS.get(finding.severity.name, 'cyan')}]{finding.severity.name}:[/] "
            f"{_words(finding.text + remedy)}",
            highlight=False,
            soft_wrap=True,
        )


def estimates(run: RunData, most: int = MOST_VELOCITIES) -> Iterator[tuple[str, str, str, str]]:
    """List rows of all groups that hold estimates, at most so many velocities of each.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> found = group("point", {}, velocity=[0.01, 0.0, 0.02j], confidence=[1e-3, 1e-3, 1e-3])
    >>> next(estimates(RunData({"point": found})))
    ('point: V_x', '10.0 ± 1.0', 'mm/s', '')
    """
    for name, group in run.groups.items():
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
            for *row, note in _point_rows(name, group, most):
                told = ", ".join(filter(None, ("void" * is_void(run.groups), note)))
                yield row[0], row[1], row[2], told


def _pose_rows(view: str, pose: xr.Dataset) -> Iterator[tuple[str, str, str, str]]:
    """List Euler angles, origin, intrinsics and residual of one view."""
    columns = (("euler", "angle_index"), ("origin", "axis"), ("intrinsic", "adjusted"))
    for variable, dim in columns:
        if variable not in pose:
            continue
        values = np.atleast_1d(pose[variable].values)
        bounds = bounds_of(pose, variable).values
        for label, value, bound in zip(pose[dim].values, values, bounds, strict=True):
            known = POSE[variable].factor, POSE[variable].shown_unit
            factor, unit = shown_intrinsic(label) if variable == "intrinsic" else known
            yield f"pose {view}: {label}", with_bound(factor * value, factor * bound), unit, ""
    if "s" in pose:
        note = f"SSE {number(float(pose['sse']))} deg²" if "sse" in pose else ""
        yield f"pose {view}: s", number(float(pose["s"])), POSE["s"].shown_unit, note


def shown_intrinsic(intrinsic: str) -> tuple[float, str]:
    """Tell factor and unit in which an intrinsic is read; a gain is relative to the calibration.

    Examples
    --------
    >>> shown_intrinsic("mirror_offset"), shown_intrinsic("gain_up_down")
    ((1000.0, 'mm'), (1.0, ''))
    """
    like = {"mirror": "origin", "zero": "euler"}.get(str(intrinsic).partition("_")[0])
    return (POSE[like].factor, POSE[like].shown_unit) if like else (1.0, "")


def _point_rows(name: str, point: xr.Dataset, most: int) -> Iterator[tuple[str, str, str, str]]:
    """List velocities of the points and frequencies that move most, and what is behind them."""
    cases = [d for d in ("point", "frequency") if d in point["velocity"].dims]
    stacked = (
        point["velocity"].stack(case=cases) if cases else point["velocity"].expand_dims("case")
    )
    bounds = (
        point["confidence"].stack(case=cases) if cases else point["confidence"].expand_dims("case")
    )
    points = point.sizes["point"] if "point" in cases else 1
    told_of = strongest_cases(stacked, most)
    for i in told_of:
        value, bound = stacked.isel(case=i), bounds.isel(case=i)
        labels = [
            f"{value[d].item():g} {FREQUENCY.units}"
            if d == "frequency"
            else f"{d} {value[d].item()}"
            for d in cases
        ]
        label = ", ".join([name.replace("compare/", ""), *labels])
        for component in point["component"].values:
            pair = (
                complex(value.sel(component=component)),
                float(bound.sel(component=component)),
            )
            text = with_bound(VELOCITY.factor * pair[0], VELOCITY.factor * pair[1])
            at = {d: value[d].item() for d in cases} | {"component": component}
            yield f"{label}: V_{component}", text, VELOCITY.shown_unit, _merit(point, at)
        of_point, of_frequency = divmod(i, stacked.sizes["case"] // points)
        for along, text in _observed(point, of_point, of_frequency):
            yield (
                f"{label}: V along {along}",
                text,
                VELOCITY.shown_unit,
                "determined by these views",
            )
    if stacked.sizes["case"] > len(told_of):
        rest = (stacked.sizes["case"] - len(told_of)) * point.sizes["component"]
        yield f"{name}: {rest} more", f"in run.nc, group {name}", "", ""


def strongest_cases(velocity: xr.DataArray, most: int) -> list[int]:
    """Choose the points and frequencies of the largest velocities, in their own order."""
    size = (abs(velocity) ** 2).sum("component").values
    return sorted(int(i) for i in np.argsort(-size, kind="stable")[:most])


def _observed(point: xr.Dataset, number: int, frequency: int) -> Iterator[tuple[str, str]]:
    """Find what is determined of a point along directions that are no axes, with bounds."""
    if "observed_velocity" not in point or number not in point["deficient_point"].values:
        return
    own = point.isel(deficient=int(np.argmax(point["deficient_point"].values == number)))
    own = own.isel(frequency=frequency, missing_dims="ignore")
    for i in range(int(own["observed_rank"])):
        one = own.isel(direction=i)
        direction = one["observed_direction"].values
        if np.abs(direction).max() < ALONG_AXIS:
            along = ", ".join(f"{x:.2f}" for x in direction + 0.0)
            value, bound = one["observed_velocity"].item(), one["observed_confidence"].item()
            yield f"({along})", with_bound(VELOCITY.factor * value, VELOCITY.factor * bound)


def _merit(point: xr.Dataset, at: Mapping[str, Any]) -> str:
    """Tell efficiency and observability of the component, point and frequency `at`."""

    def value(name: str) -> float:
        variable = point[name]
        return float(variable.sel({d: label for d, label in at.items() if d in variable.dims}))

    if "observable" in point and not value("observable"):
        return "not determined by these views"
    if "efficiency" not in point:
        return ""
    return f"efficiency {number(value('efficiency'), 2)}, rcond {number(value('rcond'), 3)}"


def published(check: xr.Dataset) -> Table:
    """Show published numbers beside this run's."""
    correct = bool(np.isfinite(np.asarray(check["correct"])).any())
    passed = int(check["passed"].sum())
    table = Table(
        title=f"Expected: {passed} of {check.sizes['quantity']} met", title_justify="left"
    )
    table.add_column("quantity")
    formula = ["correct formula"] * correct
    for column in ("", "expected", "computed", *formula, "tolerance", "met"):
        table.add_column(column, no_wrap=True)
    table.add_column("source")
    for i, name in enumerate(check["quantity"].values):
        row = check.isel(quantity=i)
        cells = [escape(str(name)), str(row["relation"].item()), number(row["published"].item(), 5)]
        cells.append(number(row["computed"].item(), 5))
        cells += [number(row["correct"].item(), 5)] * correct
        met = "[green]yes[/]" if bool(row["passed"]) else "[red bold]NO[/]"
        cells += [number(row["tolerance"].item(), 2), met, escape(str(row["source"].item()))]
        table.add_row(*cells)
    return table


#: Where text may go on in the next line: at spaces, and between the parts of a name.
PLACES = re.compile(r"(?<=\s)(?=\S)|(?<=[./@:])(?=[^\W\d]\w)|(?<=.)(?=\[)")
#: Characters of a table beside those of a column, and beside those of all.
BESIDE, RIM = 3, 1


def fitted(table: Table, width: int, keep: Collection[str] = (), rest: str = "") -> Table:
    """Make a table not wider than `width`.

    Parameters
    ----------
    table : Table
        Of columns with ``no_wrap``, cells stay in one line; other cells and all headers go on in
        the next line at spaces and between the parts of a name.
    width : int
        Characters of a line.
    keep : collection of str
        Headers of columns that stay; of the others those at the right are left out as needed.
    rest : str
        Where the columns that are left out can be read.

    Examples
    --------
    >>> table = Table("name", "value", "note")
    >>> table.add_row("rcond", "0.25", "well conditioned")
    >>> [column.header for column in fitted(table, 20, ("name", "value")).columns]
    ['name', 'value']
    """
    columns, left_out = list(table.columns), []
    for column in reversed(table.columns):
        if _width([_narrowest(c) for c in columns]) <= width:
            break
        if str(column.header) not in keep:
            columns = [c for c in columns if c is not column]
            left_out.append(_plain(column.header))
    widths = _shared(columns, width)
    said = [str(table.caption)] if table.caption else []
    if left_out:
        which = f"{len(left_out)} more column{'s' * (len(left_out) > 1)}"
        said.append(f"{which} in {rest}: {'; '.join(reversed(left_out))}")
    caption = "\n".join(said)
    made = Table(title=table.title, title_justify="left", caption=caption, caption_justify="left")
    for column, own in zip(columns, widths, strict=True):
        # a last resort: what is kept and still too wide ends in dots
        header, whole = _broken(str(column.header), own), column.no_wrap
        made.add_column(header, no_wrap=whole, overflow="ellipsis" if whole else "fold")
    cells = [
        [str(c) if column.no_wrap else _broken(str(c), own) for c in column.cells]
        for column, own in zip(columns, widths, strict=True)
    ]
    for row in zip(*cells, strict=True):
        made.add_row(*row)
    return made


def _width(columns: Sequence[int]) -> int:
    """Add up the width of a table from those of its columns."""
    return sum(columns) + BESIDE * len(columns) + RIM


def _narrowest(column: Column) -> int:
    """Find the width that a column needs at least."""
    pieces = PLACES.split(_plain(column.header))
    for cell in map(_plain, column.cells):
        pieces += [cell] if column.no_wrap else PLACES.split(cell)
    return max(cell_len(piece.rstrip()) for piece in pieces)


def _shared(columns: Sequence[Column], width: int) -> list[int]:
    """Share a width among columns: headers, then the widest cells, go on in more lines."""
    least = [_narrowest(c) for c in columns]
    widths = [max(cell_len(_plain(t)) for t in (c.header, *c.cells)) for c in columns]
    while _width(widths) > width and widths != least:
        able = [i for i, (w, n) in enumerate(zip(widths, least, strict=True)) if w > n]
        headers = [i for i in able if columns[i].no_wrap]
        widths[max(headers or able, key=lambda i: widths[i])] -= 1
    return widths


def _broken(marked: str, width: int) -> str:
    """Break a cell into lines of at most so many characters, if its parts are that short."""
    text = _plain(marked)
    if cell_len(text) <= width:
        return marked
    lines = [""]
    for piece in PLACES.split(text):
        if lines[-1] and cell_len(lines[-1] + piece.rstrip()) > width:
            lines.append("")
        lines[-1] += piece
    return escape("\n".join(line.rstrip() for line in lines))


def _plain(marked: object) -> str:
    """Take a cell's text without its markup."""
    return Text.from_markup(str(marked)).plain
