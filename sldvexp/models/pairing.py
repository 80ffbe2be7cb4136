"""Which mode of a model is which measured one: by shape, each at most once."""

from __future__ import annotations

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.models.assurance import Assurance, assurance
from sldvexp.models.shape_agreement import StackedPixels
from sldvexp.typing import Array, IntArray


def assurance_matrix(pixels: StackedPixels) -> Assurance:
    """Compute MAC of all pairs, pixels weighted by their noise, shape (mode, model_mode).

    Examples
    --------
    >>> shape = np.eye(3)[:, :2]
    >>> exact = (np.zeros((3, 2, 1)), np.zeros((3, 2)), np.zeros((2, 2, 2)))
    >>> same = StackedPixels(shape + 0j, np.ones((3, 2)), shape, *exact)
    >>> assurance_matrix(same).value.tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """
    weight = 1.0 / pixels.std
    x = (weight * pixels.measured).T[:, None]
    y = weight.T[:, None] * pixels.shape.T[None]
    return assurance(x, y, 2.0)


def pair_modes(mac: Array, measured: Array, computed: Array, least: float) -> IntArray:
    """Pair measured modes with those of a model.

    Parameters
    ----------
    mac : ndarray, shape (mode, model_mode)
    measured, computed : ndarray, Hz
        Frequencies of both; among equal shapes the nearer frequency decides.
    least : float
        MAC below which there is no pair.

    Returns
    -------
    ndarray of int, shape (mode,)
        Modes of the model, from 0; -1 where there is no pair.

    Examples
    --------
    >>> mac = np.array([[0.9, 0.1], [0.2, 0.3]])
    >>> pair_modes(mac, np.array([100.0, 200.0]), np.array([110.0, 190.0]), 0.5).tolist()
    [0, -1]
    """
    apart = np.abs(np.log(measured[:, None] / computed))
    gain = mac - 0.1 * np.minimum(apart, 1.0)
    rows, columns = scipy.optimize.linear_sum_assignment(gain, maximize=True)
    found = np.full(len(measured), -1)
    good = mac[rows, columns] >= least
    found[rows[good]] = columns[good]
    return found
