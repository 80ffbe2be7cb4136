"""Least squares with two penalties whose weights are averaged over by their evidence.

With whitened data ``y = A theta + e`` of unit variance and priors ``exp(lam_j) P_j`` of the
coefficients' precision, ``H = A'A + sum_j exp(lam_j) P_j``, the restricted likelihood is

    -2 log L(lam) = y'y - y'A H^-1 A'y + log|H| - sum_j (rank_j lam_j + log|P_j|+) + constant

(Patterson and Thompson 1971; Wahba 1985). One optimum of it would hide how little data may say of a
weight. So a grid of weights is averaged over, each counting by its likelihood and a prior that is
flat in lam_1 and, in the standard deviation tau = exp(-lam_2/2) of the other, half-Cauchy
``1 / (1 + (tau / s)^2)`` with a typical size s (Gelman 2006). It is flat where tau is small, so
that "none at all" is a limit of the model, and gives way where data tell of much; where they tell
nothing, as one view does of the motion along a surface, it keeps the mean from a share of all that
might be. Means and variances are those of the mixture: bounds carry the doubt about the weights,
and "no membrane" needs no option of its own.

Penalties do not share coefficients. With those of the second in the block m and all others in the
block b, a value of lam_1 gives ``H_bb = L L'``, ``C = L^-1 H_bm`` and the Schur complement
``S = N_mm - C'C`` (N = A'A), and one eigenproblem diagonalises S and P_2 together,

    G S G' = 1 - c D,  G P_2 G' = D:  (S + exp(lam_2) P_2)^-1 = G' (1 + (exp(lam_2) - c) D)^-1 G

for all lam_2 at once. With ``a = L^-1 f_b`` and ``g = G (f_m - C'a)`` of a functional f,

    f' H^-1 f = a'a + sum_i g_i^2 / (1 + (exp(lam_2) - c) D_i).

All columns of data share these factors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, IndexArray

#: Share of a weight in the average below which it is left out.
NEGLIGIBLE = 1e-3
#: Logarithm of a share that changes nothing, below which levels are not looked at.
UNSEEN = 40.0
#: Relative eigenvalue of a penalty that counts as zero.
NULL = 1e-9
#: Columns of data whose covariances are in memory together.
MATRICES = 16
#: Standard errors of an energy beyond which data reject a signal, one-sided at 5 %.
REJECTED = 1.645


class Blocks(NamedTuple):
    """Parts of a precision, and the second penalty.

    Attributes
    ----------
    inner, outer : ndarray of int
        Coefficients of the blocks b and m.
    of_inner, crossed, of_outer : ndarray
        The precision within b, between b and m, and within m but for the second penalty.
    penalty : ndarray, shape (outer, outer)
        P_2.
    """

    inner: IndexArray
    outer: IndexArray
    of_inner: Array
    crossed: Array
    of_outer: Array
    penalty: Array

    @classmethod
    def of(cls, precision: Array, penalty: Array) -> Blocks:
        """Split a precision by what the second penalty is one of, (coefficient, coefficient)."""
        of_second = penalty.any(axis=1)
        inner, outer = np.flatnonzero(~of_second), np.flatnonzero(of_second)
        of_inner, of_outer = (precision[np.ix_(own, own)] for own in (inner, outer))
        crossed = precision[np.ix_(inner, outer)]
        return cls(inner, outer, of_inner, crossed, of_outer, penalty[np.ix_(outer, outer)])


@dataclass(frozen=True, eq=False)
class Level:
    """Factors of H for one weight of the first penalty and all of the second.

    Attributes
    ----------
    inner, outer : ndarray of int
        Coefficients of the blocks b and m.
    lower : ndarray, shape (inner, inner)
        L.
    coupling : ndarray, shape (inner, outer)
        C.
    whitener : ndarray, shape (outer, outer)
        G.
    scale : ndarray, shape (outer, weight)
        ``1 / (1 + (exp(lam_2) - c) D)``.
    determinant : ndarray, shape (weight,)
        ``log|H|``, infinite where round-off hides the prior.
    """

    inner: IndexArray
    outer: IndexArray
    lower: Array
    coupling: Array
    whitener: Array
    scale: Array
    determinant: Array

    @classmethod
    def of(cls, blocks: Blocks, weights: Array) -> Level:
        """Factorise.

        Parameters
        ----------
        blocks : Blocks
            Of ``A'A + exp(lam_1) P_1``.
        weights : ndarray, shape (weight,)
            ``exp(lam_2)``, in their order.

        Raises
        ------
        numpy.linalg.LinAlgError
            If round-off hides what data and priors say, at all weights.
        """
        lower = _cholesky(blocks.of_inner)
        coupling = _solve(lower, blocks.crossed)
        schur = blocks.of_outer - coupling.T @ coupling
        root, first = _first_root(schur, blocks.penalty, weights)
        least = weights[first]
        inverse = _solve(root, np.eye(len(root)))
        values, vectors = np.linalg.eigh(inverse @ blocks.penalty @ inverse.T)
        whole = 1 + np.maximum(weights - least, 0.0) * np.maximum(values, 0.0)[:, None]
        diagonal = np.r_[np.diag(lower), np.diag(root)]
        determinant = 2 * np.log(diagonal).sum() + np.log(whole).sum(axis=0)
        # At the first root that there is, round-off may be as large as the prior.
        determinant[: first + 1 if first else 0] = np.inf
        whitener = vectors.T @ inverse
        inner, outer = blocks.inner, blocks.outer
        return cls(inner, outer, lower, coupling, whitener, 1 / whole, determinant)

    def whitened(self, columns: Array) -> tuple[Array, Array]:
        """Compute a and g of functionals or right sides, (coefficient, any)."""
        of_inner = _solve(self.lower, columns[self.inner])
        return of_inner, self.whitener @ (columns[self.outer] - self.coupling.T @ of_inner)

    @cached_property
    def inverse(self) -> tuple[Array, Array]:
        """Parts of ``H^-1``, that of b alone and the rows of the rest, ``T' diag(scale) T``."""
        size = len(self.inner) + len(self.outer)
        root = _solve(self.lower, np.eye(len(self.inner)))
        of_inner, rows = np.zeros((size, size)), np.zeros((len(self.outer), size))
        of_inner[np.ix_(self.inner, self.inner)] = root.T @ root
        rows[:, self.outer] = self.whitener
        rows[:, self.inner] = -self.whitener @ (self.coupling.T @ root)
        return of_inner, rows

    def whitened_twice(self, matrix: Array) -> tuple[Array, Array]:
        """Compute ``T M T'`` of a symmetric matrix within b and within m, before the scale.

        With ``T'T = H^-1`` at a weight, ``sqrt(scale_i scale_j)`` multiplies what is within m.
        """
        once = np.concatenate(self.whitened(matrix))
        own, others = self.whitened(once.T)
        size = len(self.inner)
        return own[:, :size], others[:, size:]

    def coefficients(self, of_inner: Array, of_outer: Array) -> Array:
        """Turn back what is whitened: ``H^-1 f`` is that of a and of g times the scale."""
        found = np.empty((len(self.inner) + len(self.outer), of_inner.shape[1]))
        found[self.outer] = self.whitener.T @ of_outer
        left = of_inner - self.coupling @ found[self.outer]
        found[self.inner] = scipy.linalg.solve_triangular(
            self.lower, left, lower=True, trans=1, check_finite=False
        )
        return found

    def condition(self, weight: int) -> float:
        """Compute the condition number of H."""
        size = len(self.inner)
        root = np.zeros((size + len(self.outer),) * 2)
        root[:size, :size], root[size:, :size] = self.lower, self.coupling.T
        root[size:, size:] = np.linalg.inv(self.whitener) / np.sqrt(self.scale[:, weight])
        return float(np.linalg.cond(root) ** 2)


