"""Adjustment of all views at once, with unknowns that they share and noise that is estimated.

Every view v has unknowns a_v of its own, all have the unknowns c in common. With residuals r_v, and
their derivatives A_v by the own and C_v by the common unknowns, the normal equations are a
block-arrow matrix::

    [ A_1'A_1                A_1'C_1     ] [ a_1 ]     [ A_1'r_1     ]
    [            ...          ...        ] [ ... ] = - [  ...        ]
    [ C_1'A_1    ...      sum_v C_v'C_v  ] [  c  ]     [ sum C_v'r_v ]

The own unknowns are eliminated view by view. What is left for the common ones is the Schur
complement ``S = sum_v C_v'C_v - C_v'A_v (A_v'A_v)^-1 A_v'C_v``, whose inverse is their covariance.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np

from sldvexp.typing import Array

#: Information in the worst direction, as a part of that with all else known: rounding errors below,
#: of a block and of the Schur complement, which is a difference.
UNDETERMINED, UNDETERMINED_SCHUR = 1e-14, 1e-12

#: Damping to begin with and the least one, relative to the curvature.
DAMPING, LEAST_DAMPING = 1e-6, 1e-14

#: A step that would lower the cost by less than this part of it ends the descent.
TOLERANCE = 1e-10

#: Rounds in which the noise and the weights settle, and how closely.
ROUNDS, SETTLED = 50, 1e-5

#: Least variance of the noise: noise-free data must not void what is known beforehand.
LEAST_VARIANCE = 1e-8


class LinearisedResiduals(NamedTuple):
    """Residuals (n,) over their standard errors; derivatives by own (n, p) and common unknowns."""

    residual: Array
    by_own: Array
    by_common: Array


class ViewTerms(Protocol):
    """One view's part in an adjustment."""

    def linearise(self, common: Array) -> LinearisedResiduals:
        """Evaluate residuals and derivatives; infinite residuals where the view cannot be."""

    def moved(self, step: Array) -> Self:
        """Make a step (p,) of its own unknowns."""

    def weighed(self, common: Array) -> Self:
        """Evaluate the standard errors of its residuals here."""

    def prior(self) -> tuple[Array, Array]:
        """Give the precision (p,) of what is known of its unknowns, and their distance from it."""


@dataclass(frozen=True, eq=False)
class Common:
    """Unknowns that all views share.

    Parameters
    ----------
    value, expected : ndarray, shape (q,)
    prior_std : ndarray, shape (q,)
        Infinite for what is free.
    """

    value: Array
    expected: Array
    prior_std: Array

    @property
    def precision(self) -> Array:
        """Precision of the prior, shape (q,)."""
        return np.asarray(self.prior_std**-2.0)

    @property
    def away(self) -> Array:
        """Deviation from what is expected, shape (q,)."""
        return self.value - self.expected


V = TypeVar("V", bound=ViewTerms)


@dataclass(frozen=True, eq=False)
class Adjusted(Generic[V]):
    """Adjusted views.

    Parameters
    ----------
    covariance : ndarray, shape (all, all)
        Of all views' own unknowns, then of the common ones; infinite if they are not determined.
    places : list of slice
        Where each view's own unknowns stand in `covariance`.
    residual : list of ndarray
        Over the standard errors that the views state.
    variance : ndarray, shape (view,)
        By which the squares of those are larger, estimated; one if they are known.
    dof : ndarray, shape (view,)
        Degrees of freedom behind `variance`.
    cost : float
        Sum of squared residuals over their noise, with the priors'.
    arrow : Arrow
        The information.
    """

    views: list[V]
    common: Common
    covariance: Array
    places: list[slice]
    residual: list[Array]
    variance: Array
    dof: Array
    cost: float
    converged: bool
    arrow: Arrow


