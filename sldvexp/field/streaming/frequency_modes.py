"""Few combinations of frequencies that carry all that is above the noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array

#: Columns up to which each is its own combination.
FEW = 8
#: Part of a column's sum of squares that may be left out even if it is above the noise.
NEGLIGIBLE = 1e-6


@dataclass(frozen=True, eq=False)
class FrequencyModes:
    """Orthonormal combinations C of the data's columns, ``v = (v C^T) C`` but for noise.

    A pose that is known to a part of a pixel changes velocities by that part of their difference
    from pixel to pixel. Of the noise this does not show beside the noise itself.

    Attributes
    ----------
    combination : ndarray, shape (mode, column)
    """

    combination: Array

    @classmethod
    def of(cls, data: list[Array], noise: Array) -> FrequencyModes:
        """Those of the pixels of all views.

        Parameters
        ----------
        data : list of ndarray, shape (pixel, column)
        noise : ndarray, shape (column,)
            Expected sum of squares of each column's noise.
        """
        return cls.of_gram(np.sum([d.T @ d for d in data], axis=0), noise)

    @classmethod
    def of_gram(cls, gram: Array, noise: Array) -> FrequencyModes:
        """Those of data with these products of columns, shape (column, column)."""
        columns = len(gram)
        if columns <= FEW:
            return cls(np.eye(columns))
        _, vectors = np.linalg.eigh(gram)
        vectors = vectors[:, ::-1]
        carried = np.cumsum(vectors**2 * np.einsum("ij,ik,kj->j", vectors, gram, vectors), axis=1)
        total = np.diagonal(gram)[:, None]
        enough = np.all(
            total - carried <= np.maximum(2 * noise[:, None], NEGLIGIBLE * total), axis=0
        )
        modes = int(np.argmax(enough)) + 1 if enough.any() else columns
        return cls(np.ascontiguousarray(vectors[:, :modes].T))

    def of_part(self, columns: slice) -> FrequencyModes:
        """The same modes of some columns only."""
        return FrequencyModes(self.combination[:, columns])

    def of_columns(self, values: Array) -> Array:
        """The modes' values of (..., column)."""
        return values @ self.combination.T

    def quadratic(self, gram: Array) -> Array:
        """``c^T G c`` for every column c, from (..., mode, mode) to (..., column)."""
        squares = np.einsum("ic,jc->ijc", self.combination, self.combination)
        modes, columns = self.combination.shape
        return gram.reshape(*gram.shape[:-2], -1) @ squares.reshape(modes**2, columns)
