"""Poses of several views from points and mirror angles, with intrinsics that the views share.

Each view is solved for itself first, the shared intrinsics held; from there all are adjusted
together (`sldvexp.pose.bundle_adjustment`). A view's own solution may lie in another valley once
the shared intrinsics have changed, so that this is repeated while it lowers the cost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.pose.base import EXTRINSICS, JointCovariance
from sldvexp.pose.bundle_adjustment import (
    Adjusted,
    Common,
    LinearisedResiduals,
    adjust_views,
)
from sldvexp.pose.intrinsics import named, nominal_intrinsics, places, true_angles
from sldvexp.pose.least_squares import INTRINSICS, Pose, PoseProblem, linearise
from sldvexp.pose.single_view import observations, solve_points, weighted_problem
from sldvexp.pose.solution import JointSolution, PoseSolution
from sldvexp.pose.uncertainty import origin_jacobian
from sldvexp.typing import Array

#: Starts of all views anew, with the intrinsics that the last ones gave.
STARTS = 5
#: Part of the cost that a new start must save to be one.
SAVED = 1e-6


@dataclass(frozen=True, eq=False)
class PointObservations:
    """Object points of one view and the mirror angles that reach them.

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
        """Give the pose the shared intrinsics."""
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
        """Stay as it is: the standard errors are given."""
        return self

    def prior(self) -> tuple[Array, Array]:
        """See `sldvexp.pose.bundle_adjustment.ViewTerms`."""
        away = self.pose.intrinsics[0, self.own] - self.expected
        free = np.zeros(len(EXTRINSICS))
        return np.append(free, self.own_prior**-2.0), np.append(free, away)


def solve_points_together(
    views: Sequence[PointObservations],
    *,
    step: ArrayLike,
    mirror_offset: float = 0.0,
    adjust: Mapping[str, float] | None = None,
    shared: Mapping[str, float],
    max_iterations: int = 200,
) -> JointSolution:
    """Solve for all views' poses and the intrinsics that they share, by least squares.

    Parameters
    ----------
    step : array_like, shape (2,), rad
        Angle of one DAC step of each mirror.
    mirror_offset : float, m
        Nominal.
    adjust, shared : mapping of str to float
        Intrinsics to adjust for each view and for all views, with the standard deviations of their
        Gaussian priors about the nominal values; infinite for a free one.

    Returns
    -------
    JointSolution
        Each view's covariance holds the uncertainty of the shared intrinsics. Without `std` all
        views have the same noise, estimated from all, and `dof` are those of all.

    Raises
    ------
    UserError
        If the input is malformed or something is not determined.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.laser import project
    >>> points = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0], [0.1, 0.1, 0.2]])
    >>> views = [
    ...     PointObservations(name, points, project((points - stand) * [1, -1, -1], 0.04))
    ...     for name, stand in {"left": [0.0, 0.1, 0.9], "right": [0.4, 0.2, 0.7]}.items()
    ... ]
    >>> both = solve_points_together(views, step=1e-4, shared={"mirror_offset": np.inf})
    >>> [s.intrinsics["mirror_offset"].round(6).item() for s in both.solutions]
    [0.04, 0.04]
    """
    adjust, steps = adjust or {}, np.broadcast_to(np.asarray(step, float), (2,))
    nominal = nominal_intrinsics(mirror_offset)
    expected = nominal[places(shared)]
    common = Common(expected, expected, np.array(list(shared.values()), float))
    known = views[0].std is not None
    _check_enough(views, adjust, shared, known)

    best: Adjusted[PointView] | None = None
    alone = [_alone(v, nominal, steps, adjust, max_iterations) for v in views]
    for _ in range(STARTS):
        terms = [
            _terms(v, a, steps, mirror_offset, adjust, shared)
            for v, a in zip(views, alone, strict=True)
        ]
        found = adjust_views(terms, common, known, not known, max_iterations)
        _check(found, list(shared))
        if best is not None and _cost(found) > (1 - SAVED) * _cost(best):
            break
        best, common = found, found.common
        intrinsics = nominal.copy()
        intrinsics[places(shared)] = common.value
        alone = [_alone(v, intrinsics, steps, adjust, max_iterations) for v in views]
    assert best is not None
    joint = JointCovariance([v.name for v in views], [*adjust], [*shared], best.covariance)
    return _solutions(best, views, alone, steps, joint)


