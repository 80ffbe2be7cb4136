"""Least squares at a stack of points: matrices that depend on the geometry, not on frequency.

Rows ``A v = A X theta`` are whitened, if they are to be weighted, by a matrix T that spans them and
leaves independent noise; then ``theta = (T X)^+ T v`` and the residual is K v with K orthogonal to
the columns of T X. Differences that share a view are correlated, so that T is not diagonal. The
rank is that of W X, W an orthonormal basis of the rows, so that weights have no say in what is
determined. Full rank goes by Householder's reflections, all points at once, and the rest by
singular values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array, IntArray


@dataclass(frozen=True)
class PointFit:
    """Linear estimator ``theta = H v`` of the model ``A v = A X theta`` at each point.

    The noise of the views is ``sigma^2 diag(std^2)`` in each of real and imaginary part; sigma is
    1 where the std are known.

    Attributes
    ----------
    solution : ndarray, shape (point, parameter, view)
        The matrix H. Parameters are x, y, z and, in the full model, the intercept.
    residual : ndarray, shape (point, rows left, view)
        Matrix K with ``K X = 0`` on what the rows see: ``|K v|^2`` is the sum of squares that the
        method minimises.
    std : ndarray, shape (1 or point, view), optional
    redundancy : ndarray, shape (point,)
        Expectation of ``|K v|^2`` over sigma^2, for real data.
    dof : ndarray, shape (point,)
        Its degrees of freedom, for real data; Satterthwaite's where rows are correlated.
    rank : ndarray of int, shape (point,)
        How many parameters are determined.
    null : ndarray, shape (point, parameter, parameter), optional
        Rows that span the parameters' combinations which are not determined, filled with zeros.
    """

    solution: Array
    residual: Array
    std: Array | None
    redundancy: Array
    dof: Array
    rank: IntArray
    null: Array | None

    @property
    def cofactor(self) -> Array:
        """Covariance of the parameters over sigma^2, shape (point, parameter, parameter).

        ``H diag(std^2) H^T``, which holds for any weights (Eq 5.18 is its special case).
        """
        scaled = self._scaled(self.solution)
        return scaled @ np.swapaxes(scaled, -1, -2)

    @property
    def root(self) -> Array:
        """Standard error of each parameter over sigma, shape (point, parameter)."""
        scaled = self._scaled(self.solution)
        return np.sqrt(np.einsum("pij,pij->pi", scaled, scaled))

    def _scaled(self, matrix: Array) -> Array:
        return matrix if self.std is None else matrix * self.std[:, None, :]


def point_fit(
    directions: Array,
    rows: Array,
    *,
    std: Array | None,
    intercept: bool,
    generalised: bool,
    tolerance: float,
) -> PointFit:
    """Fit the rows' model at each point by ordinary or generalised least squares (Section 5.2.3).

    Parameters
    ----------
    directions : ndarray, shape (view, point, axis)
        Direction cosines.
    rows : ndarray, shape (row, view)
        The matrix A.
    std : ndarray, shape (1 or point, view), optional
        Standard deviation of each view's velocity, per real component.
    intercept : bool
        Full model (Eq 5.12) instead of the partial one (Eq 5.4).
    generalised : bool
        Weight the rows by the inverse of their covariance; otherwise all alike.
    tolerance : float
        Relative singular value of ``W X``, W an orthonormal basis of the rows, below which a
        direction counts as not determined. Weights have no say in this.
    """
    model = design(directions, intercept)
    basis = row_basis(rows)
    rank = rank_of(_times(basis, model), tolerance)
    transform = whitening(rows, std) if generalised else rows
    factor = factorise(_times(transform, model), rank)
    solution, residual = _times(factor.inverse, transform), _times(factor.residual, transform)
    if generalised:  # K v is white
        redundancy = dof = (len(basis) - rank).astype(float)
    else:
        redundancy, dof = _satterthwaite(residual if std is None else residual * std[:, None, :])
    return PointFit(solution, residual, std, redundancy, dof, rank, factor.null)


def _times(a: Array, b: Array) -> Array:
    """Multiply ``a b``, one a stack; the identity, which most methods use, costs nothing."""
    for matrix, other in ((a, b), (b, a)):
        if matrix.ndim == 2 and np.array_equal(matrix, np.eye(len(matrix))):
            return other
    return a @ b


def _satterthwaite(noise: Array) -> tuple[Array, Array]:
    """Average ``|noise e|^2``, e white of unit variance, with the dof of the nearest chi-square.

    With C = noise noise^T: ``tr C`` and ``(tr C)^2 / tr C^2``, exact if C's eigenvalues agree.
    """
    covariance = noise @ np.swapaxes(noise, -1, -2)
    mean = np.trace(covariance, axis1=-2, axis2=-1)
    squares = np.einsum("pij,pij->p", covariance, covariance)
    return mean, np.divide(mean**2, squares, out=np.zeros_like(mean), where=squares > 0)


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


def rank_of(matrices: Array, tolerance: float, combination: Array | None = None) -> IntArray:
    """Count singular values above `tolerance` times the largest.

    Parameters
    ----------
    matrices : ndarray, shape (point, row, parameter)
    combination : ndarray, shape (combined, row), optional
        What all of them are multiplied by first.

    Returns
    -------
    ndarray of int, shape (point,)
    """
    parameters = matrices.shape[-1]
    rows = matrices.shape[-2] if combination is None else len(combination)
    if rows >= parameters:
        # Of eigenvalues with sum tr, the smallest is at least det / (tr / (p - 1))**(p - 1).
        gram = _grams(matrices, combination)
        trace = np.trace(gram)
        smallest = _determinant(gram) * (parameters - 1) ** (parameters - 1)
        if np.all(smallest > max(tolerance**2, GRAM_LIMIT) * trace**parameters):
            return np.full(matrices.shape[:-2], parameters)
    combined = matrices if combination is None else combination @ matrices
    sigma = np.linalg.svd(combined, compute_uv=False)
    return np.sum(sigma > tolerance * sigma[..., :1], axis=-1)


#: Matrices whose products stay in the cache.
POINTS_AT_ONCE = 8192


def _grams(matrices: Array, combination: Array | None = None) -> Array:
    """Compute ``G^T G``, shape (parameter, parameter, ...); an entry runs over all matrices."""
    rows, parameters = matrices.shape[-2:]
    flat = matrices.reshape(-1, rows, parameters)
    found = np.empty((parameters, parameters, len(flat)))
    for first in range(0, len(flat), POINTS_AT_ONCE):
        some = slice(first, first + POINTS_AT_ONCE)
        g = np.ascontiguousarray(np.moveaxis(flat[some], 0, -1))
        if combination is not None:
            g = np.tensordot(combination, g, axes=1)
        for i, j in np.ndindex(parameters, parameters):
            if i <= j:
                found[i, j, some] = found[j, i, some] = np.einsum("rp,rp->p", g[:, i], g[:, j])
    return found.reshape(parameters, parameters, *matrices.shape[:-2])


def _determinant(matrices: Array) -> Array:
    """Compute determinants of matrices (parameter, parameter, ...), of 3 x 3 all at once."""
    if len(matrices) != 3:
        return np.asarray(np.linalg.det(np.moveaxis(matrices, (0, 1), (-2, -1))), float)
    a, b, c = matrices
    found = a[0] * (b[1] * c[2] - b[2] * c[1])
    found += a[1] * (b[2] * c[0] - b[0] * c[2])
    found += a[2] * (b[0] * c[1] - b[1] * c[0])
    return np.asarray(found)


def factorise(matrices: Array, rank: IntArray) -> Factor:
    """Compute pseudo-inverse and bases of the residual and null space of each matrix.

    Parameters
    ----------
    matrices : ndarray, shape (point, row, parameter)
    rank : ndarray of int, shape (point,)
        Singular values to keep.
    """
    if np.all(rank == matrices.shape[-1]):
        return _by_householder(matrices)
    return _by_singular_values(matrices, rank)


def _by_singular_values(matrices: Array, rank: IntArray) -> Factor:
    """Factorise ``G = U S V^T``: pseudo-inverse ``V S^+ U^T``, the rest of U^T, the rest of V^T."""
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
    """Factorise ``G = Q R``, all of Q, ``G^+ = R^-1 Q1^T``; a step runs over all points."""
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


def design(directions: Array, intercept: bool) -> Array:
    """Set up the matrix of the model ``v = D V`` (Eq 5.4) or ``v = D V + beta0`` (Eq 5.12).

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
    """Find orthonormal rows W that span the row matrix A, or A times the views' std.

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
    """Find the matrix T that spans the rows A and leaves independent noise of unit variance.

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
