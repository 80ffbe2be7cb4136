"""Wrong points of a registration: found without a noise level, so that the others give the pose.

One wrong point of sixteen moves a pose by centimetres, and two of them hide each other from a test
that leaves out one at a time. So the search goes forward, from points that agree:

1. least squares with Tukey's weights ``w = (1 - (d / c)^2)^2``, zero beyond the cutoff
   ``c = 3.7 s max(20 x 0.75^k, 1)``, which shrinks from step k to step; d is the length of a
   point's residual and s its scale, ``median(d) / sqrt(2 ln 2)``, since d has Rayleigh's
   distribution;
2. the max(n/2 + 1, 5, those within the last cutoff) best points are a core; a point of great
   leverage among few can keep itself within, so that the points without the one, and without the
   two, whose loss lowers the cost most are cores, too;
3. of the others the one that raises the cost least is put back while the probability of
   ``F(2, dof) = (rise / 2) / (cost / dof)`` is above 1 %/n, the pose being solved anew each time;
4. of the poses of all cores that of the least deviance ``dof ln s^2 + 2 m ln(n / 1 %)`` is taken, m
   being the points that it does without and dof those of all points.

Errors of right points are taken as normal, independent and alike, or as large as is stated of them
and more by one factor; more than half of the points must be right.

Wrong points may have each other's numbers: the assignment of the pose's predictions to their angles
that costs least tells which, if it makes them fit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations

import numpy as np

from sldvexp.errors import UserError
from sldvexp.laser import project
from sldvexp.lazy import scipy
from sldvexp.pose.single_view import solve_points
from sldvexp.pose.solution import PoseSolution
from sldvexp.statistics import f_test
from sldvexp.typing import Array, BoolArray, IndexArray

#: Tukey's cutoff in scales, how much wider it is at first, how it shrinks, and steps.
CUTOFF, WIDER, SHRINKING, STEPS = 3.7, 20.0, 0.75, 16
#: Median of Rayleigh's distribution, in standard deviations.
MEDIAN = math.sqrt(2 * math.log(2))
#: Probability that a clean registration loses a point.
LEVEL = 0.01
#: Least scale, DAC steps: far below any pointing, and above rounded decimals.
LEAST = 1e-3
#: Points up to which all pairs are tried; among more, two hardly hide each other.
MOST_FOR_PAIRS = 20


@dataclass(frozen=True, eq=False)
class MatchedPoints:
    """Object points and the angles that were recorded for them, in one view.

    Parameters
    ----------
    points : ndarray, shape (N, 3), m
        In the world.
    angles : ndarray, shape (N, 2), rad
    step : ndarray, shape (2,), rad
        Angle of one DAC step of each mirror.
    mirror_offset : float, m
    adjust : mapping of str to float
        Intrinsics to adjust, with the standard deviations of their priors.
    std : ndarray, shape (N,), DAC steps, optional
        Of the angles; alike and unknown without it.
    max_iterations : int
    """

    points: Array
    angles: Array
    step: Array
    mirror_offset: float = 0.0
    adjust: Mapping[str, float] = field(default_factory=dict)
    std: Array | None = None
    max_iterations: int = 200

    def __len__(self) -> int:
        return len(self.points)

    @property
    def least(self) -> int:
        """Points that leave their pose a few degrees of freedom."""
        return (6 + len(self.adjust)) // 2 + 2

    @property
    def relative_std(self) -> Array:
        """Standard deviations, as far as something is known of them, shape (N,)."""
        return np.ones(len(self)) if self.std is None else self.std

    def solve(self, chosen: BoolArray | IndexArray, std: Array | None = None) -> PoseSolution:
        """Solve for the pose of some points, or for those of a batch of selections.

        Parameters
        ----------
        chosen : ndarray
            A mask (N,), or positions, shape (points,) or (batch, points).
        std : ndarray, shape (N,), DAC steps, optional
            In place of the points' own.
        """
        std = self.std if std is None else std
        return solve_points(
            self.points[chosen],
            self.angles[chosen],
            step=self.step,
            mirror_offset=self.mirror_offset,
            adjust=self.adjust,
            std=None if std is None else std[chosen],
            max_iterations=self.max_iterations,
        )

    def residual(self, pose: PoseSolution, angles: Array | None = None) -> Array:
        """Give recorded minus predicted angles of all points, shape (..., N, 2), DAC steps.

        Parameters
        ----------
        angles : ndarray, shape (..., N, 2), rad, optional
            In place of those recorded.
        """
        gain, zero = (
            np.array([float(pose.intrinsics[f"{what}_{m}"]) for m in ("up_down", "left_right")])
            for what in ("gain", "zero")
        )
        in_laser = (self.points - pose.origin) @ pose.rotation.T
        predicted = project(in_laser, float(pose.intrinsics["mirror_offset"]))
        recorded = self.angles if angles is None else angles
        return np.asarray((recorded - (predicted - zero) / gain) / self.step)

    def distance(self, pose: PoseSolution) -> Array:
        """Give the lengths of the residuals over their standard deviations, shape (N,)."""
        return np.linalg.norm(self.residual(pose), axis=1) / self.relative_std


@dataclass(frozen=True, eq=False)
class RobustPose:
    """A pose, and which points it rests on.

    Parameters
    ----------
    pose : PoseSolution
        Of the points that are used.
    used : ndarray of bool, shape (N,)
    statistic, p_value : ndarray, shape (N,)
        F of putting a point back that is not used, and its probability; NaN for others.
    scale : float
        Standard deviation of the used points' angles: DAC steps, or relative to a given one.
    deviance : float
        By which alternatives are compared.
    """

    pose: PoseSolution
    used: BoolArray
    statistic: Array
    p_value: Array
    scale: float
    deviance: float


def robust_pose(matched: MatchedPoints) -> RobustPose:
    """Find the pose of the points that agree.

    Raises
    ------
    UserError
        If no selection of points determines a pose.
    """
    found: list[RobustPose] = []
    for choose in (_closest, partial(_without, count=1), partial(_without, count=2)):
        try:
            core = choose(matched)
            found += [] if core is None else [_extended(matched, core)]
        except UserError as error:  # the points of the core lie on a line, say
            reason = error
    if not found:
        raise reason
    return min(found, key=lambda one: one.deviance)


def _extended(matched: MatchedPoints, core: BoolArray) -> RobustPose:
    """Put points back that agree with a core, one at a time."""
    n, used, pose = len(matched), core.copy(), matched.solve(core)
    statistic, p_value = np.full((2, n), np.nan)
    while not used.all():
        others = np.flatnonzero(~used)
        with_one = np.hstack([np.tile(np.flatnonzero(used), (len(others), 1)), others[:, None]])
        tried = matched.solve(np.sort(with_one, axis=1))
        statistic[others], p_value[others] = rise(pose, tried.cost, 2)
        best = int(np.argmin(tried.cost))
        if not p_value[others[best]] > LEVEL / n:
            break
        used[others[best]] = True
        pose = tried.single()[best]
    statistic[used] = p_value[used] = np.nan
    variance, left_out = _variance(pose), int(np.sum(~used))
    dof = pose.dof + 2 * left_out
    deviance = dof * math.log(variance) + 2 * left_out * math.log(n / LEVEL)
    return RobustPose(pose, used, statistic, p_value, math.sqrt(variance), float(deviance))


def _without(matched: MatchedPoints, count: int) -> BoolArray | None:
    """Give the core without those points whose loss helps most; None for too few or many."""
    n = len(matched)
    if n - count < matched.least or (count > 1 and n > MOST_FOR_PAIRS):
        return None
    kept = np.array(list(combinations(range(n), n - count)))
    core = np.zeros(n, bool)
    core[kept[np.argmin(matched.solve(kept).cost)]] = True
    return core


def _closest(matched: MatchedPoints) -> BoolArray:
    """Give the core of points that Tukey's weights leave."""
    n, std = len(matched), matched.relative_std
    least = LEAST if matched.std is None else 1.0
    unbiased = math.sqrt(2 * n / (2 * n - 6 - len(matched.adjust))) / MEDIAN
    d = matched.distance(matched.solve(np.ones(n, bool)))
    for k in range(STEPS):
        s = max(float(np.median(d)) * unbiased, least)
        cutoff = CUTOFF * s * max(WIDER * SHRINKING**k, 1.0)
        root_weight = 1 - (d / cutoff) ** 2
        some = root_weight > 0
        d = matched.distance(matched.solve(some, s * std / np.where(some, root_weight, 1.0)))
    core = np.zeros(n, bool)
    core[np.argsort(d)[: max(n // 2 + 1, matched.least, int(np.sum(d < cutoff)))]] = True
    return core


def rise(pose: PoseSolution, cost: Array, numerator: int) -> tuple[Array, Array]:
    """Test how much observations raise the cost of a pose that does without them.

    Parameters
    ----------
    cost : ndarray
        With them.
    numerator : int
        How many they are.

    Returns
    -------
    statistic, p_value : ndarray
        ``F(numerator, dof)``.
    """
    statistic = (np.asarray(cost) - pose.cost) / numerator / _variance(pose)
    test = f_test(statistic, numerator, pose.dof, 1 - LEVEL)
    return test.statistic, test.p_value


def _variance(pose: PoseSolution) -> float:
    """Estimate the variance of the residuals; at least the stated one, if one is."""
    return max(float(pose.cost / pose.dof), 1.0 if pose.noise_known else LEAST**2)


def exchanged(matched: MatchedPoints, found: RobustPose) -> Iterator[list[int]]:
    """Find points that are not used and have each other's angles.

    Yields
    ------
    list of int
        Positions of points; the object point of each has the angles of the next, that of the last
        those of the first.
    """
    others = np.flatnonzero(~found.used)
    if len(others) < 2:
        return
    # How far the angles of point j are from the prediction of point i.
    away = matched.residual(found.pose, matched.angles[:, None])[:, others][others]
    square = np.sum(away**2, axis=-1)
    _, theirs = scipy.optimize.linear_sum_assignment(square.T)
    for cycle in _cycles(theirs):
        own, next_ones = others[cycle], others[np.roll(cycle, -1)]
        angles = matched.angles.copy()
        angles[own] = matched.angles[next_ones]
        used = found.used.copy()
        used[own] = True
        renumbered = replace(matched, angles=angles).solve(used)
        _, p_value = rise(found.pose, renumbered.cost, 2 * len(own))
        if p_value > LEVEL / len(matched):
            yield own.tolist()


def _cycles(permutation: IndexArray) -> Iterator[IndexArray]:
    """Follow a permutation from each element to the next until it is back; two and more."""
    left = set(range(len(permutation)))
    while left:
        cycle = [min(left)]
        while (following := int(permutation[cycle[-1]])) != cycle[0]:
            cycle.append(following)
        left -= set(cycle)
        if len(cycle) > 1:
            yield np.array(cycle)
