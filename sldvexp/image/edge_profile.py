"""Profile of an edge seen by a finite spot, fitted to many edges at once.

A Gaussian spot that moves over the edge between a moving and a resting part sees
``before + (after - before) Phi((t - edge) / width)``, Phi the normal distribution and `width` the
spot's radius at 60 % of its peak intensity (1 / e^2 diameter / 4), over the cosine of the angle
between the line and the edge's normal. The four numbers of every edge are fitted by weighted least
squares; the Levenberg-Marquardt steps of all edges are taken together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.lazy import scipy
from sldvexp.statistics import NORMAL_MEDIAN
from sldvexp.typing import Array, BoolArray

#: Steps of Levenberg-Marquardt; about eight suffice from a gradient edge.
ITERATIONS = 60
#: Smallest damping: keeps the equations of an edge regular whose numbers its pixels do not tell.
LEAST_DAMPING = 1e-12
#: Change of chi square, relative or absolute, at which an edge has settled.
SETTLED = 1e-10
#: The same of a fit that only tells which pixels stand out.
ROUGHLY = 1e-6
#: Width, in pixels, below which no pixel lies on the slope: then the edge is between two of them.
NARROWEST = 0.3
#: Pixels farther from the profile than this many robust standard deviations are left out.
REJECT = 5.0
#: Stands for zero where a division needs a number.
TINY = 1e-30
#: Of the four numbers' matrices.
DIAGONAL = np.arange(4)


@dataclass(frozen=True, eq=False)
class Profiles:
    """Fitted profiles of n edges.

    Parameters
    ----------
    edge, width : ndarray, shape (n,), the unit of `along`
    before, after : ndarray, shape (n,), the unit of the magnitude
    edge_std : ndarray, shape (n,)
        Standard error of the edge from the pixels' standard errors.
    gain : ndarray, shape (n, pixel)
        Derivative of the edge by each pixel's magnitude; none of what lies between two pixels.
    chi_square : ndarray, shape (n,)
    dof : ndarray of int, shape (n,)
    resolved : ndarray of bool, shape (n,)
        Whether pixels lie on the slope; otherwise the edge is somewhere between two pixels.
    settled : ndarray of bool, shape (n,)
        Whether the fit settled on an edge within its window; between two pixels it need not.
    """

    edge: Array
    width: Array
    before: Array
    after: Array
    edge_std: Array
    gain: Array
    chi_square: Array
    dof: NDArray[np.int_]
    resolved: BoolArray
    settled: BoolArray


def step_profile(along: Array, numbers: Array) -> tuple[Array, Array]:
    """Compute magnitude that a finite spot sees, and its derivatives.

    Parameters
    ----------
    along : ndarray, shape (n, pixel)
    numbers : ndarray, shape (n, 4)
        Edge, logarithm of the width, magnitude before and after.

    Returns
    -------
    magnitude : ndarray, shape (n, pixel)
    jacobian : ndarray, shape (n, pixel, 4)
    """
    edge, log_width, before, after = numbers.T[..., None]
    u = (along - edge) * np.exp(-log_width)
    part = scipy.special.ndtr(u)
    slope = (after - before) * np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi)
    jacobian = np.stack([-slope * np.exp(-log_width), -slope * u, 1.0 - part, part], axis=-1)
    return before + (after - before) * part, jacobian


def fit_profiles(
    along: Array, magnitude: Array, smooth: Array, weight: Array, start: Array, pitch: Array
) -> Profiles:
    """Fit `step_profile` to each row without the pixels that stand out.

    Those are found against a first fit to the median-filtered row, which they do not move and which
    has the same profile, because a median filter leaves what only rises or only falls as it is.

    Parameters
    ----------
    along : ndarray, shape (n, pixel), steps
        Never falling along a row.
    magnitude, smooth : ndarray, shape (n, pixel)
        As measured and median-filtered; one and the same where no pixel can stand out.
    weight : ndarray, shape (n, pixel)
        One over the standard error; zero for pixels that do not count.
    start : ndarray, shape (n, 4)
        As in `step_profile`.
    pitch : ndarray, shape (n,), steps
        Distance between pixels.
    """
    if smooth is not magnitude:
        start, _ = _least_squares(along, smooth, weight, start, pitch, ROUGHLY)
        weight = _without_outliers(along, magnitude, weight, start, pitch)
    numbers, settled = _least_squares(along, magnitude, weight, start, pitch)

    rows, left = _weighed(along, weight * magnitude, weight, numbers)
    edge_std, gain = _of_edge(rows)
    resolved = _resolved(numbers, pitch)
    between = pitch / np.sqrt(12.0)  # of two pixels: every place is as likely
    inside = (numbers[:, 0] > along[:, 0]) & (numbers[:, 0] < along[:, -1])
    return Profiles(
        edge=numbers[:, 0],
        width=np.exp(numbers[:, 1]),
        before=numbers[:, 2],
        after=numbers[:, 3],
        edge_std=np.where(resolved, edge_std, between),
        gain=np.where(resolved[:, None], gain * weight, 0.0),
        chi_square=(left * left).sum(axis=1),
        dof=np.count_nonzero(weight, axis=1) - 4,
        resolved=resolved,
        settled=(settled | ~resolved) & inside,
    )


def fit_places(along: Array, magnitude: Array, start: Array, pitch: Array) -> tuple[Array, Array]:
    """Fit edge and width alone to rows of which every pixel counts alike, shape (n,) each.

    Parameters
    ----------
    along, magnitude, start, pitch
        As of `fit_profiles`.
    """
    numbers, _ = _least_squares(along, magnitude, np.ones_like(magnitude), start, pitch)
    return numbers[:, 0], np.exp(numbers[:, 1])


def _of_edge(rows: Array) -> tuple[Array, Array]:
    """Compute standard error of the first of four numbers, and its derivative by what was weighed.

    Huge where the pixels do not determine it.

    Returns
    -------
    std : ndarray, shape (n,)
    gain : ndarray, shape (n, pixel)
    """
    normal = rows @ np.swapaxes(rows, 1, 2)
    scale = np.sqrt(np.maximum(normal[:, DIAGONAL, DIAGONAL], TINY))
    correlation = normal / (scale[:, :, None] * scale[:, None, :]) + 1e-12 * np.eye(4)
    first = np.linalg.inv(correlation)[:, 0]
    gain = ((first / (scale[:, :1] * scale))[:, None] @ rows)[:, 0]
    return np.sqrt(first[:, 0]) / scale[:, 0], gain


def _without_outliers(
    along: Array, magnitude: Array, weight: Array, numbers: Array, pitch: Array
) -> Array:
    """Weight with zero the pixels that speckle or a spike moved off the profile.

    On an edge that is not resolved the pixels next to it are spared: the least width is not its.
    """
    size = np.abs(weight * (magnitude - step_profile(along, numbers)[0]))
    spread = np.nanmedian(np.where(weight > 0, size, np.nan), axis=1) / NORMAL_MEDIAN
    near = np.abs(along - numbers[:, :1]) < pitch[:, None]
    spared = near & ~_resolved(numbers, pitch)[:, None]
    return np.where((size <= REJECT * np.maximum(spread, 1.0)[:, None]) | spared, weight, 0.0)


def _resolved(numbers: Array, pitch: Array) -> BoolArray:
    return np.exp(numbers[:, 1]) > 1.01 * NARROWEST * pitch


def _least_squares(
    along: Array,
    magnitude: Array,
    weight: Array,
    start: Array,
    pitch: Array,
    settled_at: float = SETTLED,
) -> tuple[Array, BoolArray]:
    """Fit every row by Levenberg-Marquardt with its own damping; which rows settled.

    A row that has settled is left alone: few that do not would have all others computed as often.
    """
    low, high = np.log(NARROWEST * pitch), np.log(along[:, -1] - along[:, 0])
    numbers, settled = start.copy(), np.zeros(len(start), bool)
    numbers[:, 1] = np.clip(numbers[:, 1], low, high)
    told, damping = weight * magnitude, np.full(len(start), 1e-3)
    rows, left = _weighed(along, told, weight, numbers)
    open_, at, cost = np.arange(len(start)), numbers.copy(), (left * left).sum(axis=1)
    for _ in range(ITERATIONS):
        trial = at + _step(rows, left, damping)
        trial[:, 1] = np.minimum(np.maximum(trial[:, 1], low), high)
        trial_rows, trial_left = _weighed(along, told, weight, trial)
        trial_cost = (trial_left * trial_left).sum(axis=1)
        better = trial_cost <= cost
        done = np.abs(cost - trial_cost) <= settled_at * (cost + 1.0)
        damping = np.maximum(np.where(better, damping / 10.0, damping * 10.0), LEAST_DAMPING)
        at = np.where(better[:, None], trial, at)
        rows = np.where(better[:, None, None], trial_rows, rows)
        left = np.where(better[:, None], trial_left, left)
        cost = np.where(better, trial_cost, cost)
        numbers[open_], settled[open_] = at, done
        if done.all():
            break
        if done.any():
            open_, along, told, weight, low, high, at, rows, left, cost, damping = (
                each[~done]
                for each in (open_, along, told, weight, low, high, at, rows, left, cost, damping)
            )
    return numbers, settled


def _step(rows: Array, left: Array, damping: Array) -> Array:
    """Solve the damped normal equations of each row, shape (n, 4)."""
    normal = rows @ np.swapaxes(rows, 1, 2)
    own = normal[:, DIAGONAL, DIAGONAL]
    normal[:, DIAGONAL, DIAGONAL] = own + damping[:, None] * np.maximum(own, TINY)
    return np.asarray(np.linalg.solve(normal, rows @ left[..., None])[..., 0])


def _weighed(along: Array, told: Array, weight: Array, numbers: Array) -> tuple[Array, Array]:
    """Differentiate `step_profile`, over standard errors, and take it from what was measured.

    Returns
    -------
    rows : ndarray, shape (n, 4, pixel)
    left : ndarray, shape (n, pixel)
    """
    edge, log_width, before, after = numbers.T[..., None]
    inverse = np.exp(-log_width)
    u = (along - edge) * inverse
    rows = np.empty((len(along), 4, along.shape[1]))
    slope = np.exp(-0.5 * u * u) * weight
    slope *= (before - after) / np.sqrt(2.0 * np.pi)
    np.multiply(slope, inverse, out=rows[:, 0])
    np.multiply(slope, u, out=rows[:, 1])
    np.multiply(scipy.special.ndtr(u), weight, out=rows[:, 3])
    np.subtract(weight, rows[:, 3], out=rows[:, 2])
    return rows, told - before * rows[:, 2] - after * rows[:, 3]
