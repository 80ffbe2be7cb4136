"""Pose from object points and mirror angles, without a starting guess, for one or many at once.

The recorded angles less those of the two-mirror model (Eqs 4.2 and 4.3) are least squares in the
pose and in what is adjusted of the intrinsics. A closed form gives two starts, since a plane object
looks nearly the same from two places; Levenberg-Marquardt steps lead both down, and the lower one
is the pose. Angles err independently and alike, or as a given standard deviation says. With priors
and noise that is not known, the noise is estimated in turns with the pose, for the priors' weight
depends on it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError, nearest
from sldvexp.pose.base import EXTRINSICS
from sldvexp.pose.initial_pose import start_poses
from sldvexp.pose.intrinsics import named, nominal_intrinsics, places
from sldvexp.pose.least_squares import INTRINSICS, Pose, PoseProblem, levenberg_marquardt, take
from sldvexp.pose.solution import PoseSolution
from sldvexp.pose.uncertainty import about_origin, worth
from sldvexp.typing import Array, BoolArray, IndexArray

#: Two solutions whose rotations differ by less, in rad, are one.
DISTINCT = 1e-3
#: Problems solved together; more no longer fit the processor's cache.
BLOCK = 256
#: Rounds in which the noise's variance and the weight of the priors settle, and how closely.
ROUNDS, SETTLED = 50, 1e-6
#: Least variance of the noise, in squared DAC steps: noise-free data must not void the priors.
LEAST_VARIANCE = 1e-8


def solve_points(
    object_points: ArrayLike,
    angles: ArrayLike,
    *,
    step: ArrayLike,
    mirror_offset: float = 0.0,
    adjust: Mapping[str, float] | None = None,
    std: ArrayLike | None = None,
    max_iterations: int = 200,
) -> PoseSolution:
    """Solve for the laser's pose from points and the mirror angles that reach them (Section 4.6.2).

    Parameters
    ----------
    object_points : array_like, shape (points, 3) or (batch, points, 3), m
        In the world; one set may serve the whole batch.
    angles : array_like, shape (points, 2) or (batch, points, 2), rad
        Recorded (up_down, left_right) by the nominal calibration, ``(angle - zero) / gain``.
    step : array_like, shape (2,), rad
        Angle of one DAC step of each mirror.
    mirror_offset : float, m
        Nominal, and the mean of its prior if it is adjusted.
    adjust : mapping of str to float
        Names from `INTRINSICS` to the standard deviation of their Gaussian prior about the nominal
        value (m, rad, gains relative), `inf` for a free one. What is not named stays nominal.
    std : array_like, broadcastable to (batch, points), optional, DAC steps
        Standard deviation of each angle. Without it all are alike and estimated from the residuals,
        so that a prior which the angles contradict is taken for more noise.
    max_iterations : int
        Of each start.

    Raises
    ------
    UserError
        If the input is malformed, the points lie on one line, or a parameter is not determined.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.laser import project
    >>> points = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0], [0.1, 0.1, 0.1]])
    >>> stand, facing = np.array([0.2, 0.1, 1.5]), np.diag([1.0, -1.0, -1.0])
    >>> angles = project((points - stand) @ facing.T).round(4)
    >>> pose = solve_points(points, angles, step=1e-4)
    >>> pose.origin.round(3)
    array([0.2, 0.1, 1.5])
    >>> pose
    pose from 5 points: origin (...) m, std (...) mm, residuals ... DAC steps rms
    """
    given = observations(object_points, angles, step, mirror_offset, adjust or {}, std)
    blocks = [
        _solve(given.part(slice(first, first + BLOCK)), max_iterations)
        for first in range(0, len(given.angles), BLOCK)
    ]
    fields = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    _check_determined(given, fields.pop("undetermined"))
    if not given.batched:
        fields = {name: field[0] for name, field in fields.items()}
    return PoseSolution(
        intrinsics=dict(zip(INTRINSICS, np.moveaxis(fields.pop("intrinsics"), -1, 0), strict=True)),
        parameters=EXTRINSICS + tuple(INTRINSICS[k] for k in given.prior_std),
        noise_known=given.noise_known,
        noise_dof=np.inf,
        **fields,
    )


def _solve(given: Observations, max_iterations: int) -> dict[str, Array]:
    """Solve one block of problems for the fields of `PoseSolution`."""
    each = np.arange(len(given.angles))
    offset = np.full((len(each), 1), given.nominal[0])
    rotation, centre = start_poses(given.points, given.normal, given.angles, offset)
    pose = Pose(
        rotation.reshape(-1, 3, 3),
        centre.reshape(-1, 3),
        np.tile(given.nominal, (2 * len(each), 1)),
    )
    problem = weighted_problem(given).take(each.repeat(2))
    pose, cost, converged = levenberg_marquardt(problem, pose, 2, max_iterations)
    priors = [math.isfinite(std) for std in given.prior_std.values()]
    if any(priors) and not given.noise_known:
        problem, pose, cost, converged = _settle_noise(problem, pose, max_iterations)

    best = 2 * each + np.argmin(cost.reshape(-1, 2), axis=1)
    other = best ^ 1
    fields = _evaluated(given, problem.take(best), take(pose, best), converged[best])
    fields |= {"cost": cost[best], "converged": converged[best]}
    turned = np.einsum("mij,mij->m", pose.rotation[best], pose.rotation[other])
    distinct = turned < 1 + 2 * np.cos(DISTINCT)
    has_other = distinct & converged[other]
    second = {
        "other_rotation": pose.rotation[other],
        "other_origin": _origin(given, take(pose, other)),
        "other_cost": cost[other],
    }
    for field in second.values():
        field[~has_other] = np.nan
    return fields | second | {"has_other": has_other}


def weighted_problem(given: Observations) -> PoseProblem:
    """Weigh by a unit of noise: a DAC step, or the given standard deviation."""
    adjusted = list(given.prior_std)
    shape = (len(given.angles), len(adjusted))
    prior_std = np.array(list(given.prior_std.values()))
    return PoseProblem(
        points=given.points,
        recorded=given.angles,
        weight=1 / (given.std * given.step[:, None]),
        adjusted=adjusted,
        prior=np.broadcast_to(given.nominal[adjusted], shape),
        prior_weight=np.broadcast_to(1 / prior_std, shape),
    )


def _origin(given: Observations, pose: Pose) -> Array:
    """Give the origin of ``centre = R (centroid - origin)``, shape (M, 3), m."""
    return given.centroid - np.einsum("mji,mj->mi", pose.rotation, pose.centre)


def _settle_noise(
    problem: PoseProblem, pose: Pose, max_iterations: int
) -> tuple[PoseProblem, Pose, Array, BoolArray]:
    """Follow two starts of each problem while the noise, and so the priors' weight, settles."""
    of_unit_noise = problem.prior_weight
    variance = np.ones(len(pose.centre))
    for _ in range(ROUNDS):
        before = variance
        variance = np.maximum(worth(problem, pose).variance, LEAST_VARIANCE)
        problem = replace(problem, prior_weight=of_unit_noise * np.sqrt(variance)[:, None])
        pose, cost, converged = levenberg_marquardt(problem, pose, 2, max_iterations)
        settled = np.abs(variance - before) <= SETTLED * variance
        if settled.all():
            break
    return problem, pose, cost, converged & settled


