"""What the field leaves of the measured velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.model import FieldModel
from sldvexp.field.parts import Part

Array = NDArray[np.float64]

#: Columns that are worked on together.
COLUMNS_AT_ONCE = 16


@dataclass(eq=False)
class Residuals:
    """Sums of squares of the residuals; real and imaginary parts are columns.

    Attributes
    ----------
    squares : ndarray, shape (equation, column), m2/s2
        What the method minimises: of all rows, weighted as they are, or of each component for the
        contravariant method.
    by_view : ndarray, shape (view, column), m2/s2
        Of ``v_k - X_k theta``, all weighted alike.
    by_row : ndarray, shape (row, column), m2/s2
        Of the method's rows.
    view_count, row_count : ndarray of int
        How many samples are behind them.
    """

    squares: Array
    by_view: Array
    by_row: Array
    view_count: NDArray[np.int_]
    row_count: NDArray[np.int_]

    @classmethod
    def empty(cls, model: FieldModel, views: int, columns: int) -> Residuals:
        """Zeros."""
        rows, equations = len(model.rows), model.parameters if model.contravariant else 1
        return cls(
            np.zeros((equations, columns)),
            np.zeros((views, columns)),
            np.zeros((rows, columns)),
            np.zeros(views, int),
            np.zeros(rows, int),
        )

    def add(self, part: Part, theta: Array, data: list[Array]) -> None:
        """Add the samples that a part owns.

        Parameters
        ----------
        part : Part
        theta : ndarray, shape (layer, surface_node, parameter, column)
        data : list of ndarray, shape (pixel, column)
        """
        rows = part.model.rows.matrix
        used = part.look.valid & (part.at.pointwise.kept & part.owned)[:, None]
        has_row = ~np.any((rows != 0)[None] & ~used[:, None], axis=2)
        self.view_count += used.sum(axis=0)
        self.row_count += has_row.sum(axis=0)
        for first in range(0, theta.shape[-1], COLUMNS_AT_ONCE):
            some = slice(first, first + COLUMNS_AT_ONCE)
            v, u = part.velocities([d[:, some] for d in data]), part.field(theta[..., some])
            left = (v - part.at.pointwise.design @ u) * used[..., None]
            self.by_view[:, some] += np.einsum("skc,skc->kc", left, left)
            of_rows = (rows @ left) * has_row[..., None]
            self.by_row[:, some] += np.einsum("src,src->rc", of_rows, of_rows)
            self.squares[:, some] += _squares(part, v, u, left)


def _squares(part: Part, v: Array, u: Array, left: Array) -> Array:
    """``sum_s r^T Q r``, or ``sum_s (T v - u)^2`` for each component."""
    if not part.model.contravariant:
        return np.einsum("skc,skc->c", left, part.at.pointwise.weight @ left)[None]
    off = (part.at.estimator @ v - u) * (part.at.information[..., 0] * part.owned[:, None])[
        ..., None
    ]
    return np.einsum("spc,spc->pc", off, off)
