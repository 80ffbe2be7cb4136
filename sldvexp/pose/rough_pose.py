"""Rough poses from a few marks, all that fit them, and where those put any other place.

The recorded angles of n marks less those of the two-mirror model are least squares in the pose, as
in `sldvexp.pose.single_view`. Three marks leave no residuals and allow up to four poses, four marks
in a plane often two, so that every minimum is followed, from a grid of rotations or from the two
starts of `sldvexp.pose.initial_pose`. A pose is as likely as

``exp(-cost / 2) (ODD + exp(-roll^2 / (2 ROLL^2))) (1 if in front else BEHIND)``,

since people set instruments upright, before the side that the world's z axis points to. A place p
then lies at the angles of the likeliest pose, with the variance of the mixture, ``sum_k w_k
(J_k C_k J_k' + (angle_k - angle_0)^2)``: poses that cannot be told apart widen each other's bounds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry import rotation_towards, skew
from sldvexp.laser import TwoMirror, project, project_jacobian
from sldvexp.pose.initial_pose import (
    beam_planes,
    lift,
    object_space_form,
    rotation_grid,
    start_poses,
)
from sldvexp.pose.least_squares import Pose, levenberg_marquardt, linearise, normal_equations, take
from sldvexp.pose.outliers import MatchedPoints
from sldvexp.pose.single_view import DISTINCT, Observations, observations, weighted_problem
from sldvexp.pose.uncertainty import about_origin
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array, IndexArray

#: Standard deviation of an instrument's roll about its line of sight, rad.
ROLL = math.radians(5.0)
#: Information that an instrument stands within some 10 m, turned anyhow: three marks of which one
#: more would be needed leave a direction open.
VAGUE = np.diag([math.pi**-2] * 3 + [10.0**-2] * 3)
#: Likelihoods of an instrument that is not upright, and of one behind the object.
ODD, BEHIND = 1e-3, 1e-3
#: Relative likelihood below which a pose is no longer looked at.
UNLIKELY = 1e-6
#: Rotations from which the poses of three marks are looked for; a third of them finds all.
STARTS, FEW_STARTS = 150, 16
#: Probability of the residuals below which the stated errors are too small.
REFUTED = 0.001
#: Sets of marks whose poses are remembered: with each mark that is taken all others are compared
#: once more, which leaves most sets as they were.
REMEMBERED = 256


@dataclass(frozen=True, eq=False)
class RoughPose:
    """One pose that a few marks allow.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        World to laser.
    origin : ndarray, shape (3,), m
    covariance : ndarray, shape (6, 6)
        Of the `EXTRINSICS`, rad and m; wider where the marks contradict one another.
    cost : float
        Sum of squared residuals over their standard deviations.
    dof : int
        Residuals less unknowns.
    probability : float
        Of this pose among all that fit.
    """

    rotation: Array
    origin: Array
    covariance: Array
    cost: float
    dof: int
    probability: float

    @property
    def roll(self) -> float:
        """Turn about the line of sight from upright, rad."""
        upright = rotation_towards(self.origin, self.origin + self.rotation[2])
        turn = self.rotation @ upright.T
        return float(np.arctan2(turn[0, 1], turn[0, 0]))

    def angles(self, points: Array, mirror_offset: float) -> tuple[Array, Array]:
        """Give the angles of places, shape (N, 2), rad, and their covariance by the pose's.

        Angles of places that are not before the instrument are NaN.
        """
        in_laser = (points - self.origin) @ self.rotation.T
        in_laser[in_laser[:, 2] <= 0] = np.nan
        by_point, _ = project_jacobian(in_laser, mirror_offset)
        # A small rotation vector w and displacement d move a point to P + w x P - R d.
        moved = np.concatenate(
            [-skew(in_laser), np.broadcast_to(-self.rotation, (len(points), 3, 3))], axis=-1
        )
        jacobian = by_point @ moved
        return project(in_laser, mirror_offset), jacobian @ self.covariance @ jacobian.swapaxes(
            -1, -2
        )


def rough_poses(matched: MatchedPoints) -> list[RoughPose]:
    """Find the poses that fit a few marks, the likeliest first.

    Parameters
    ----------
    matched : MatchedPoints
        Three or more, with the standard deviations of their angles.

    Raises
    ------
    UserError
        If there are fewer, they lie on one line, or no pose was found.
    """
    return [*_remembered(_Marks.from_points(matched))]


@dataclass(frozen=True)
class _Marks:
    """Marks that are the same as others of the same numbers."""

    numbers: tuple[object, ...]
    matched: MatchedPoints = field(compare=False)

    @classmethod
    def from_points(cls, matched: MatchedPoints) -> _Marks:
        """Take all that decides the poses."""
        arrays = (matched.points, matched.angles, matched.step, matched.relative_std)
        numbers = (matched.std is None, matched.mirror_offset, matched.max_iterations)
        return cls((*numbers, *(np.asarray(a, float).tobytes() for a in arrays)), matched)


@lru_cache(REMEMBERED)
def _remembered(marks: _Marks) -> tuple[RoughPose, ...]:
    """Find what `rough_poses` gives, once."""
    matched = marks.matched
    given = observations(
        matched.points, matched.angles, matched.step, matched.mirror_offset, {}, matched.std
    )
    start = _starts(given)
    count = len(start.rotation)
    if not count:
        raise UserError("no pose has all marks in front of it")
    problem = weighted_problem(given).take(np.zeros(count, int))
    pose, cost, _ = levenberg_marquardt(problem, start, count, matched.max_iterations)
    found = _distinct(pose, cost)
    if not len(found):
        raise UserError("no pose fits the marks")
    problem, pose, cost = problem.take(found), take(pose, found), cost[found]
    information, _ = normal_equations(problem, pose, linearise(problem, pose))
    dof = 2 * len(matched) - 6
    excess = _excess(float(cost.min()), dof)
    inverse = np.asarray(excess * np.linalg.inv(information + VAGUE), np.float64)
    covariance = about_origin(inverse, pose.rotation, pose.centre)
    origin = given.centroid - np.einsum("mji,mj->mi", pose.rotation, pose.centre)
    centroid = given.centroid[0]
    each = [
        RoughPose(pose.rotation[k], origin[k], covariance[k], float(cost[k]), dof, 1.0)
        for k in range(len(found))
    ]
    logarithm = np.array([-one.cost / excess / 2 + _prior(one, centroid) for one in each])
    probability = np.exp(logarithm - logarithm.max())
    probability[probability < UNLIKELY] = 0.0
    probability /= probability.sum()
    return tuple(
        RoughPose(one.rotation, one.origin, one.covariance, one.cost, dof, float(p))
        for p, one in sorted(zip(probability, each, strict=True), key=lambda pair: -pair[0])
        if p > 0
    )


def _excess(cost: float, dof: int) -> float:
    """Give the factor of the stated variance that explains residuals which refute it, else one."""
    refuted = dof > 0 and chi_square_p_value(cost, dof) < REFUTED
    return cost / dof if refuted else 1.0


def _prior(pose: RoughPose, centroid: Array) -> float:
    """Give the logarithm of how likely an instrument stands so, before any mark."""
    upright = ODD + math.exp(-((pose.roll / ROLL) ** 2) / 2)
    in_front = 1.0 if pose.origin[2] > centroid[2] else BEHIND
    return math.log(upright * in_front)


def _starts(given: Observations) -> Pose:
    """Give poses from which every minimum is reached: those that fit best of a grid of rotations.

    Marks that are nearly in a line, or in a plane, have minima close to each other.
    """
    offset = np.full((1, 1), given.nominal[0])
    form = object_space_form(given.points, *beam_planes(given.angles, offset))
    every, lifted, _ = rotation_grid()
    count = STARTS if given.angles.shape[-1] == 3 else FEW_STARTS
    rotation = every[np.argsort(form.error(lifted))[:count]]
    best, _ = start_poses(given.points, given.normal, given.angles, offset)
    rotation = np.concatenate([best[0], rotation])
    centre = form.centre(lift(rotation))
    start = Pose(rotation, centre, np.tile(given.nominal, (len(rotation), 1)))
    problem = weighted_problem(given).take(np.zeros(len(rotation), int))
    return take(start, np.isfinite(linearise(problem, start).cost))


def _distinct(pose: Pose, cost: Array) -> IndexArray:
    """Take the positions of poses that differ, from the lowest cost on."""
    kept: list[int] = []
    for k in np.argsort(cost):
        if not np.isfinite(cost[k]):
            break
        cosine = np.einsum("mij,ij->m", pose.rotation[kept], pose.rotation[k])
        if np.all(cosine < 1 + 2 * np.cos(DISTINCT)):
            kept.append(int(k))
    return np.array(kept, np.intp)


def predicted_angles(
    poses: Sequence[RoughPose], points: Array, laser: TwoMirror
) -> tuple[Array, Array]:
    """Give the angles of places by the likeliest pose, and what all poses leave open of them.

    Returns
    -------
    angle : ndarray, shape (N, 2), rad
        NaN of places behind the instrument, else also beyond the mirrors' reach.
    std : ndarray, shape (N, 2), steps
    """
    offset = laser.mirror_offset
    angle, _ = poses[0].angles(points, offset)
    variance = np.zeros(angle.shape)
    for pose in poses:
        own, covariance = pose.angles(points, offset)
        square = np.einsum("nkk->nk", covariance) + (own - angle) ** 2
        variance += pose.probability * np.where(np.isfinite(square), square, 0.0)
    return angle, np.sqrt(variance) / laser.step


def predicted_steps(
    poses: Sequence[RoughPose], points: Array, laser: TwoMirror
) -> tuple[Array, Array]:
    """Give the DAC steps of places by all poses that fit, and their standard deviations.

    Parameters
    ----------
    poses : sequence of RoughPose
        The likeliest first.
    points : ndarray, shape (N, 3), m

    Returns
    -------
    dac, std : ndarray, shape (N, 2), steps
        NaN for places that the mirrors do not reach.
    """
    angle, std = predicted_angles(poses, points, laser)
    reached = laser.reaches(angle)
    dac = np.full(angle.shape, np.nan)
    dac[reached] = laser.dac_from_angle(angle[reached])
    return dac, np.where(reached[:, None], std, np.nan)