@dataclass(frozen=True, eq=False)
class WeightedFit:
    """Posterior of the coefficients of several columns of data, a mixture over weights.

    Attributes
    ----------
    levels : list of Level
        One for every weight of the first penalty that counts.
    reduced : ndarray, shape (coefficient, column)
        ``A'y``.
    share : list of ndarray, shape (weight, column)
        Of each level's combinations in the average; all together they add up to 1.
    density : list of ndarray, shape (weight, column)
        Logarithms of likelihood and prior of each level's combinations, but for a constant.
    """

    levels: list[Level]
    reduced: Array
    share: list[Array]
    density: list[Array]

    @classmethod
    def of(
        cls,
        normal: Array,
        reduced: Array,
        squares: Array,
        penalties: Sequence[Array],
        grids: Sequence[Array],
        typical: float = np.inf,
    ) -> WeightedFit:
        """Fit, for every combination of weights of a grid.

        Parameters
        ----------
        normal : ndarray, shape (coefficient, coefficient)
            ``A'A``.
        reduced : ndarray, shape (coefficient, column)
            ``A'y``.
        squares : ndarray, shape (column,)
            ``y'y``.
        penalties : sequence of 2 ndarray, shape (coefficient, coefficient)
            Of different coefficients.
        grids : sequence of 2 ndarray
            Values of lam of each penalty, in their order.
        typical : float
            s; the prior is flat in tau without it.

        Raises
        ------
        numpy.linalg.LinAlgError
            If data and penalties together leave coefficients open, at all weights.
        """
        found = _Likelihood.of(
            normal, reduced, squares, penalties, grids, typical
        ).levels_that_count()
        density = [density for _, density in found]
        if not found or np.max(density) == -np.inf:
            raise np.linalg.LinAlgError("the data and both priors leave coefficients open")
        share = _shares(np.array(density))
        used = np.flatnonzero(share.any(axis=(1, 2)))
        levels = [found[i][0] for i in used]
        return cls(levels, reduced, [share[i] for i in used], [density[i] for i in used])

    def with_most(self, gained: Sequence[Array], part: float) -> WeightedFit:
        """Keep the combinations that let the second's coefficients be largest.

        An average shrinks what is too small to be found, and its variance falls with it. Bounds of
        what may have been overlooked are those of the largest that the data do not speak against.

        Parameters
        ----------
        gained : sequence of ndarray, shape (weight, column)
            Added to the density of each level's combinations.
        part : float
            Share of all combinations that is kept, those of the smallest lam_2.
        """
        density = np.array(self.density) + np.array(gained)
        share = np.exp(density - np.max(density, axis=(0, 1)))
        share /= share.sum(axis=(0, 1))
        by_weight = share.sum(axis=0)
        before = np.cumsum(by_weight, axis=0) - by_weight
        kept = np.clip(part - before, 0.0, by_weight) / np.where(by_weight > 0, by_weight, 1.0)
        # what is small beside all may be large beside the part
        return replace(self, share=list(_that_count(share * kept)))

    @property
    def condition(self) -> float:
        """Condition number of H, of the first weights that count."""
        return self.levels[0].condition(int(self.share[0].any(axis=1).argmax()))

    def mean(self) -> Array:
        """Average the coefficients, shape (coefficient, column)."""
        return self._mean

    @cached_property
    def _mean(self) -> Array:
        return np.asarray(sum(self._averaged(self.reduced, self.share)))

    @cached_property
    def _whitened(self) -> list[tuple[Array, Array]]:
        return [level.whitened(self.reduced) for level in self.levels]

    def solve(self, right: Array, column: int) -> Array:
        """Compute ``H^-1 right``, averaged over the weights of a column of data.

        Parameters
        ----------
        right : ndarray, shape (coefficient, any)
        column : int
        """
        return np.asarray(sum(self._averaged(right, [s[:, [column]] for s in self.share])))

    def _averaged(self, right: Array, share: list[Array]) -> Iterator[Array]:
        """Give the parts of the average of ``H^-1 right``, of columns with their own shares."""
        for level, of_level in zip(self.levels, share, strict=True):
            if of_level.any():
                of_inner, of_outer = level.whitened(right)
                scale = level.scale @ of_level
                yield level.coefficients(of_inner * of_level.sum(axis=0), of_outer * scale)

    def overlooked(self, noise: Array, energy: Array, count: int) -> Array:
        """Bound signal in columns of data that are taken for noise, over their noise.

        Coefficients of each block, whitened by ``T'T = H^-1`` of the last column, have the energy
        ``count tr K`` with ``K = T C T'`` if there is noise alone, with the standard error
        ``sqrt(2 count) |K|``. Signal is the most that the energy does not reject.

        Parameters
        ----------
        noise : ndarray, shape (coefficient, coefficient)
            C, the covariance of ``A'y`` of one of them if it is noise.
        energy : ndarray, shape (coefficient, coefficient)
            ``A'Y Y'A`` of these columns.
        count : int
            How many they are.

        Returns
        -------
        ndarray, shape (2,)
            Signal over noise of the block b and of the block m given b, as variances.
        """
        over = np.zeros(2)
        for level, scales, shares in self._of_last():
            both = zip(*(level.whitened_twice(m) for m in (noise, energy)), strict=True)
            for k, (own, found) in enumerate(both):
                # (weight, coefficient): only within m a weight scales anything
                scale = scales.T if k else np.ones((len(shares), len(own)))
                alone = count * scale @ np.diag(own)
                norm = np.sqrt(np.sum((scale @ own**2) * scale, axis=1))
                most = scale @ np.diag(found) - alone + REJECTED * np.sqrt(2 * count) * norm
                over[k] += shares @ (np.maximum(most, 0.0) / alone)
        return over

    def by_block(self) -> tuple[Array, Array]:
        """Split the covariance of the last column by the blocks b and m, given b."""
        size = len(self.reduced)
        own, others = np.zeros((2, size, size))
        for level, scales, shares in self._of_last():
            of_inner, rows = level.inverse
            own += shares.sum() * of_inner
            others += rows.T @ ((scales @ shares)[:, None] * rows)
        return own, others

    def _of_last(self) -> Iterator[tuple[Level, Array, Array]]:
        """Give levels with the scales of the weights that count for the last column, and shares."""
        for level, share in zip(self.levels, self.share, strict=True):
            counts = share[:, -1] > 0
            if counts.any():
                yield level, level.scale[:, counts], share[counts, -1]

    def covariance(self, column: int) -> Array:
        """Compute the covariance of a column's coefficients: all variances are made of it.

        It is that of the mixture, ``sum share (H^-1 + (theta - mean) (theta - mean)')``.
        """
        if self.reduced.shape[1] > MATRICES:
            return self._covariance(column)
        if column not in self._covariances:
            self._covariances[column] = self._covariance(column)
        return self._covariances[column]

    @cached_property
    def _covariances(self) -> dict[int, Array]:
        """Covariances of columns that were asked for, where these are few."""
        return {}

    def _covariance(self, column: int) -> Array:
        mean, found = self._mean[:, [column]], np.zeros((len(self.reduced),) * 2)
        for level, (of_data, to_data), share in zip(
            self.levels, self._whitened, self.share, strict=True
        ):
            used = share[:, column] > 0
            if not used.any():
                continue  # not of the part that was kept
            own, scale = share[used, column], level.scale[:, used]
            of_inner, rows = level.inverse
            found += own.sum() * of_inner
            scaled = np.sqrt(scale @ own)[:, None] * rows
            found += scaled.T @ scaled
            inner = np.broadcast_to(of_data[:, [column]], (len(of_data), len(own)))
            apart = level.coefficients(inner, scale * to_data[:, [column]]) - mean
            found += (own * apart) @ apart.T
        return found


