"""Test of a field's intercepts with the covariance that shared pixels and poses give them.

Samples are interpolated from the same pixels, and an error of a pose moves all of them together:
their sums of squares have neither the mean nor the degrees of freedom of independent ones. What is
independent is the noise of the pixels v_k, of variances S_k. Combinations of the nodal intercepts,
``beta = P theta``, are linear in them, and with their derivatives J by the poses, whose covariance
is C, Wald's test asks whether all are zero:

    beta = sum_k Y_k^T v_k,  Y_k = R_k^T M^-1 P^T,
    F = beta^T (s^2 sum_k Y_k^T S_k Y_k + J C J^T)^-1 beta / q,  distributed as F(q, nu).

The residuals r tell s^2 of the noise: their sum of squares over ``tr B S``, where ``r^T Q r = v^T B
v``; nu is Satterthwaite's, with what intercepts and residuals have in common. Before that they
lose what errors of the poses leave in them, the part along ``G = D - X dtheta/dp``. The samples'
change D has the slopes of smoothed images, since noise has no part in what poses do:

    r^T Q r - g^T (G^T Q G)^-1 g,  g = G^T Q r = sum_k N_k^T v_k,
    N_k = W_k^T Q D - R_k^T dtheta/dp.

Real and imaginary part have the poses' errors in common and are tested together. All intercepts
are tested of a small field; of a large one their means over compact parts of the surface, weighted
by the inverse of their variances. Assumed: normal noise, and errors of the poses so small that
velocities change linearly with them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from sldvexp.field.bounds.pose_uncertainty import POSE, PoseEffect
from sldvexp.field.bounds.residuals_and_bounds import FieldBounds
from sldvexp.field.bounds.smooth_image import smooth_image
from sldvexp.field.equations.regions import RegionIterator, RegionSamples
from sldvexp.field.equations.system import NormalEquations, Solve, solution
from sldvexp.field.streaming.compression import FrequencyModes
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.lazy import scipy
from sldvexp.statistics import FTest, f_test
from sldvexp.typing import Array, BoolArray, IndexArray

#: Place of the intercept among the parameters.
INTERCEPT = 3
#: Parts of a large field's surface whose mean intercepts are tested; at most twice as many.
SURFACE_PARTS = 32
#: Images of random signs from which the trace of (B S)^2 is estimated.
PROBES = 8
#: Share of the largest eigenvalue below which a direction counts as none.
NOTHING = 1e-9


@dataclass(frozen=True, eq=False)
class InterceptTest:
    """Everything of the test that does not depend on the frequency.

    Attributes
    ----------
    combination : ndarray, shape (layer, surface_node, combination)
        The matrix P, such that the stated noise gives its combinations the covariance 1.
    noise : ndarray, shape (view, combination, combination)
        ``Y_k^T S_k Y_k``.
    by_pose : ndarray, shape (combination, error, mode)
        The matrix J for independent errors of variance 1.
    left_by_pose : list of ndarray, shape (pixel, error, mode)
        The matrices N_k for such errors.
    left_squares : ndarray, shape (error, mode, error, mode)
        ``G^T Q G``.
    left_noise : ndarray, shape (view, error, mode, error, mode)
        ``N_k^T S_k N_k``.
    dof : float
        nu of real and imaginary part together.
    """

    combination: Array
    noise: Array
    by_pose: Array
    left_by_pose: list[Array]
    left_squares: Array
    left_noise: Array
    dof: float

    @classmethod
    def prepare(
        cls,
        parts: RegionIterator,
        system: NormalEquations,
        solve: Solve,
        determined: BoolArray,
        variance: Array,
        effect: PoseEffect | None,
    ) -> InterceptTest:
        """Set up the test of a field whose equations are solved.

        Parameters
        ----------
        determined : ndarray of bool, shape (layer, surface_node)
            Nodes with an intercept.
        variance : ndarray, shape (layer, surface_node)
            Of the intercepts, from the noise.
        effect : PoseEffect, optional
            None if the poses have no covariance.
        """
        seen = parts.visibility
        if effect is not None:
            effect = replace(effect, data=seen.of_columns("smooth", effect.data, _smooth(seen)))
        s = [std[:, None] ** 2 for std in parts.model.pixel_std]
        columns = SampleColumns.from_noise(effect, s)
        right, squares = columns.normal_equations(parts)
        solve = system.solved if system.is_small else solve
        theta = solution(right, system, solve)
        squares -= np.tensordot(right, theta, ([0, 1, 2], [0, 1, 2]))
        known = _chosen.get(system)
        p = (
            known.combination[..., :0]
            if known
            else _combinations(parts, system, determined, variance)
        )
        x = _solved_for(p, parts.model.parameters, system, solve)
        y, left = columns.of_pixels(parts, x, theta)
        chosen = known or ChosenIntercepts.from_pixels(p, y, s)
        if system.is_small:
            _chosen[system] = chosen
        poses, root = columns.poses, _root(effect)
        by_pose = np.einsum("lnq,lnp->qp", chosen.combination, theta[:, :, INTERCEPT, :poses])
        own = [_by_errors(n[:, :poses], root) for n in left]
        square = squares[:poses, :poses].reshape(2 * (len(root), poses // max(1, len(root))))
        left_squares = np.einsum("ambn,ae,bd->emdn", square, root, root, optimize=True)
        probes = [n[:, poses:] for n in left]
        return cls(
            chosen.combination,
            chosen.noise,
            _by_errors(by_pose, root),
            own,
            left_squares,
            np.stack(
                [np.tensordot(n, v[..., None] * n, (0, 0)) for n, v in zip(own, s, strict=True)]
            ),
            2 * _dof(columns.probes, probes, chosen.of_pixels, s),
        )

    def with_changes(self, changes: Array) -> InterceptTest:
        """Add further errors that are independent of those of the poses, of variance 1.

        Parameters
        ----------
        changes : ndarray, shape (error, layer, surface_node, parameter, mode)
            Of the solution.
        """
        added = np.einsum("lnq,elnm->qem", self.combination, changes[:, :, :, INTERCEPT])
        return replace(self, by_pose=np.concatenate([self.by_pose, added], axis=1))

    def test(
        self,
        theta: Array,
        data: list[Array],
        found: FieldBounds,
        factor: Array,
        modes: FrequencyModes | None,
        confidence: float,
    ) -> FTest:
        """Test whether all intercepts are zero, at every frequency.

        Parameters
        ----------
        theta : ndarray, shape (layer, surface_node, parameter, column)
        data : list of ndarray, shape (pixel, column), m/s
        found : FieldBounds
            With the sum of squares of the residuals, and what the stated noise lets expect.
        factor : ndarray, shape (view, frequency)
            Each frequency's variance over the mean of all.
        modes : FrequencyModes, optional
            Of these columns; None if the poses have no covariance.
        """
        count, columns = self.combination.shape[-1], theta.shape[-1]
        combined = np.zeros((0, columns)) if modes is None else modes.combination
        beta = np.einsum("lnq,lnc->qc", self.combination, theta[:, :, INTERCEPT])
        each = zip(self.left_by_pose, data, strict=True)
        g = np.sum([np.tensordot(n, d, (0, 0)) for n, d in each], axis=0)
        assert found.expected is not None
        squares, expected = found.residuals.squares[0], found.expected[0]
        statistic = np.full(columns // 2, np.nan)  # as where all velocities are zero
        for f in range(columns // 2):
            two = slice(2 * f, 2 * f + 2)
            c = combined[:, two]
            inverse = np.linalg.pinv(_quadratic(self.left_squares, c), NOTHING, hermitian=True)
            along = np.einsum("emc,mc->e", g[..., two], c)
            noise = _quadratic(np.tensordot(factor[:, f], self.left_noise, 1), c)
            left = expected[f] - np.trace(inverse @ noise)
            s2 = (squares[two].sum() - along @ inverse @ along) / left if left > 0 else 0.0
            if s2 > 0:
                covariance = s2 * np.tensordot(factor[:, f], self.noise, 1)
                statistic[f] = wald(beta[:, two], covariance, self.by_pose @ c) / (2 * count)
        return f_test(statistic, 2 * count, self.dof, confidence)


@dataclass(frozen=True, eq=False)
class ChosenIntercepts:
    """Combinations of the intercepts that are tested, which no velocity and no pose decides.

    Attributes
    ----------
    combination : ndarray, shape (layer, surface_node, combination)
        See `InterceptTest`.
    noise : ndarray, shape (view, combination, combination)
        See `InterceptTest`.
    of_pixels : list of ndarray, shape (pixel, combination)
        The matrices Y_k of these combinations.
    """

    combination: Array
    noise: Array
    of_pixels: list[Array]

    @classmethod
    def from_pixels(cls, chosen: Array, y: list[Array], s: list[Array]) -> ChosenIntercepts:
        """Give the combinations P with these Y_k the covariance 1.

        Parameters
        ----------
        chosen : ndarray, shape (layer, surface_node, combination)
        y : list of ndarray, shape (pixel, combination)
        s : list of ndarray, shape (pixel, 1)
            Variances of each view's pixels.
        """
        noise = np.stack([a.T @ (v * a) for a, v in zip(y, s, strict=True)])
        white = _whitening(noise.sum(axis=0))
        return cls(chosen @ white, white.T @ noise @ white, [a @ white for a in y])


#: Those of small systems that are still there, since fits by several solvers have one in common.
_chosen: WeakKeyDictionary[NormalEquations, ChosenIntercepts] = WeakKeyDictionary()


def _solved_for(chosen: Array, parameters: int, system: NormalEquations, solve: Solve) -> Array:
    """Solve ``M x = P^T`` for the matrix P of intercepts."""
    of_chosen = np.zeros((*chosen.shape[:2], parameters, chosen.shape[-1]))
    of_chosen[:, :, INTERCEPT] = chosen
    return solution(of_chosen, system, solve)


def wald(beta: Array, covariance: Array, common: Array) -> float:
    """Compute ``beta^T (I (x) covariance + common common^T)^-1 beta`` of several columns.

    Parameters
    ----------
    beta : ndarray, shape (value, column)
    covariance : ndarray, shape (value, value)
        Of each column by itself.
    common : ndarray, shape (value, error, column)
        Change of the values with errors of variance 1 that all columns have in common.
    """
    both = np.concatenate([beta[:, None], common], axis=1)
    factor = scipy.linalg.cholesky(covariance, lower=True)
    white = scipy.linalg.solve_triangular(factor, both.reshape(len(beta), -1), lower=True)
    white = white.reshape(both.shape)
    gram = np.einsum("qec,qdc->ed", white, white, optimize=True)
    own, along, of_errors = gram[0, 0], gram[0, 1:], gram[1:, 1:]
    return float(own - along @ np.linalg.solve(np.eye(len(along)) + of_errors, along))


@dataclass(frozen=True, eq=False)
class SampleColumns:
    """Columns of changes E of the samples' velocities: by each pose, and by random pixels.

    A least-squares fit of them, with the right sides ``b = X^T Q E``, leaves ``E - X theta``; that
    has the squares ``E^T Q E - b^T theta`` and weighs on the pixels by ``W^T Q E - R^T theta``.

    Parameters
    ----------
    probes : list of ndarray, shape (pixel, probe)
        Images of random signs times the pixels' std, of each view.
    """

    effect: PoseEffect | None
    probes: list[Array]

    @classmethod
    def from_noise(cls, effect: PoseEffect | None, variances: list[Array]) -> SampleColumns:
        """Draw the probes, the same each time."""
        rng = np.random.default_rng(0)
        signs = [rng.choice([-1.0, 1.0], (len(v), PROBES)) for v in variances]
        return cls(effect, [z * np.sqrt(v) for z, v in zip(signs, variances, strict=True)])

    @property
    def of_view(self) -> int:
        """Columns of one view's pose."""
        return 0 if self.effect is None else POSE * self.effect.theta.shape[-1]

    @property
    def poses(self) -> int:
        """Columns of all poses; those of the probes come after them."""
        return self.of_view * len(self.probes)

    def at(self, part: RegionSamples) -> list[tuple[IndexArray, Array]]:
        """Find each view's E, shape (sample, place), and the places of its columns among all."""
        views = len(self.probes)
        own = [np.zeros((len(part.at.estimator), self.of_view))] * views
        if self.effect is not None:
            for k, change in self.effect.changes(part, part.field(self.effect.theta)):
                own[k] = change.reshape(len(change), -1)
        seen = [s.weights @ z for s, z in zip(part.samples.by_view, self.probes, strict=True)]
        first, after = np.arange(self.of_view), self.poses + np.arange(PROBES)
        return [
            (np.append(k * self.of_view + first, after), np.concatenate([own[k], seen[k]], axis=1))
            for k in range(views)
        ]

    def normal_equations(self, parts: RegionIterator) -> tuple[Array, Array]:
        """Set up ``X^T Q E``, shape (layer, surface_node, parameter, column), and ``E^T Q E``."""
        prisms, columns = parts.visibility.prisms, self.poses + PROBES
        shape = (prisms.layers, prisms.surface_nodes, parts.model.parameters)
        right, squares = np.zeros((*shape, columns)), np.zeros((columns, columns))
        for part in parts.disjoint():
            patch, q, each = part.patch, part.at.pointwise.weight, self.at(part)
            added = np.zeros((patch.layers, len(patch.nodes), shape[2], columns))
            for k, (places, e) in enumerate(each):
                side = part.at.estimator[:, :, k, None] * e[:, None]
                sums = patch.to_nodes(side.reshape(len(e), -1))
                added[..., places] += sums.reshape(*added.shape[:3], -1)
                for j, (others, other) in enumerate(each):
                    if (both := q.of_views(j, k)).any():
                        squares[np.ix_(others, places)] += other.T @ (both[:, None] * e)
            right[:, patch.nodes] += added
        return right, squares

    def of_pixels(
        self, parts: RegionIterator, x: Array, theta: Array
    ) -> tuple[list[Array], list[Array]]:
        """Compute ``R^T x`` and ``W^T Q E - R^T theta`` of every view, shape (pixel, column)."""
        seen = [np.zeros((len(z), x.shape[-1])) for z in self.probes]
        left = [np.zeros((len(z), theta.shape[-1])) for z in self.probes]
        for part in parts.disjoint():
            nodes, q, each = part.patch.nodes, part.at.pointwise.weight, self.at(part)
            of_x, of_theta = (_columns(a[:, nodes]) for a in (x, theta))
            for k, (of_view, r) in enumerate(
                zip(part.samples.by_view, part.influences, strict=True)
            ):
                if x.shape[-1]:
                    seen[k] += r.T @ of_x
                left[k] -= r.T @ of_theta
                for j, (places, e) in enumerate(each):
                    if (both := q.of_views(k, j)).any():
                        left[k][:, places] += of_view.weights.T @ (both[:, None] * e)
        return seen, left


