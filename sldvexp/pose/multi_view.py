"""Poses of several views from points and mirror angles, with intrinsics that the views share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.pose.base import EXTRINSICS
from sldvexp.pose.bundle_adjustment import Adjusted, Common, LinearisedResiduals, adjust
from sldvexp.pose.intrinsics import named, nominal_intrinsics, places, true_angles
from sldvexp.pose.least_squares import INTRINSICS, Pose, PoseProblem, linearise
from sldvexp.pose.single_view import PoseSolution, observations, solve_pose
from sldvexp.pose.uncertainty import origin_jacobian
from sldvexp.typing import Array

#: Starts of all views anew, with the intrinsics that the last ones gave.
STARTS = 5
#: Part of the cost that a new start must save to be one.
SAVED = 1e-6


@dataclass(frozen=True, eq=False)
class PointObservations:
    """What one view saw.

    Parameters
    ----------
    name : str
        Of the view, for messages.
    points : ndarray, shape (N, 3), m
        In the world.
    angles : ndarray, shape (N, 2), rad
        Recorded, by the nominal calibration.
    std : ndarray, shape (N,), DAC steps, optional
        Standard deviation of each angle; all views have it or none.
    """

    name: str
    points: Array
    angles: Array
    std: Array | None = None


@dataclass(frozen=True, eq=False)
class PointView:
    """One view's points in the adjustment; its unknowns are pose and own intrinsics.

    Parameters
    ----------
    problem : PoseProblem
        Of one view; own intrinsics are the first that it adjusts, shared ones the others.
    pose : Pose
    own_prior : ndarray, shape (own,)
        Standard deviations; infinite for a free one.
    expected : ndarray, shape (own,)
    """

    problem: PoseProblem
    pose: Pose
    own_prior: Array
    expected: Array

    @property
    def own(self) -> list[int]:
        """Positions in `INTRINSICS` of those of this view."""
        return self.problem.adjusted[: len(self.own_prior)]

    def with_common(self, common: Array) -> Pose:
        """The pose with the shared intrinsics."""
        intrinsics = self.pose.intrinsics.copy()
        intrinsics[0, self.problem.adjusted[len(self.own_prior) :]] = common
        return self.pose._replace(intrinsics=intrinsics)

    def linearise(self, common: Array) -> LinearisedResiduals:
        """See `sldvexp.pose.bundle_adjustment.ViewTerms`."""
        at = linearise(self.problem, self.with_common(common))
        residual = at.residual[0]
        if not np.isfinite(at.cost[0]):
            residual = np.full_like(residual, np.inf)
        # The derivatives there are those of the predicted angles.
        jacobian, own = -at.jacobian[0].T, len(EXTRINSICS) + len(self.own_prior)
        return LinearisedResiduals(residual, jacobian[:, :own], jacobian[:, own:])

    def moved(self, step: Array) -> PointView:
        """See `sldvexp.pose.bundle_adjustment.ViewTerms`."""
        return replace(self, pose=self.pose.moved(step[None], self.own))

    def weighed(self, common: Array) -> PointView:
        """The standard errors are given."""
        return self

    def prior(self) -> tuple[Array, Array]:
        """See `sldvexp.pose.bundle_adjustment.ViewTerms`."""
        away = self.pose.intrinsics[0, self.own] - self.expected
        free = np.zeros(len(EXTRINSICS))
        return np.append(free, self.own_prior**-2.0), np.append(free, away)


def solve_together(
    sights: Sequence[PointObservations],
    *,
    step: Array,
    mirror_offset: float,
    adjusted: Mapping[str, float],
    shared: Mapping[str, float],
    max_iterations: int,
) -> tuple[list[PoseSolution], Array]:
    """Poses of all views and the intrinsics that they share, by least squares over all angles.

    Parameters
    ----------
    sights : sequence of PointObservations
        Of each view.
    step : ndarray, shape (2,), rad
        Angle of one DAC step of each mirror.
    mirror_offset : float, m
        Nominal.
    adjusted, shared : mapping of str to float
        Intrinsics to adjust for each view and for all views, with the standard deviations of their
        Gaussian priors about the nominal values; infinite for a free one.
    max_iterations : int

    Returns
    -------
    solutions : list of PoseSolution
        Of each view; its covariance holds the uncertainty of the shared intrinsics. Without `std`
        all views have the same noise, estimated from all, and `dof` are those of all.
    covariance : ndarray, shape (all, all)
        Of each view's `EXTRINSICS` and own intrinsics, view by view, then of the shared ones.

    Raises
    ------
    UserError
        If the input is malformed or something is not determined.
    """
    nominal = nominal_intrinsics(mirror_offset)
    expected = nominal[places(shared)]
    common = Common(expected, expected, np.array(list(shared.values()), float))
    known = sights[0].std is not None
    _check_enough(sights, adjusted, shared, known)

    def single(intrinsics: Array) -> list[PoseSolution]:
        """Each view for itself, with the shared intrinsics as they are."""
        return [_single(s, intrinsics, step, adjusted, max_iterations) for s in sights]

    best: Adjusted[PointView] | None = None
    alone = single(nominal)
    for _ in range(STARTS):
        views = [
            _view(s, a, step, mirror_offset, adjusted, shared)
            for s, a in zip(sights, alone, strict=True)
        ]
        found = adjust(views, common, known, not known, max_iterations)
        _check(found, list(shared))
        if best is not None and _cost(found) > (1 - SAVED) * _cost(best):
            break
        best, common = found, found.common
        intrinsics = nominal.copy()
        intrinsics[places(shared)] = common.value
        alone = single(intrinsics)
    assert best is not None
    return _solutions(best, sights, alone, step, [*adjusted, *shared])


def _single(
    sight: PointObservations,
    intrinsics: Array,
    step: Array,
    adjusted: Mapping[str, float],
    most: int,
) -> PoseSolution:
    try:
        return solve_pose(
            sight.points,
            true_angles(sight.angles, intrinsics),
            step=step,
            mirror_offset=float(intrinsics[0]),
            adjust=adjusted,
            std=sight.std,
            max_iterations=most,
        )
    except UserError as error:
        raise UserError(f"view {sight.name}: {error}") from None


def _view(
    sight: PointObservations,
    start: PoseSolution,
    step: Array,
    mirror_offset: float,
    adjusted: Mapping[str, float],
    shared: Mapping[str, float],
) -> PointView:
    """A view's observations, and where it starts."""
    given = observations(sight.points, sight.angles, step, mirror_offset, adjusted, sight.std)
    known = [*given.prior_std, *places(shared)]
    problem = PoseProblem(
        points=given.points,
        recorded=given.angles,
        weight=1 / (given.std * given.step[:, None]),
        adjusted=known,
        prior=given.nominal[None, known],
        prior_weight=np.zeros((1, len(known))),
    )
    centre = start.rotation @ (given.centroid[0] - start.origin)
    intrinsics = given.nominal.copy()
    own = places(adjusted)
    intrinsics[own] = [start.intrinsics[name] for name in adjusted]
    pose = Pose(start.rotation[None], centre[None], intrinsics[None])
    prior = np.array(list(adjusted.values()), float)
    return PointView(problem, pose, prior, given.nominal[own])


