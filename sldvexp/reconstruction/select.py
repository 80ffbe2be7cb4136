"""From a method's `rows` field to the row matrix of a data set's views."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.reconstruction.base import Model, Reconstruction
from sldvexp.reconstruction.rows import RowSet, check, parse
from sldvexp.reconstruction.search import best_rows


def select_rows(method: Reconstruction, directions: ArrayLike, view_names: Sequence[str]) -> RowSet:
    """The rows that `method` applies to these views, the same for all points.

    Parameters
    ----------
    method : Reconstruction
    directions : array_like, shape (view, point, axis)
        Direction cosines; only ``best`` looks at them.
    view_names : sequence of str

    Returns
    -------
    RowSet

    Raises
    ------
    UserError
        If the rows name no view, are not the method's, or are too few for its model.
    """
    choice = method.row_choice(view_names)
    intercept = method.model is Model.full
    # Fewer than three views still determine some components; an intercept needs them all.
    needed = 4 if intercept else 1
    text = method.rows.strip()
    if text == "best":
        cosines = np.asarray(directions, float)
        size = 4 if intercept else 3
        rows = best_rows(choice.candidates, cosines, size, intercept, method.rank_tolerance)
    elif text == "all" and choice.every is not None:
        rows = choice.every
    else:
        rows = parse(text, view_names)
    if not len(rows):
        raise UserError("a difference needs two views, but there is only one")
    check(rows, choice, needed)
    if intercept and not rows.has_views:
        raise UserError(
            f"the full model cannot be fitted to {rows}: an intercept cancels in every difference; "
            "use model=partial or add a single view"
        )
    return rows
