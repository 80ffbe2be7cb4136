"""Least-squares adjustment of many poses at once: Levenberg-Marquardt on mirror angles.

Each problem has the pose of its points' centroid, ``P_laser = R (p - centroid) + centre``, and the
laser's intrinsics; a step turns the points about their centroid. Points lie in the last dimension
of every array; a `weight` is one over the standard deviation of an angle, in rad.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from sldvexp.geometry import skew
from sldvexp.typing import Array, BoolArray, IndexArray

Index = BoolArray | IndexArray

#: Names of the intrinsics, in the order of their arrays.
INTRINSICS = ("mirror_offset", "gain_up_down", "zero_up_down", "gain_left_right", "zero_left_right")
#: The damping a problem begins with and the least one, relative to the curvature.
DAMPING, LEAST_DAMPING = 1e-4, 1e-12
#: A pose has converged when its next step would lower the cost by less than this part of it.
TOLERANCE = 1e-12
#: The same for a start that is being beaten, relative to how far it is behind.
TOLERANCE_BEHIND = 1e-8
#: ``w SKEW`` is the matrix ``[w]`` of a cross product, flattened.
SKEW = skew(np.eye(3)).reshape(3, 9)


def cross_matrix(vector: Array) -> Array:
    """Make the matrix [v] with ``[v] a = v x a``, shape (..., 3, 3), in one product."""
    return (vector @ SKEW).reshape(*vector.shape, 3)


def turned(rotation: Array, vector: Array) -> Array:
    """Turn each rotation (..., 3, 3) by a small rotation vector (..., 3), in rad.

    Cayley's form of ``exp([vector]) rotation``: equal to second order and a rotation for any
    vector, at a few array operations.
    """
    half = vector / 2
    k = cross_matrix(half)
    scale = 2 / (1 + (half * half).sum(axis=-1))
    return rotation + scale[..., None, None] * ((k + k @ k) @ rotation)


def solve(matrix: Array, right: Array) -> Array:
    """Solve ``matrix x = right`` for stacks of matrices (..., n, n) and vectors (..., n)."""
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], np.float64)


class Pose(NamedTuple):
    """A stack of poses: rotation (M, 3, 3), centre (M, 3) in m, intrinsics (M, 5)."""

    rotation: Array
    centre: Array
    intrinsics: Array

    def moved(self, step: Array, adjusted: list[int]) -> Pose:
        """Make a step (M, 6 + adjusted): rotation vector, displacement, change of intrinsics."""
        intrinsics = self.intrinsics
        if adjusted:
            intrinsics = intrinsics.copy()
            intrinsics[:, adjusted] += step[:, 6:]
        rotation = turned(self.rotation, step[:, :3])
        return Pose(rotation, self.centre + step[:, 3:6], intrinsics)


class Linearisation(NamedTuple):
    """Weighted residuals (M, 2N), their Jacobian (M, parameters, 2N) and the cost (M,)."""

    residual: Array
    jacobian: Array
    cost: Array


Stack = TypeVar("Stack", Pose, Linearisation)


def take(stack: Stack, index: Index) -> Stack:
    """Take the entries of a stack that an index or a mask names."""
    return type(stack)(*(field[index] for field in stack))


def choose(first: BoolArray, a: Stack, b: Stack) -> Stack:
    """Choose entries of `a` where `first`, of `b` elsewhere."""
    if first.all():
        return a
    return type(a)(
        *(
            np.where(first.reshape(-1, *(1,) * (x.ndim - 1)), x, y)
            for x, y in zip(a, b, strict=True)
        )
    )


@dataclass(frozen=True)
class PoseProblem:
    """Observations of a stack of M problems.

    Parameters
    ----------
    points : ndarray, shape (M or 1, 3, N), m
        In the world, relative to their centroid.
    recorded : ndarray, shape (M, 2, N), rad
        Angles as the nominal calibration has them, ``(angle - zero) / gain``.
    weight : ndarray, shape (M or 1, 2, N), 1/rad
    adjusted : list of int
        Positions in `INTRINSICS` of those that are adjusted.
    prior : ndarray, shape (M, adjusted)
        Expected values of those.
    prior_weight : ndarray, shape (M, adjusted)
        Zero for a free one.
    """

    points: Array
    recorded: Array
    weight: Array
    adjusted: list[int]
    prior: Array
    prior_weight: Array

    def take(self, index: Index) -> PoseProblem:
        """Take the problems that an index or a mask names."""

        def of(a: Array) -> Array:
            return a[index] if len(a) > 1 else a

        return replace(
            self,
            points=of(self.points),
            recorded=self.recorded[index],
            weight=of(self.weight),
            prior=self.prior[index],
            prior_weight=self.prior_weight[index],
        )


def linearise(problem: PoseProblem, pose: Pose) -> Linearisation:
    """Evaluate residuals of the two-mirror model and their derivatives (Eqs 4.2 and 4.3).

    The derivatives are those of the *predicted* angles by the rotation vector, the displacement of
    the centre and the adjusted intrinsics. A pose with a point not in front has infinite cost.
    """
    m, n = len(pose.rotation), problem.points.shape[-1]
    about_centre = pose.rotation @ problem.points
    x, y, z = (about_centre + pose.centre[:, :, None]).swapaxes(0, 1)
    square_radius = y * y + z * z
    radius = np.sqrt(square_radius)
    reach = radius + pose.intrinsics[:, 0, None]
    square = x * x + reach * reach

    angle = np.empty((m, 2, n))
    np.arctan2(y, z, out=angle[:, 0])
    np.arctan2(x, reach, out=angle[:, 1])
    observed, weight = problem.recorded, problem.weight
    if problem.adjusted:
        gain, zero = pose.intrinsics[:, 1::2, None], pose.intrinsics[:, 2::2, None]
        observed, weight = gain * observed + zero, weight / gain
    residual = (observed - angle) * weight

    jacobian = np.zeros((m, 6 + len(problem.adjusted), 2, n))
    by_x, by_y, by_z = jacobian[:, 3], jacobian[:, 4], jacobian[:, 5]
    by_y[:, 0], by_z[:, 0] = z / square_radius, -y / square_radius
    slope = -x / (radius * square)
    by_x[:, 1], by_y[:, 1], by_z[:, 1] = reach / square, slope * y, slope * z
    p, q, r = about_centre.swapaxes(0, 1)[:, :, None]
    jacobian[:, 0] = q * by_z - r * by_y
    jacobian[:, 1] = r * by_x - p * by_z
    jacobian[:, 2] = p * by_y - q * by_x
    for k, index in enumerate(problem.adjusted, start=6):
        mirror = (index - 1) // 2
        if INTRINSICS[index] == "mirror_offset":
            jacobian[:, k, 1] = -x / square
        elif INTRINSICS[index].startswith("gain"):
            jacobian[:, k, mirror] = (zero - angle)[:, mirror] / gain[:, mirror]
        else:
            jacobian[:, k, mirror] = -1.0
    jacobian *= weight[:, None]
    cost = np.einsum("mij,mij->m", residual, residual)
    if problem.adjusted:
        away = (pose.intrinsics[:, problem.adjusted] - problem.prior) * problem.prior_weight
        cost += np.einsum("ij,ij->i", away, away)
    cost[z.min(axis=-1) <= 0] = np.inf
    return Linearisation(residual.reshape(m, 2 * n), jacobian.reshape(m, -1, 2 * n), cost)


def normal_equations(problem: PoseProblem, pose: Pose, at: Linearisation) -> tuple[Array, Array]:
    """Make information matrix (M, p, p) and right-hand side (M, p), with the priors in them."""
    matrix = at.jacobian @ at.jacobian.swapaxes(-1, -2)
    right = (at.jacobian @ at.residual[:, :, None])[:, :, 0]
    if problem.adjusted:
        precision = problem.prior_weight**2
        right[:, 6:] += precision * (problem.prior - pose.intrinsics[:, problem.adjusted])
        np.einsum("mkk->mk", matrix)[:, 6:] += precision
    return matrix, right


def levenberg_marquardt(
    problem: PoseProblem, pose: Pose, starts: int, max_iterations: int
) -> tuple[Pose, Array, BoolArray]:
    """Follow every start down to its least weighted sum of squares.

    Parameters
    ----------
    pose : Pose
        Where to start; each run of `starts` entries belongs to the same observations.

    Returns
    -------
    cost : ndarray, shape (M,)
        Infinite where no pose with all points in front was found.
    converged : ndarray of bool, shape (M,)
    """
    solution, at = Pose(*(field.copy() for field in pose)), linearise(problem, pose)
    cost, converged = at.cost.copy(), np.zeros(len(at.cost), bool)
    active = np.arange(len(cost))
    damping, growth = np.full(len(cost), DAMPING), np.full(len(cost), 2.0)
    for _ in range(max_iterations):
        matrix, right = normal_equations(problem, pose, at)
        diagonal = np.einsum("mkk->mk", matrix)
        extra = damping[:, None] * diagonal
        diagonal += extra
        step = solve(matrix, right)
        expected = np.einsum("mk,mk->m", step, right + extra * step)
        trial = pose.moved(step, problem.adjusted)
        then = linearise(problem, trial)

        least = cost.reshape(-1, starts).min(axis=1)[active // starts]
        with np.errstate(invalid="ignore", divide="ignore"):  # infinite costs are never finished
            enough = TOLERANCE * (1 + least) + TOLERANCE_BEHIND * (at.cost - least)
            ratio = (at.cost - then.cost) / expected
        done = (expected <= enough) & np.isfinite(at.cost)
        better = then.cost <= at.cost + np.where(done, TOLERANCE * at.cost, 0.0)
        pose, at = choose(better, trial, pose), choose(better, then, at)
        for field, value in zip(solution, pose, strict=True):
            field[active] = value
        cost[active], converged[active] = at.cost, done
        if done.all():
            break
        # A decrease as expected lets the damping fall tenfold; a failure raises it ever faster.
        change = np.where(better, np.maximum(1 - (2 * ratio - 1) ** 3, 0.1), growth)
        damping = np.maximum(damping * change, LEAST_DAMPING)
        growth = np.where(better, 2.0, 2 * growth)
        if done.any():
            keep = ~done
            active, damping, growth = active[keep], damping[keep], growth[keep]
            problem, pose, at = problem.take(keep), take(pose, keep), take(at, keep)
    return solution, cost, converged
