"""The conventions that explain numbers printed in Section 5.2; none is used for a result."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.typing import Array


def sample_std(residuals: ArrayLike) -> float:
    """The std of Tables 5.5 and 5.6: mean removed, divisor n - 1, modulus of complex residuals."""
    return float(np.std(np.asarray(residuals), ddof=1))


def printed_f(sse_partial: float, sse_full: float, std_full: float) -> float:
    """F of Eq 5.17: the drop of the sum of squares over the full model's squared `sample_std`.

    That counts the intercept once and leaves n - 1 degrees of freedom; a complex intercept has two
    and leaves 2 (n - 4). The print follows from the numbers as tabulated, to four decimals.
    """
    return (sse_partial - sse_full) / std_full**2


def printed_half_width(s: float, v_ii: ArrayLike) -> Array:
    """Half-widths of Section 5.2.6 as printed: 1.96 s v_ii, without the square root of Eq 5.18.

    Parameters
    ----------
    s : float
        Sample standard deviation of the residuals.
    v_ii : array_like
        Diagonal of the inverse of ``D^T D``.
    """
    return 1.96 * s * np.asarray(v_ii, float)
