"""Warnings first: what to mind before any number is believed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sldvexp.report.base import notes
from sldvexp.report.html.blocks import Listing, Section, Text
from sldvexp.report.html.page_data import Subject
from sldvexp.report.numbers import number

#: A larger share of flagged pixels is told first of all.
MOST_FLAGGED = 0.05


def section(run: Subject) -> Section:
    """What the stages noted, what was missed, and what has no bound."""
    found = list(dict.fromkeys(_all(run)))
    block = Listing(found, "warning") if found else Text("Nothing to mind.", "good")
    return Section("Warnings", [block])


def _all(run: Subject) -> Iterator[str]:
    yield from _missed(run)
    yield from notes(run.groups)
    yield from _unbounded(run)
    yield from _undetermined(run)
    for view, image in run.below("image").items():
        flagged = float(np.mean(image["flags"].values != 0))
        if flagged > MOST_FLAGGED:
            yield f"view {view}: {flagged:.0%} of the image's pixels are flagged"
    if str(run.attributes.get("git_commit", "")).endswith("-dirty"):
        yield "the program had been changed since its last commit, which does not tell how"


def _missed(run: Subject) -> Iterator[str]:
    """Expectations that were not met."""
    if "check" not in run.groups:
        return
    check = run.groups["check"]
    for i in np.flatnonzero(~check["passed"].values.astype(bool)):
        one = check.isel(quantity=i)
        yield (
            f"not as expected: {one['quantity'].item()} is {number(one['computed'].item(), 5)}, "
            f"and should be {one['relation'].item()} {number(one['published'].item(), 5)}"
            f" ({one['source'].item() or 'no source given'})"
        )


def _unbounded(run: Subject) -> Iterator[str]:
    """Poses without bounds, which make those of the velocities too small."""
    pose = run.groups.get("pose")
    if pose is None:
        return
    std = pose.get("origin_std")
    known = np.zeros(pose.sizes["view"]) if std is None else np.isfinite(std.values).all(axis=1)
    if views := [str(v) for v, k in zip(pose["view"].values, known, strict=True) if not k]:
        yield f"the pose of {_views(views)} has no bounds"


def _undetermined(run: Subject) -> Iterator[str]:
    """Directions that the views do not tell."""
    for name, field in run.fields.items():
        if flagged := field.sizes.get("flagged", 0):
            of = "" if name == "field" else f" by {name}"
            yield (
                f"at {flagged} of {field.sizes['node']} nodes the views do not determine every "
                f"component of the velocity{of}; what they determine is given"
            )
    point = run.groups.get("point")
    if point is not None and point.sizes.get("deficient", 0):
        where = f"{count} points" if (count := point.sizes["deficient"]) > 1 else "one point"
        yield f"at {where} the views do not determine every component"


def _views(views: list[str]) -> str:
    return f"view {views[0]}" if len(views) == 1 else f"views {', '.join(views)}"