def _evaluated(
    given: Observations, problem: PoseProblem, pose: Pose, converged: BoolArray
) -> dict[str, Array]:
    """Evaluate the better solution for `PoseSolution`, and what it leaves `undetermined`."""
    found = worth(problem, pose)
    variance = np.where(given.noise_known, 1.0, found.variance)
    covariance = about_origin(found.cofactor, pose.rotation, pose.centre)
    known = converged & ~found.undetermined.any(axis=-1) & np.isfinite(variance)
    covariance *= np.where(known, variance, 1.0)[:, None, None]
    covariance[~known] = np.inf
    residual = found.residual * given.std
    degrees = np.degrees(residual * given.step[:, None])
    return {
        "rotation": pose.rotation,
        "origin": _origin(given, pose),
        "intrinsics": pose.intrinsics,
        "covariance": covariance,
        "residual": residual.swapaxes(-1, -2),
        "sse_deg2": np.einsum("mij,mij->m", degrees, degrees),
        "dof": found.dof,
        "s": np.sqrt(found.variance),
        "undetermined": np.where(converged[:, None], found.undetermined, 0.0),
    }


def _check_determined(given: Observations, share: Array) -> None:
    """Raise if a motion of the instrument, or an intrinsic, changes no angle.

    `share` (batch, 6 + adjusted) is zero but where some direction is undetermined.
    """
    undetermined = np.argwhere(share.any(axis=-1))
    if not len(undetermined):
        return
    first = undetermined[0]
    where = place(first, len(share))
    if names := named([INTRINSICS[k] for k in given.prior_std], share[first[0], 6:]):
        raise UserError(
            f"the angles{where} cannot tell {names} from a motion of the instrument: "
            "keep it fixed or give it a finite prior"
        )
    raise UserError(
        f"the points and angles{where} leave the pose undetermined, since a motion of the "
        "instrument changes none of them: add points"
    )


