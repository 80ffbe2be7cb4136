"""Velocities that are the same to the last digit, which noise never is.

Two views with the same velocities are one file that was read twice, however far apart they are said
to stand; three views show it too. Two lines with the same velocities are one line that was
recorded twice, and all that follow come one late. Many pixels that have the largest velocity
are cut off: by a range, or by what wrote the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.field import View
from sldvexp.typing import BoolArray, ComplexArray

#: Different velocities that two views or lines must have in common, and pixels that must have the
#: largest velocity.
LEAST_ALIKE = 12
#: How many times as many pixels must have the largest velocity as have others on average: in a
#: file of few digits all velocities repeat.
MORE_OFTEN = 5
#: Relative difference of velocities that are the same.
ALIKE = 1e-9
#: Part of the largest velocity that others reach as well if it is cut off; it stands for a missing
#: one if none does.
REACHED = 0.5


def repeated_views(velocity: Mapping[str, ComplexArray]) -> list[Finding]:
    """Find pairs of views with the same velocities.

    Parameters
    ----------
    velocity : mapping of str to ndarray
        Of every view, by its name; NaN where there is none.
    """
    found = []
    for one, other in combinations(velocity, 2):
        first, second = velocity[one], velocity[other]
        if first.shape != second.shape or not np.array_equal(first, second, equal_nan=True):
            continue
        if np.unique(first[np.isfinite(first)]).size < LEAST_ALIKE:
            continue
        which = f"views {one} and {other}"
        text = f"{which} have the same velocities to the last digit: was one file read twice?"
        found.append(Finding("repeated", which, text, Severity.void, views=(one, other)))
    return found


def repeated_lines(view: View) -> list[Finding]:
    """Find lines of pixels with the same velocities as the line before.

    Parameters
    ----------
    view : View
        One that is no lattice has no lines.
    """
    if view.shape is None:
        return []
    image = view.velocity.reshape(*view.shape, -1)
    usable = view.usable.reshape(view.shape)
    found = []
    for lines, known in ((image, usable), (image.swapaxes(0, 1), usable.T)):
        for k in range(1, len(lines)):
            both = known[k] & known[k - 1]
            if not np.array_equal(lines[k][both], lines[k - 1][both]):
                continue
            if np.unique(lines[k][both]).size < LEAST_ALIKE:
                continue
            text = (
                f"line {k + 1} of view {view.name} has the same velocities as line {k} to the last "
                "digit: was a line recorded twice? The lines that follow would be in the place of "
                "others"
            )
            found.append(
                Finding(
                    "repeated_line",
                    f"lines of view {view.name}",
                    text,
                    Severity.void,
                    views=(view.name,),
                )
            )
    return found


def cut_off(view: View) -> BoolArray:
    """Find pixels whose velocity is the largest one together with that of many others, (pixel,).

    By real part, imaginary part or amplitude, at any of the frequencies.
    """
    found = np.zeros(len(view.velocity), bool)
    usable = np.flatnonzero(view.usable)
    for line in view.velocity[usable].T:
        for part in (line.real, -line.real, line.imag, -line.imag, np.abs(line)):
            largest = part.max(initial=0.0)
            there = part >= largest * (1 - ALIKE)
            others = len(part) / max(len(np.unique(part)), 1)
            if there.sum() < max(LEAST_ALIKE, MORE_OFTEN * others):
                continue
            if part[~there].max(initial=0.0) > REACHED * largest:
                found[usable[there]] = True
    return found
