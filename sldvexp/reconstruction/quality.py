"""How well conditioned a method is: true numbers, not estimates."""

from __future__ import annotations

import numpy as np

from sldvexp.reconstruction.model import design
from sldvexp.typing import Array


def solved_matrix(directions: Array, rows: Array, intercept: bool) -> Array:
    """The matrix whose conditioning Tables 5.2 to 5.6 state, at each point.

    ``A X`` if the rows are as many as the unknowns, otherwise ``(A X)^T (A X)``, the matrix of
    the normal equations. X has the intercept's column in the full model.

    Parameters
    ----------
    directions : ndarray, shape (view, point, axis)
    rows : ndarray, shape (row, view)
    intercept : bool

    Returns
    -------
    ndarray, shape (point, parameter, parameter)
    """
    matrix = rows @ design(directions, intercept)
    square = matrix.shape[-2] == matrix.shape[-1]
    return matrix if square else np.swapaxes(matrix, -1, -2) @ matrix


def reciprocal_condition(matrix: Array) -> Array:
    """``1 / (|M| |M^-1|)`` in the 1-norm, exactly; 1 is ideal, 0 singular.

    Parameters
    ----------
    matrix : ndarray, shape (..., n, n)

    Returns
    -------
    ndarray, shape (...)
    """
    return 1 / np.linalg.cond(matrix, 1)


def hadamard_condition(matrix: Array) -> Array:
    """Hadamard condition number ``|det M| / product of the rows' Euclidean lengths``.

    It is 1 for orthogonal rows and 0 for dependent ones, by Hadamard's inequality. Kreis, cited in
    Section 5.2.1, asks for more than 0.1.

    Parameters
    ----------
    matrix : ndarray, shape (..., n, n)

    Returns
    -------
    ndarray, shape (...)
    """
    length = np.prod(np.linalg.norm(matrix, axis=-1), axis=-1)
    return np.abs(np.linalg.det(matrix)) / np.where(length > 0, length, 1.0)


def contravariant_basis(rows: Array) -> Array:
    """Base vectors g^j with ``g_i . g^j = delta_ij`` (Eqs 5.13 and 5.16).

    ``g^1 = g_2 x g_3 / (g_1 . (g_2 x g_3))`` and in turn: the rows of the inverse transposed.

    Parameters
    ----------
    rows : ndarray, shape (..., 3, axis)
        The base vectors g_i: direction cosines, or differences of them.

    Returns
    -------
    ndarray, shape (..., 3, axis)
        NaN where the three rows are coplanar: they have no such basis.
    """
    g1, g2, g3 = np.moveaxis(rows, -2, 0)
    crossed = np.stack([np.cross(g2, g3), np.cross(g3, g1), np.cross(g1, g2)], axis=-2)
    volume = np.einsum("...i,...i->...", g1, crossed[..., 0, :])[..., None, None]
    return crossed / np.where(volume == 0, np.nan, volume)