def _dof(probes: list[Array], weighed: list[Array], y: list[Array], s: list[Array]) -> float:
    """Find nu for which F(q, nu) has the variance of F, of one part.

    Interpolation makes residuals and intercepts depend on one another. With ``A = Y Y^T`` of q
    combinations that have the covariance 1, quadratic forms of normal numbers have

        1 / nu = tr (B S)^2 / (tr B S)^2 - 2 tr (A S B S) / (q tr B S),

    where traces are means over the probes z, as ``tr B S = z^T B z``.

    Parameters
    ----------
    weighed : list of ndarray, shape (pixel, probe)
        ``B z``.
    y : list of ndarray, shape (pixel, combination)
    s : list of ndarray, shape (pixel, 1)
    """
    z, n, v, of_y = (np.concatenate(each) for each in (probes, weighed, s, y))
    trace = np.sum(z * n) / PROBES
    if not trace > 0:
        return np.nan
    square = np.sum(v * n**2) / PROBES
    both = np.sum((of_y.T @ z) * (of_y.T @ (v * n))) / PROBES
    inverse = square / trace**2 - 2 * both / (of_y.shape[1] * trace)
    return float(1 / inverse) if inverse > 0 else np.inf


def _columns(values: Array) -> Array:
    """Turn (..., column) into a matrix, which may have no column."""
    return values.reshape(math.prod(values.shape[:-1]), values.shape[-1])