def adjust_views(
    views: Sequence[V],
    common: Common,
    noise_known: bool,
    pooled: bool,
    max_iterations: int,
) -> Adjusted[V]:
    """Find the least squares over all views.

    Parameters
    ----------
    views : sequence of ViewTerms
        Where to start.
    noise_known : bool
        Whether the residuals' standard errors are right as they are.
    pooled : bool
        Whether all views have the same noise, if it is not known.
    max_iterations : int
        Of each descent.
    """
    views, variance, dof = list(views), np.ones(len(views)), np.full(len(views), np.nan)
    if not noise_known:
        start = [v.weighed(common.value).linearise(common.value).residual for v in views]
        variance = _variance(start, np.array([float(len(r)) for r in start]), pooled)
    for _ in range(ROUNDS):
        views = [v.weighed(common.value) for v in views]
        views, common, at, converged = _descend(views, common, variance, max_iterations)
        arrow = normal_equations(views, common, at, variance)
        places, determined = arrow.places(), arrow.determined()
        covariance = arrow.covariance() if determined else np.full(2 * (arrow.size,), np.inf)
        if not determined:
            break
        dof = _freedom(at, covariance, places, variance)
        before = variance
        if not noise_known:
            variance = _variance([a.residual for a in at], dof, pooled)
        if (np.abs(variance - before) <= SETTLED * variance).all():
            break
    else:
        converged = False
    return Adjusted(
        views=views,
        common=common,
        covariance=covariance,
        places=places,
        residual=[a.residual for a in at],
        variance=variance,
        dof=np.full(len(dof), dof.sum()) if pooled else dof,
        cost=_cost(views, common, at, variance),
        converged=converged,
        arrow=arrow,
    )


def normal_equations(
    views: Sequence[ViewTerms], common: Common, at: Sequence[LinearisedResiduals], variance: Array
) -> Arrow:
    """Make the information of linearised views and of the priors."""
    priors = [v.prior()[0] for v in views]
    each = list(zip(at, variance, strict=True))
    return Arrow(
        [a.by_own.T @ a.by_own / s2 + np.diag(p) for (a, s2), p in zip(each, priors, strict=True)],
        [a.by_own.T @ a.by_common / s2 for a, s2 in each],
        np.diag(common.precision) + sum(a.by_common.T @ a.by_common / s2 for a, s2 in each),
    )


def _descend(
    views: list[V], common: Common, variance: Array, max_iterations: int
) -> tuple[list[V], Common, list[LinearisedResiduals], bool]:
    """Take Levenberg-Marquardt steps down to the least cost; tell whether it was reached."""
    at = [v.linearise(common.value) for v in views]
    cost = _cost(views, common, at, variance)
    damping, growth = DAMPING, 2.0
    for _ in range(max_iterations):
        arrow = normal_equations(views, common, at, variance)
        right, pull = _right_hand_side(views, common, at, variance)
        steps, change = arrow.damped(damping).solve(right, pull)
        trial = [v.moved(step) for v, step in zip(views, steps, strict=True)]
        trial_common = replace(common, value=common.value + change)
        then = [v.linearise(trial_common.value) for v in trial]
        trial_cost = _cost(trial, trial_common, then, variance)

        # The damped step promises at least this much.
        expected = float(change @ pull + sum(s @ r for s, r in zip(steps, right, strict=True)))
        done = expected <= TOLERANCE * (1 + cost)
        if trial_cost <= cost * (1 + TOLERANCE * done):
            views, common, at = trial, trial_common, then
            damping, growth, cost = max(damping / 10, LEAST_DAMPING), 2.0, trial_cost
        else:
            damping, growth = damping * growth, 2 * growth
        if done:
            return views, common, at, True
    return views, common, at, False


def _right_hand_side(
    views: Sequence[ViewTerms], common: Common, at: Sequence[LinearisedResiduals], variance: Array
) -> tuple[list[Array], Array]:
    """Point down the cost's slope, by the own unknowns of each view and by the common ones."""
    own, pull = [], -common.precision * common.away
    for view, a, s2 in zip(views, at, variance, strict=True):
        precision, away = view.prior()
        own.append(-a.by_own.T @ a.residual / s2 - precision * away)
        pull = pull - a.by_common.T @ a.residual / s2
    return own, pull


def _cost(
    views: Sequence[ViewTerms], common: Common, at: Sequence[LinearisedResiduals], variance: Array
) -> float:
    """Add squared residuals over their noise, and squared distances from the priors over theirs."""
    of_residuals = sum(a.residual @ a.residual / s2 for a, s2 in zip(at, variance, strict=True))
    of_own = sum(precision @ away**2 for precision, away in (v.prior() for v in views))
    return float(of_residuals + of_own + common.precision @ common.away**2)


def _freedom(
    at: Sequence[LinearisedResiduals], covariance: Array, places: Sequence[slice], variance: Array
) -> Array:
    """Count the residuals of each view less what the unknowns take of them, shape (view,).

    That is the trace of ``I - J C J' / s^2``; a prior gives its share back.
    """
    count = places[-1].stop
    dof = []
    for a, place, s2 in zip(at, places, variance, strict=True):
        own = np.r_[place, count : len(covariance)]
        jacobian = np.concatenate([a.by_own, a.by_common], axis=1)
        taken = np.einsum("ni,ij,nj->", jacobian, covariance[np.ix_(own, own)], jacobian)
        dof.append(len(a.residual) - taken / s2)
    return np.array(dof)


