"""Least squares at a stack of points: matrices that depend on the geometry, not on frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.reconstruction.factor import factorise, rank_of
from sldvexp.reconstruction.model import design, row_basis, whitening
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

    Returns
    -------
    PointFit
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
    """``a b``, one of them a stack; the identity, which most methods use, costs nothing."""
    for matrix, other in ((a, b), (b, a)):
        if matrix.ndim == 2 and np.array_equal(matrix, np.eye(len(matrix))):
            return other
    return a @ b


def _satterthwaite(noise: Array) -> tuple[Array, Array]:
    """Mean of ``|noise e|^2``, e white of unit variance, and the dof of the nearest chi-square.

    With C = noise noise^T: ``tr C`` and ``(tr C)^2 / tr C^2``, exact if C's eigenvalues agree.
    """
    covariance = noise @ np.swapaxes(noise, -1, -2)
    mean = np.trace(covariance, axis1=-2, axis2=-1)
    squares = np.einsum("pij,pij->p", covariance, covariance)
    return mean, np.divide(mean**2, squares, out=np.zeros_like(mean), where=squares > 0)
