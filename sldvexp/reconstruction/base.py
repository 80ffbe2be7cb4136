"""Base of all reconstruction methods: the way from views to a velocity, and the choice of rows.

A method's `rows` becomes the row matrix A of a data set's views. ``best`` searches all sets of as
many candidates as there are unknowns for the largest reciprocal condition number in the 1-norm,
which bounds how much relative errors of velocities and cosines can grow. The search is exact: every
set is looked at, and only the points at which it is judged are thinned out if there are many. Where
there are too many sets (Fedorov's exchange, V. V. Fedorov 1972): the best set of some evenly spread
candidates comes first, and one row of it after the other gives way to the best of all candidates
until none is better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, islice
from itertools import count as count_from
from math import comb
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction.gaps import gaps_of, solved_around
from sldvexp.reconstruction.least_squares import design, rank_of
from sldvexp.reconstruction.result import PointVelocity, reciprocal_condition
from sldvexp.reconstruction.rows import RowChoice, RowSet, check, parse
from sldvexp.reconstruction.solve import solve
from sldvexp.reconstruction.system import Model, ReconstructionSettings
from sldvexp.reconstruction.views import Views
from sldvexp.typing import Array, IndexArray


@dataclass
class Reconstruction(ReconstructionSettings):
    """Velocity vector from line-of-sight velocities, ``A v = A D V`` with a method's rows A.

    A strategy implements the one hook `row_choice`: the rows that it may use.
    """

    #: Whether a field takes the velocity at each sample from its own rows alone, or fits all rows
    #: of all samples together.
    sample_by_sample: ClassVar[bool] = False

    def row_choice(self, view_names: Sequence[str]) -> RowChoice:
        """Offer the rows that this method may use: the hook that makes a strategy."""
        raise NotImplementedError

    def row_set(self, directions: ArrayLike, view_names: Sequence[str]) -> RowSet:
        """Select the rows A that this method applies to these views; see `select_rows`."""
        return select_rows(self, directions, view_names)

    def reconstruct(
        self,
        directions: ArrayLike,
        velocity: ArrayLike,
        std: ArrayLike | None = None,
        view_names: Sequence[str] | None = None,
    ) -> PointVelocity:
        """Reconstruct velocity vectors with bounds at points and frequencies (Section 5.2).

        Parameters
        ----------
        directions : array_like, shape (view, point, axis) or, for one point, (view, axis)
            Direction cosines from the surface to the instrument.
        velocity : array_like, shape (view, point[, frequency]), for one point (view[, frequency])
            Line-of-sight velocity, positive towards the instrument, real or complex; peak, m/s.
        std : array_like, optional, m/s
            Its standard error, of real and imaginary part each: (view,), (view, point),
            (view, point, frequency) or, for one point, (view[, frequency]). Without it the noise
            is estimated from the residuals.
        view_names : sequence of str, optional
            Names of the views, "1", "2" and so on without them.

        Raises
        ------
        UserError
            If arrays do not fit one another, are not finite, direction cosines are not of unit
            length, or the rows cannot be formed from these views.

        Examples
        --------
        Four views of a point that moves along z:

        >>> import numpy as np
        >>> from sldvexp.reconstruction import Absolute
        >>> directions = np.array([[0.6, 0, 0.8], [-0.6, 0, 0.8], [0, 0.6, 0.8], [0, 0, 1]])
        >>> velocity = directions @ [0, 0, 1e-3 + 2e-3j]
        >>> result = Absolute().reconstruct(directions, velocity, std=[1e-6] * 4)
        >>> result
        PointVelocity: x, y, z at 1 point and 1 frequency, rows 1,2,3,4
          rcond 0.071 or more, noise from given
          largest bound 3.7e-06 m/s (95%)
        >>> result.velocity.shape, result.to_dataset()["velocity"].dims
        ((1, 3, 1), ('component',))
        """
        views = Views.checked(directions, velocity, std, view_names)
        rows = self.row_set(views.directions, views.names)
        return solve(views, rows, self)

    def group(self, line_of_sight: xr.Dataset) -> xr.Dataset:
        """Make the group ``point`` of a run from its group ``line_of_sight``.

        Parameters
        ----------
        line_of_sight : xarray.Dataset
            ``direction_cosines``, ``velocity`` and perhaps ``velocity_std``; point and frequency
            dimensions are optional and stay as they are. Where a view has no velocity
            the others are used, if they are three or more; else results are NaN.
        """
        if not bool(gaps_of(line_of_sight).any()):
            return self._group(line_of_sight)
        names = [str(v) for v in line_of_sight["view"].values]

        def of_some(part: xr.Dataset, views: IndexArray) -> xr.Dataset:
            """Solve from some views, with those of the rows that need no other."""
            return self._group(part, self._rows_of_some(names, views))

        return solved_around(of_some, line_of_sight)

    def _group(self, line_of_sight: xr.Dataset, rows: RowSet | None = None) -> xr.Dataset:
        """Make the group of views without gaps, by default with the method's own rows of them."""
        velocity, std = line_of_sight["velocity"], line_of_sight.get("velocity_std")
        of_views = (
            line_of_sight["direction_cosines"].transpose("view", ..., "axis").values,
            velocity.values,
            None if std is None else std.values,
            [str(v) for v in line_of_sight["view"].values],
        )
        if rows is None:
            result = self.reconstruct(*of_views)
        else:
            result = solve(Views.checked(*of_views), rows, self)
        point, frequency = (
            velocity[d].values if d in velocity.dims else None for d in ("point", "frequency")
        )
        return result.to_dataset(point, frequency)

    def _rows_of_some(self, names: Sequence[str], views: IndexArray) -> RowSet | None:
        """Keep the rows that are written and need no other views; None if none are written.

        Numbers count all views, so that a row is of the same view wherever one is missing.
        """
        if self.rows.strip() in ("best", "all"):
            return None
        written = parse(self.rows, names)
        others = np.setdiff1d(np.arange(len(names)), views)
        kept = written.take(np.flatnonzero(~written.matrix[:, others].any(axis=1)))
        some = RowSet(kept.matrix[:, views], kept.labels)
        check(some, self.row_choice([names[k] for k in views]), _needed(self))
        return some


