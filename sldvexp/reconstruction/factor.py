"""Stacks of small least-squares matrices: rank, pseudo-inverse, residual and null space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array, IntArray

#: Squared ratio of singular values below which a Gram determinant, rounded, proves nothing.
GRAM_LIMIT = 1e-12


@dataclass(frozen=True)
class Factor:
    """Bases that belong to each matrix G of a stack.

    Attributes
    ----------
    inverse : ndarray, shape (point, parameter, row)
        Moore-Penrose inverse, of the rank that was asked for.
    residual : ndarray, shape (point, rows left, row)
        Orthonormal rows that G's columns have no part in; rows of zeros where a matrix has a
        higher rank than another one.
    null : ndarray, shape (point, parameter, parameter), optional
        Orthonormal rows that span what G does not determine, filled with zeros; None if every
        matrix has full column rank.
    """

    inverse: Array
    residual: Array
    null: Array | None


def rank_of(matrices: Array, tolerance: float) -> IntArray:
    """Number of singular values above `tolerance` times the largest.

    Parameters
    ----------
    matrices : ndarray, shape (point, row, parameter)
    tolerance : float

    Returns
    -------
    ndarray of int, shape (point,)
    """
    rows, parameters = matrices.shape[-2:]
    if rows >= parameters:
        # Of eigenvalues with sum tr, the smallest is at least det / (tr / (p - 1))**(p - 1).
        gram = np.swapaxes(matrices, -1, -2) @ matrices
        trace = np.trace(gram, axis1=-2, axis2=-1)
        smallest = np.linalg.det(gram) * (parameters - 1) ** (parameters - 1)
        if np.all(smallest > max(tolerance**2, GRAM_LIMIT) * trace**parameters):
            return np.full(matrices.shape[:-2], parameters)
    sigma = np.linalg.svd(matrices, compute_uv=False)
    return np.sum(sigma > tolerance * sigma[..., :1], axis=-1)


def factorise(matrices: Array, rank: IntArray) -> Factor:
    """Pseudo-inverse and bases of the residual and the null space of each matrix.

    Parameters
    ----------
    matrices : ndarray, shape (point, row, parameter)
    rank : ndarray of int, shape (point,)
        Singular values to keep.

    Returns
    -------
    Factor
    """
    if np.all(rank == matrices.shape[-1]):
        return _by_householder(matrices)
    return _by_singular_values(matrices, rank)


def _by_singular_values(matrices: Array, rank: IntArray) -> Factor:
    """``G = U S V^T``: the pseudo-inverse ``V S^+ U^T``, the rest of U^T, the rest of V^T."""
    rows, parameters = matrices.shape[-2:]
    u, sigma, vt = np.linalg.svd(matrices)
    ut = np.swapaxes(u, -1, -2)
    k = sigma.shape[-1]
    kept = np.arange(k) < rank[:, None]
    reciprocal = np.where(kept, 1 / np.where(kept, sigma, 1.0), 0.0)
    inverse = np.swapaxes(vt[:, :k] * reciprocal[..., None], -1, -2) @ ut[:, :k]
    lowest = int(rank.min())
    left_over = np.arange(lowest, rows) >= rank[:, None]
    residual = ut[:, lowest:] * left_over[..., None]
    null = vt * (np.arange(parameters) >= rank[:, None])[..., None]
    return Factor(inverse, residual, null)


def _by_householder(matrices: Array) -> Factor:
    """``G = Q R`` with all of Q, ``G^+ = R^-1 Q1^T``; each step runs over all points at once."""
    r = np.moveaxis(matrices, 0, -1).copy()  # (row, parameter, point)
    rows, parameters, points = r.shape
    qt = np.zeros((rows, rows, points))
    qt[np.arange(rows), np.arange(rows)] = 1.0
    for k in range(min(parameters, rows - 1)):
        mirror = r[k:, k].copy()
        mirror[0] += np.copysign(np.sqrt(np.sum(mirror**2, axis=0)), mirror[0])
        scaled = 2 / np.sum(mirror**2, axis=0) * mirror
        for block in (r[k:, k:], qt[k:]):
            block -= scaled[:, None] * np.sum(mirror[:, None] * block, axis=0)
    inverse = qt[:parameters].copy()
    for i in reversed(range(parameters)):
        inverse[i] -= np.sum(r[i, i + 1 :, None] * inverse[i + 1 :], axis=0)
        inverse[i] /= r[i, i]
    return Factor(np.moveaxis(inverse, -1, 0), np.moveaxis(qt[parameters:], -1, 0), None)
