"""Edges along scan lines (Section 4.5.2), placed by one of three methods.

All start from the steepest places of the median-filtered magnitude. `pixel_edges` takes the pixel,
`gradient_edges` puts a parabola through the largest gradient and its neighbours; `profile_edges`
fits what a finite spot sees.

Steepest places of median-filtered scan lines, and whether each can be an edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sldvexp.image.edge_profile import NARROWEST, Profiles, fit_profiles
from sldvexp.image.scan_lines import Reason, ScanLineEdges, ScanLines, is_edge
from sldvexp.lazy import scipy
from sldvexp.statistics import NORMAL_MEDIAN
from sldvexp.typing import Array, BoolArray, IndexArray

#: Median windows of the coarse and the fine lines (Section 4.5.2), pixels.
COARSE_WINDOW, FINE_WINDOW = 25, 5
#: Standard error, in steps, above which the place that fits best is no edge.
WORST = 3.0
#: Chi square, as a multiple of the median of all edges, above which a profile does not fit.
MISFIT = 5.0


def gradient_edges(lines: ScanLines, edges_per_line: int, window: int) -> ScanLineEdges:
    """Place edges where the median-filtered magnitude is steepest, by a parabola.

    Parameters
    ----------
    edges_per_line : int
        2 for lines across a whole circle, which rise and then fall; 1 for lines across one edge.
    window : int
        Of the median filter, pixels.

    Returns
    -------
    ScanLineEdges
        The standard error is that of the pixels' noise, to first order and as if the filter did not
        reduce it; where the spot is smaller than a pixel, a pixel's share is added.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.image import ScanLines, gradient_edges
    >>> pixel = np.arange(40.0)
    >>> step = np.clip((pixel - 20.3) / 3, 0, 1)  # rests on one side, moves on the other
    >>> lines = ScanLines(
    ...     magnitude=step[None], std=np.full((1, 40), 0.01),
    ...     position=np.stack([np.zeros(40), pixel], axis=1)[None], flag=np.zeros((1, 40), bool))
    >>> gradient_edges(lines, edges_per_line=1, window=3).position.round(1)
    array([[ 0. , 21.8]])
    """
    found = candidates(lines, edges_per_line, window)
    return _edges(lines, found, found.edge, found.std, found.width, found.reason)


def pixel_edges(lines: ScanLines, edges_per_line: int, window: int) -> ScanLineEdges:
    """Place edges at the pixel where the median-filtered magnitude is steepest, a whole DAC step.

    Parameters
    ----------
    edges_per_line : int
        2 for lines across a whole circle, which rise and then fall; 1 for lines across one edge.
    window : int
        Of the median filter, pixels.

    Returns
    -------
    ScanLineEdges
        The standard error is that of `gradient_edges` and of a place rounded to pixels.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.image import ScanLines, pixel_edges
    >>> pixel = np.arange(40.0)
    >>> step = np.clip((pixel - 20.3) / 3, 0, 1)  # rests on one side, moves on the other
    >>> lines = ScanLines(
    ...     magnitude=step[None], std=np.full((1, 40), 0.01),
    ...     position=np.stack([np.zeros(40), pixel], axis=1)[None], flag=np.zeros((1, 40), bool))
    >>> pixel_edges(lines, edges_per_line=1, window=3).position.round(1)
    array([[ 0., 22.]])
    """
    found = candidates(lines, edges_per_line, window)
    along = lines.along[found.line]
    # Gradients are of evenly spaced places; on an oblique line whole steps lie beside them.
    even = along[:, 0] + (along[:, -1] - along[:, 0]) * found.pixel / (along.shape[1] - 1)
    nearest = np.abs(along - even[:, None]).argmin(axis=1)
    std = np.hypot(found.std, lines.pitch[found.line] / np.sqrt(12.0))
    edges = _edges(lines, found, found.edge, std, found.width, found.reason)
    good = is_edge(found.reason)
    return replace(edges, position=lines.position[found.line[good], nearest[good]])


def profile_edges(lines: ScanLines, edges_per_line: int, window: int) -> ScanLineEdges:
    """Place edges where the profile of a finite spot fits the unfiltered magnitude best.

    Parameters
    ----------
    edges_per_line : int
        2 for lines across a whole circle, which rise and then fall; 1 for lines across one edge.
    window : int
        Of the median filter that finds the start, pixels.

    Returns
    -------
    ScanLineEdges
        The standard error is that of the fit, larger by the root of the mean chi square per degree
        of freedom of all edges where that exceeds one.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.image import ScanLines, profile_edges
    >>> pixel = np.arange(40.0)
    >>> step = np.clip((pixel - 20.3) / 3, 0, 1)  # rests on one side, moves on the other
    >>> lines = ScanLines(
    ...     magnitude=step[None], std=np.full((1, 40), 0.01),
    ...     position=np.stack([np.zeros(40), pixel], axis=1)[None], flag=np.zeros((1, 40), bool))
    >>> profile_edges(lines, edges_per_line=1, window=3).position.round(1)
    array([[ 0. , 21.8]])
    """
    found = candidates(lines, edges_per_line, window)
    edge, std, width = found.edge.copy(), found.std.copy(), found.width.copy()
    reason = found.reason.copy()
    gain = np.zeros((len(edge), lines.magnitude.shape[1]))
    good = np.flatnonzero(is_edge(reason))
    if len(good):
        profiles = _fit(lines, found, good)
        fits, inflation = _judge(profiles, found.rising[good])
        edge[good], width[good] = profiles.edge, profiles.width
        std[good] = profiles.edge_std * inflation
        # Places beyond the ends of a line stand for its last pixels, and have no gain.
        np.add.at(gain, (good[:, None], found.around[good]), profiles.gain)
        reason[good[~fits]] = Reason.profile
    edges = _edges(lines, found, edge, std, width, reason)
    return replace(edges, gain=gain[is_edge(reason)])


def _fit(lines: ScanLines, found: Candidates, good: IndexArray) -> Profiles:
    place = found.line[good, None], found.around[good]
    weight = np.where(found.counts[good], 1.0 / np.where(lines.flag, np.inf, lines.std)[place], 0.0)
    before, after = found.before[good], found.after[good]
    pitch = lines.pitch[found.line[good]]
    width = np.maximum(found.width[good], NARROWEST * pitch)
    start = np.stack([found.edge[good], np.log(width), before, after], axis=-1)
    values = lines.filled()

    smooth = scipy.ndimage.median_filter(values, size=(1, FINE_WINDOW), mode="mirror")
    return fit_profiles(lines.along[place], values[place], smooth[place], weight, start, pitch)


def _judge(profiles: Profiles, rising: BoolArray) -> tuple[BoolArray, Array]:
    """Find which profiles fit, and by how much the standard errors of those are too small."""
    same_sense = (profiles.after > profiles.before) == rising
    fits = profiles.settled & same_sense & (profiles.dof > 0) & (profiles.edge_std <= WORST)
    if not (fits & profiles.resolved).any():
        return fits, np.ones(len(fits))
    reduced = profiles.chi_square / np.maximum(profiles.dof, 1)
    usual = float(np.median(reduced[fits & profiles.resolved]))
    fits &= ~profiles.resolved | (reduced <= MISFIT * max(usual, 1.0))
    known = fits & profiles.resolved
    mean = float(profiles.chi_square[known].sum() / profiles.dof[known].sum())
    return fits, np.where(profiles.resolved, np.sqrt(max(mean, 1.0)), 1.0)


def _edges(
    lines: ScanLines,
    found: Candidates,
    edge: Array,
    std: Array,
    width: Array,
    reason: NDArray[np.object_],
) -> ScanLineEdges:
    good = is_edge(reason)
    line = found.line[good]
    phase = np.full(len(line), np.nan) if lines.phase is None else lines.phase[line]
    return ScanLineEdges(
        position=lines.place(line, edge[good], width[good]),
        std=std[good],
        direction=lines.direction[line],
        width=width[good],
        line=line,
        rising=found.rising[good],
        phase=phase,
        rejected=tuple(zip(found.line[~good].tolist(), reason[~good].tolist(), strict=True)),
        lines=len(lines.magnitude),
        name=lines.name,
        reach=_reach(lines, found, edge, good),
    )


def _reach(lines: ScanLines, found: Candidates, edge: Array, good: BoolArray) -> Array:
    """Measure how far the pixels are looked at, back from the edges and on."""
    around = found.around[good]
    first, last = (lines.along[found.line[good], around[:, k]] for k in (0, -1))
    return np.stack([edge[good] - first, last - edge[good]], axis=-1)


#: Pixels on each side of an edge that are looked at: as many as a fine line has.
REACH = 12
#: Pixels next to the edge that belong to neither side, and the least number on a side.
GAP, LEAST_SIDE = 2, 3
#: Least difference between the two sides of an edge, in standard deviations of a pixel.
CONTRAST = 6.0
#: Largest fraction of flagged pixels within reach of an edge.
FLAGGED = 0.5
#: Gradient, as a fraction of the contrast a pixel, above which the spot is not resolved.
UNRESOLVED = 0.4
#: Root mean square error, in pixels, of a parabola through samples of a resolved gradient.
LOCKING = 0.03
#: Keeps a line without any gradient from dividing by zero.
TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Candidates:
    """Steepest places of scan lines, and what is around them.

    Parameters
    ----------
    line, pixel : ndarray of int, shape (n,)
    rising : ndarray of bool, shape (n,)
        Whether the magnitude grows along the line.
    around : ndarray of int, shape (n, 2 REACH + 1)
        Pixels within reach, on the same line.
    counts : ndarray of bool, shape (n, 2 REACH + 1)
        Which of those are there and not flagged.
    edge, std : ndarray, shape (n,), steps
        Place along the line by the parabola, and its standard error.
    width : ndarray, shape (n,), steps
        Width of the profile that has this largest gradient.
    before, after : ndarray, shape (n,)
        Median magnitudes on the two sides.
    reason : ndarray of Reason or None, shape (n,)
    """

    line: IndexArray
    pixel: IndexArray
    rising: BoolArray
    around: IndexArray
    counts: BoolArray
    edge: Array
    std: Array
    width: Array
    before: Array
    after: Array
    reason: NDArray[np.object_]


def candidates(lines: ScanLines, edges_per_line: int, window: int) -> Candidates:
    """Find the steepest rise and the steepest fall of every line (or, for one edge, the steeper).

    Parameters
    ----------
    edges_per_line : int
        1 or 2.
    window : int
        Of the median filter along the line, pixels.
    """
    filtered = scipy.ndimage.median_filter(lines.filled(), size=(1, window), mode="mirror")
    along, even = _evenly(lines.along, filtered)
    gradient = np.gradient(even, axis=1) / lines.pitch[:, None]
    line, pixel, rising = _steepest(gradient, edges_per_line)
    around, inside = _surroundings(lines.flag.shape[1], pixel)
    counts = inside & ~lines.flag[line[:, None], around]
    std = _std(lines)
    place = line[:, None], around
    before, after, noise = _sides(lines.filled()[place], std[place], counts)
    difference = np.where(rising, after - before, before - after)

    reason = np.full(len(line), None, object)
    reason[~(difference > CONTRAST * noise)] = Reason.contrast
    reason[np.isnan(difference)] = Reason.end
    flat = np.ptp(filtered, axis=1) < CONTRAST * np.median(std, axis=1)
    reason[flat[line]] = Reason.contrast
    reason[(inside & ~counts).sum(axis=1) > FLAGGED * inside.sum(axis=1)] = Reason.flagged
    if edges_per_line == 2:
        reason[_swapped(pixel, is_edge(reason))] = Reason.order

    edge, slope = _parabola(along, gradient, line, pixel)
    pitch = lines.pitch[line]
    contrast = np.where(is_edge(reason), difference, np.nan)
    error = _parabola_std(pitch, std, line, pixel, np.abs(slope), contrast)
    # differences over two pixels widen the profile by the variance of a box of that length
    square = (contrast / (np.abs(slope) + TINY)) ** 2 / (2.0 * np.pi) - pitch**2 / 3.0
    width = np.sqrt(np.maximum(square, 0.0))
    return Candidates(
        line, pixel, rising, around, counts, edge, error, width, before, after, reason
    )


def _std(lines: ScanLines) -> Array:
    """Give flagged pixels their line's median standard error, shape as given."""
    good = ~lines.flag
    usual = _median(np.where(good, lines.std, 1.0), good)
    return np.where(good, lines.std, usual[:, None])


