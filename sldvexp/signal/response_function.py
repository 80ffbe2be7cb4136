r"""Response functions from sums over records, with their coherence and standard errors.

Of a linear structure ``y = H x``, with noise n on the reference and m on the response, as powers
Gnn and Gmm:

- ``H1 = Sxy / Sxx`` is the regression of y on x. ``E H1 = H / (1 + Gnn / Gxx)``.
- ``H2 = Syy / conj(Sxy)`` is that of x on y. ``E H2 = H (1 + Gmm / Gyy)``.
- ``Hv = (a + sqrt(a^2 + 4 r |Sxy|^2)) / (2 conj(Sxy))``, ``a = Syy - r Sxx``, is right with both,
  if their ratio ``r = Gmm / Gnn`` is. It is H2 for r = 0 and H1 for large r.

The coherence ``g^2 = |Sxy|^2 / (Sxx Syy)`` gives each part of H the variance
``|H|^2 (1 - g^2) / (2 (n - 1) g^2)`` of a regression on n records, whose residuals have
``2 (n - 1)`` degrees of freedom. Noise is assumed to be independent from record to record; energy
that leaks from line to line is bias, which no bound from scatter sees.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from sldvexp.errors import UserError
from sldvexp.signal.response_sums import ResponseSums
from sldvexp.typing import Array, ComplexArray, IntArray

#: Records that a standard error needs.
LEAST_RECORDS = 2


class Estimator(Enum):
    """Ways to make a response function of auto and cross spectra.

    Attributes
    ----------
    h1
        ``Sxy / Sxx``, by the reference's auto spectrum: right with noise in the response.
    h2
        ``Syy / conj(Sxy)``, by the response's: right with noise in the reference.
    hv
        Right with noise in both, in the ratio that is given.
    """

    h1 = "h1"
    h2 = "h2"
    hv = "hv"


@dataclass(frozen=True, repr=False)
class ResponseFunction:
    """Response of each pixel to the reference.

    Attributes
    ----------
    frequency : ndarray, shape (line,), Hz
    response : ndarray of complex, shape (pixel, line), (m/s)/V
        NaN without records.
    std : ndarray, shape (pixel, line), (m/s)/V
        Standard error, of real and imaginary part each; NaN with fewer than two records.
    coherence : ndarray, shape (pixel, line)
        ``g^2``; 1 with one record, whatever it is worth.
    records : ndarray of int, shape (pixel,)
        Behind each pixel.
    averages : ndarray, shape (pixel,)
        Independent records that these are worth, more than they are where stretches between them
        are used.
    """

    frequency: Array
    response: ComplexArray
    std: Array
    coherence: Array
    records: IntArray
    averages: Array

    def __repr__(self) -> str:
        pixels, lines = self.response.shape
        return f"response functions of {pixels} pixels at {lines} lines"

    @property
    def dof(self) -> Array:
        """Degrees of freedom of each pixel's standard error, shape (pixel,)."""
        return np.asarray(np.maximum(2 * (self.averages - 1), 0))


def response_function(
    sums: ResponseSums, estimator: Estimator = Estimator.h1, noise_ratio: float = 1.0
) -> ResponseFunction:
    """Make response functions of sums over records.

    Parameters
    ----------
    noise_ratio : float, ((m/s)/V)2
        Of `Estimator.hv`: noise power of the response over that of the reference.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.signal import ResponseSums, response_function
    >>> rng = np.random.default_rng(1)
    >>> x, noise = rng.standard_normal((2, 1, 50, 1, 2)) @ [1, 1j]
    >>> sums = ResponseSums.zeros(1, [50.0])
    >>> sums.add(x, 3j * x + 0.1 * noise)
    >>> h = response_function(sums)
    >>> bool(abs(h.response - 3j)[0, 0] < 4 * h.std[0, 0]), bool(h.coherence[0, 0] > 0.99)
    (True, True)
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        cross = sums.sxy.real**2 + sums.sxy.imag**2
        coherence = np.minimum(cross / (sums.sxx * sums.syy), 1.0)
        response = estimate(sums.sxx, sums.syy, sums.sxy, estimator, noise_ratio)
        more = (sums.averages - 1.0)[:, None]
        lost = np.maximum(1 - coherence, np.finfo(float).eps)  # rounding is no error of zero
        std = np.abs(response) * np.sqrt(lost / (2 * more * coherence))
        if estimator is Estimator.h1:  # also where nothing moves and |H| / g is 0 / 0
            rest = np.maximum(sums.syy - cross / sums.sxx, np.finfo(float).eps * sums.syy)
            std = np.sqrt(rest / (2 * more * sums.sxx))
    std[sums.count < LEAST_RECORDS] = np.nan
    found = sums.count.copy(), sums.averages
    return ResponseFunction(sums.frequency, response, std, coherence, *found)


def estimate(
    sxx: Array, syy: Array, sxy: ComplexArray, estimator: Estimator, noise_ratio: float = 1.0
) -> ComplexArray:
    """Compute H1, H2 or Hv of auto and cross spectra, which may be sums, means or densities."""
    if estimator is Estimator.h1:
        return np.asarray(sxy / sxx, complex)
    if estimator is Estimator.h2:
        return np.asarray(syy / np.conj(sxy), complex)
    if not (np.isfinite(noise_ratio) and noise_ratio > 0):
        raise UserError(f"signal: the noise ratio must be a positive number, not {noise_ratio}")
    a = syy - noise_ratio * sxx
    root = np.sqrt(a**2 + 4 * noise_ratio * (sxy.real**2 + sxy.imag**2))
    # Of two forms of one number, the one in which nothing cancels.
    above = (a + root) / (2 * np.conj(sxy))
    below = 2 * noise_ratio * sxy / (root - a)
    return np.asarray(np.where(a > 0, above, below), complex)
