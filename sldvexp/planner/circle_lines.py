"""Scan lines across the circles of planned stands: with which stride they reach across.

A circle that is seen wide, from near by or on a board of fine steps, needs lines of a larger stride
than a narrow one; `CalibrationScan` chooses it where a rough pose predicts the circle, and a plan
where rough centres are all that a scan will have.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sldvexp.planner.images import Stand, half_chords_of
from sldvexp.planner.place import Place
from sldvexp.scan import Scan
from sldvexp.scan.calibration import CalibrationScan, CircleLines
from sldvexp.scan.session import Session

#: Half of a line over the half width of a circle, at least: rough centres are beside the middle.
LEAST = 1.15
#: Rough centres with numbers that tell the scan how wide circles are seen, at least.
MARKED = 3


def too_short(stands: Sequence[Stand], place: Place, scan: Scan | None) -> Iterator[str]:
    """Say of which circles the edge is not reached by lines of the stride that is set."""
    part = scan.calibration if isinstance(scan, Session) else scan
    circles = place.marks.circles
    if not isinstance(part, CalibrationScan) or circles is None:
        return
    rough = scan.rough_poses() if scan is not None else {}
    key = "scan.calibration" if isinstance(scan, Session) else "scan"
    for stand in stands:
        chords = half_chords_of(stand, place, part.coarse.lines)
        marked = stand.name in part.views and len(part.views[stand.name].circles) >= MARKED
        if (stand.name in rough or marked) and part.coarse.stride is None:
            continue
        reach = part.strides(place.laser)[0].min() * (part.coarse.pixels // 2)
        wide = chords.max(axis=1)
        if reach < LEAST * wide.max():
            short = np.array(list(circles.circles))[reach < LEAST * wide]
            names = ", ".join(map(str, short))
            yield (
                f"stand {stand.name}: scan lines of {reach} steps to each side do not reach beyond "
                f"circle {names}, as seen up to {wide.max():.0f} steps to each side: "
                f"{key}.coarse.stride={part.strides_across(wide).max()}, or none with a "
                "rough pose"
            )


def fit_stride(calibration: dict[str, Any], stands: Sequence[Stand], place: Place) -> None:
    """Set the stride of a scan of circles, as data, so that its lines reach across all of them.

    With rough poses a stride that is too small is taken out; else the least that reaches is set.
    """
    coarse = calibration["coarse"]
    lines = CircleLines(coarse["lines"], coarse["pixels"], coarse["window"], coarse["stride"])
    part = replace(CalibrationScan(), coarse=lines)
    chords = np.array([half_chords_of(stand, place, lines.lines) for stand in stands])
    if not chords.size:
        return
    reach = part.strides(place.laser)[0].min() * (lines.pixels // 2)
    if reach < LEAST * chords.max():
        needed = int(part.strides_across(chords.ravel()).max())
        coarse["stride"] = needed if calibration["views"] else None
