"""Least squares with penalties whose weights are averaged over by their evidence.

With whitened data ``y = A theta + e`` of unit variance and priors ``exp(lam_j) P_j`` of the
coefficients' precision, ``H = A'A + sum_j exp(lam_j) P_j``, the restricted likelihood is

    -2 log L(lam) = y'y - y'A H^-1 A'y + log|H| - sum_j (rank_j lam_j + log|P_j|+) + constant

(Patterson and Thompson 1971; Wahba 1985). One optimum of it would hide how little data may say of a
weight. So a grid of weights is averaged over, each counting by its likelihood and a prior that is
flat in lam_1 and flat in the standard deviation exp(-lam_j/2) of all others, whose "none at all" is
then a limit of the model. Means and variances are those of the mixture: bounds carry the doubt
about the weights, and "no membrane" needs no option of its own.

All columns of data share the factors of H; a column more costs one product a point of the grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array

#: Share of a weight in the average below which it is left out.
NEGLIGIBLE = 1e-3
#: Relative eigenvalue of a penalty that counts as zero.
NULL = 1e-9


@dataclass(frozen=True, eq=False)
class WeightedFit:
    """Posterior of the coefficients of several columns of data, a mixture over weights.

    Attributes
    ----------
    factors : list of ndarray, shape (coefficient, coefficient)
        Lower Cholesky factors of H, one for every combination of weights that counts.
    reduced : ndarray, shape (coefficient, column)
        ``A'y``.
    share : ndarray, shape (combination, column)
        Of each combination in the average; they add up to 1.
    """

    factors: list[Array]
    reduced: Array
    share: Array

    @classmethod
    def of(
        cls,
        normal: Array,
        reduced: Array,
        squares: Array,
        penalties: Sequence[Array],
        grids: Sequence[Array],
    ) -> WeightedFit:
        """Fit, for every combination of weights of a grid.

        Parameters
        ----------
        normal : ndarray, shape (coefficient, coefficient)
            ``A'A``.
        reduced : ndarray, shape (coefficient, column)
            ``A'y``.
        squares : ndarray, shape (column,)
            ``y'y``.
        penalties : sequence of ndarray, shape (coefficient, coefficient)
        grids : sequence of ndarray
            Values of lam of each penalty.
        """
        weight = np.array(np.meshgrid(*grids, indexing="ij")).reshape(len(grids), -1).T
        size = [_rank_and_log_determinant(p) for p in penalties]
        twice, kept = [], []
        for lam in weight:
            factor = scipy.linalg.cholesky(
                normal + sum(np.exp(w) * p for w, p in zip(lam, penalties, strict=True)),
                lower=True,
                check_finite=False,
            )
            solved = scipy.linalg.solve_triangular(factor, reduced, lower=True, check_finite=False)
            prior = sum(w * rank + log for w, (rank, log) in zip(lam, size, strict=True))
            determinant = 2 * np.log(np.diag(factor)).sum()
            twice.append(squares - (solved**2).sum(axis=0) + determinant - prior)
            kept.append(factor)
        likelihood = -0.5 * np.array(twice)
        density = likelihood - weight[:, 1:].sum(axis=1)[:, None] / 2
        share = np.exp(density - density.max(axis=0))
        share /= share.sum(axis=0)
        share[share < NEGLIGIBLE] = 0
        share /= share.sum(axis=0)
        used = np.flatnonzero(share.any(axis=1))
        return cls([kept[i] for i in used], reduced, share[used])

    def mean(self) -> Array:
        """Average the coefficients, shape (coefficient, column)."""
        return np.asarray(
            sum(
                scipy.linalg.cho_solve((c, True), self.reduced, check_finite=False) * share
                for c, share in zip(self.factors, self.share, strict=True)
            )
        )

    def evaluate(self, rows: Array) -> tuple[Array, Array]:
        """Compute mean and variance of linear functionals, shape (functional, column) each.

        Parameters
        ----------
        rows : ndarray, shape (functional, coefficient)
        """
        mean = np.zeros((len(rows), self.reduced.shape[1]))
        square = np.zeros_like(mean)
        for factor, share in zip(self.factors, self.share, strict=True):
            solved = scipy.linalg.solve_triangular(
                factor, np.column_stack([rows.T, self.reduced]), lower=True, check_finite=False
            )
            of_rows, of_data = solved[:, : len(rows)], solved[:, len(rows) :]
            here = of_rows.T @ of_data
            variance = (of_rows**2).sum(axis=0)[:, None]
            mean += share * here
            square += share * (variance + here**2)
        return mean, np.maximum(square - mean**2, 0.0)

    def solve(self, right: Array, column: int) -> Array:
        """Compute ``H^-1 right``, averaged over the weights of a column of data.

        Parameters
        ----------
        right : ndarray, shape (coefficient, any)
        column : int
        """
        return np.asarray(
            sum(
                share[column] * scipy.linalg.cho_solve((c, True), right, check_finite=False)
                for c, share in zip(self.factors, self.share, strict=True)
                if share[column] > 0
            )
        )


def _rank_and_log_determinant(penalty: Array) -> tuple[int, float]:
    """Count eigenvalues that are not zero, and add up their logarithms."""
    values = np.linalg.eigvalsh(penalty)
    values = values[values > NULL * values.max()]
    return len(values), float(np.log(values).sum())
