"""Structure that ends before `Volume.margin` does: found, left out, and told with where it ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.field import View
from sldvexp.shell.beyond_rim import RestingSide, resting_sides, should_move
from sldvexp.shell.surface_fit import SurfaceFit
from sldvexp.signal import Flag
from sldvexp.typing import IndexArray
from sldvexp.volume import Volume

#: Margins are told to a tenth of a mm, m.
TENTH = 1e-4


def without_resting_sides(
    fitted: Callable[[Sequence[View]], SurfaceFit], views: Sequence[View], volume: Volume
) -> tuple[SurfaceFit, Sequence[View], list[Finding]]:
    """Fit without pixels beyond sides at which the structure has ended.

    Returns
    -------
    found : SurfaceFit
    views : sequence of View
        Those pixels flagged.
    findings : list of Finding
    """
    found = fitted(views)
    if not (sides := resting_sides(found)):
        return found, views, []
    bare = fitted(flagged := _without_sides(views, sides))
    ended = [side for side in sides if should_move(bare, side, found.pixels)]
    if not ended:
        return found, views, []
    if len(ended) < len(sides):
        bare = fitted(flagged := _without_sides(views, ended))
    return bare, flagged, [_finding(found, ended, volume)]


def without(view: View, pixels: IndexArray) -> View:
    """Flag some pixels of a view as unlike."""
    flags = np.array(view.flags)
    flags[pixels] |= int(Flag.unlike)
    return replace(view, flags=flags)


def _without_sides(views: Sequence[View], sides: Sequence[RestingSide]) -> list[View]:
    every = [np.concatenate(each) for each in zip(*(side.pixels for side in sides), strict=True)]
    return [without(view, pixels) for view, pixels in zip(views, every, strict=True)]


def _finding(found: SurfaceFit, ended: Sequence[RestingSide], volume: Volume) -> Finding:
    """Say where the structure ends, and which margin would be right."""
    unit = volume.unit
    right = math.floor(min(side.ends for side in ended) / TENTH) * TENTH / unit.value
    count = sum(len(pixels) for side in ended for pixels in side.pixels)
    middles = found.outline.chart.points(np.array([side.middle for side in ended]), 0.0)
    places = ", ".join(f"({', '.join(f'{x:.3f}' for x in middle)}) m" for middle in middles)
    return Finding(
        "margin",
        "volume.margin",
        f"the structure ends before volume.margin={volume.margin:g} {unit.name} does: {count} "
        f"pixels beyond the surface, around {places}, are at rest in all views; they are left out",
        Severity.note,
        size=right,
        remedy=f"volume.margin={right:g}",
    )