class _Evaluated(NamedTuple):
    """Parts of the likelihood at a level.

    Attributes
    ----------
    level : Level
    explained : ndarray, shape (weight, column)
        ``y'A H^-1 A'y``, which falls with lam_1.
    volume : ndarray, shape (weight,)
        ``log|H| - sum_j (rank_j lam_j + log|P_j|+)``, which falls with lam_1 as well.
    """

    level: Level
    explained: Array
    volume: Array


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Restricted likelihood of data, and prior, over the grid of weights."""

    blocks: Blocks
    first: Array
    reduced: Array
    squares: Array
    grids: tuple[Array, Array]
    rank: int
    constant: Array
    of_tau: Array

    @classmethod
    def of(
        cls,
        normal: Array,
        reduced: Array,
        squares: Array,
        penalties: Sequence[Array],
        grids: Sequence[Array],
        typical: float,
    ) -> _Likelihood:
        (first, second), (own, other) = penalties, grids
        blocks = Blocks.of(normal, second)
        first = first[np.ix_(blocks.inner, blocks.inner)]
        (rank, log), (other_rank, other_log) = (
            _rank_and_log_determinant(p) for p in (first, blocks.penalty)
        )
        constant = log + other_rank * other + other_log
        # A step of lam_2 is one of tau / 2 in tau.
        of_tau = -other / 2 - np.log1p(np.exp(-other) / typical**2)
        return cls(blocks, first, reduced, squares, (own, other), rank, constant, of_tau)

    def levels_that_count(self) -> list[tuple[Level, Array]]:
        """Evaluate all levels but those that cannot count, with their densities.

        Between two levels there is no more explained than at the first, and no less volume than at
        the second: no density there is above the one of both together.
        """
        last = len(self.grids[0]) - 1
        known = {k: self._at(k) for k in {0, last}}
        gaps = [(0, last)] if last > 1 else []
        best = self._best(known.values())
        while gaps:
            most = [np.max(self._most(known[a], known[b]) - best) for a, b in gaps]
            k = int(np.argmax(most))
            if most[k] < -UNSEEN:
                break
            a, b = gaps.pop(k)
            middle = (a + b) // 2
            known[middle] = self._at(middle)
            best = self._best(known.values())
            gaps += [gap for gap in ((a, middle), (middle, b)) if gap[1] - gap[0] > 1]
        found = [known[k] for k in sorted(known)]
        return [
            (one.level, self._density(one.explained, one.volume))
            for one in found
            if one is not None
        ]

    def _at(self, k: int) -> _Evaluated | None:
        """Evaluate a level; none where round-off of so strong a prior hides what the data say."""
        lam, other = self.grids[0][k], self.grids[1]
        of_inner = self.blocks.of_inner + np.exp(lam) * self.first
        try:
            level = Level.of(self.blocks._replace(of_inner=of_inner), np.exp(other))
        except np.linalg.LinAlgError:
            return None
        inner, outer = level.whitened(self.reduced)
        explained = (inner**2).sum(axis=0) + level.scale.T @ outer**2
        return _Evaluated(level, explained, level.determinant - self.rank * lam - self.constant)

    def _density(self, explained: Array, volume: Array) -> Array:
        """Compute logarithms of likelihood and prior, shape (weight, column)."""
        return np.asarray(-(self.squares - explained + volume[:, None]) / 2 + self.of_tau[:, None])

    def _best(self, known: Iterable[_Evaluated | None]) -> Array:
        """Find the largest density of every column; without any one none counts for nothing."""
        found = [self._density(k.explained, k.volume) for k in known if k is not None]
        return np.max(found, axis=(0, 1)) if found else np.full(len(self.squares), -np.inf)

    def _most(self, before: _Evaluated | None, after: _Evaluated | None) -> Array:
        """Bound the densities between two levels, shape (weight, column)."""
        if before is None or after is None:
            return np.full((len(self.of_tau), len(self.squares)), np.inf)
        hidden = np.isinf(before.volume) | np.isinf(after.volume)
        bound = self._density(before.explained, after.volume)
        return np.where(hidden[:, None], np.inf, bound)


def _shares(density: Array) -> Array:
    """Compute shares of combinations, (level, weight, column), from logarithms of densities."""
    return _that_count(np.exp(density - np.max(density, axis=(0, 1))))


def _that_count(share: Array) -> Array:
    """Leave out negligible shares, (level, weight, column), and let the others add up to 1."""
    share = share / share.sum(axis=(0, 1))
    share[share < NEGLIGIBLE] = 0
    return np.asarray(share / share.sum(axis=(0, 1)))


def _first_root(schur: Array, penalty: Array, weights: Array) -> tuple[Array, int]:
    """Factorise ``S + exp(lam_2) P_2`` for the smallest weight at which there is a root."""
    for k, weight in enumerate(weights[:-1]):
        try:
            return _cholesky(schur + weight * penalty), k
        except np.linalg.LinAlgError:
            continue
    return _cholesky(schur + weights[-1] * penalty), len(weights) - 1


def _cholesky(matrix: Array) -> Array:
    return np.asarray(scipy.linalg.cholesky(matrix, lower=True, check_finite=False))


def _solve(lower: Array, right: Array) -> Array:
    return np.asarray(scipy.linalg.solve_triangular(lower, right, lower=True, check_finite=False))


def _rank_and_log_determinant(penalty: Array) -> tuple[int, float]:
    """Count eigenvalues that are not zero, and add up their logarithms."""
    own = penalty.any(axis=1)
    values = np.linalg.eigvalsh(penalty[np.ix_(own, own)])
    values = values[values > NULL * values.max()]
    return len(values), float(np.log(values).sum())
