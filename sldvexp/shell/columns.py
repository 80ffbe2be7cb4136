"""Columns of data, real and imaginary parts of all frequencies, and the few that carry signal.

Noise that differs by pixel and by frequency is taken as a product of both, so that after division
every number has the variance 1. Then ``Y = U S W'``, and columns ``Y W`` of singular values beyond
what noise alone has (``sqrt(pixels) + sqrt(columns)``) hold all of the signal. They are fitted
instead of the lines, and lines put together from them again. A line's variance then has two parts,
that of the fitted columns and that of W itself:

    var(v_c) = sum_j W_cj^2 var_j + sum_j (mean_j / S_j)^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array, ComplexArray

#: Factor of the largest singular value of noise, beyond which a column is signal.
BEYOND = 1.01


@dataclass(frozen=True, eq=False)
class SignalColumns:
    """Reduced columns of whitened data.

    Attributes
    ----------
    data : ndarray, shape (pixel, reduced)
        In m/s over the pixels' standard errors.
    combination : ndarray, shape (reduced, column)
        W'; orthonormal rows.
    size : ndarray, shape (reduced,)
        Singular values; infinite where all columns are kept, since W is then exact.
    scale : ndarray, shape (frequency,)
        Standard error of a frequency over those of all, by which columns were divided.
    """

    data: Array
    combination: Array
    size: Array
    scale: Array

    @classmethod
    def of(cls, velocity: ComplexArray, pixel_std: Array, scale: Array) -> SignalColumns:
        """Whiten velocities and keep the columns that carry signal.

        Parameters
        ----------
        velocity : ndarray of complex, shape (pixel, frequency), m/s
        pixel_std : ndarray, shape (pixel,), m/s
        scale : ndarray, shape (frequency,)
        """
        white = velocity / pixel_std[:, None] / scale
        whole = np.concatenate([white.real, white.imag], axis=1)
        values, vectors = np.linalg.eigh(whole.T @ whole)
        size = np.sqrt(np.maximum(values[::-1], 0.0))
        combination = vectors.T[::-1]
        noise = np.sqrt(len(whole)) + np.sqrt(whole.shape[1])
        kept = max(int((size > BEYOND * noise).sum()), 1)
        if velocity.shape[1] == 1 or kept == whole.shape[1]:
            kept, size = whole.shape[1], np.full(whole.shape[1], np.inf)
        used = combination[:kept]
        return cls(whole @ used.T, used, size[:kept], scale)

    def lines(self, mean: Array, variance: Array) -> tuple[ComplexArray, Array]:
        """Put lines together from the reduced columns' results.

        Parameters
        ----------
        mean, variance : ndarray, shape (..., reduced)

        Returns
        -------
        values : ndarray of complex, shape (..., frequency)
        variance : ndarray, shape (part, ..., frequency)
        """
        of_columns = variance @ self.combination**2
        of_columns += np.sum((mean / self.size) ** 2, axis=-1, keepdims=True)
        real, imaginary = np.split(of_columns, 2, axis=-1)
        return self.combined(mean), np.stack([real, imaginary]) * self.scale**2

    def combined(self, reduced: Array) -> ComplexArray:
        """Put complex lines together, shape (..., frequency)."""
        real, imaginary = np.split(reduced @ self.combination, 2, axis=-1)
        return np.asarray((real + 1j * imaginary) * self.scale, complex)
