"""Half-width factors of two-sided confidence intervals (Eq 5.18)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.lazy import scipy
from sldvexp.typing import Array


def student_factor(confidence: float, dof: ArrayLike) -> Array:
    """Factor t of the interval ``estimate +- t standard_error``.

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
