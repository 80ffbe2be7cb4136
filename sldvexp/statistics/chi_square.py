"""Chi-square: do the residuals agree with the noise that was stated?"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.lazy import scipy
from sldvexp.typing import Array


def chi_square_p_value(chi_square: ArrayLike, dof: ArrayLike) -> Array:
    """Probability of a larger chi-square if the stated noise is right; NaN without freedom.

    Parameters
    ----------
    chi_square : array_like
        Sum of squared residuals, each over its standard deviation.
    dof : array_like, broadcastable to `chi_square`

    Returns
    -------
    ndarray
    """
    nu = np.asarray(dof, float)
    p_value = scipy.special.chdtrc(np.where(nu > 0, nu, 1.0), np.asarray(chi_square, float))
    return np.where(nu > 0, p_value, np.nan)
