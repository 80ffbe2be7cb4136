"""Statistics that several rooms share: quantiles of bounds and tests of hypotheses.

All assume normal noise. Half-widths of two-sided confidence intervals are Student's t times the
standard error (Eq 5.18). F-tests ask whether a model with more parameters explains the data
significantly better, chi-square whether the residuals agree with the noise that was stated, and
Welch's test whether two estimates with different uncertainties are the same (Eqs 4.25 to 4.30).
Real and imaginary parts count as data of their own: complex data have twice the degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray

#: Median of the absolute value of a standard normal variable: robust standard deviations are the
#: median size over it.
NORMAL_MEDIAN = 0.6745


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
    numerator_dof, denominator_dof : array_like, broadcastable to `statistic`
        An infinite denominator stands for a known noise. Without any degrees of freedom
        everything but the statistic is NaN and nothing is rejected.
    confidence : float
        1 - alpha, as 0.95.

    Examples
    --------
    >>> from sldvexp.statistics import f_test
    >>> test = f_test(4.0, 2, 10, confidence=0.95)
    >>> round(float(test.critical), 3), round(float(test.p_value), 4), bool(test.reject)
    (4.103, 0.0529, False)
    """
    # What all statistics have in common is computed once: quantiles cost more than all else here.
    p, q = np.broadcast_arrays(np.asarray(numerator_dof, float), np.asarray(denominator_dof, float))
    known, none = np.isinf(q), ~(q > 0)
    finite = np.where(known | none, 1.0, q)
    critical = np.where(
        known,
        scipy.special.chdtri(p, 1 - confidence) / p,
        scipy.special.fdtri(p, finite, confidence),
    )
    critical = np.where(none, np.nan, critical)
    f = np.asarray(statistic, float)
    p_value = scipy.special.fdtrc(p, finite, f)
    if known.any():
        p_value = np.where(known, scipy.special.chdtrc(p, p * f), p_value)
    p_value = np.where(none, np.nan, p_value)
    f, p, q, critical = np.broadcast_arrays(f, p, q, critical)
    with np.errstate(invalid="ignore"):
        return FTest(f, (p, q), p_value, critical.copy(), f > critical)


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

    Examples
    --------
    An intercept of complex data from 6 views:

    >>> from sldvexp.statistics import nested_f_test
    >>> test = nested_f_test(5.0, 2.0, added_dof=2, residual_dof=4, confidence=0.95)
    >>> float(test.statistic), bool(test.reject)
    (3.0, False)
    """
    partial, full = np.asarray(sse_partial, float), np.asarray(sse_full, float)
    statistic = (partial - full) / np.asarray(added_dof) / (full / np.asarray(residual_dof))
    return f_test(statistic, added_dof, residual_dof, confidence)


def student_factor(confidence: float, dof: ArrayLike) -> Array:
    """Compute the factor t of the interval ``estimate +- t standard_error``.

    Parameters
    ----------
    confidence : float
        Two-sided level, as 0.95.
    dof : array_like
        Degrees of freedom of the standard error, whole or not. Infinite for a known noise, which
        gives the normal quantile.

    Returns
    -------
    ndarray, shape of `dof`
        NaN where there are no degrees of freedom: there is no bound to give.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.statistics import student_factor
    >>> student_factor(0.95, [0, 1, 10, np.inf]).round(3).tolist()
    [nan, 12.706, 2.228, 1.96]
    """
    # Many points share few values, and the quantile is slow.
    nu, where = np.unique(np.asarray(dof, float), return_inverse=True)
    upper = 0.5 + confidence / 2
    known = np.isinf(nu)
    none = ~(nu > 0)
    t = scipy.special.stdtrit(np.where(known | none, 1.0, nu), upper)
    return np.where(none, np.nan, np.where(known, scipy.special.ndtri(upper), t))[where].reshape(
        np.shape(dof)
    )


def chi_square_p_value(chi_square: ArrayLike, dof: ArrayLike) -> Array:
    """Compute the probability of a larger chi-square if the stated noise is right.

    Parameters
    ----------
    chi_square : array_like
        Sum of squared residuals, each over its standard deviation.
    dof : array_like, broadcastable to `chi_square`

    Examples
    --------
    >>> from sldvexp.statistics import chi_square_p_value
    >>> chi_square_p_value([3.0, 30.0], 10).round(4).tolist()
    [0.9814, 0.0009]
    """
    nu = np.asarray(dof, float)
    p_value = scipy.special.chdtrc(np.where(nu > 0, nu, 1.0), np.asarray(chi_square, float))
    return np.where(nu > 0, p_value, np.nan)


@dataclass(frozen=True)
class WelchTest:
    """Result of `welch`; every array has the estimates' shape.

    Attributes
    ----------
    statistic : ndarray
        t' of Eq 4.28, with its sign.
    dof : ndarray
        Welch-Satterthwaite degrees of freedom (Eq 4.29), not rounded.
    critical : ndarray
        Two-sided critical value of t at `dof`.
    reject : ndarray of bool
        True where the estimates differ significantly.
    """

    statistic: Array
    dof: Array
    critical: Array
    reject: BoolArray


def welch(
    mean1: ArrayLike,
    standard_error1: ArrayLike,
    dof1: ArrayLike,
    mean2: ArrayLike,
    standard_error2: ArrayLike,
    dof2: ArrayLike,
    confidence: float = 0.95,
) -> WelchTest:
    """Test whether two estimates of one parameter are equal (Eqs 4.28 to 4.30).

    The estimates need not be sample means: a fitted parameter with its standard error and degrees
    of freedom will do. For the mean of n samples of standard deviation s, ``standard_error =
    s / sqrt(n)`` and ``dof = n - 1`` give the dissertation's formulas.

    Parameters
    ----------
    mean1, mean2 : array_like
        The estimates, in one unit.
    standard_error1, standard_error2 : array_like
        Their standard errors, in the same unit; not both zero.
    dof1, dof2 : array_like
        Degrees of freedom of the standard errors; infinite if they are known.
    confidence : float
        1 - alpha; the dissertation's Table 4.2 uses 0.99.

    Examples
    --------
    >>> from sldvexp.statistics import welch
    >>> test = welch(10.0, 0.1, 9, 10.5, 0.2, 4)
    >>> round(float(test.statistic), 3), round(float(test.dof), 2), bool(test.reject)
    (-2.236, 6.08, False)
    """
    variance1, variance2 = np.square(standard_error1), np.square(standard_error2)
    statistic = (np.asarray(mean1, float) - mean2) / np.sqrt(variance1 + variance2)
    c = variance1 / (variance1 + variance2)  # Eq 4.30
    with np.errstate(divide="ignore"):
        dof = 1 / (c**2 / np.asarray(dof1, float) + (1 - c) ** 2 / np.asarray(dof2, float))
    critical = student_factor(confidence, dof)
    return WelchTest(statistic, dof, critical, np.abs(statistic) > critical)
