"""Columns of data, real and imaginary parts of all frequencies, and the few that carry signal.

Noise that differs by pixel and by frequency is taken as a product of both, so that after division
every number has the variance 1. Then ``Y = U S W'``, and columns ``Y W`` of singular values beyond
what noise alone has (``sqrt(pixels) + sqrt(columns)``) hold all of the signal. They are fitted
instead of the lines, and lines put together from them again. A line's variance then has two parts,
that of the fitted columns and that of W itself:

    var(v_c) = sum_j W_cj^2 var_j + sum_j (mean_j / S_j)^2.

Signal that stays below that limit is let go with the noise, and may still be many standard errors
of a line. So what is let go is held against the noise it would be by itself, and what it has more
of, ``sldvexp.shell.evidence.WeightedFit.overlooked``, is a third part of a line's variance, in the
share ``1 - sum_j W_cj^2`` of the line that is not fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

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
    def of(cls, white: Callable[[], Iterable[Array]], scale: Array) -> SignalColumns:
        """Keep the columns of whitened velocities that carry signal.

        Parameters
        ----------
        white : callable
            Gives the velocities over their standard errors, real parts and then imaginary parts of
            all frequencies, (pixel, 2 frequency), some pixels at a time.
        scale : ndarray, shape (frequency,)
        """
        columns, pixels = 2 * len(scale), 0
        gram = np.zeros((columns, columns))
        for some in white():
            gram += some.T @ some
            pixels += len(some)
        values, vectors = np.linalg.eigh(gram)
        size = np.sqrt(np.maximum(values[::-1], 0.0))
        combination = vectors.T[::-1]
        noise = np.sqrt(pixels) + np.sqrt(columns)
        kept = max(int((size > BEYOND * noise).sum()), 1)
        if len(scale) == 1 or kept == columns:
            kept, size = columns, np.full(columns, np.inf)
        used = combination[:kept]
        return cls(np.concatenate([some @ used.T for some in white()]), used, size[:kept], scale)

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

    @property
    def left_out(self) -> Array:
        """Share of every line's parts that no column holds, shape (part, frequency)."""
        if np.isinf(self.size).all():
            return np.zeros((2, len(self.scale)))
        left = np.maximum(1 - (self.combination**2).sum(axis=0), 0.0)
        return np.stack(np.split(left, 2))

    def of_left_out(self, variance: Array) -> Array:
        """Spread what is left out over the lines, as variances, (part, ..., frequency).

        Parameters
        ----------
        variance : ndarray, shape (...)
            Of a column that is not fitted.
        """
        real, imaginary = self.left_out
        return np.stack([variance[..., None] * part for part in (real, imaginary)]) * self.scale**2

    def quadratic(self, gram: Array) -> Array:
        """Compute variances of both parts, (part, ..., frequency), from those of reduced columns.

        Parameters
        ----------
        gram : ndarray, shape (..., reduced, reduced)
        """
        pairs = np.einsum("ic,jc->ijc", self.combination, self.combination)
        flat = gram.reshape(*gram.shape[:-2], -1) @ pairs.reshape(-1, pairs.shape[-1])
        return np.stack(np.split(np.maximum(flat, 0.0), 2, axis=-1)) * self.scale**2

    def of_part(self, lines: slice) -> SignalColumns:
        """Keep some of the lines, which are put together from the same columns."""
        real, imaginary = np.split(self.combination, 2, axis=-1)
        combination = np.concatenate([real[:, lines], imaginary[:, lines]], axis=1)
        return replace(self, combination=combination, scale=self.scale[lines])

    def combined(self, reduced: Array) -> ComplexArray:
        """Put complex lines together, shape (..., frequency)."""
        real, imaginary = np.split(reduced @ self.combination, 2, axis=-1)
        return np.asarray((real + 1j * imaginary) * self.scale, complex)
