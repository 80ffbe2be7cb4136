"""The velocity of the structure, with bounds: the shape that moves, the tables, the figures."""

from __future__ import annotations

from typing import Any

from sldvexp.report.field_tables import field_tables
from sldvexp.report.html.blocks import HtmlTable, Section, Shape, Text, having
from sldvexp.report.html.figures import figures
from sldvexp.report.html.page_data import Subject
from sldvexp.report.html.shape import shape_of, shape_of_points
from sldvexp.report.terminal import estimates

#: Velocities in the table of points, which scrolls; the dataset has all.
MOST_VELOCITIES = 30


def section(run: Subject) -> Section | None:
    """The field, or the velocity of points."""
    fields = run.fields
    known = estimates(run.groups, MOST_VELOCITIES)
    points = [list(row) for row in known if not row[0].startswith("pose ")]
    if not fields and not points:
        return None
    own = {name: group for name, group in run.groups.items() if not name.startswith("examined/")}
    blocks = having(_shape(run), [HtmlTable.from_table(table) for table in field_tables(own)])
    if points:
        shown = [row for row in points if not row[0].endswith(" more")]
        table = HtmlTable(["of", "velocity ± bound", "unit", "note"], shown, "At points", (3,))
        left_out = [Text(f"{r[0]} {r[1]}.", "small") for r in points if r[0].endswith(" more")]
        blocks += [table, *left_out]
    if coverage := "; ".join(str(f.attrs.get("coverage", "")) for f in list(fields.values())[:1]):
        blocks.append(Text(f"Coverage: {'; '.join(coverage.splitlines())}.", "small"))
    title = "Velocity field" if fields else "Velocity"
    return Section(title, having(blocks, figures(run, "field")))


def _shape(run: Subject) -> list[Any]:
    """The shape that turns and moves, or why there is none."""
    fields = run.fields
    if fields and "volume" in run.groups:
        data = shape_of(next(iter(fields.values())), run.groups["volume"])
        note = "The layer next to the given surface is drawn."
    elif "surface" in run.drawable:
        data = shape_of_points(run.groups["point"], run.groups["line_of_sight"])
        note = "Points are joined as their file says."
    else:
        return []
    if data is None:
        told = "The surface has too many nodes for a page; other programs can turn it."
        return [Text(told, "small")]
    note += " Black crosses: not determined."
    if data["left_out"]:
        shown = len(data["frequencies"])
        note += f" Of {shown + data['left_out']} frequencies the {shown} strongest are here."
    return having(Shape(data), Text(note, "small"), figures(run, "shape"))
