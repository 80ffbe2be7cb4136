"""Model of each sample: what a method makes of the views that see it.

All methods model ``A v = A X theta`` with the rows A and ``X = [D]`` or ``[D 1]``. With the weights
W of the rows, and ``Q = A^T W A`` of the views, the normal equations at a sample are ``N theta = T
v``, ``N = X^T Q X`` and ``T = X^T Q``. The contravariant method solves each sample by itself, ``u =
N^-1 T v``, and fits the field to these vectors; the others fit it to all rows together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.field.visibility.projection import CYCLES, ViewSamples
from sldvexp.field.visibility.view import View
from sldvexp.field.visibility.visibility import SampleVisibility, VolumeVisibility
from sldvexp.lazy import scipy
from sldvexp.reconstruction import Model, Reconstruction, RowSet, Weights
from sldvexp.reconstruction.least_squares import rank_of
from sldvexp.typing import Array, BoolArray, IndexArray

#: Samples that stay in the cache, whatever is computed of them.
SAMPLES_IN_CACHE = 4096
#: Fewest rows that make a sample worth keeping.
FEWEST_ROWS = 2
#: Components of a velocity.
AXES = len(CYCLES)


@dataclass(frozen=True, eq=False)
class RowWeights:
    """Weights of the views at samples, ``Q = diag(d) + s F^T F`` with few rows F.

    Attributes
    ----------
    diagonal : ndarray, shape (sample, view)
        Of d.
    factor : ndarray, shape (sample, factor_row, view)
        The matrix F.
    sign : ndarray, shape (sample,)
        Of s, 1 or -1.
    """

    diagonal: Array
    factor: Array
    sign: Array

    def __getitem__(self, here: slice | IndexArray | BoolArray) -> RowWeights:
        return RowWeights(self.diagonal[here], self.factor[here], self.sign[here])

    def times(self, x: Array) -> Array:
        """Multiply Q by vectors, shape (sample, view, column)."""
        if self.is_everywhere:
            factor = self.factor[:1]
            return np.asarray(self.sign[:, None, None] * ((np.swapaxes(factor, 1, 2) @ factor) @ x))
        if not self.factor.shape[1]:
            return np.asarray(self.diagonal[..., None] * x)
        # As arrays of their own, transposed matrices are multiplied three times as fast.
        transposed = np.ascontiguousarray(np.swapaxes(self.factor, 1, 2))
        of_factor = transposed @ (self.sign[:, None, None] * (self.factor @ x))
        of_factor += self.diagonal[..., None] * x
        return of_factor

    def times_last(self, x: Array) -> Array:
        """Multiply Q by vectors that have the sample last, shape (view, column, sample)."""
        if self.is_everywhere:
            f = self.factor[0]
            return np.asarray(self.sign * np.tensordot(f.T @ f, x, axes=1))
        found = self.diagonal.T[:, None] * x
        if self.factor.shape[1]:
            f = np.moveaxis(self.factor, 0, -1).copy()
            of_rows = self.sign * np.einsum("rvs,vcs->rcs", f, x)
            found += np.einsum("rvs,rcs->vcs", f, of_rows)
        return found

    @property
    def is_everywhere(self) -> bool:
        """Whether Q is the same at all samples, but for its sign."""
        return not self.factor.strides[0] and not self.diagonal.any()

    def of_views(self, j: int, k: int) -> Array:
        """Take an entry of Q, shape (sample,)."""
        product = np.einsum("sr,sr->s", self.factor[:, :, j], self.factor[:, :, k])
        return self.sign * product + (self.diagonal[:, j] if j == k else 0.0)

    def have(self, k: int) -> bool:
        """Tell whether any of the rows has the view."""
        return bool(self.diagonal[:, k].any() or self.factor[:, :, k].any())


@dataclass(frozen=True, eq=False)
class SampleLeastSquares:
    """Least squares of the rows at samples.

    Matrices have the sample first, but an entry of all samples is contiguous in memory.

    Attributes
    ----------
    design : ndarray, shape (sample, view, parameter)
        The matrix X; rows of views that do not see the sample are zero.
    weight : RowWeights
        The matrix Q; zero where a sample is not kept.
    rank : ndarray of int, shape (sample,)
        How many parameters the rows determine at the sample alone.
    rows : ndarray of int, shape (sample,)
        How many rows there are; 0 where a sample is not kept.
    determined : bool
        Whether the method's own rows determine all parameters at every sample.
    """

    design: Array
    weight: RowWeights
    rank: NDArray[np.int_]
    rows: NDArray[np.int_]
    determined: bool

    @property
    def kept(self) -> BoolArray:
        """Samples that have a part in the field, shape (sample,)."""
        return self.rows > 0

    @cached_property
    def estimator(self) -> Array:
        """The matrix T of the normal equations, shape (sample, parameter, view)."""
        count, views, parameters = self.design.shape
        found = np.empty((views, parameters, count))
        for here, _, t in self._some_estimators():
            found[..., here] = t
        return found.T

    @cached_property
    def information(self) -> Array:
        """The matrix N of the normal equations, shape (sample, parameter, parameter)."""
        count, _, parameters = self.design.shape
        found, estimator = np.empty((parameters, parameters, count)), self.estimator.T
        for first in range(0, count, SAMPLES_IN_CACHE):
            here = slice(first, first + SAMPLES_IN_CACHE)
            x = np.ascontiguousarray(np.moveaxis(self.design[here], 0, -1))
            found[..., here] = _gram(estimator[..., here], x)
        return found.T

    def solutions(self) -> tuple[Array, Array]:
        """Solve each sample by itself; 0 where it is not kept.

        Returns
        -------
        inverse : ndarray, shape (sample, parameter, parameter)
            Of N.
        solution : ndarray, shape (sample, parameter, view)
            The matrix H of ``u = H v``.
        """
        count, views, parameters = self.design.shape
        inverse = np.empty((parameters, parameters, count))
        solution = np.empty((views, parameters, count))
        every = self.kept
        for here, x, t in self._some_estimators():
            kept, n = every[here], _gram(t, x)
            if not kept.all():
                n[..., ~kept] = np.eye(parameters)[..., None]
                t[..., ~kept] = 0.0
            of_some = _inverse(n)
            solution[..., here] = np.einsum("pqs,vqs->vps", of_some, t)
            of_some[..., ~kept] = 0.0
            inverse[..., here] = of_some
        return inverse.T, solution.T

    def _some_estimators(self) -> Iterator[tuple[slice, Array, Array]]:
        """Multiply T of some samples, which are last: X and T, (view, parameter, sample)."""
        for first in range(0, len(self.design), SAMPLES_IN_CACHE):
            here = slice(first, first + SAMPLES_IN_CACHE)
            x = np.ascontiguousarray(np.moveaxis(self.design[here], 0, -1))
            yield here, x, self.weight[here].times_last(x)


def _gram(t: Array, x: Array) -> Array:
    """Multiply ``N = T X``, symmetric, of samples that are last."""
    parameters = x.shape[1]
    n = np.empty((parameters, parameters, x.shape[-1]))
    for p, q in np.ndindex(parameters, parameters):
        if p <= q:
            n[p, q] = n[q, p] = np.einsum("vs,vs->s", t[:, p], x[:, q])
    return n


@dataclass(frozen=True, eq=False)
class RowModel:
    """Rows, and how they are weighted.

    Parameters
    ----------
    rows : ndarray, shape (row, view)
        The matrix A.
    generalised : bool
        Weighted by the inverse of the rows' covariance; otherwise all alike.
    tolerance : float
        Relative singular value below which a direction counts as not determined.
    complete : bool
        Keep only samples whose rows determine all parameters.
    instead : bool
        Where a view of the rows does not see a sample, take all that do, weighted by their noise.
    """

    rows: Array
    intercept: bool
    generalised: bool
    tolerance: float
    complete: bool
    instead: bool = False

    @property
    def parameters(self) -> int:
        """Unknowns at a point."""
        return 4 if self.intercept else 3

    def at(
        self, directions: Array, valid: BoolArray, std: Array, *, determined: bool = False
    ) -> SampleLeastSquares:
        """Set up the rows' least squares at samples.

        A row that needs a view which does not see the sample drops out. Weighted by their
        covariance, rows are as good as any others that span the same: then those combinations of
        them are left that need no such view.

        Parameters
        ----------
        directions : ndarray, shape (sample, view, 3)
            Direction cosines, in the axes of the velocity's components.
        valid : ndarray of bool, shape (sample, view)
        std : ndarray, shape (sample, view)
            Of the views' velocities; only their ratios matter, and only if `generalised`.
        determined : bool
            Whether the rows are known to determine all parameters at every one of these samples.
        """
        design = directions if valid.all() else directions * valid[..., None]
        if self.intercept:
            design = np.concatenate([design, valid[..., None].astype(float)], axis=-1)
        samples, views = valid.shape
        rank, rows = np.zeros(samples, int), np.zeros(samples, int)
        found: list[tuple[slice | IndexArray, RowWeights]] = []
        for pattern, here in _patterns(valid):
            left = self._rows_of(pattern)
            if len(left) < FEWEST_ROWS:
                continue
            basis = np.linalg.svd(left, full_matrices=False)[2][: np.linalg.matrix_rank(left)]
            # All views span what any basis of them does.
            turned = None if len(basis) == views else basis
            rank[here] = (
                self.parameters if determined else rank_of(design[here], self.tolerance, turned)
            )
            rows[here] = len(left)
            found.append((here, self._weights(basis, left, valid[here], std[here])))
        determined = bool(np.all(rank == self.parameters))
        if self.complete:
            rows[rank < self.parameters] = 0
        found = [_where(rows > 0, here, weight) for here, weight in found]
        if self.instead and (lost := rows == 0).any():
            by_all = replace(self, rows=np.eye(views), generalised=True, instead=False)
            other = by_all.at(directions[lost], valid[lost], std[lost])
            found.append((np.flatnonzero(lost), other.weight))
            rank[lost], rows[lost] = other.rank, other.rows
        weight = _joined(found, valid.shape)
        return SampleLeastSquares(design, weight, rank, rows, determined)

    def _rows_of(self, seen: BoolArray) -> Array:
        """Select rows that need none of the views that do not see a sample."""
        if not self.generalised:
            return self.rows[~np.any(self.rows[:, ~seen] != 0, axis=1)]
        if seen.all():
            return self.rows
        u, sigma, _ = np.linalg.svd(self.rows[:, ~seen])
        used = int(np.sum(sigma > 1e-9))
        left = u[:, used:].T @ self.rows
        left[:, ~seen] = 0
        return left[np.abs(left).max(axis=1) > 1e-9]

    def _weights(self, basis: Array, left: Array, valid: BoolArray, std: Array) -> RowWeights:
        """Compute ``A^T A``, or ``A^T (A Sigma A^T)^-1 A`` with Sigma of the views.

        With a basis C of what the rows do not see, the latter is
        ``S - S C (C^T S C)^-1 C^T S``, ``S = Sigma^-1``; the shorter of both is taken.
        """
        samples, views = valid.shape
        sign = np.ones(samples)
        if not self.generalised:
            few: Array = left if len(left) <= views else np.asarray(np.linalg.qr(left, mode="r"))
            return RowWeights(
                np.zeros(valid.shape), np.broadcast_to(few, (samples, *few.shape)), sign
            )
        variance = np.where(valid, std, 1.0) ** 2
        seen = valid[0]
        blind = np.linalg.svd(basis[:, seen])[2][len(basis) :]
        if len(basis) < len(blind):
            covariance = (basis * variance[:, None]) @ basis.T
            factor: Array = np.asarray(
                np.linalg.solve(np.linalg.cholesky(covariance), basis), float
            )
            return RowWeights(np.zeros(valid.shape), factor, sign)
        inverse = valid / variance
        unseen = np.zeros((len(blind), views))
        unseen[:, seen] = blind
        scaled = unseen * inverse[:, None]
        factor = np.linalg.solve(np.linalg.cholesky(scaled @ unseen.T), scaled)
        return RowWeights(inverse, factor, -sign)


def _where(
    kept: BoolArray, here: slice | IndexArray, weight: RowWeights
) -> tuple[slice | IndexArray, RowWeights]:
    """Keep the weights of some samples; nothing is copied where all are kept."""
    if kept[here].all():
        return here, weight
    return np.arange(len(kept))[here][kept[here]], weight[kept[here]]


def _patterns(valid: BoolArray) -> Iterator[tuple[BoolArray, slice | IndexArray]]:
    """Go through the sets of views that see samples, with the samples that each set sees.

    Those are a slice, so that nothing is copied, where the same views see all. Eight views are one
    number; a few of these numbers, put in order, number the sets so far.
    """
    if len(valid) and (valid.all() or np.array_equal(valid.all(axis=0), valid.any(axis=0))):
        yield valid[0], slice(None)
        return
    code = np.zeros(len(valid), np.intp)
    for eight in np.packbits(valid, axis=1).T:
        _, code = np.unique(256 * code + eight, return_inverse=True)
    order = np.argsort(code, kind="stable")
    ends = np.cumsum(np.bincount(code))
    for here in np.split(order, ends[:-1]):
        yield valid[here[0]], here


def _joined(
    parts: list[tuple[slice | IndexArray, RowWeights]], shape: tuple[int, int]
) -> RowWeights:
    """Join weights of some samples each; those of the others are zero."""
    if len(parts) == 1 and isinstance(parts[0][0], slice):
        return parts[0][1]
    rows = max((weight.factor.shape[1] for _, weight in parts), default=0)
    whole = RowWeights(np.zeros(shape), np.zeros((shape[0], rows, shape[1])), np.ones(shape[0]))
    for here, weight in parts:
        whole.diagonal[here], whole.sign[here] = weight.diagonal, weight.sign
        whole.factor[here, : weight.factor.shape[1]] = weight.factor
    return whole


#: Ratio of the weights of samples that are told apart.
STEP = np.sqrt(2)
#: Triangles that are looked at to choose the best rows.
TRIANGLES_FOR_ROWS = 200


@dataclass(frozen=True, eq=False)
class SampleContributions:
    """Contributions of samples, ``sum_s B_s^T B_s (x) N_s theta = sum_s B_s^T (x) T_s v_s``.

    Attributes
    ----------
    weight : ndarray, shape (sample, 1, 1), optional
        Contravariant only: of the sample, w.
    estimator : ndarray, shape (sample, parameter, view)
        T_s. The contravariant method's is ``w H`` with the sample's own solution ``u = H v``.
    inverse : ndarray, shape (sample, parameter, parameter), optional
        Contravariant only: of the sample's own normal equations.
    own : ndarray, shape (sample, parameter, view), optional
        Contravariant only: the matrix H.
    std : ndarray, shape (sample, view), m/s
        Mean standard error of the pixels around a sample. That of the interpolated velocity is
        smaller between pixels than on them, but its errors are then shared with more samples.
    """

    pointwise: SampleLeastSquares
    weight: Array | None
    estimator: Array
    inverse: Array | None
    own: Array | None
    std: Array

    @property
    def information(self) -> Array:
        """The matrix N_s, shape (sample, block, block).

        The contravariant method's is the sample's weight: all components have the same equations.
        """
        return self.pointwise.information if self.weight is None else self.weight

    @property
    def solution(self) -> Array:
        """Contravariant only: the matrix H, shape (sample, parameter, view)."""
        assert self.own is not None
        return self.own


@dataclass(frozen=True, eq=False)
class FieldModel:
    """A method with its rows, for these views.

    Parameters
    ----------
    local : bool
        Components along the surface's tangents and normal instead of the world's axes.
    pixel_std : tuple of ndarray, shape (pixel,), m/s
        Of each view: root mean square over the frequencies.
    """

    method: Reconstruction
    rows: RowSet
    local: bool
    pixel_std: tuple[Array, ...]

    @classmethod
    def from_method(
        cls, method: Reconstruction, visibility: VolumeVisibility, local: bool
    ) -> FieldModel:
        """Choose the rows; one set serves the whole field."""
        some = _spread(len(visibility.prisms.triangles))
        samples = visibility.at(some)
        by_all = samples.valid.all(axis=1)
        points = samples.directions[by_all if by_all.any() else slice(None)]
        rows = method.row_set(np.swapaxes(points, 0, 1), visibility.names)
        model = cls(method, rows, local, tuple(_pixel_std(v) for v in visibility.views))
        model._check_rows()
        model._check_std(visibility.views)
        return model

    @property
    def contravariant(self) -> bool:
        """Whether samples are solved one by one before the field is."""
        return self.method.sample_by_sample

    @property
    def intercept(self) -> bool:
        """Whether nodes have an intercept."""
        return self.method.model is Model.full

    @property
    def generalised(self) -> bool:
        """Whether rows are weighted by their noise."""
        return self.method.weights is Weights.noise

    @property
    def parameters(self) -> int:
        """Unknowns of a node."""
        return 4 if self.intercept else 3

    @property
    def block(self) -> int:
        """Unknowns of a node that the normal equations couple."""
        return 1 if self.contravariant else self.parameters

    @property
    def variance(self) -> float:
        """Variance that weights are relative to: the mean over the views' pixels, or 1, m2/s2."""
        if not self.generalised:
            return 1.0
        return float(np.mean(np.concatenate(self.pixel_std) ** 2))

    @property
    def row_model(self) -> RowModel:
        """Rows at a sample; weights say nothing where each is solved exactly."""
        exact = self.contravariant and len(self.rows) == self.parameters
        return RowModel(
            self.rows.matrix,
            self.intercept,
            self.generalised and not exact,
            self.method.rank_tolerance,
            complete=self.contravariant,
            instead=exact and self.generalised and self.method.rows.strip() == "best",
        )

    def directions(self, samples: SampleVisibility) -> Array:
        """Turn direction cosines into the components' axes, shape (sample, view, 3)."""
        world = samples.directions
        return world @ np.swapaxes(samples.frame, 1, 2) if self.local else world

    def at(
        self, samples: SampleVisibility, std: Array | None = None, *, determined: bool = False
    ) -> SampleContributions:
        """Set up what samples contribute.

        Parameters
        ----------
        std : ndarray, shape (sample, view), m/s, optional
            See `SampleContributions`; where another model of the same pixels has it already.
        determined : bool
            See `RowModel.at`.
        """
        if std is None:
            each = zip(samples.by_view, self.pixel_std, strict=True)
            std = np.stack([_mean_std(*of_view) for of_view in each]).T
        relative = std / np.sqrt(self.variance) if self.generalised else std
        directions = self.directions(samples)
        pointwise = self.row_model.at(directions, samples.valid, relative, determined=determined)
        if not self.contravariant:
            return SampleContributions(pointwise, None, pointwise.estimator, None, None, std)
        inverse, solution = pointwise.solutions()
        weight = pointwise.kept.astype(float)
        if self.generalised:
            weight *= self._weights(directions, samples.valid, solution, relative)
        # Weights of samples that are not kept are 0, and so is the solution there.
        alike = bool(np.all(weight[pointwise.kept] == 1))
        weight = weight[:, None, None]
        estimator = solution if alike else weight * solution
        return SampleContributions(pointwise, weight, estimator, inverse, solution, std)

    def _weights(
        self, directions: Array, valid: BoolArray, solution: Array, relative: Array
    ) -> Array:
        """Weigh samples by the inverse of their variance, shape (sample,).

        It is that over what the same rows had there if all views saw the sample, each with its
        mean noise; in steps, so that samples that are all seen weigh exactly alike and the matrix
        stays a Kronecker product.
        """
        std = np.array([np.sqrt(np.mean(s[s > 0] ** 2)) for s in self.pixel_std])
        mean = np.broadcast_to(std / np.sqrt(self.variance), valid.shape)
        variance, usual = _variances(solution, relative, mean)
        # Seen by all and rows all alike: its own solution is the one by all.
        others = np.ones(len(valid), bool) if self.row_model.generalised else ~valid.all(axis=1)
        if others.any():
            seen = np.ones_like(valid[others])
            by_all = self.row_model.at(directions[others], seen, mean[others])
            (usual[others],) = _variances(by_all.solutions()[1], mean[others])
        ratio = np.divide(
            usual, variance, out=np.ones_like(usual), where=(usual > 0) & (variance > 0)
        )
        return np.asarray(STEP ** np.round(np.log(ratio) / np.log(STEP)))

    def _check_rows(self) -> None:
        independent = int(np.linalg.matrix_rank(self.rows.matrix))
        if independent < self.parameters:
            what = "three components and an intercept" if self.intercept else "three components"
            raise UserError(
                f"field: the rows {self.rows} are {independent} independent ones, which cannot "
                f"determine {what} anywhere; {self.parameters} are needed, so take more views"
            )

    def _check_std(self, views: Sequence[View]) -> None:
        if not self.generalised:
            return
        for view, std in zip(views, self.pixel_std, strict=True):
            zero = np.flatnonzero((std <= 0) & view.usable)
            if len(zero):
                raise UserError(
                    f"view {view.name}: the standard error of pixel {zero[0]} is 0, so that "
                    "weights=noise would trust it beyond all others; use weights=equal"
                )


