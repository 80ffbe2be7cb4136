"""Pictures of what a view sees, as one sees it who stands at the instrument: right is right.

The laser frame's y is up and its x is to the left of who looks along z (`sldvexp.laser`). So
mirror angles grow upwards and to the left, and DAC steps do if a mirror's gain is positive. Axes
have their numbers turned accordingly; these stay what they are.
"""

from __future__ import annotations

import functools
from contextlib import suppress
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from sldvexp.dataset import RunData
from sldvexp.errors import UserError
from sldvexp.laser import TwoMirror
from sldvexp.plot.selection import plugin
from sldvexp.typing import Array

#: Signs of angles, or of steps of a laser that a run does not tell, that go up and to the left.
ANGLES = (1, 1)


@functools.lru_cache(maxsize=1)
def laser_of(run: RunData) -> TwoMirror | None:
    """Find the run's laser; None if it does not tell."""
    known = '"laser"' in str(run.attributes.get("plugins", "")) and "config" in run.attributes
    found: TwoMirror | None = plugin(run, "laser", "as seen") if known else None
    return found


def ways_of(run: RunData) -> tuple[int, int]:
    """Tell the signs of DAC steps that go up and to the left, `ANGLES` if no laser is known.

    A picture of a run whose laser this version cannot make is worth having; its axes stay true.
    """
    laser = None
    with suppress(UserError):
        laser = laser_of(run)
    if laser is None:
        return ANGLES
    up_down, left_right = laser.ways.tolist()
    return up_down, left_right


def turn(axes: Axes, ways: tuple[int, int] = ANGLES) -> None:
    """Turn the axes of a finished panel, left-right across and up-down up, to be as it is seen."""
    up_down, left_right = ways
    axes.yaxis.set_inverted(up_down < 0)
    axes.xaxis.set_inverted(left_right > 0)


def from_the_right(away: Array, ways: tuple[int, int]) -> Array:
    """Tell directions of ways in steps, (..., 2), from the right on and up, as seen, deg.

    Examples
    --------
    >>> from_the_right(np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0]]), (1, 1)).tolist()
    [0.0, 90.0, 180.0]
    """
    up, left = np.moveaxis(away * np.array(ways), -1, 0)
    found: Any = np.degrees(np.arctan2(up, -left + 0.0))
    return np.asarray(found)
