"""Edges along scan lines (Section 4.5.2), placed by one of three methods.

All start from the steepest places of the median-filtered magnitude. `pixel_edges` takes the pixel,
`gradient_edges` puts a parabola through the largest gradient and its neighbours; `profile_edges`
fits what a finite spot sees.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sldvexp.image.candidates import Candidates, candidates
from sldvexp.image.edge_profile import NARROWEST, Profiles, fit_profiles
from sldvexp.image.scan_lines import Edges, Reason, ScanLines, is_edge
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray

#: Median windows of the coarse and the fine lines (Section 4.5.2), pixels.
COARSE_WINDOW, FINE_WINDOW = 25, 5
#: Standard error, in steps, above which the place that fits best is no edge.
WORST = 3.0
#: Chi square, as a multiple of the median of all edges, above which a profile does not fit.
MISFIT = 5.0


def gradient_edges(lines: ScanLines, edges_per_line: int, window: int) -> Edges:
    """Edges where the median-filtered magnitude is steepest, placed by a parabola.

    Parameters
    ----------
    lines : ScanLines
    edges_per_line : int
        2 for lines across a whole circle, which rise and then fall; 1 for lines across one edge.
    window : int
        Of the median filter, pixels.

    Returns
    -------
    Edges
        The standard error is that of the pixels' noise, to first order and as if the filter did not
        reduce it; where the spot is smaller than a pixel, a pixel's share is added.
    """
    found = candidates(lines, edges_per_line, window)
    return _edges(lines, found, found.edge, found.std, found.width, found.reason)


def pixel_edges(lines: ScanLines, edges_per_line: int, window: int) -> Edges:
    """Edges at the pixel where the median-filtered magnitude is steepest, a whole DAC step.

    Parameters
    ----------
    lines : ScanLines
    edges_per_line : int
        2 for lines across a whole circle, which rise and then fall; 1 for lines across one edge.
    window : int
        Of the median filter, pixels.

    Returns
    -------
    Edges
        The standard error is that of `gradient_edges` and of a place rounded to pixels.
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


def profile_edges(lines: ScanLines, edges_per_line: int, window: int) -> Edges:
    """Edges where the profile of a finite spot fits the unfiltered magnitude best.

    Parameters
    ----------
    lines : ScanLines
    edges_per_line : int
        2 for lines across a whole circle, which rise and then fall; 1 for lines across one edge.
    window : int
        Of the median filter that finds the start, pixels.

    Returns
    -------
    Edges
        The standard error is that of the fit, larger by the root of the mean chi square per degree
        of freedom of all edges where that exceeds one.
    """
    found = candidates(lines, edges_per_line, window)
    edge, std, width = found.edge.copy(), found.std.copy(), found.width.copy()
    reason = found.reason.copy()
    good = np.flatnonzero(is_edge(reason))
    if len(good):
        profiles = _fit(lines, found, good)
        fits, inflation = _judge(profiles, found.rising[good])
        edge[good], width[good] = profiles.edge, profiles.width
        std[good] = profiles.edge_std * inflation
        reason[good[~fits]] = Reason.profile
    return _edges(lines, found, edge, std, width, reason)


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
    """Which profiles fit, and by how much the standard errors of those are too small."""
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
) -> Edges:
    good = is_edge(reason)
    line = found.line[good]
    phase = np.full(len(line), np.nan) if lines.phase is None else lines.phase[line]
    return Edges(
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
    )
