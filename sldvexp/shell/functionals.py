"""Linear functionals of a shell's coefficients: their products with columns, and their variances.

Forms at the same places are made of the same few numbers there, the jet q of u0, v0, w and some of
their derivatives: ``c'q`` with q = X theta and the local rows X (`sldvexp.shell.local_rows`). With
the covariance V of the coefficients that of a jet is ``X V X'``, of one cell's coefficients alone,
and gives the variances ``c' X V X' c`` of all forms.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.shell.linear_form import LinearForm
from sldvexp.shell.local_rows import LocalRows, spread_out
from sldvexp.shell.love import ThinShell
from sldvexp.typing import Array

#: Rows, and places, that are worked on at once.
ROWS, PLACES = 4096, 1024


class Functionals(ABC):
    """Functionals of coefficients."""

    @abstractmethod
    def evaluate(self, columns: Array, matrices: Sequence[Array]) -> tuple[Array, Array]:
        """Compute their products with columns, and their quadratic forms.

        Parameters
        ----------
        columns : ndarray, shape (coefficient, column)
        matrices : sequence of ndarray, shape (coefficient, coefficient) each
            Symmetric.

        Returns
        -------
        products : ndarray, shape (functional, column)
        squares : ndarray, shape (functional, matrix)
            ``f' V f``.
        """


@dataclass(frozen=True, eq=False)
class Rows(Functionals):
    """Functionals with rows of any kind.

    Attributes
    ----------
    rows : ndarray, shape (functional, coefficient)
    """

    rows: Array

    def evaluate(self, columns: Array, matrices: Sequence[Array]) -> tuple[Array, Array]:
        """Multiply; see `Functionals`."""
        squares = np.empty((len(self.rows), len(matrices)))
        for k in range(0, len(self.rows), ROWS):
            some = self.rows[k : k + ROWS]
            for m, matrix in enumerate(matrices):
                squares[k : k + ROWS, m] = np.einsum("fi,fi->f", some @ matrix, some)
        return self.rows @ columns, squares


@dataclass(frozen=True, eq=False)
class Forms(Functionals):
    """Forms at places, one form after the other.

    Attributes
    ----------
    shell : ThinShell
    coordinates : ndarray, shape (place, 2), m
    forms : sequence of LinearForm
        At these places.
    """

    shell: ThinShell
    coordinates: Array
    forms: Sequence[LinearForm]

    def evaluate(self, columns: Array, matrices: Sequence[Array]) -> tuple[Array, Array]:
        """Multiply, cell by cell; see `Functionals`."""
        terms = sorted({term for form in self.forms for term in form.terms})
        count = len(self.coordinates)
        factors = np.zeros((count, len(self.forms), len(terms)))
        for f, form in enumerate(self.forms):
            for term, factor in form.terms.items():
                factors[:, f, terms.index(term)] = factor
        columns = spread_out(self.shell, columns)
        spread = [spread_out(self.shell, spread_out(self.shell, m).T) for m in matrices]
        products = np.empty((len(self.forms), count, columns.shape[1]))
        squares = np.empty((len(self.forms), count, len(spread)))
        order = LocalRows(self.shell, self.coordinates).cells.order
        for begin in range(0, count, PLACES):
            some = order[begin : begin + PLACES]
            local = LocalRows(self.shell, self.coordinates[some])
            own, covariances = _of_jets(local, local.jets(terms), columns, spread)
            products[:, some] = (factors[some] @ own).swapaxes(0, 1)
            for m, covariance in enumerate(covariances):
                both = np.einsum("pft,pft->fp", factors[some] @ covariance, factors[some])
                squares[:, some, m] = both
        every = len(self.forms) * count
        return products.reshape(every, columns.shape[1]), squares.reshape(every, len(spread))


def _of_jets(
    local: LocalRows, jets: Array, columns: Array, matrices: Sequence[Array]
) -> tuple[Array, list[Array]]:
    """Compute jets' products with columns, (place, term, column), and ``X V X'``."""
    order, each = local.cells
    jets = jets[order]
    terms, width = jets.shape[1:]
    products = np.empty((len(order), terms, columns.shape[1]))
    half = [np.empty_like(jets) for _ in matrices]
    for some, own in each:
        rows = jets[some].reshape(-1, width)
        products[some] = (rows @ columns[own]).reshape(products[some].shape)
        for of, matrix in zip(half, matrices, strict=True):
            of[some] = (rows @ matrix[own[:, None], own]).reshape(-1, terms, width)
    back = np.argsort(order)
    turned = jets.swapaxes(1, 2)
    return products[back], [(of @ turned)[back] for of in half]
