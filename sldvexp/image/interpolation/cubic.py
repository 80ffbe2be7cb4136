"""Parabolic patches through each pixel and its neighbours, blended by the linear weights.

``v(x) = sum_i w_i(x) q_i(x)`` over the corners i of the cell, with linear weights w and patches q
of second order through each corner. In one dimension this is Overhauser's blend of two parabolas,
the Catmull-Rom cubic; on a lattice of even steps it is that of both directions.
"""

from __future__ import annotations

import numpy as np

from sldvexp.image.interpolation.base import Interpolator, PixelWeights
from sldvexp.image.interpolation.mesh import ImageMesh, Located
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray

#: How many places are weighted at once.
BLOCK = 65536


class CubicInterpolator(Interpolator):
    """Blended patches: exact for functions of second order.

    Parameters
    ----------
    mesh : ImageMesh
    """

    def __init__(self, mesh: ImageMesh) -> None:
        self.mesh = mesh
        self._frame = mesh.frames()
        # Rows: the value of every patch at its own pixel, then its coefficients term by term.
        self._patches = fit_patches(
            mesh.vertices,
            self._frame,
            *mesh.neighbours(),
            mesh.biquadratic,
            mesh.beyond_one_side(),
        )

    def at(self, dac: Array) -> PixelWeights:
        """Compute weights at places, shape (place, 2), steps."""
        blocks = [self._at(dac[k : k + BLOCK]) for k in range(0, max(len(dac), 1), BLOCK)]
        if len(blocks) == 1:
            return blocks[0]
        value, up_down, left_right = (
            scipy.sparse.vstack(each, format="csr")
            for each in zip(*((b.value, *b.gradient) for b in blocks), strict=True)
        )
        return PixelWeights(
            value,
            (up_down, left_right),
            np.concatenate([b.outside for b in blocks]),
            np.concatenate([b.flagged for b in blocks]),
        )

    def _at(self, dac: Array) -> PixelWeights:
        at = self.mesh.locate(dac)
        frame = self._frame[at.corner]
        away = dac[at.place][:, None] - self.mesh.vertices[at.corner]
        term, by_own = monomials(np.einsum("nkab,nkb->nka", frame, away))
        by_dac = np.einsum("nkmb,nkba->nkma", by_own, frame)
        value = at.weight[..., None] * term
        gradient = at.gradient[:, :, None] * term[..., None]
        gradient += at.weight[..., None, None] * by_dac
        up_down, left_right = (self._over_pixels(at, gradient[..., a]) for a in range(2))
        both = up_down, left_right
        return PixelWeights(self._over_pixels(at, value), both, at.outside, at.flagged)

    def _over_pixels(self, at: Located, weight: Array) -> scipy.sparse.csr_array:
        """Turn weights of the pixels from those (found, k, term) of the patches' coefficients."""
        vertices = len(self.mesh.vertices)
        column = at.corner[..., None] + vertices * np.arange(TERMS)
        flat = len(at.place), at.corner.shape[1] * TERMS
        of_patches = at.rows(column.reshape(flat), weight.reshape(flat), TERMS * vertices)
        return self.mesh.over_pixels(of_patches @ self._patches)


#: Powers of the two coordinates, the constant first: linear, quadratic, biquadratic.
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (2, 1), (1, 2), (2, 2))
TERMS = len(POWERS)
#: Those of third order or less, but for the third powers themselves.
CUBIC = POWERS[:8]


BIQUADRATIC, QUADRATIC, LINEAR = 9, 6, 3


#: Least reciprocal condition number of a fit's (equilibrated) normal matrix. Worse ones are fitted
#: with fewer terms: they would raise the pixels' noise more than a hundredfold.
DETERMINED = 1e-4
#: The same of a fit of third order, whose terms are more alike by nature.
ONE_SIDED = 1e-7
#: Coefficients below this are rounding errors of zero, in a frame where neighbours are at about 1.
NOTHING = 1e-14