#: Points whose second largest spread is below this part of the largest lie on one line.
COLLINEAR = 1e-6


@dataclass(frozen=True)
class Observations:
    """A stack of problems, the points in the last dimension.

    Parameters
    ----------
    points : ndarray, shape (batch or 1, 3, points), m
        In the world, relative to their centroid.
    centroid : ndarray, shape (batch or 1, 3), m
    normal : ndarray, shape (batch or 1, 3)
        Direction in which the points spread least.
    angles : ndarray, shape (batch, 2, points), rad
    step : ndarray, shape (2,), rad
    std : ndarray, shape (batch or 1, 1, points), DAC steps
        Standard deviations of the angles; one step if unknown.
    noise_known : bool
        Whether `std` was given.
    nominal : ndarray, shape (5,)
        Values of `INTRINSICS`.
    prior_std : dict of int to float
        Positions in `INTRINSICS` of those to adjust; infinite for a free one.
    batched : bool
        Whether the input had a batch dimension.
    """

    points: Array
    centroid: Array
    normal: Array
    angles: Array
    step: Array
    std: Array
    noise_known: bool
    nominal: Array
    prior_std: dict[int, float]
    batched: bool

    def part(self, block: slice) -> Observations:
        """Take those problems; what they share is kept."""

        def part(a: Array) -> Array:
            return a if len(a) == 1 else a[block]

        return replace(
            self,
            points=part(self.points),
            centroid=part(self.centroid),
            normal=part(self.normal),
            angles=self.angles[block],
            std=part(self.std),
        )


def observations(
    object_points: ArrayLike,
    angles: ArrayLike,
    step: ArrayLike,
    mirror_offset: float,
    adjust: Mapping[str, float],
    std: ArrayLike | None,
) -> Observations:
    """Check the arguments of `solve_points` and bring them into shape.

    Raises
    ------
    UserError
        At the first mistake.
    """
    points, recorded = np.asarray(object_points, float), np.asarray(angles, float)
    _check_shapes(points, recorded)
    batched = recorded.ndim == 3
    points = points.reshape(-1, *points.shape[-2:])
    recorded = recorded.reshape(-1, *recorded.shape[-2:])
    _check_all(np.isfinite(points).all(axis=-1), "the coordinates", "must be finite")
    in_front = (np.abs(recorded) < np.pi / 2).all(axis=-1)
    _check_all(in_front, "the angles", "must lie between -90 and 90 degrees")
    differ = (recorded != recorded[:, :1]).any(axis=(1, 2))
    _check_all(differ, "the angles", "must differ from point to point")
    steps = np.broadcast_to(np.asarray(step, float), (2,))
    if not (np.isfinite(steps) & (steps > 0)).all():
        raise UserError(f"the angle of a DAC step must be positive, not {steps.tolist()} rad")
    _check_adjust(mirror_offset, adjust, recorded.shape[-2], std is not None)

    points = points.swapaxes(-1, -2)
    centroid = points.mean(axis=-1)
    points = points - centroid[..., None]
    return Observations(
        points=points,
        centroid=centroid,
        normal=_least_spread(points),
        angles=np.ascontiguousarray(recorded.swapaxes(-1, -2)),
        step=steps,
        std=_deviations(std, recorded.shape[:2], batched),
        noise_known=std is not None,
        nominal=nominal_intrinsics(mirror_offset),
        prior_std=dict(zip(places(adjust), map(float, adjust.values()), strict=True)),
        batched=batched,
    )


