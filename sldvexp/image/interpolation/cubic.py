"""Parabolic patches through each pixel and its neighbours, blended by the linear weights.

``v(x) = sum_i w_i(x) q_i(x)`` over the corners i of the cell, with linear weights w and patches q
of second order through each corner. In one dimension this is Overhauser's blend of two parabolas,
the Catmull-Rom cubic; on a lattice of even steps it is that of both directions.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sldvexp.image.interpolation.base import Interpolator, Located, PixelWeights, rows_of
from sldvexp.image.interpolation.mesh import ImageMesh
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray

#: How many places are weighted at once, and how many slopes are computed.
BLOCK, SLOPES_AT_ONCE = 4096, 1024


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
        at = self.mesh.locate(dac)
        found = dac[at.place]
        parts = [self._rows(at, found, here) for here in _blocks(len(found), BLOCK)]
        rows = parts[0] if len(parts) == 1 else scipy.sparse.vstack(parts, format="csr")
        return PixelWeights(at.spread(rows), at)

    def slopes(self, at: Located, dac: Array, values: Array) -> Array:
        """Differentiate by both steps, shape (2, found, column)."""
        count, columns = len(self.mesh.vertices), values.shape[1]
        coefficient = self._patches @ self.mesh.of_vertices(values)
        by_term = np.asarray(coefficient).reshape(TERMS, count, columns)
        found = np.empty((2, len(dac), columns))
        for here in _blocks(len(dac), SLOPES_AT_ONCE):
            corner, weight = at.corner[here], at.weight[here, :, None]
            gradient = self.mesh.gradients(corner, dac[here])
            frame = self._frame.take(corner, axis=0)[..., None]
            patch, by_x, by_y = patches(by_term.take(corner, axis=1), self._placed(at, dac, here))
            for a in range(2):
                by_dac = by_x * frame[:, :, 0, a]
                by_dac += by_y * frame[:, :, 1, a]
                by_dac *= weight
                by_dac += gradient[:, :, a, None] * patch
                by_dac.sum(axis=1, out=found[a, here])
        return found

    def _rows(self, at: Located, dac: Array, here: slice) -> scipy.sparse.csr_array:
        """Compute weights of the pixels at some found places, a row each."""
        corner, vertices = at.corner[here], len(self.mesh.vertices)
        weight = terms(self._placed(at, dac, here), at.weight[here])
        column = corner[:, None] + vertices * np.arange(TERMS, dtype=np.int32)[:, None]
        flat = len(corner), TERMS * corner.shape[1]
        of_patches = rows_of(column.reshape(flat), weight.reshape(flat), TERMS * vertices)
        return self.mesh.over_pixels(of_patches @ self._patches)

    def _placed(self, at: Located, dac: Array, here: slice) -> Array:
        """Give some found places in the frames of their corners' patches, (place, k, 2)."""
        corner = at.corner[here]
        away = dac[here][:, None] - self.mesh.vertices.take(corner, axis=0)
        return np.einsum("nkab,nkb->nka", self._frame.take(corner, axis=0), away)


def _blocks(count: int, most: int) -> Iterator[slice]:
    """Go through so many places, some at a time."""
    for first in range(0, max(count, 1), most):
        yield slice(first, first + most)


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


def terms(place: Array, weight: Array | float = 1.0) -> Array:
    """Compute all terms of patches, weighted, shape (n, TERMS, ...).

    Parameters
    ----------
    place : ndarray, shape (n, ..., 2)
        In the patches' own frames.
    weight : ndarray, shape (n, ...), optional
    """
    x, y = place[..., 0].copy(), place[..., 1].copy()
    found = np.empty((len(x), TERMS, *x.shape[1:]))
    of = {powers: found[:, m] for m, powers in enumerate(POWERS)}
    of[0, 0][...] = weight
    for (i, j), term in of.items():  # each is one of those before it times a coordinate
        if i:
            np.multiply(of[i - 1, j], x, out=term)
        elif j:
            np.multiply(of[i, j - 1], y, out=term)
    return found


def patches(coefficient: Array, place: Array) -> tuple[Array, Array, Array]:
    """Evaluate patches and differentiate them by the coordinates of their own frames.

    In nested form, ``a_0 + x (a_1 + x a_2)`` with ``a_i = c_i0 + y (c_i1 + y c_i2)``: a third of
    the operations that terms take which are computed first.

    Parameters
    ----------
    coefficient : ndarray, shape (TERMS, ..., column)
    place : ndarray, shape (..., 2)

    Returns
    -------
    value, by_x, by_y : ndarray, shape (..., column)
    """
    x, y = place[..., 0, None], place[..., 1, None]
    of, along = dict(zip(POWERS, coefficient, strict=True)), []
    for i in range(3):
        last = y * of[i, 2]
        slope = of[i, 1] + last
        value = y * slope
        value += of[i, 0]
        slope += last
        along.append((value, slope))
    (a, a_y), (b, b_y), (c, c_y) = along
    last = x * c
    by_x = b + last
    value = x * by_x
    value += a
    by_x += last
    c_y *= x
    c_y += b_y
    c_y *= x
    c_y += a_y
    return value, by_x, c_y


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
    term = terms(away)
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
        # Of the kind of all weights' indices, or those of every sample would be twice as wide.
        rows, columns = (np.append(a, i).astype(np.int32) for a in (i, second[used]))
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
    term = terms(away)
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