def _check_enough(
    sights: Sequence[PointObservations],
    adjusted: Mapping[str, float],
    shared: Mapping[str, float],
    known: bool,
) -> None:
    angles = sum(2 * len(s.points) for s in sights)
    own = len(EXTRINSICS) + sum(np.isinf(std) for std in adjusted.values())
    free = own * len(sights) + sum(np.isinf(std) for std in shared.values())
    if angles < free or (angles == free and not known):
        raise UserError(
            f"{angles} angles in all views are too few for {free} unknowns and the noise: add "
            "points or share fewer intrinsics"
        )


def _check(found: Adjusted[PointView], shared: list[str]) -> None:
    """UserError if a shared intrinsic was not determined."""
    share = found.arrow.undetermined_common()
    if share.any():
        raise UserError(
            f"the angles of all views cannot tell {named(shared, share)} from motions of the "
            "instrument: keep it fixed or give it a prior, or a narrower one"
        )


def _cost(found: Adjusted[PointView]) -> float:
    """In squared standard deviations, whatever noise was found."""
    return found.cost * float(found.variance[0])


def _solutions(
    found: Adjusted[PointView],
    sights: Sequence[PointObservations],
    alone: Sequence[PoseSolution],
    step: Array,
    adjusted: list[str],
) -> tuple[list[PoseSolution], Array]:
    """Solutions about the origin, and the joint covariance."""
    count = len(found.covariance)
    transform = np.eye(count)
    for view, place in zip(found.views, found.places, strict=True):
        six = slice(place.start, place.start + len(EXTRINSICS))
        transform[six, six] = origin_jacobian(view.pose.rotation[0], view.pose.centre[0])
    covariance = transform @ found.covariance @ transform.T
    common = np.arange(found.places[-1].stop, count)
    solutions = []
    for k, (view, sight, other) in enumerate(zip(found.views, sights, alone, strict=True)):
        pose, own = view.with_common(found.common.value), np.r_[found.places[k], common]
        std = 1.0 if sight.std is None else sight.std[:, None]
        residual = found.residual[k].reshape(2, -1).T * std
        solutions.append(
            replace(
                other,
                rotation=pose.rotation[0],
                origin=sight.points.mean(axis=0) - pose.rotation[0].T @ pose.centre[0],
                intrinsics=dict(zip(INTRINSICS, pose.intrinsics[0], strict=True)),
                parameters=(*EXTRINSICS, *adjusted),
                covariance=covariance[np.ix_(own, own)],
                residual=residual,
                cost=np.asarray(np.sum(found.residual[k] ** 2)),
                sse_deg2=np.sum(np.degrees(residual * step) ** 2),
                dof=found.dof[k],
                s=np.sqrt(found.variance[k]),
                converged=np.asarray(found.converged),
            )
        )
    return solutions, covariance