def select_rows(method: Reconstruction, directions: ArrayLike, view_names: Sequence[str]) -> RowSet:
    """Select the rows that `method` applies to these views, the same for all points.

    Parameters
    ----------
    directions : array_like, shape (view, point, axis)
        Direction cosines; only ``best`` looks at them.

    Raises
    ------
    UserError
        If the rows name no view, are not the method's, or are too few for its model.
    """
    choice = method.row_choice(view_names)
    intercept = method.model is Model.full
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
    check(rows, choice, _needed(method))
    if intercept and not rows.has_views:
        raise UserError(
            f"the full model cannot be fitted to {rows}: an intercept cancels in every difference; "
            "use model=partial or add a single view"
        )
    return rows


def _needed(method: Reconstruction) -> int:
    """Count the rows needed: fewer than three views still determine some components.

    An intercept needs them all.
    """
    return 4 if method.model is Model.full else 1


#: Sets beyond this number are not all searched: it would take longer than reading the data.
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
    """Search the set of `size` rows with the largest reciprocal condition number.

    One set serves all points of a data set, so that its results are comparable from point to
    point: the one whose median over points evenly spread over the data set is largest. Views that
    determine fewer than all parameters are ranked by the ratio of the singular values that exist.

    Parameters
    ----------
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
        Its `note` says so if there were too many sets to look at each.

    Raises
    ------
    UserError
        If there are not enough independent rows.

    Examples
    --------
    Of two views that nearly agree only one is of use:

    >>> import numpy as np
    >>> from sldvexp.reconstruction import best_rows, rows
    >>> directions = np.array([[1, 0, 0], [0.995, 0.0999, 0], [0, 1, 0], [0, 0, 1]])[:, None]
    >>> str(best_rows(rows.views("abcd"), directions, 3, intercept=False, tolerance=1e-4))
    'a,c,d'
    """
    if np.linalg.matrix_rank(candidates.matrix) < size:
        raise UserError(
            f"the best {size} rows are asked for, but {directions.shape[0]} views do not have "
            f"{size} independent rows of this method; more views are needed"
        )
    count = len(candidates)
    sets = comb(count, size)
    whole = sets <= LARGEST_SEARCH
    step = 1 if whole else -(-count // _searchable(size))
    points = _spread(directions.shape[1], max(1, EFFORT // comb(-(-count // step), size)))
    matrices = candidates.matrix @ design(directions[:, points], intercept)
    rank = int(rank_of(matrices, tolerance).max())
    score = partial(_score, matrices, rank)
    if whole:
        return candidates.take(_best_of(combinations(range(count), size), score))
    starts = range(min(step, STARTS))
    of_some = (_best_of(combinations(range(k, count, step), size), score) for k in starts)
    best = _best_of([_exchanged(each, count, score) for each in of_some], score)
    return replace(candidates.take(best), note=GREEDY.format(rows=count, sets=sets, size=size))


#: From how many best sets of some candidates rows are exchanged.
STARTS = 8
#: How the best rows were found where there are too many sets of them.
GREEDY = (
    "{rows} candidate rows have {sets} sets of {size}: the best of some were improved row by row, "
    "and no exchange of one row is better"
)


def _searchable(size: int) -> int:
    """Count how many candidates have few enough sets for each to be looked at in a second."""
    return next(n for n in count_from(size) if comb(n + 1, size) > EFFORT)


def _score(matrices: Array, rank: int, sets: IndexArray) -> Array:
    """Compute the median over the points of what sets, shape (set, size), are ranked by."""
    return np.round(np.median(_scores(matrices[:, sets], rank), axis=0), DIGITS)


def _best_of(
    sets: Iterable[Sequence[int] | IndexArray], score: Callable[[IndexArray], Array]
) -> IndexArray:
    """Return the first of those sets whose score is largest."""
    best, best_score, left = np.array([], int), -1.0, iter(sets)
    while chunk := list(islice(left, SETS_AT_ONCE)):
        indices = np.array(chunk)
        scores = score(indices)
        if scores.max() > best_score:
            best, best_score = indices[np.argmax(scores)], scores.max()
    return best


def _exchanged(best: IndexArray, count: int, score: Callable[[IndexArray], Array]) -> IndexArray:
    """Exchange one row of a set after the other until no exchange makes it better."""
    while True:
        before = best
        for place in range(len(best)):
            left = np.setdiff1d(np.arange(count), np.delete(best, place))
            tried = np.repeat(best[None], len(left) + 1, axis=0)
            tried[1:, place] = left  # its own row first: only a better one takes its place
            best = _best_of(tried, score)
        if np.array_equal(before, best):
            return np.sort(best)


def _scores(matrices: Array, rank: int) -> Array:
    """Compute reciprocal conditions of square matrices, in as many dimensions as they can span."""
    if rank == matrices.shape[-1]:
        return reciprocal_condition(matrices)
    sigma = np.linalg.svd(matrices, compute_uv=False)
    return sigma[..., rank - 1] / sigma[..., 0]


def _spread(count: int, at_most: int) -> NDArray[np.int_]:
    """Spread at most so many indices of points evenly, the middle one if there is only one."""
    if count <= at_most:
        return np.arange(count)
    edges = np.linspace(0, count, at_most + 1)
    return ((edges[:-1] + edges[1:]) / 2).astype(int)