def _swapped(pixel: IndexArray, good: BoolArray) -> BoolArray:
    """Find candidates of the lines that, as far as they are good, fall before they rise."""
    rise, fall = slice(0, None, 2), slice(1, None, 2)
    return np.repeat(good[rise] & good[fall] & (pixel[fall] < pixel[rise]), 2)


def _evenly(along: Array, values: Array) -> tuple[Array, Array]:
    """Space places evenly and interpolate there; on an oblique line whole steps are not even."""
    grid = np.linspace(along[:, 0], along[:, -1], along.shape[1], axis=1)
    even = [np.interp(g, t, v) for g, t, v in zip(grid, along, values, strict=True)]
    return grid, np.array(even)


def _steepest(gradient: Array, edges_per_line: int) -> tuple[IndexArray, IndexArray, BoolArray]:
    """Find line, pixel and sense of the candidates; of two, first the rise."""
    lines = np.arange(len(gradient))
    if edges_per_line == 1:
        pixel = np.argmax(np.abs(gradient), axis=1)
        return lines, pixel, gradient[lines, pixel] > 0
    pixel = np.stack([np.argmax(gradient, axis=1), np.argmin(gradient, axis=1)], axis=1).ravel()
    return np.repeat(lines, 2), pixel, np.tile([True, False], len(lines))


