"""Circles whose rough centres are given: their numbers, and how wide they are seen.

Marks with numbers tell roughly where the instrument stands, and so how far the coarse lines across
each circle must reach. Lines that a run has kept, or a recording has, stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.instrument.person import Mark
from sldvexp.laser import TwoMirror
from sldvexp.scan.calibration import CalibrationScan
from sldvexp.scan.lines import across, half_chords
from sldvexp.session.camera import ViewContext
from sldvexp.session.search import COARSE, CircleSearch, RoughCircle
from sldvexp.targets import Circles
from sldvexp.typing import Array, IntArray


def given_circles(scan: CalibrationScan, at: ViewContext) -> list[RoughCircle]:
    """Take the rough centres that the configuration gives, with their circles' numbers if known.

    Raises
    ------
    UserError
        If the target has no circle of such a number.
    """
    centres, numbers = scan.centres(at.view), scan.views[at.view].circles
    known = at.target.circles if isinstance(at.target, Circles) else {}
    for number in numbers:
        if number not in known:
            raise UserError(
                f"circles has the number {number}, but the calibration object's are "
                f"{', '.join(map(str, known))}"
            )
    if not numbers:
        return [*map(RoughCircle, centres)]
    usual = [RoughCircle(*both) for both in zip(centres, numbers, strict=True)]
    with suppress(UserError):  # by the pose of these marks a circle is out of reach
        chords = _half_chords(scan, at, numbers, centres)
        pairs = zip(usual, chords, strict=bool(chords))
        wide = [replace(circle, half_chord=own, marked=True) for circle, own in pairs]
        if wide and (_are_kept(scan, at, wide) or not _are_kept(scan, at, usual)):
            return wide
    return usual


def coarse_lines(
    scan: CalibrationScan, circle: RoughCircle, laser: TwoMirror
) -> tuple[IntArray, IntArray, int]:
    """Lay the coarse lines across a circle.

    Returns
    -------
    dac : ndarray of int, shape (line, pixel, 2)
    coarse : ndarray of int, shape (line,), steps
        Stride of each of them.
    fine : int, steps
        Stride of the fine lines that follow.
    """
    stage = scan.coarse
    coarse, fine = scan.strides(laser, circle.half_chord)
    return on_board(across(circle.centre, stage.lines, stage.pixels, coarse), laser), coarse, fine


def on_board(dac: IntArray, laser: TwoMirror) -> IntArray:
    """Move lines that leave the board's range back into it as a whole."""
    low, high = laser.board.value
    under = np.minimum(dac.min(axis=1, keepdims=True) - low, 0)
    over = np.maximum(dac.max(axis=1, keepdims=True) - high, 0)
    return dac - under - over


def _half_chords(
    scan: CalibrationScan, at: ViewContext, numbers: Sequence[int], centres: IntArray
) -> list[Array]:
    """Find by the pose of a view's marks how wide each circle is seen; none if no pose fits."""
    if at.guide is None:
        return []
    search = CircleSearch(scan, at)
    middles = search.outlines.mean(axis=1)
    places = [search.numbers.index(number) for number in numbers]
    guide = at.guide([Mark(k, middles[k], np.zeros(3)) for k in places], None)
    for name, centre in zip(guide.open, centres, strict=True):
        guide.take(name, centre.tolist())
    if (pose := guide.stand) is None:
        return []
    predicted = [search.predicted(k, *pose) for k in places]
    for seen, centre in zip(predicted, centres, strict=True):
        if (np.abs(seen.centre - centre) > seen.half_width).any():
            return []  # marks that contradict one another say nothing of a size
    return [half_chords(seen.outline, scan.coarse.lines) for seen in predicted]


def _are_kept(scan: CalibrationScan, at: ViewContext, circles: Sequence[RoughCircle]) -> bool:
    """Tell whether the coarse lines that are there already, if any, are those of these circles."""
    some = False
    for number, circle in enumerate(circles, 1):
        dac = coarse_lines(scan, circle, at.laser)[0]
        for own, kept in zip(dac, at.camera.known(f"{number}_{COARSE}", len(dac)), strict=True):
            if kept is not None and not np.array_equal(own, kept):
                return False
            some |= kept is not None
    return some
