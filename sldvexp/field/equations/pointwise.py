"""The rows' least squares at every sample: what a method makes of the views that see it.

All methods model ``A v = A X theta`` with the rows A and ``X = [D]`` or ``[D 1]``. With the weights
W of the rows, and ``Q = A^T W A`` of the views, the normal equations at a sample are
``N theta = T v``, ``N = X^T Q X`` and ``T = X^T Q``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.reconstruction.factor import rank_of
from sldvexp.typing import Array, BoolArray

#: Fewest rows that make a sample worth keeping.
FEWEST_ROWS = 2


@dataclass(frozen=True, eq=False)
class Pointwise:
    """The model at samples.

    Attributes
    ----------
    design : ndarray, shape (sample, view, parameter)
        The matrix X; rows of views that do not see the sample are zero.
    weight : ndarray, shape (sample, view, view)
        The matrix Q; zero where a sample is not kept.
    rank : ndarray of int, shape (sample,)
        How many parameters the rows determine at the sample alone.
    rows : ndarray of int, shape (sample,)
        How many rows there are; 0 where a sample is not kept.
    """

    design: Array
    weight: Array
    rank: NDArray[np.int_]
    rows: NDArray[np.int_]

    @property
    def kept(self) -> BoolArray:
        """Which samples have a part in the field, shape (sample,)."""
        return self.rows > 0

    @property
    def information(self) -> Array:
        """The matrix N, shape (sample, parameter, parameter)."""
        return self.estimator @ self.design

    @property
    def estimator(self) -> Array:
        """The matrix T, shape (sample, parameter, view)."""
        return np.swapaxes(self.design, 1, 2) @ self.weight


@dataclass(frozen=True, eq=False)
class RowModel:
    """Rows, and how they are weighted.

    Parameters
    ----------
    rows : ndarray, shape (row, view)
        The matrix A.
    intercept : bool
    generalised : bool
        Weighted by the inverse of the rows' covariance; otherwise all alike.
    tolerance : float
        Relative singular value below which a direction counts as not determined.
    complete : bool
        Keep only samples whose rows determine all parameters.
    """

    rows: Array
    intercept: bool
    generalised: bool
    tolerance: float
    complete: bool

    @property
    def parameters(self) -> int:
        """Unknowns at a point."""
        return 4 if self.intercept else 3

    def at(self, directions: Array, valid: BoolArray, std: Array) -> Pointwise:
        """Set up the rows' least squares at samples.

        A row that needs a view which does not see the sample drops out. Weighted by their
        covariance, rows are as good as any others that span the same: then those combinations of
        them are left that need no such view.

        Parameters
        ----------
        directions : ndarray, shape (sample, view, 3)
            Direction cosines, in the axes of the velocity's components.
        valid : ndarray of bool, shape (sample, view)
        std : ndarray, shape (sample, view)
            Of the views' velocities; only their ratios matter, and only if `generalised`.
        """
        design = directions * valid[..., None]
        if self.intercept:
            design = np.concatenate([design, valid[..., None].astype(float)], axis=-1)
        samples, views = valid.shape
        weight = np.zeros((samples, views, views))
        rank, rows = np.zeros(samples, int), np.zeros(samples, int)
        code = valid @ (1 << np.arange(views))
        for pattern in np.unique(code):
            here = np.flatnonzero(code == pattern)
            left = self._rows_of(valid[here[0]])
            if len(left) < FEWEST_ROWS:
                continue
            basis = np.linalg.svd(left, full_matrices=False)[2][: np.linalg.matrix_rank(left)]
            rank[here] = rank_of(basis @ design[here], self.tolerance)
            rows[here] = len(left)
            weight[here] = self._weights(basis, left, valid[here], std[here])
        if self.complete:
            rows[rank < self.parameters] = 0
        weight[rows == 0] = 0
        return Pointwise(design, weight, rank, rows)

    def _rows_of(self, seen: BoolArray) -> Array:
        """Rows that need none of the views that do not see a sample."""
        if not self.generalised:
            return self.rows[~np.any(self.rows[:, ~seen] != 0, axis=1)]
        if seen.all():
            return self.rows
        u, sigma, _ = np.linalg.svd(self.rows[:, ~seen])
        used = int(np.sum(sigma > 1e-9))
        left = u[:, used:].T @ self.rows
        left[:, ~seen] = 0
        return left[np.abs(left).max(axis=1) > 1e-9]

    def _weights(self, basis: Array, left: Array, valid: BoolArray, std: Array) -> Array:
        """``A^T A``, or ``A^T (A Sigma A^T)^-1 A`` with Sigma of the views.

        With a basis C of what the rows do not see, the latter is
        ``S - S C (C^T S C)^-1 C^T S``, ``S = Sigma^-1``.
        """
        if not self.generalised:
            return np.broadcast_to(left.T @ left, (len(valid), *2 * valid.shape[1:]))
        inverse = valid / np.where(valid, std, 1.0) ** 2
        weight = inverse[..., None] * np.eye(valid.shape[1])
        seen = valid[0]
        blind = np.linalg.svd(basis[:, seen])[2][len(basis) :]
        if not len(blind):
            return weight
        unseen = np.zeros((len(blind), len(seen)))
        unseen[:, seen] = blind
        scaled = unseen * inverse[:, None]
        return weight - np.swapaxes(scaled, 1, 2) @ np.linalg.solve(scaled @ unseen.T, scaled)