def _variance(residual: Sequence[Array], dof: Array, pooled: bool) -> Array:
    """Divide sums of squares by degrees of freedom, of each view or of all, shape (view,)."""
    square = np.array([r @ r for r in residual])
    if pooled:
        square, dof = np.full_like(square, square.sum()), np.full_like(dof, dof.sum())
    return np.maximum(square / dof, LEAST_VARIANCE)


@dataclass(frozen=True, eq=False)
class Arrow:
    """A block-arrow information matrix.

    Parameters
    ----------
    own : sequence of ndarray, shapes (p_v, p_v)
        ``A_v'A_v``, with the priors of the own unknowns.
    mixed : sequence of ndarray, shapes (p_v, q)
        ``A_v'C_v``.
    common : ndarray, shape (q, q)
        ``sum_v C_v'C_v``, with the priors of the common unknowns.
    """

    own: Sequence[Array]
    mixed: Sequence[Array]
    common: Array

    def damped(self, damping: float) -> Arrow:
        """Enlarge the diagonal by a part of it, as Levenberg and Marquardt do."""

        def larger(block: Array) -> Array:
            return block + damping * np.diag(np.diag(block))

        return Arrow([larger(a) for a in self.own], self.mixed, larger(self.common))

    def solve(self, own: Sequence[Array], common: Array) -> tuple[list[Array], Array]:
        """Solve for own and common unknowns, with right-hand sides of shapes (p_v,) and (q,)."""
        pulls = self._pulls()
        left = common - sum(p.T @ r for p, r in zip(pulls, own, strict=True))
        c = _solve(self._schur(pulls), left)
        each = zip(self.own, own, pulls, strict=True)
        return [_solve(a, r) - p @ c for a, r, p in each], c

    def covariance(self) -> Array:
        """Invert the whole matrix: own unknowns in the order of the views, then the common.

        Two views correlate by what they have in common only:
        ``cov(a_v, a_w) = P_v S^-1 P_w'`` with ``P_v = (A_v'A_v)^-1 A_v'C_v``.
        """
        common = np.linalg.inv(self._schur(self._pulls()))
        # How far each unknown follows the common ones: a_v = -P_v c.
        follows = np.concatenate([*(-p for p in self._pulls()), np.eye(len(common))])
        whole = follows @ common @ follows.T
        for place, block in zip(self.places(), self.own, strict=True):
            whole[place, place] += np.linalg.inv(block)
        return np.asarray((whole + whole.T) / 2)

    def places(self) -> list[slice]:
        """Find where each view's own unknowns stand among all."""
        ends = itertools.accumulate((len(a) for a in self.own), initial=0)
        return [slice(a, b) for a, b in itertools.pairwise(ends)]

    @property
    def size(self) -> int:
        """Number of all unknowns."""
        return sum(len(a) for a in self.own) + len(self.common)

    def determined(self) -> bool:
        """Tell whether the views and priors determine every unknown."""
        if any(share.any() for share in self.undetermined_own()):
            return False
        return not self.undetermined_common().any()

    def undetermined_own(self) -> list[Array]:
        """Give each view's own unknowns' shares in a direction that nothing determines, or zero.

        The common unknowns are taken as known.
        """
        return [_worst(a, np.diag(a), UNDETERMINED) for a in self.own]

    def undetermined_common(self) -> Array:
        """Give the common unknowns' shares in a direction that no view determines, or zeros."""
        schur = self._schur(self._pulls())
        return _worst(schur, np.diag(self.common), UNDETERMINED_SCHUR)

    def _pulls(self) -> list[Array]:
        return [_solve(a, m) for a, m in zip(self.own, self.mixed, strict=True)]

    def _schur(self, pulls: Sequence[Array]) -> Array:
        return self.common - sum(m.T @ p for m, p in zip(self.mixed, pulls, strict=True))


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right), np.float64)


def _worst(information: Array, known: Array, least: float) -> Array:
    """Give the worst direction's absolute components, relative to `known`; or zeros."""
    scale = np.sqrt(np.where(known > 0, known, 1.0))
    value, vector = np.linalg.eigh(information / np.outer(scale, scale))
    if not len(value) or value[0] > least:
        return np.zeros(len(value))
    return np.abs(vector[:, 0])