def _alone(
    view: PointObservations,
    intrinsics: Array,
    step: Array,
    adjust: Mapping[str, float],
    max_iterations: int,
) -> PoseSolution:
    """Solve a view for itself, with the shared intrinsics as they are."""
    try:
        return solve_points(
            view.points,
            true_angles(view.angles, intrinsics),
            step=step,
            mirror_offset=float(intrinsics[0]),
            adjust=adjust,
            std=view.std,
            max_iterations=max_iterations,
        )
    except UserError as error:
        raise UserError(f"view {view.name}: {error}") from None


def _terms(
    view: PointObservations,
    start: PoseSolution,
    step: Array,
    mirror_offset: float,
    adjust: Mapping[str, float],
    shared: Mapping[str, float],
) -> PointView:
    """Give the adjustment a view's observations, and where it starts."""
    given = observations(view.points, view.angles, step, mirror_offset, adjust, view.std)
    known = [*given.prior_std, *places(shared)]
    # The adjustment knows the priors itself.
    problem = replace(
        weighted_problem(given),
        adjusted=known,
        prior=given.nominal[None, known],
        prior_weight=np.zeros((1, len(known))),
    )
    centre = start.rotation @ (given.centroid[0] - start.origin)
    intrinsics = given.nominal.copy()
    own = places(adjust)
    intrinsics[own] = [start.intrinsics[name] for name in adjust]
    pose = Pose(start.rotation[None], centre[None], intrinsics[None])
    prior = np.array(list(adjust.values()), float)
    return PointView(problem, pose, prior, given.nominal[own])


def _check_enough(
    views: Sequence[PointObservations],
    adjust: Mapping[str, float],
    shared: Mapping[str, float],
    known: bool,
) -> None:
    """Count angles and unknowns of all views."""
    angles = sum(2 * len(v.points) for v in views)
    own = len(EXTRINSICS) + sum(np.isinf(std) for std in adjust.values())
    free = own * len(views) + sum(np.isinf(std) for std in shared.values())
    if angles < free or (angles == free and not known):
        raise UserError(
            f"{angles} angles in all views are too few for {free} unknowns and the noise: add "
            "points or share fewer intrinsics"
        )


def _check(found: Adjusted[PointView], shared: list[str]) -> None:
    """Refuse a solution if a shared intrinsic was not determined."""
    share = found.arrow.undetermined_common()
    if share.any():
        raise UserError(
            f"the angles of all views cannot tell {named(shared, share)} from motions of the "
            "instrument: keep it fixed or give it a prior, or a narrower one"
        )


def _cost(found: Adjusted[PointView]) -> float:
    """Give the cost in squared standard deviations, whatever noise was found."""
    return found.cost * float(found.variance[0])


def _solutions(
    found: Adjusted[PointView],
    views: Sequence[PointObservations],
    alone: Sequence[PoseSolution],
    step: Array,
    joint: JointCovariance,
) -> JointSolution:
    """Turn poses about the points' centroids into solutions about the origin."""
    count = len(found.covariance)
    transform = np.eye(count)
    for term, place in zip(found.views, found.places, strict=True):
        six = slice(place.start, place.start + len(EXTRINSICS))
        transform[six, six] = origin_jacobian(term.pose.rotation[0], term.pose.centre[0])
    covariance = transform @ found.covariance @ transform.T
    common = np.arange(found.places[-1].stop, count)
    solutions = []
    for k, (term, view, other) in enumerate(zip(found.views, views, alone, strict=True)):
        pose, own = term.with_common(found.common.value), np.r_[found.places[k], common]
        std = 1.0 if view.std is None else view.std[:, None]
        residual = found.residual[k].reshape(2, -1).T * std
        solutions.append(
            replace(
                other,
                rotation=pose.rotation[0],
                origin=view.points.mean(axis=0) - pose.rotation[0].T @ pose.centre[0],
                intrinsics=dict(zip(INTRINSICS, pose.intrinsics[0], strict=True)),
                parameters=(*EXTRINSICS, *joint.adjusted),
                covariance=covariance[np.ix_(own, own)],
                residual=residual,
                cost=np.asarray(np.sum(found.residual[k] ** 2)),
                sse_deg2=np.sum(np.degrees(residual * step) ** 2),
                dof=found.dof[k],
                s=np.sqrt(found.variance[k]),
                converged=np.asarray(found.converged),
            )
        )
    return JointSolution(solutions, replace(joint, matrix=covariance))
