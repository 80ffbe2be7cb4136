"""Marks of a view, and what is predicted of them, as browsers are told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sldvexp.console.marks import AimedMarks, Name
from sldvexp.console.outlook import Foresight
from sldvexp.instrument.person import mark_label
from sldvexp.pose.few_points import joined

#: What a mark is that was taken at its prediction.
UNMOVED = (
    "taken where it was predicted, it tells nothing until you have moved the beam onto what you "
    "see; if it is right there, move off and back"
)


def marks_told(
    marks: AimedMarks, view: str, views: Sequence[str], ahead: Foresight
) -> dict[str, Any]:
    """Tell the marks of a view, those that every view has, and what is foreseen of this one."""
    found, telling = marks.of(view), marks.telling(view)
    unmoved = [name for name in sorted(found) if name not in telling]
    beside: dict[Name, dict[str, Any]] = {k: misfit.told for k, misfit in ahead.misfit.items()}
    beside |= {name: {"off": None, "why": UNMOVED, "unmoved": True} for name in unmoved}
    undo, redo = marks.can
    return {
        "view": view,
        "views": [{"name": v, "marks": len(marks.of(v))} for v in views],
        "marks": [
            {**_named(name), "dac": list(found[name]), **beside.get(name, {})}
            for name in sorted(found)
        ],
        "predicted": [
            {**_named(name), "dac": list(steps), "instead": ahead.instead.get(name, [])}
            for name, steps in ahead.predicted.items()
        ],
        "out": [{**_named(name), "why": w} for name, w in ahead.out.items() if name not in found],
        "outlines": [
            {"points": np.round(points, 1).tolist(), "closed": True} for points in ahead.outlines
        ],
        "pose": " ".join(filter(None, [ahead.told, _left_out(unmoved)])),
        "undo": undo,
        "redo": redo,
    }


def _left_out(unmoved: Sequence[Name]) -> str:
    """Say which marks a pose does not rest on, in a sentence; empty if on all.

    Examples
    --------
    >>> _left_out([("fiducial", 4), ("fiducial", 6)])
    'Left out: marks 4 and 6, taken where the program alone had put the beam.'
    """
    if not unmoved:
        return ""
    names = joined([mark_label(number) for _, number in unmoved])
    return f"Left out: {names}, taken where the program alone had put the beam."


def _named(name: Name) -> dict[str, Any]:
    return {"kind": name[0], "number": name[1]}
