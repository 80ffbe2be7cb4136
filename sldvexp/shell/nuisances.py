"""What is not known exactly beside the field: poses, calibration, height, thickness.

Their errors d have the prior ``d = L x`` with ``x ~ N(0, 1)``. The data of all columns together,
``y_c = A theta_c + J_c (d - d0) + e``, tell about them what the field leaves over,

    (1 + L' N L) x = L' (N d0 + sum_c J_c' y_c - J_c'A H_c^-1 A'y_c),
    N = sum_c J_c'J_c - J_c'A H_c^-1 A'J_c,

where A and J are those at the errors d0, and x is known with the covariance
``(1 + L' N L)^-1``. Every result g of the field changes with them by
``-g H_c^-1 A'J_c (d - d0)``.

Likelihoods of the field's weights are taken at d0 there. Where the errors are not held, but
integrated over with their prior, a column of data alone gives each combination of weights

    -2 log L gains d0'(2 J'R y + N d0) - F'(1 + L' N L)^-1 F + log|1 + L' N L|,
    R = 1 - A H^-1 A', N = J'R J, F = L'(J'R y + N d0)

(the determinant lemma; Rasmussen and Williams 2006, 2.7): errors that were found anew have taken up
whatever motion of the middle looks like them, and at them nothing speaks for it any more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.shell.calibration import CalibrationError
from sldvexp.shell.evidence import WeightedFit
from sldvexp.typing import Array


@dataclass(frozen=True, eq=False)
class PriorErrors:
    """What was known beforehand of poses, calibration, height and thickness.

    Attributes
    ----------
    factor : ndarray, shape (6 view + calibration + 2, any)
        Of their covariance: poses, errors of the calibration in standard deviations, the given
        surface's height, the sheet's thickness.
    calibration : list of CalibrationError
    adjusted : bool
        Whether they are found anew together with the field.
    """

    factor: Array
    calibration: list[CalibrationError]
    adjusted: bool

    @classmethod
    def of(
        cls,
        poses: Array,
        calibration: list[CalibrationError],
        height: float,
        thickness: float,
        adjusted: bool,
    ) -> PriorErrors:
        """Combine covariances of poses, (6 view, 6 view), and standard errors, m."""
        values, vectors = np.linalg.eigh(poses)
        known = values > 1e-14 * max(values.max(initial=0.0), 1e-300)
        factor = scipy.linalg.block_diag(
            vectors[:, known] * np.sqrt(values[known]),
            np.eye(len(calibration)),
            [[height]],
            [[thickness]],
        )
        return cls(factor[:, np.any(factor != 0, axis=0)], calibration, adjusted)

    @property
    def own(self) -> slice:
        """Places of the calibration's errors."""
        return slice(len(self.factor) - 2 - len(self.calibration), len(self.factor) - 2)


@dataclass(frozen=True, eq=False)
class ErrorEquations:
    """Equations of the errors, of every column of data.

    Attributes
    ----------
    prior : ndarray, shape (error, any)
        L.
    at : ndarray, shape (error,)
        d0.
    crossed : ndarray, shape (coefficient, error, column)
        ``A'J_c``.
    products : ndarray, shape (error, column)
        ``J_c' y_c``.
    squares : ndarray, shape (column, error, error)
        ``J_c' J_c``.
    """

    prior: Array
    at: Array
    crossed: Array
    products: Array
    squares: Array

    def solved(self, posterior: WeightedFit) -> list[Array]:
        """Compute ``H_c^-1 A'J_c`` of every column, shape (coefficient, error) each."""
        return [posterior.solve(self.crossed[:, :, c], c) for c in range(len(self.squares))]

    def known(self, posterior: WeightedFit, solved: list[Array]) -> Nuisances:
        """Combine the prior with what all columns tell; `solved` is that of this posterior."""
        told, left = np.zeros((len(self.at),) * 2), np.zeros(len(self.at))
        for c, square in enumerate(self.squares):
            told += square - self.crossed[:, :, c].T @ solved[c]
            left += self.products[:, c] - solved[c].T @ posterior.reduced[:, c]
        precision = np.eye(self.prior.shape[1]) + self.prior.T @ told @ self.prior
        lower = scipy.linalg.cholesky(precision, lower=True)
        x = scipy.linalg.cho_solve((lower, True), self.prior.T @ (told @ self.at + left))
        return Nuisances(self.prior @ x, self.prior @ np.linalg.inv(lower).T)

    def gained(self, posterior: WeightedFit) -> list[Array]:
        """Compute what densities of weights gain if the errors are not held at d0.

        Returns
        -------
        list of ndarray, shape (weight, column)
            Of each level.
        """
        gained = []
        for level in posterior.levels:
            own = np.empty((level.scale.shape[1], len(self.squares)))
            of_data, to_data = level.whitened(posterior.reduced)
            for c, square in enumerate(self.squares):
                inner, outer = level.whitened(self.crossed[:, :, c])
                for k, scale in enumerate(level.scale.T):
                    scaled = outer.T * scale
                    told = square - inner.T @ inner - scaled @ outer
                    left = self.products[:, c] - inner.T @ of_data[:, c] - scaled @ to_data[:, c]
                    own[k, c] = -self._twice(told, left) / 2
            gained.append(own)
        return gained

    def _twice(self, told: Array, left: Array) -> float:
        """Compute what -2 log L gains, from N and ``J'R y``."""
        force = self.prior.T @ (left + told @ self.at)
        precision = np.eye(self.prior.shape[1]) + self.prior.T @ told @ self.prior
        explained = force @ np.linalg.solve(precision, force)
        held = self.at @ (2 * left + told @ self.at)
        return float(held - explained + np.linalg.slogdet(precision)[1])


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
        """Split the factor: columns that some of the errors take part in, and those without them.

        A turn of its columns leaves the covariance alone, and can make some rows end in zeros.
        """
        rows = self.factor[own]
        if not len(rows):
            return self.factor[:, :0], self.factor
        turn = np.linalg.qr(rows.T, mode="complete")[0]
        turned = self.factor @ turn
        return turned[:, : len(rows)], turned[:, len(rows) :]
