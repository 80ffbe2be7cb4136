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
#: Width, in pixels, below which no pixel lies on the slope: then the edge is between two of them.
NARROWEST = 0.3
#: Pixels farther from the profile than this many robust standard deviations are left out.
REJECT = 5.0
#: Stands for zero where a division needs a number.
TINY = 1e-30


@dataclass(frozen=True, eq=False)
class Profiles:
    """Fitted profiles of n edges.

    Parameters
    ----------
    edge, width : ndarray, shape (n,), the unit of `along`
    before, after : ndarray, shape (n,), the unit of the magnitude
    edge_std : ndarray, shape (n,)
        Standard error of the edge from the pixels' standard errors.
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
        As measured and median-filtered.
    weight : ndarray, shape (n, pixel)
        One over the standard error; zero for pixels that do not count.
    start : ndarray, shape (n, 4)
        As in `step_profile`.
    pitch : ndarray, shape (n,), steps
        Distance between pixels.
    """
    numbers, _ = _least_squares(along, smooth, weight, start, pitch)
    weight = _without_outliers(along, magnitude, weight, numbers, pitch)
    numbers, settled = _least_squares(along, magnitude, weight, numbers, pitch)

    model, jacobian = step_profile(along, numbers)
    resolved = _resolved(numbers, pitch)
    rows = weight[..., None] * jacobian
    between = pitch / np.sqrt(12.0)  # of two pixels: every place is as likely
    inside = (numbers[:, 0] > along[:, 0]) & (numbers[:, 0] < along[:, -1])
    return Profiles(
        edge=numbers[:, 0],
        width=np.exp(numbers[:, 1]),
        before=numbers[:, 2],
        after=numbers[:, 3],
        edge_std=np.where(resolved, _edge_std(rows), between),
        chi_square=np.sum((weight * (magnitude - model)) ** 2, axis=1),
        dof=np.count_nonzero(weight, axis=1) - 4,
        resolved=resolved,
        settled=(settled | ~resolved) & inside,
    )


def _edge_std(rows: Array) -> Array:
    """Compute standard error of the first of four numbers.

    Huge where the pixels do not determine it.
    """
    normal = np.swapaxes(rows, 1, 2) @ rows
    scale = np.sqrt(np.maximum(np.einsum("nii->ni", normal), TINY))
    correlation = normal / (scale[:, :, None] * scale[:, None, :]) + 1e-12 * np.eye(4)
    return np.sqrt(np.linalg.inv(correlation)[:, 0, 0]) / scale[:, 0]


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
    along: Array, magnitude: Array, weight: Array, start: Array, pitch: Array
) -> tuple[Array, BoolArray]:
    """Fit every row by Levenberg-Marquardt with its own damping; which rows settled."""
    narrowest = np.log(NARROWEST * pitch)
    widest = np.log(along[:, -1] - along[:, 0])
    numbers = start.copy()
    numbers[:, 1] = np.clip(numbers[:, 1], narrowest, widest)
    damping = np.full(len(start), 1e-3)
    settled = np.zeros(len(start), bool)
    model, jacobian = step_profile(along, numbers)
    cost = np.sum((weight * (magnitude - model)) ** 2, axis=1)
    for _ in range(ITERATIONS):
        rows = weight[..., None] * jacobian
        normal = np.swapaxes(rows, 1, 2) @ rows
        scale = np.maximum(np.einsum("nii->ni", normal), TINY)
        normal += damping[:, None, None] * scale[:, None, :] * np.eye(4)
        pull = np.einsum("npi,np->ni", rows, weight * (magnitude - model))
        step = np.linalg.solve(normal, pull[..., None])[..., 0]
        trial = numbers + step
        trial[:, 1] = np.clip(trial[:, 1], narrowest, widest)
        trial_model, trial_jacobian = step_profile(along, trial)
        trial_cost = np.sum((weight * (magnitude - trial_model)) ** 2, axis=1)
        better = trial_cost <= cost
        settled |= np.abs(cost - trial_cost) <= SETTLED * (cost + 1.0)
        damping = np.maximum(np.where(better, damping / 10.0, damping * 10.0), LEAST_DAMPING)
        numbers = np.where(better[:, None], trial, numbers)
        model = np.where(better[:, None], trial_model, model)
        jacobian = np.where(better[:, None, None], trial_jacobian, jacobian)
        cost = np.where(better, trial_cost, cost)
        if settled.all():
            break
    return numbers, settled
