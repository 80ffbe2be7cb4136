"""What the field leaves of the measured velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.equations.regions import Part
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.typing import Array, BoolArray

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
        used = part.look.valid & (part.at.pointwise.kept & part.owned)[:, None]
        has_row = ~np.any((part.model.rows.matrix != 0)[None] & ~used[:, None], axis=2)
        self.view_count += used.sum(axis=0)
        self.row_count += has_row.sum(axis=0)
        samples = len(used) // part.patch.sample_shape[0]
        for gap in range(part.patch.sample_shape[0]):
            here = slice(gap * samples, (gap + 1) * samples)
            weights = [seen.weights[here] for seen in part.look.seen]
            for first in range(0, theta.shape[-1], COLUMNS_AT_ONCE):
                some = slice(first, first + COLUMNS_AT_ONCE)
                v = np.stack([w @ d[:, some] for w, d in zip(weights, data, strict=True)], axis=1)
                u = part.field(theta[..., some], gap)
                left = (v - part.at.pointwise.design[here] @ u) * used[here, :, None]
                self._add(part, here, some, has_row[here], v, u, left)

    def _add(
        self,
        part: Part,
        here: slice,
        some: slice,
        has_row: BoolArray,
        v: Array,
        u: Array,
        left: Array,
    ) -> None:
        """Add some samples and columns: velocities, the field there, and what it leaves of them."""
        self.by_view[:, some] += np.einsum("skc,skc->kc", left, left)
        of_rows = (part.model.rows.matrix @ left) * has_row[..., None]
        self.by_row[:, some] += np.einsum("src,src->rc", of_rows, of_rows)
        if part.model.contravariant:
            own = part.at.information[here, :, 0] * part.owned[here, None]
            off = (part.at.estimator[here] @ v - u) * own[..., None]
            self.squares[:, some] += np.einsum("spc,spc->pc", off, off)
        else:
            weighted = part.at.pointwise.weight[here] @ left
            self.squares[0, some] += np.einsum("skc,skc->c", left, weighted)