def _inverse(m: Array) -> Array:
    """Invert symmetric matrices, the samples last: (parameter, parameter, sample).

    Those of three rows a, b, c by ``b x c, c x a, a x b`` over ``|a b c|``: element by element over
    all of them that is ten times as fast as LAPACK, one after the other.
    """
    if len(m) != AXES:
        return np.moveaxis(np.asarray(np.linalg.inv(np.moveaxis(m, -1, 0)), float), 0, -1)
    inverse = np.empty_like(m)
    for i, j, k in CYCLES:
        for p, q, r in CYCLES:
            inverse[p, i] = m[j, q] * m[k, r] - m[j, r] * m[k, q]
    inverse /= sum(m[0, p] * inverse[p, 0] for p in range(AXES))
    return inverse


def _variances(solution: Array, *stds: Array) -> list[Array]:
    """Average the variance of a sample's components, shape (sample,), with each noise of views."""
    components = solution[:, :AXES]
    squares = np.einsum("spk,spk->sk", components, components)
    return [np.einsum("sk,sk->s", squares, std**2) / AXES for std in stds]


def _pixel_std(view: View) -> Array:
    """Take root mean squares over frequencies; 0 where a pixel is flagged."""
    square = np.square(view.std).reshape(len(view.std), -1).mean(axis=1)
    return np.where(view.usable, np.sqrt(np.where(view.usable, square, 0.0)), 0.0)


def _mean_std(samples: ViewSamples, pixel_std: Array) -> Array:
    """Average the variance of the pixels around each sample; 0 where there are none."""
    weights = samples.weights
    size = scipy.sparse.csr_array(
        (np.abs(weights.data), weights.indices, weights.indptr), shape=weights.shape
    )
    mean, total = (size @ np.stack([pixel_std**2, np.ones_like(pixel_std)], axis=1)).T
    return np.sqrt(mean / np.where(total > 0, total, 1.0))


def _spread(count: int) -> IndexArray:
    """Choose some triangles, evenly spread."""
    number = min(count, TRIANGLES_FOR_ROWS)
    return np.unique(np.linspace(0, count - 1, number).round().astype(np.intp))
