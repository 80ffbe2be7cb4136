"""LINPACK's estimate of the reciprocal condition number, only to explain printed numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.lazy import scipy


def linpack_rcond(matrix: ArrayLike) -> float:
    """Reciprocal condition number as `dgeco` estimated it, hence MATLAB 5's ``rcond``.

    With ``A = P L U`` it solves ``A^T y = e`` and ``A z = y``, choosing the signs of ``e = +-1``
    one by one so that y grows, and returns ``|y| / (|A| |z|)`` in the 1-norm. ``|z| / |y|`` is a
    lower bound of the inverse's norm: the estimate is never below the true value.

    Parameters
    ----------
    matrix : array_like, shape (n, n)

    Returns
    -------
    float
        0 for a singular matrix.
    """
    a = np.asarray(matrix, float)
    permutation, lower, upper = scipy.linalg.lu(a)
    if not np.all(np.diag(upper)):
        return 0.0
    w = _growing_solution(upper)
    y = permutation @ scipy.linalg.solve_triangular(lower.T, w, unit_diagonal=True)
    z = scipy.linalg.solve_triangular(lower, permutation.T @ y, lower=True, unit_diagonal=True)
    z = scipy.linalg.solve_triangular(upper, z)
    return float(np.abs(y).sum() / (np.abs(a).sum(axis=0).max() * np.abs(z).sum()))


def _growing_solution(upper: np.ndarray) -> np.ndarray:
    """Solution of ``U^T w = e`` with each sign of e taken so that what follows is larger."""
    n = len(upper)
    w = np.zeros(n)
    done = np.zeros(n)  # what the w found so far contribute to each equation
    for k in range(n):
        sign = -1.0 if done[k] > 0 else 1.0
        trials = []
        for e in (sign, -sign):
            w_k = (e - done[k]) / upper[k, k]
            following = done[k + 1 :] + w_k * upper[k, k + 1 :]
            trials.append((abs(e - done[k]) + np.abs(following).sum(), w_k, following))
        _, w[k], done[k + 1 :] = max(trials, key=lambda trial: trial[0])
    return w
