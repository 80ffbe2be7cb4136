"""The best conditioned set of rows: ``rows: best``."""

from __future__ import annotations

from itertools import combinations, islice
from math import comb

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.reconstruction.factor import rank_of
from sldvexp.reconstruction.model import design
from sldvexp.reconstruction.rows import RowSet
from sldvexp.typing import Array

#: Sets beyond this number are not searched: it would take longer than reading the data.
LARGEST_SEARCH = 3_000_000
#: Condition numbers that a search computes, sets times points, before it looks at fewer points.
EFFORT = 50_000
#: Sets whose condition numbers are computed together.
SETS_AT_ONCE = 2000
#: Condition numbers equal to this many digits count as equal: the first set of them is taken.
DIGITS = 10


def best_rows(
    candidates: RowSet, directions: Array, size: int, intercept: bool, tolerance: float
) -> RowSet:
    """The set of `size` rows with the largest reciprocal condition number.

    One set serves all points of a data set, so that its results are comparable from point to
    point: the one whose median over points evenly spread over the data set is largest. Views that
    determine fewer than all parameters are ranked by the ratio of the singular values that exist.

    Parameters
    ----------
    candidates : RowSet
    directions : ndarray, shape (view, point, axis)
        Direction cosines.
    size : int
        Rows in a set: as many as the model has parameters.
    intercept : bool
        Whether the model has an intercept.
    tolerance : float
        Relative singular value below which a direction counts as not determined.

    Returns
    -------
    RowSet

    Raises
    ------
    UserError
        If there are not enough independent rows, or too many sets to search.
    """
    if np.linalg.matrix_rank(candidates.matrix) < size:
        raise UserError(
            f"the best {size} rows are asked for, but {directions.shape[0]} views do not have "
            f"{size} independent rows of this method; more views are needed"
        )
    sets = comb(len(candidates), size)
    if sets > LARGEST_SEARCH:
        raise UserError(
            f"{len(candidates)} candidate rows have {sets} sets of {size}, too many to search for "
            "the best; write the rows, as in 1-5,2,4"
        )
    points = _spread(directions.shape[1], max(1, EFFORT // sets))
    matrices = candidates.matrix @ design(directions[:, points], intercept)
    rank = int(rank_of(matrices, tolerance).max())
    best, best_score = np.arange(size), -1.0
    every_set = combinations(range(len(candidates)), size)
    while chunk := list(islice(every_set, SETS_AT_ONCE)):
        indices = np.array(chunk)
        score = np.round(np.median(_scores(matrices[:, indices], rank), axis=0), DIGITS)
        if score.max() > best_score:
            best, best_score = indices[np.argmax(score)], score.max()
    return candidates.take(best)


def _scores(matrices: Array, rank: int) -> Array:
    """Reciprocal condition of square matrices, in as many dimensions as they can span."""
    if rank == matrices.shape[-1]:
        return 1 / np.linalg.cond(matrices, 1)
    sigma = np.linalg.svd(matrices, compute_uv=False)
    return sigma[..., rank - 1] / sigma[..., 0]


def _spread(count: int, at_most: int) -> NDArray[np.int_]:
    """Indices of at most so many points, evenly spread, the middle one if there is only one."""
    if count <= at_most:
        return np.arange(count)
    edges = np.linspace(0, count, at_most + 1)
    return ((edges[:-1] + edges[1:]) / 2).astype(int)
