"""F-tests: does a model with more parameters explain the data significantly better?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True)
class FTest:
    """An F statistic with its distribution under the hypothesis that the parameters are zero.

    Attributes
    ----------
    statistic : ndarray
    dof : tuple of ndarray
        Degrees of freedom of numerator and denominator.
    p_value : ndarray
        Probability of a larger statistic if the hypothesis holds.
    critical : ndarray
        Value that the statistic exceeds with probability 1 - confidence if it holds.
    reject : ndarray of bool
        True where the hypothesis is rejected: the parameters are significant.
    """

    statistic: Array
    dof: tuple[Array, Array]
    p_value: Array
    critical: Array
    reject: BoolArray


def f_test(
    statistic: ArrayLike, numerator_dof: ArrayLike, denominator_dof: ArrayLike, confidence: float
) -> FTest:
    """Judge an F statistic.

    Parameters
    ----------
    statistic : array_like
    numerator_dof, denominator_dof : array_like, broadcastable to `statistic`
        An infinite denominator stands for a known noise. Without any degrees of freedom
        everything but the statistic is NaN and nothing is rejected.
    confidence : float
        1 - alpha, as 0.95.

    Returns
    -------
    FTest
    """
    f, p, q = np.broadcast_arrays(
        np.asarray(statistic, float),
        np.asarray(numerator_dof, float),
        np.asarray(denominator_dof, float),
    )
    known, none = np.isinf(q), ~(q > 0)
    finite = np.where(known | none, 1.0, q)
    p_value = np.where(known, scipy.special.chdtrc(p, p * f), scipy.special.fdtrc(p, finite, f))
    critical = np.where(
        known,
        scipy.special.chdtri(p, 1 - confidence) / p,
        scipy.special.fdtri(p, finite, confidence),
    )
    p_value, critical = np.where(none, np.nan, p_value), np.where(none, np.nan, critical)
    with np.errstate(invalid="ignore"):
        return FTest(f, (p, q), p_value, critical, f > critical)


def nested_f_test(
    sse_partial: ArrayLike,
    sse_full: ArrayLike,
    added_dof: ArrayLike,
    residual_dof: ArrayLike,
    confidence: float,
) -> FTest:
    """Compare a model with the same model without some of its parameters (Eq 5.17, corrected).

    ``F = ((SSE_partial - SSE_full) / added) / (SSE_full / residual)``. With complex data every
    parameter and every sample counts twice: an intercept has ``added_dof = 2`` and n views leave
    ``residual_dof = 2 (n - 4)``.

    Parameters
    ----------
    sse_partial, sse_full : array_like
        Residual sums of squares of the model without and with the parameters.
    added_dof, residual_dof : array_like
        Real parameters that were added; real degrees of freedom that the full model leaves.
    confidence : float

    Returns
    -------
    FTest
    """
    partial, full = np.asarray(sse_partial, float), np.asarray(sse_full, float)
    statistic = (partial - full) / np.asarray(added_dof) / (full / np.asarray(residual_dof))
    return f_test(statistic, added_dof, residual_dof, confidence)