def monomials(place: Array) -> tuple[Array, Array]:
    """Compute all terms and their derivatives.

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
    vertices: Array,
    frame: Array,
    first: IndexArray,
    second: IndexArray,
    biquadratic: bool,
    wider: tuple[IndexArray, IndexArray] | None = None,
) -> scipy.sparse.csr_array:
    """Fit the coefficients of every vertex' patch from the values of the vertices.

    Parameters
    ----------
    vertices : ndarray, shape (vertex, 2)
    frame : ndarray, shape (vertex, 2, 2)
        Takes distances from a vertex into its patch's own frame.
    first, second : ndarray of int, shape (pair,)
        Vertices and their neighbours, in ascending order of `first`.
    biquadratic : bool
        Whether to try all terms where the neighbours determine them.
    wider : pair of ndarray of int, shape (pair,), optional
        The same of vertices with neighbours on one side only, and of more around them.

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
        least = -np.inf if size == LINEAR else DETERMINED
        found, determined = _fit(first[pair], term[pair, 1:size], weight[pair], least)
        coefficient[pair[determined], 1:size] = found[determined]
        left[pair[determined]] = False
    if wider is not None and len(wider[0]):
        more = _fit_one_sided(vertices, frame, *wider)
        sided = np.isin(first, more[0])
        coefficient[sided] = 0.0
        first, second = np.append(first, more[0]), np.append(second, more[1])
        coefficient = np.concatenate([coefficient, more[2]])
    blocks = [scipy.sparse.eye_array(count, format="csr")]
    for m in range(1, TERMS):
        used = np.flatnonzero(np.abs(coefficient[:, m]) > NOTHING)
        values, i = coefficient[used, m], first[used]
        rows, columns = np.append(i, i), np.append(second[used], i)
        blocks.append(
            scipy.sparse.csr_array((np.append(values, -values), (rows, columns)), (count, count))
        )
    return scipy.sparse.vstack(blocks, format="csr")


def _fit_one_sided(
    vertices: Array, frame: Array, first: IndexArray, second: IndexArray
) -> tuple[IndexArray, IndexArray, Array]:
    """Fit patches that have neighbours on one side as if they had them on all.

    A parabola through pixels on one side misses the third power of their distance, all of it with
    the same sign; through pixels on both sides it misses what the next patch makes up for. Here
    the polynomial of third order through more pixels is taken at the places -1, 0, 1 of the
    missing neighbours: there ``x^3 = x``.

    Returns
    -------
    first, second : ndarray of int, shape (pair,)
        Those of vertices whose pixels determine it.
    coefficient : ndarray, shape (pair, TERMS)
    """
    away = np.einsum("pab,pb->pa", frame[first], vertices[second] - vertices[first])
    term, _ = monomials(away)
    every = np.concatenate([term[:, 1 : len(CUBIC)], away**3], axis=1)
    found, determined = _fit(first, every, np.square(away).sum(axis=1) ** -2.0, ONE_SIDED)
    coefficient = np.zeros((len(first), TERMS))
    coefficient[:, 1 : len(CUBIC)] = found[:, :-2]
    coefficient[:, 1:3] += found[:, -2:]
    kept = np.flatnonzero(determined)
    return first[kept], second[kept], coefficient[kept]


def _fit(first: IndexArray, term: Array, weight: Array, least: float) -> tuple[Array, BoolArray]:
    """Fit each pair's values: coefficients, shape (pair, term), and whether they are determined."""
    start = np.flatnonzero(np.diff(first, prepend=-1))
    patch = np.cumsum(np.diff(first, prepend=first[0]) > 0)
    weighted = weight[:, None] * term
    normal = np.add.reduceat(weighted[:, :, None] * term[:, None, :], start, axis=0)
    scale = np.sqrt(np.einsum("imm->im", normal))
    scale = np.where(scale > 0, scale, 1.0)
    value, vector = np.linalg.eigh(normal / (scale[:, :, None] * scale[:, None, :]))
    determined = value[:, 0] > least * value[:, -1]
    part = vector / scale[:, :, None]
    small = value <= np.finfo(float).eps * value[:, -1:]
    inverse = (part * np.where(small, 0.0, 1 / np.where(small, 1.0, value))[:, None, :]) @ (
        part.swapaxes(-1, -2)
    )
    return np.einsum("pml,pl->pm", inverse[patch], weighted), determined[patch]
