"""The model of the views and how its rows are weighted."""

from __future__ import annotations

import numpy as np

from sldvexp.typing import Array


def design(directions: Array, intercept: bool) -> Array:
    """Matrix of the model ``v = D V`` (Eq 5.4) or ``v = D V + beta0`` (Eq 5.12).

    Parameters
    ----------
    directions : ndarray, shape (view, point, axis)
        Direction cosines.
    intercept : bool
        Whether to add the column of ones; it comes last here.

    Returns
    -------
    ndarray, shape (point, view, parameter)
    """
    matrix = np.swapaxes(np.asarray(directions, float), 0, 1)
    if not intercept:
        return matrix
    return np.concatenate([matrix, np.ones((*matrix.shape[:-1], 1))], axis=-1)


def row_basis(rows: Array, std: Array | None = None) -> Array:
    """Orthonormal rows W that span the row matrix A, or A times the views' std.

    Parameters
    ----------
    rows : ndarray, shape (row, view)
    std : ndarray, shape (1 or point, view), optional

    Returns
    -------
    ndarray, shape (rank, view) or (1 or point, rank, view)
        A itself if its rows are different views: they stay orthogonal whatever the std.
    """
    if np.array_equal(rows @ rows.T, np.eye(len(rows))):
        return rows
    scaled = rows if std is None else rows * std[:, None, :]
    _, _, basis = np.linalg.svd(scaled, full_matrices=False)
    return basis[..., : np.linalg.matrix_rank(rows), :]


def whitening(rows: Array, std: Array | None = None) -> Array:
    """Matrix T that spans the rows A and leaves independent noise of unit variance.

    ``T = W S^-1`` with ``S = diag(std)`` and W an orthonormal basis of the rows of ``A S``. Least
    squares of ``T v = T X theta`` is generalised least squares of ``A v = A X theta`` with the
    covariance ``A S^2 A^T``, which differences that share a view do have, also where rows depend
    on one another and that covariance has no inverse.

    Parameters
    ----------
    rows : ndarray, shape (row, view)
    std : ndarray, shape (1 or point, view), optional
        Standard deviation of each view; without it one common, unknown std is the unit.

    Returns
    -------
    ndarray, shape (rank, view) or (1 or point, rank, view)
    """
    basis = row_basis(rows, std)
    return basis if std is None else basis / std[:, None, :]
