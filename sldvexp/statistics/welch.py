"""Welch's test: are two estimates with different uncertainties the same (Eqs 4.25 to 4.30)?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.statistics.student import student_factor
from sldvexp.typing import Array, BoolArray


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

    Returns
    -------
    WelchTest
    """
    variance1, variance2 = np.square(standard_error1), np.square(standard_error2)
    statistic = (np.asarray(mean1, float) - mean2) / np.sqrt(variance1 + variance2)
    c = variance1 / (variance1 + variance2)  # Eq 4.30
    with np.errstate(divide="ignore"):
        dof = 1 / (c**2 / np.asarray(dof1, float) + (1 - c) ** 2 / np.asarray(dof2, float))
    critical = student_factor(confidence, dof)
    return WelchTest(statistic, dof, critical, np.abs(statistic) > critical)
