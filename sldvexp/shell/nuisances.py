"""What is not known exactly beside the field: poses, calibration, height, thickness.

Their errors d have the prior ``d = L x`` with ``x ~ N(0, 1)``. The data of all columns together,
``y_c = A theta_c + J_c d + e``, tell about them what the field leaves over,

    (1 + L' N L) x = L' (N d0 + sum_c J_c' y_c - J_c'A H_c^-1 A'y_c),
    N = sum_c J_c'J_c - J_c'A H_c^-1 A'J_c,

where A and J are those at the errors d0. Every result g of the field changes with them by
``-g H_c^-1 A'J_c (d - d0)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array


@dataclass(frozen=True, eq=False)
class Nuisances:
    """Errors beside the field, as far as they are known after the fit.

    Attributes
    ----------
    mean : ndarray, shape (error,), rad and m
    factor : ndarray, shape (error, any)
        Of their covariance.
    """

    mean: Array
    factor: Array

    def by_source(self, own: slice) -> tuple[Array, Array]:
        """Split the factor: what goes with some of the errors, and the rest, which they have not.

        A turn of its columns leaves the covariance alone, and can make some rows end in zeros.
        """
        rows = self.factor[own]
        if not len(rows):
            return self.factor[:, :0], self.factor
        turn = np.linalg.qr(rows.T, mode="complete")[0]
        turned = self.factor @ turn
        return turned[:, : len(rows)], turned[:, len(rows) :]

    @classmethod
    def posterior(
        cls,
        prior: Array,
        at: Array,
        products: Array,
        normal: list[Array],
        solved: list[Array],
        right: Array,
    ) -> Nuisances:
        """Combine the prior with what all columns tell.

        Parameters
        ----------
        prior : ndarray, shape (error, any)
            L.
        at : ndarray, shape (error,)
            d0.
        products : ndarray, shape (error, column)
            ``J_c' y_c``.
        normal : list of ndarray, shape (error, error)
            ``J_c'J_c - J_c'A H_c^-1 A'J_c`` of every column.
        solved : list of ndarray, shape (coefficient, error)
            ``H_c^-1 A'J_c``.
        right : ndarray, shape (coefficient, column)
            ``A'y_c``.
        """
        told = np.stack([s.T @ r for s, r in zip(solved, right.T, strict=True)], axis=1)
        information = np.sum(normal, axis=0)
        precision = np.eye(prior.shape[1]) + prior.T @ information @ prior
        force = prior.T @ (information @ at + (products - told).sum(axis=1))
        lower = scipy.linalg.cholesky(precision, lower=True)
        x = scipy.linalg.cho_solve((lower, True), force)
        return cls(prior @ x, prior @ np.linalg.inv(lower).T)