def place(index: IndexArray, batch: int) -> str:
    """Say of which problem, or which point (problem, point); the problem only if there are many."""
    point = f" of point {index[1] + 1}" if len(index) > 1 else ""
    return point + (f" of pose {index[0] + 1} of {batch}" if batch > 1 else "")


def _check_shapes(points: Array, angles: Array) -> None:
    lead = angles.shape[:-2]
    fits = (
        len(lead) <= 1
        and angles.ndim >= 2
        and angles.shape[-1] == 2
        and points.shape in ((angles.shape[-2], 3), (*lead, angles.shape[-2], 3))
    )
    if not fits:
        raise UserError(
            "object points and angles must be (points, 3) and (points, 2), or the same with a "
            f"batch before them, not {points.shape} and {angles.shape}"
        )
    if angles.shape[-2] < 3:
        raise UserError(f"a pose needs at least 3 points, not {angles.shape[-2]}")
    if not angles.size:
        raise UserError("there is no pose to solve: the batch is empty")


def _check_all(ok: BoolArray, what: str, right: str) -> None:
    """Raise about the first (problem, point) that is not `ok`."""
    if not ok.all():
        raise UserError(f"{what}{place(np.argwhere(~ok)[0], len(ok))} {right}")


def _check_adjust(
    mirror_offset: float, adjust: Mapping[str, float], points: int, noise_known: bool
) -> None:
    if not math.isfinite(mirror_offset):
        raise UserError(f"mirror_offset must be finite, not {mirror_offset}")
    for name, prior in adjust.items():
        if name not in INTRINSICS:
            raise UserError(f"no intrinsic is called {name}; {nearest(name, INTRINSICS)}")
        if not prior > 0:
            raise UserError(f"the prior of {name} must be a positive number or inf, not {prior}")
    free = 6 + sum(math.isinf(prior) for prior in adjust.values())
    if 2 * points < free:
        raise UserError(f"{points} points give {2 * points} angles, too few for {free} unknowns")
    if 2 * points == free and len(adjust) > free - 6 and not noise_known:
        raise UserError(
            f"{points} points leave no residuals that tell the noise, so that a prior has no "
            "weight beside them: give std, or more points"
        )


def _deviations(std: ArrayLike | None, shape: tuple[int, ...], batched: bool) -> Array:
    """Broadcast standard deviations to the shape (batch or 1, 1, points), DAC steps."""
    if std is None:
        return np.ones((1, 1, shape[1]))
    try:
        given = np.broadcast_to(np.asarray(std, float), shape)
    except ValueError:
        raise UserError(
            f"std must have one value a point, {shape if batched else shape[1:]}, "
            f"not {np.shape(std)}"
        ) from None
    _check_all(np.isfinite(given) & (given > 0), "the std", "must be positive")
    return given[:, None, :]


def _least_spread(points: Array) -> Array:
    """Find the direction in which centred points (..., 3, N) spread least, shape (..., 3).

    Raises
    ------
    UserError
        If they spread in one direction only.
    """
    square, direction = np.linalg.eigh(points @ points.swapaxes(-1, -2))
    line = np.argwhere(~(square[..., 1] > COLLINEAR**2 * square[..., 2]))
    if len(line):
        raise UserError(
            f"the object points{place(line[0], len(points))} lie on one line: "
            "a pose needs points that span a plane"
        )
    return direction[..., 0]
