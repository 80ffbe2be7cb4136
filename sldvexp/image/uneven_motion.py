"""Motion of a circle that its scan lines see unevenly, made even.

A circle that moves along its normal n is seen with ``n . d`` along the beam d, at 70 degrees by
0.3 % more for every mm that the beam moves towards the normal at 1 m. The profile of an edge has
the same motion everywhere inside: fitted to one that goes on to grow it lies beside the edge, by
about 2.5 widths times the growth over a width, and so by the square of the spot's size. On both
sides of a circle that is in the same direction: the ellipse is displaced.

One edge tells next to nothing of the growth, all edges of a circle together tell it. With the
`part` of the spot's light that falls on the circle and x the place from the circle's middle

    magnitude = rest + (motion + slope . x) part

is linear in ``rest``, ``motion`` and ``slope``. To first order that is true of every motion, also
of one that is uneven itself, as long as it is not uneven in the same way towards every edge. The
part is that of the ellipse and the spot which the edges show, each line moved to where its own edge
is; that place, and the spot's size, are found anew with the slope: fixed where an uneven motion has
displaced them they would hide up to four fifths of it, and their noise would count as slope. So is
how the spot grows over the circle, whose nearer side sees it larger: by half of what the motion
grows by at 60 degrees, and taken as even it would count as slope, too.

Lines end 2.5 widths inside of the edge, where a wide spot has hardly left it: the slope is then
known badly, and its error displaces all edges of the circle together. It is handed on with the
edges (`ScanLineEdges.growth_std`): errors that edges share do not become less by more of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry.blurred_disc import part_and_changes
from sldvexp.geometry.conic import shape_matrix
from sldvexp.image.pinhole import fit_circle, lines_at_ellipse
from sldvexp.image.scan_lines import ScanLineEdges, ScanLines
from sldvexp.statistics import NORMAL_MEDIAN
from sldvexp.typing import Array, BoolArray

#: By how much the motion differs between middle and edge, relative: its standard deviation where
#: edges on one side only do not tell it, and the most that is believed.
USUAL, MOST = 0.1, 0.5
#: Standard deviation of the spot's variances beside those that the edges show, relative; that of
#: their growth over the circle is `USUAL`.
SPOT = 1.0
#: Place and size of the spot at one motion, then at another: the second sees what the first left.
ROUNDS = 2
#: Pixels farther from the model than this many robust standard deviations do not count.
REJECT = 4.0
#: Nodes of the light, exact to 1e-5 of it.
NODES = 32


@dataclass(frozen=True, eq=False)
class Growth:
    """Motion of a circle by place.

    Parameters
    ----------
    rest, motion : float, m/s or any unit
        Outside, and in the middle.
    middle : ndarray, shape (2,), steps
    slope : ndarray, shape (2,), 1/steps
        Growth of the motion, over the motion in the middle.
    covariance : ndarray, shape (2, 2), 1/steps^2
        Of the slope.
    response : ndarray, shape (line, pixel, 2)
        Covariance of each pixel's noise with the slope, the magnitude's unit over steps.
    """

    rest: float
    motion: float
    middle: Array
    slope: Array
    covariance: Array
    response: Array

    def evened(self, lines: ScanLines, beside: Array | float = 0.0) -> ScanLines:
        """Divide what moves by how it grows, or by a growth beside it."""
        growth = (lines.position - self.middle) @ (self.slope + beside)
        level = 1.0 + np.clip(growth, -MOST, MOST)
        magnitude = self.rest + (lines.magnitude - self.rest) / level
        return replace(lines, magnitude=magnitude, std=lines.std / level)


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
    found, growth = place(lines, 1, window), None
    for _ in range(ROUNDS):
        before, growth = lines, find_growth(lines, found)
        if growth is None:
            return found
        lines = growth.evened(before)
        found = place(lines, 1, window)
    assert growth is not None
    return replace(
        found, growth_std=_growth_std(lambda lines: place(lines, 1, window), before, found, growth)
    )


def _growth_std(
    find: Callable[[ScanLines], ScanLineEdges],
    lines: ScanLines,
    edges: ScanLineEdges,
    growth: Growth,
) -> Array:
    """Find how far the error of the growth moves edges that were found on evened lines.

    Independent errors z of the growth, of unit variance, move them by ``J z``, and noise of the
    pixels that makes the growth also moves the edges themselves: their covariance with z is c. Of
    ``J J' + c J' + J c'`` that part is taken which moves edges as the growth does, ``c = J B``.

    Returns
    -------
    ndarray, shape (n, 2), steps
    """
    root = np.linalg.cholesky(growth.covariance)
    fields = np.moveaxis(growth.response @ np.linalg.inv(root).T, -1, 0)
    even = growth.evened(lines)
    noisy = [replace(even, magnitude=even.magnitude + field) for field in fields]
    uneven = [growth.evened(lines, beside) for beside in root.T]
    own, by_growth = (
        np.stack([_shift(find, edges, even, one) for one in each], axis=-1)
        for each in (noisy, uneven)
    )
    std = edges.std[:, None]
    both = np.linalg.lstsq(by_growth / std, own / std, rcond=None)[0]
    size, axes = np.linalg.eigh(np.eye(2) + both + both.T)
    return np.asarray(by_growth @ axes * np.sqrt(np.maximum(size, 0.0)))


def _shift(
    find: Callable[[ScanLines], ScanLineEdges],
    edges: ScanLineEdges,
    lines: ScanLines,
    others: ScanLines,
) -> Array:
    """Measure how far ahead other magnitudes of the same lines move edges, shape (n,), steps.

    To first order, if it is known how each pixel moves them: pixels that come to count, or to stand
    out, with the change are none of the error's doing. Otherwise edges are found anew, and one that
    is not found did not move.
    """
    if edges.gain is not None:
        change = np.where(lines.flag, 0.0, others.magnitude - lines.magnitude)
        return np.asarray((edges.gain * change[edges.line]).sum(axis=-1))
    found = find(others)
    ahead, is_there = np.zeros((len(lines.std), 2)), np.zeros(len(lines.std), bool)
    ahead[found.line], is_there[found.line] = found.position, True
    away = np.sum((ahead[edges.line] - edges.position) * edges.direction, axis=-1)
    return np.where(is_there[edges.line], away, 0.0)


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
    growth = find_growth(lines, edges)
    return lines if growth is None else growth.evened(lines)


def find_growth(lines: ScanLines, edges: ScanLineEdges) -> Growth | None:
    """Fit rest, motion and its slope to the pixels of all lines that have an edge.

    Returns
    -------
    Growth or None
        None if the edges make no ellipse or nothing moves there.
    """
    try:
        fit, freed = fit_circle(edges)
    except UserError:
        return None
    own, numbers = edges.line, fit.ellipse.parameters
    good = ~lines.flag[own]
    values = np.where(good, lines.magnitude[own], 0.0)
    contrast = float(np.ptp(values[good]))
    if not contrast > 0:
        return None
    size = float(np.sqrt(np.mean(fit.ellipse.semi_axes**2)))
    width = np.maximum(edges.width, lines.pitch[own] / 2.0)
    ahead, spot = lines_at_ellipse(freed, width, fit)
    away = lines.position[own] + (ahead[:, None] * edges.direction)[:, None] - numbers[:2]
    part, by_place, by_spot = _parts(numbers, spot, away, edges.direction)
    known = np.stack([np.ones_like(part), part], axis=-1)
    # The nearer side of an oblique circle sees a larger spot, in angle.
    wider = by_spot[..., :2].sum(axis=-1, keepdims=True) * (away / size)
    columns = [known, part[..., None] * (away / size), by_spot, wider]
    beyond = np.array([0.0, 0.0, *[1.0 / USUAL] * 2, *[1.0 / SPOT] * 3, *[1.0 / USUAL] * 2])
    std = np.where(good, lines.std[own], 1.0)
    found, covariance, response = _solve(
        np.concatenate(columns, axis=-1), by_place, values, std, good, beyond / contrast
    )
    rest, motion = found[:2]
    if not abs(motion) > 0:
        return None
    unit = motion * size
    of_lines = np.zeros((*lines.std.shape, 2))
    of_lines[own] = response[..., 2:4] / unit
    return Growth(
        float(rest),
        float(motion),
        numbers[:2],
        found[2:4] / unit,
        covariance[2:4, 2:4] / unit**2,
        of_lines,
    )


def _parts(
    numbers: Array, spot: Array, away: Array, direction: Array
) -> tuple[Array, Array, Array]:
    """Compute the part of the light on the ellipse, and differentiate it.

    Returns
    -------
    part : ndarray, shape (n, pixel)
    by_place : ndarray, shape (n, pixel)
        Along the scan line.
    by_spot : ndarray, shape (n, pixel, 3)
        By the spot's variances and covariance, relative to its mean variance.
    """
    to_disc = np.linalg.inv(np.linalg.cholesky(shape_matrix(numbers)))
    variance = float(np.trace(spot)) / 2.0
    part, gradient, second = part_and_changes(away @ to_disc.T, to_disc @ spot @ to_disc.T, NODES)
    by_place = ((gradient @ to_disc) * direction[:, None]).sum(axis=-1)
    by_light = variance / 2.0 * (to_disc.T @ second @ to_disc)
    return part, by_place, by_light[..., [0, 1, 0], [0, 1, 1]]


def _solve(
    design: Array, by_place: Array, values: Array, std: Array, good: BoolArray, beyond: Array
) -> tuple[Array, Array, Array]:
    """Fit numbers of all lines by robust least squares, whatever the place of each line is.

    Parameters
    ----------
    design : ndarray, shape (n, pixel, p)
    by_place : ndarray, shape (n, pixel)
        Derivative by the line's own place.
    beyond : ndarray, shape (p,)
        One over the standard deviations of the numbers beforehand.

    Returns
    -------
    numbers : ndarray, shape (p,)
    covariance : ndarray, shape (p, p)
    response : ndarray, shape (n, pixel, p)
        Covariance of the pixels' noise with the numbers.
    """
    rows = np.concatenate([design, values[..., None]], axis=-1) / std[..., None]
    own = (by_place / std)[..., None]
    counts, scatter = good, 1.0
    for _ in range(5):
        used, told = counts, np.where(counts[..., None], rows, 0.0)
        place = np.where(counts[..., None], own, 0.0)
        square = np.maximum(np.sum(place**2, axis=1, keepdims=True), np.finfo(float).tiny)
        left = rows - own * (np.sum(place * told, axis=1, keepdims=True) / square)
        equations = left[counts] / scatter
        normal = equations[:, :-1].T @ equations[:, :-1] + np.diag(beyond**2)
        covariance = np.linalg.inv(normal)
        numbers = covariance @ (equations[:, :-1].T @ equations[:, -1])
        size = np.abs(left[..., -1] - left[..., :-1] @ numbers)
        scatter = max(float(np.median(size[good])) / NORMAL_MEDIAN, 1.0)
        counts = good & (size <= REJECT * scatter)
    response = np.where(used[..., None], std[..., None] * (left[..., :-1] @ covariance), 0.0)
    return numbers, covariance, response
