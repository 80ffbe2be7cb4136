"""Polynomial patches through each vertex that fit its neighbours by weighted least squares.

A patch passes through its own vertex, so that its coefficients c minimise
``sum_j (v_j - v_i - sum_m c_m p_m(x_j - x_i))^2 / |x_j - x_i|^2`` over the neighbours j. They are
linear in the values: a sparse matrix gives them.
"""

from __future__ import annotations

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray

#: Powers of the two coordinates, the constant first: linear, quadratic, biquadratic.
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (2, 1), (1, 2), (2, 2))
TERMS = len(POWERS)
BIQUADRATIC, QUADRATIC, LINEAR = 9, 6, 3
#: Least reciprocal condition number of a fit's (equilibrated) normal matrix. Worse ones are fitted
#: with fewer terms: they would raise the pixels' noise more than a hundredfold.
DETERMINED = 1e-4
#: Coefficients below this are rounding errors of zero, in a frame where neighbours are at about 1.
NOTHING = 1e-14


def monomials(place: Array) -> tuple[Array, Array]:
    """All terms and their derivatives.

    Parameters
    ----------
    place : ndarray, shape (..., 2)
        In the patch's own frame.

    Returns
    -------
    term : ndarray, shape (..., TERMS)
    derivative : ndarray, shape (..., TERMS, 2)
    """
    x, y = np.moveaxis(place, -1, 0)
    one, zero = np.ones_like(x), np.zeros_like(x)
    power_x, power_y = (one, x, x * x), (one, y, y * y)
    slope_x, slope_y = (zero, one, 2 * x), (zero, one, 2 * y)
    term = np.stack([power_x[i] * power_y[j] for i, j in POWERS], axis=-1)
    by_x = np.stack([slope_x[i] * power_y[j] for i, j in POWERS], axis=-1)
    by_y = np.stack([power_x[i] * slope_y[j] for i, j in POWERS], axis=-1)
    return term, np.stack([by_x, by_y], axis=-1)


def fit_patches(
    vertices: Array, frame: Array, first: IndexArray, second: IndexArray, biquadratic: bool
) -> scipy.sparse.csr_array:
    """The coefficients of every vertex' patch from the values of the vertices.

    Parameters
    ----------
    vertices : ndarray, shape (vertex, 2)
    frame : ndarray, shape (vertex, 2, 2)
        Takes distances from a vertex into its patch's own frame.
    first, second : ndarray of int, shape (pair,)
        Vertices and their neighbours, in ascending order of `first`.
    biquadratic : bool
        Whether to try all terms where the neighbours determine them.

    Returns
    -------
    csr_array, shape (TERMS * vertex, vertex)
        Row ``m * vertices + i`` has the coefficient of term m of the patch of vertex i.
    """
    count = len(vertices)
    away = np.einsum("pab,pb->pa", frame[first], vertices[second] - vertices[first])
    term, _ = monomials(away)
    weight = 1.0 / np.square(away).sum(axis=1)
    coefficient = np.zeros((len(first), TERMS))
    left = np.ones(len(first), bool)
    for size in (BIQUADRATIC, QUADRATIC, LINEAR) if biquadratic else (QUADRATIC, LINEAR):
        pair = np.flatnonzero(left)
        if not len(pair):
            break
        found, determined = _fit(first[pair], term[pair, 1:size], weight[pair], size == LINEAR)
        coefficient[pair[determined], 1:size] = found[determined]
        left[pair[determined]] = False
    blocks = [scipy.sparse.eye_array(count, format="csr")]
    for m in range(1, TERMS):
        used = np.flatnonzero(np.abs(coefficient[:, m]) > NOTHING)
        values, i = coefficient[used, m], first[used]
        rows, columns = np.append(i, i), np.append(second[used], i)
        blocks.append(
            scipy.sparse.csr_array((np.append(values, -values), (rows, columns)), (count, count))
        )
    return scipy.sparse.vstack(blocks, format="csr")


def _fit(first: IndexArray, term: Array, weight: Array, last: bool) -> tuple[Array, BoolArray]:
    """Coefficients by each pair's value, shape (pair, term), and whether they are determined."""
    start = np.flatnonzero(np.diff(first, prepend=-1))
    patch = np.cumsum(np.diff(first, prepend=first[0]) > 0)
    weighted = weight[:, None] * term
    normal = np.add.reduceat(weighted[:, :, None] * term[:, None, :], start, axis=0)
    scale = np.sqrt(np.einsum("imm->im", normal))
    scale = np.where(scale > 0, scale, 1.0)
    value, vector = np.linalg.eigh(normal / (scale[:, :, None] * scale[:, None, :]))
    determined = last | (value[:, 0] > DETERMINED * value[:, -1])
    part = vector / scale[:, :, None]
    small = value <= np.finfo(float).eps * value[:, -1:]
    inverse = (part * np.where(small, 0.0, 1 / np.where(small, 1.0, value))[:, None, :]) @ (
        part.swapaxes(-1, -2)
    )
    return np.einsum("pml,pl->pm", inverse[patch], weighted), determined[patch]