def _surroundings(pixels: int, pixel: IndexArray) -> tuple[IndexArray, BoolArray]:
    """Find pixels within reach, and which of them there are."""
    around = pixel[:, None] + np.arange(-REACH, REACH + 1)
    inside = (around >= 0) & (around < pixels)
    return np.clip(around, 0, pixels - 1), inside


def _sides(values: Array, std: Array, counts: BoolArray) -> tuple[Array, Array, Array]:
    """Take the median on each side, NaN for a side of too few pixels, and the noise around both.

    The noise is the pixels' standard error or, where that is larger, their scatter.
    """
    offset = np.arange(-REACH, REACH + 1)
    left, right = (counts & side for side in (offset < -GAP, offset > GAP))
    enough = (left.sum(axis=1) >= LEAST_SIDE) & (right.sum(axis=1) >= LEAST_SIDE)
    before, after = (np.where(enough, _median(values, side), np.nan) for side in (left, right))
    scatter = np.abs(values - np.where(offset < 0, before[:, None], after[:, None]))
    noise = np.maximum(_median(scatter, left | right) / NORMAL_MEDIAN, _median(std, left | right))
    return before, after, noise


def _median(values: Array, counts: BoolArray) -> Array:
    """Take the median of the values that count in each row; if none, the largest number."""
    ordered = np.sort(np.where(counts, values, np.inf), axis=1)
    last = np.maximum(counts.sum(axis=1) - 1, 0)
    rows = np.arange(len(ordered))
    return np.asarray((ordered[rows, last // 2] + ordered[rows, (last + 1) // 2]) / 2.0)


def _parabola(
    along: Array, gradient: Array, line: IndexArray, pixel: IndexArray
) -> tuple[Array, Array]:
    """Find the top of the parabola through the gradient at a pixel and its neighbours.

    Where the three are level, as a median filter may leave them, the pixel itself.
    """
    k = np.clip(pixel, 1, along.shape[1] - 2)
    before, at, after = (gradient[line, k + i] for i in (-1, 0, 1))
    bend = before - 2.0 * at + after
    peaked = bend * at < 0
    shift = np.where(peaked, (before - after) / np.where(peaked, 2.0 * bend, 1.0), 0.0)
    return along[line, k] + shift * (along[line, 1] - along[line, 0]), at


def _parabola_std(
    pitch: Array,
    std: Array,
    line: IndexArray,
    pixel: IndexArray,
    slope: Array,
    contrast: Array,
) -> Array:
    """Compute standard error of the parabola's top to first order.

    The slope of the gradient is ``(m[+2] - 2 m[0] + m[-2]) / 4`` a pixel^2; the bend at the top of
    a Gaussian whose peak is `slope` and whose area is `contrast` is ``2 pi slope^3 / contrast^2``.
    """
    place = np.clip(pixel[:, None] + np.array([-2, 0, 2]), 0, std.shape[1] - 1)
    noise = np.sqrt((std[line[:, None], place] ** 2) @ np.array([1.0, 4.0, 1.0])) / (4 * pitch**2)
    unresolved = slope * pitch > UNRESOLVED * contrast
    sampling = pitch * np.where(unresolved, 1.0 / np.sqrt(12.0), LOCKING)
    return np.hypot(noise * contrast**2 / (2.0 * np.pi * slope**3 + TINY), sampling)
