"""Motion of a circle that its scan lines see unevenly, made even.

A circle that moves along its normal n is seen with ``n . d`` along the beam d, at 70 degrees by
0.3 % more for every mm that the beam moves towards the normal at 1 m. The profile of an edge has
the same motion everywhere inside: fitted to one that goes on to grow it lies beside the edge, by
about 2.5 widths times the growth over a width, and so by the square of the spot's size. On both
sides of a circle that is in the same direction: the ellipse is displaced.

One edge tells next to nothing of the growth, all edges of a circle together tell it. With `part`
the profile at each edge and x the place from the circle's middle

    magnitude = rest + (motion + slope . x) part

is linear in ``rest``, ``motion`` and ``slope``. To first order that is true of every motion, also
of one that is uneven itself, as long as it is not uneven in the same way towards every edge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sldvexp.image.scan_lines import ScanLineEdges, ScanLines
from sldvexp.lazy import scipy
from sldvexp.statistics import NORMAL_MEDIAN
from sldvexp.typing import Array

#: By how much the motion differs between middle and edge, relative: its standard deviation where
#: edges on one side only do not tell it, and the most that is believed.
USUAL, MOST = 0.1, 0.5
#: Edges that an uneven motion displaces hide a seventh of how uneven it is, and so on.
ROUNDS = 2
#: Pixels farther from the model than this many robust standard deviations do not count.
REJECT = 4.0


def even_edges(
    lines: ScanLines, place: Callable[[ScanLines, int, int], ScanLineEdges], window: int
) -> ScanLineEdges:
    """Find the edge on each line across a circle's, as of a circle that moves evenly.

    Parameters
    ----------
    place : callable
        A function of `sldvexp.image.edge_detection`.
    window : int
        Of the median filter, pixels.

    Returns
    -------
    ScanLineEdges

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.special import ndtr
    >>> from sldvexp.image import ScanLines, even_edges, gradient_edges
    >>> turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    >>> out = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    >>> away = np.arange(90.0, 111.0)
    >>> position = away[:, None] * out[:, None]
    >>> step = ndtr((100 - away) / 2) * (1 + 3e-3 * position[..., 0])
    >>> lines = ScanLines(step, np.full((12, 21), 1e-3), position, np.zeros((12, 21), bool))
    >>> found = gradient_edges(lines, 1, 3), even_edges(lines, gradient_edges, 3)
    >>> [round(abs(float(edges.position[:, 0].mean())), 3) for edges in found]
    [0.013, 0.0]
    """
    found = place(lines, 1, window)
    for _ in range(ROUNDS):
        lines = even_motion(lines, found)
        found = place(lines, 1, window)
    return found


def even_motion(lines: ScanLines, edges: ScanLineEdges) -> ScanLines:
    """Divide what moves on the lines across one circle by how it grows over the circle.

    Parameters
    ----------
    lines : ScanLines
    edges : ScanLineEdges
        Found on them; lines without an edge are divided, but tell nothing.

    Returns
    -------
    ScanLines
        As if the circle moved everywhere as in the middle of its edges.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.image import ScanLines, even_motion, gradient_edges
    >>> turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    >>> out = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    >>> away = np.arange(90.0, 111.0)
    >>> position = away[:, None] * out[:, None]
    >>> step = np.clip((100.5 - away) / 3, 0, 1) * (1 + 1e-3 * position[..., 0])
    >>> lines = ScanLines(step, np.full((12, 21), 1e-3), position, np.zeros((12, 21), bool))
    >>> even = even_motion(lines, gradient_edges(lines, edges_per_line=1, window=3))
    >>> [float(round(np.ptp(one.magnitude[:, 0]), 2)) for one in (lines, even)]
    [0.18, 0.0]
    """
    if not len(edges.std):
        return lines
    middle = edges.position.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((edges.position - middle) ** 2, axis=-1))))
    if not size > 0:
        return lines
    place = (lines.position - middle) / size
    rest, motion, *slope = _motion(lines, edges, place)
    if not abs(motion) > 0:
        return lines
    level = np.clip(1.0 + place @ slope / motion, 1.0 - MOST, 1.0 + MOST)
    return replace(lines, magnitude=rest + (lines.magnitude - rest) / level, std=lines.std / level)


def _motion(lines: ScanLines, edges: ScanLineEdges, place: Array) -> Array:
    """Fit rest, motion and its slope to the pixels of all lines that have an edge."""
    own = edges.line
    edge = np.sum((edges.position - lines.origin[own]) * edges.direction, axis=-1)
    width = np.maximum(edges.width, lines.pitch[own] / 2.0)
    inwards = np.where(edges.rising, 1.0, -1.0) / width
    part = scipy.special.ndtr((lines.along[own] - edge[:, None]) * inwards[:, None])

    good = ~lines.flag[own]
    part, values, std = part[good], lines.magnitude[own][good], lines.std[own][good]
    design = np.column_stack([np.ones_like(part), part, part[:, None] * place[own][good]])
    counts, scatter, numbers = np.ones(len(part), bool), 1.0, np.zeros(4)
    contrast = np.ptp(values)
    if not contrast > 0:
        return numbers
    held = np.zeros((2, 4))
    held[:, 2:] = np.eye(2) / (USUAL * contrast)
    for _ in range(5):
        weight = 1.0 / (scatter * std[counts])
        rows = np.concatenate([weight[:, None] * design[counts], held])
        told = np.concatenate([weight * values[counts], np.zeros(2)])
        numbers = np.linalg.lstsq(rows, told, rcond=None)[0]
        size = np.abs(values - design @ numbers) / std
        scatter = max(float(np.median(size)) / NORMAL_MEDIAN, 1.0)
        counts = size <= REJECT * scatter
    return np.asarray(numbers)
