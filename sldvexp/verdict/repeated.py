"""Views that have the velocities of another one: a file that was read twice.

Noise is never the same twice. Velocities that are equal to the last digit are one measurement,
however far apart the two views are said to stand; three views show it too.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.typing import ComplexArray

#: Different velocities that two views must have in common.
LEAST_ALIKE = 12


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
