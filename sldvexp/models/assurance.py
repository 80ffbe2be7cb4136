"""Assurance criteria of two complex vectors, and what noise alone makes of them.

    A = |x' y|^2 / (x'x y'y)

is MAC over places for a pair of modes, CoMAC over modes at a place, FRAC over frequencies at a
place, CSAC over places at a frequency. If y is right and x = c y + e with independent noise of
variance v (real and imaginary part together) in each entry, then 1 - A = |M e|^2 / |x|^2 to first
order, M the projection across y. With u = y / |y|

    E |M e|^2 = sum v (1 - |u|^2),   Var |M e|^2 = sum v^2 (1 - 2 |u|^2) + (sum v |u|^2)^2.

So 0.9999 can be read: a criterion near its expected value says nothing against the model.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.typing import Array


class Assurance(NamedTuple):
    """Assurance criterion, and its distribution if the model is right.

    Attributes
    ----------
    value, expected, std : ndarray
    """

    value: Array
    expected: Array
    std: Array


def assurance(measured: ArrayLike, predicted: ArrayLike, variance: ArrayLike) -> Assurance:
    """Compute an assurance criterion over the last axis.

    Parameters
    ----------
    measured, predicted : array_like of complex, shape (..., entry)
    variance : array_like, broadcastable to (..., entry)
        Of the noise of the measured entries, of real and imaginary part together.

    Examples
    --------
    >>> found = assurance([1.0, 2.0, 2.0], [1.0, 2.0, 2.1], 0.0)
    >>> round(float(found.value), 5), float(found.expected)
    (0.99941, 1.0)
    >>> noisy = assurance(np.ones(100), np.ones(100), 0.02)
    >>> round(float(noisy.expected), 4), round(float(noisy.std), 4)
    (0.9802, 0.002)
    """
    x, y = np.broadcast_arrays(np.asarray(measured), np.asarray(predicted))
    v = np.broadcast_to(np.asarray(variance, float), x.shape)
    size, other = (np.sum(np.abs(one) ** 2, axis=-1) for one in (x, y))
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.abs(np.sum(np.conj(x) * y, axis=-1)) ** 2 / (size * other)
        u = np.abs(y) ** 2 / other[..., None]
        mean = np.sum(v * (1 - u), axis=-1)
        spread = np.sum(v**2 * (1 - 2 * u), axis=-1) + np.sum(v * u, axis=-1) ** 2
        return Assurance(value, 1 - mean / size, np.sqrt(np.maximum(spread, 0.0)) / size)