def _smooth(visibility: VolumeVisibility) -> Callable[[Sequence[Array]], list[Array]]:
    """Make the map from columns of every view's image to smooth ones."""
    return lambda data: [smooth_image(*each) for each in zip(visibility.views, data, strict=True)]


def _combinations(
    parts: RegionIterator, system: NormalEquations, determined: BoolArray, variance: Array
) -> Array:
    """Choose the intercepts, or means of them, that are tested: the matrix P."""
    node = np.argwhere(determined)
    if system.is_small:
        chosen = np.zeros((*determined.shape, len(node)))
        chosen[node[:, 0], node[:, 1], np.arange(len(node))] = 1.0
        return chosen
    largest = -(-determined.shape[1] // SURFACE_PARTS)
    weight = np.divide(1.0, variance, out=np.zeros_like(variance), where=determined)
    means = []
    for nodes in parts.surface.parts(largest):
        if determined[:, nodes].any():
            mean = np.zeros_like(weight)
            mean[:, nodes] = weight[:, nodes] / weight[:, nodes].sum()
            means.append(mean)
    return np.stack(means, axis=-1)


def _whitening(covariance: Array) -> Array:
    """Find T with ``T^T covariance T = 1``, without what has no error of its own."""
    return _roots(covariance)[1]


def _root(effect: PoseEffect | None) -> Array:
    """Find U with ``U U^T`` the covariance of the poses, shape (6 views, error)."""
    return np.zeros((0, 0)) if effect is None else _roots(effect.covariance)[0]


def _roots(covariance: Array) -> tuple[Array, Array]:
    """Find U with ``U U^T = covariance``, and its pseudo-inverse's transpose."""
    size = np.sqrt(np.diagonal(covariance))
    size = np.where(size > 0, size, 1.0)[:, None]
    value, vector = np.linalg.eigh(covariance / (size * size.T))
    kept = value > NOTHING * value.max(initial=0.0)
    root = np.sqrt(value[kept])
    return size * vector[:, kept] * root, vector[:, kept] / root / size


def _by_errors(by_pose: Array, root: Array) -> Array:
    """Turn derivatives (value, 6 views * mode) into those by independent errors of variance 1."""
    modes = by_pose.shape[1] // max(1, len(root))
    return np.einsum("pam,ae->pem", by_pose.reshape(len(by_pose), len(root), modes), root)


def _quadratic(products: Array, c: Array) -> Array:
    """Sum ``c^T products c`` over columns, from (error, mode, error, mode) to (error, error)."""
    return np.einsum("amen,mc,nc->ae", products, c, c, optimize=True)
