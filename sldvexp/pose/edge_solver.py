"""Maximum-likelihood poses from all edge points of a calibration object's circles, in all views.

The views have the object in common: the errors of its circles are the same in each, and so are the
intrinsics that are said to be shared. The noise of the edges is estimated for every view.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry.rotation import rotation_from_vector
from sldvexp.pose.base import EXTRINSICS
from sldvexp.pose.bundle_adjustment import Adjusted, Common, Linear, adjust
from sldvexp.pose.edge_model import (
    ERRORS,
    FIRST_INTRINSIC,
    MOVED,
    RIM,
    EdgePoints,
    EdgeScene,
    residuals,
    spread,
)
from sldvexp.pose.intrinsics import named, nominal_intrinsics, places
from sldvexp.typing import Array

#: Standard deviations of a circle's errors over that of a coordinate: a radius is half a diameter.
CIRCLE = np.array([1.0, 1.0, 1.0, 0.5])


@dataclass(frozen=True, eq=False)
class EdgeView:
    """One view's edges in the adjustment; its unknowns are pose, rim and own intrinsics.

    Parameters
    ----------
    points : EdgePoints
    scene : EdgeScene
        As far as it is known by now; what is shared comes from the common unknowns.
    own, shared : list of int
        Positions in `INTRINSICS` of those adjusted for the view and for all views.
    own_prior : ndarray, shape (own,)
        Standard deviations; infinite for a free one.
    expected : ndarray, shape (own,)
    scale : ndarray, shape (n,), m
        Standard errors of the residuals.
    """

    points: EdgePoints
    scene: EdgeScene
    own: list[int]
    shared: list[int]
    own_prior: Array
    expected: Array
    scale: Array

    def with_common(self, common: Array) -> EdgeScene:
        """The scene with the common unknowns: shared intrinsics, then the circles' errors."""
        intrinsics = self.scene.intrinsics.copy()
        intrinsics[self.shared] = common[: len(self.shared)]
        moved = common[len(self.shared) :].reshape(-1, ERRORS)
        # Without machining errors there are none among the unknowns.
        return replace(
            self.scene, intrinsics=intrinsics, moved=moved if len(moved) else self.scene.moved
        )

    def linearise(self, common: Array) -> Linear:
        """See `sldvexp.pose.bundle_adjustment.View`."""
        residual, jacobian = residuals(self.points, self.with_common(common))
        jacobian /= self.scale[:, None]
        own = [*range(RIM + 1), *(FIRST_INTRINSIC + k for k in self.own)]
        shared = [FIRST_INTRINSIC + k for k in self.shared]
        circles = range(MOVED, MOVED + len(common) - len(shared))
        return Linear(residual / self.scale, jacobian[:, own], jacobian[:, [*shared, *circles]])

    def moved(self, step: Array) -> EdgeView:
        """See `sldvexp.pose.bundle_adjustment.View`."""
        s = self.scene
        intrinsics = s.intrinsics.copy()
        intrinsics[self.own] += step[RIM + 1 :]
        scene = replace(
            s,
            rotation=rotation_from_vector(step[:3]) @ s.rotation,
            origin=s.origin + step[3:RIM],
            rim=s.rim + float(step[RIM]),
            intrinsics=intrinsics,
        )
        return replace(self, scene=scene)

    def weighed(self, common: Array) -> EdgeView:
        """See `sldvexp.pose.bundle_adjustment.View`."""
        return replace(self, scale=spread(self.points, self.with_common(common)))

    def prior(self) -> tuple[Array, Array]:
        """See `sldvexp.pose.bundle_adjustment.View`."""
        free = np.zeros(RIM + 1)
        away = self.scene.intrinsics[self.own] - self.expected
        return np.append(free, self.own_prior**-2.0), np.append(free, away)


@dataclass(frozen=True, eq=False)
class EdgePose:
    """Pose of one view from its edge points.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
    origin : ndarray, shape (3,), m
    intrinsics : ndarray, shape (5,)
    rim : float, m
        By how much every edge is seen outside of its circle.
    residual : ndarray, shape (n,)
        Distance of each edge over its standard error.
    s : float
        Standard deviation of the residuals; the covariance is for errors larger by it.
    dof : float
    """

    rotation: Array
    origin: Array
    intrinsics: Array
    rim: float
    residual: Array
    s: float
    dof: float


@dataclass(frozen=True, eq=False)
class EdgePoses:
    """Poses of all views and their covariance.

    Parameters
    ----------
    poses : list of EdgePose
    covariance : ndarray, shape (all, all)
        Of each view's `EXTRINSICS` and own intrinsics, view by view, then of the shared intrinsics.
    """

    poses: list[EdgePose]
    covariance: Array


def solve_edges(
    points: Sequence[EdgePoints],
    starts: Sequence[tuple[Array, Array]],
    mirror_offset: float,
    adjusted: Mapping[str, float],
    shared: Mapping[str, float],
    circle_std: float,
    max_iterations: int,
    names: Sequence[str],
) -> EdgePoses:
    """Adjust the poses until every edge point lies on its circle as well as its error allows.

    The noise of the edges is estimated, in each view for itself; that of the circles themselves (a
    coordinate measuring machine's) enters as errors of each circle's centre and radius with a
    prior, the same in all views. All edges of a view may be seen outside or inside of the circles
    by one free amount, the rim.

    Parameters
    ----------
    points : sequence of EdgePoints
        Of each view.
    starts : sequence of (rotation, origin)
        From the bitangents.
    mirror_offset : float, m
        Nominal.
    adjusted, shared : mapping of str to float
        Intrinsics to adjust for each view and for all views, with the standard deviation of what is
        known of them, infinite for a free one.
    circle_std : float, m
        Standard deviation of every circle's centre coordinates and diameter.
    max_iterations : int
    names : sequence of str
        Of the views, for messages.

    Raises
    ------
    UserError
        If the iteration does not settle or the edges do not determine the poses.
    """
    nominal = nominal_intrinsics(mirror_offset)
    own, common = places(adjusted), places(shared)
    own_prior = np.array(list(adjusted.values()))
    circles = 1 + max(int(p.circle.max()) for p in points)
    free = RIM + 1 + int(np.isinf(own_prior).sum())
    for p, name in zip(points, names, strict=True):
        if len(p.radius) <= free:
            raise UserError(f"{name}: {len(p.radius)} edges are too few to determine the pose")
    views = [
        EdgeView(
            p,
            EdgeScene(*start, 0.0, nominal, np.zeros((circles, ERRORS))),
            own,
            common,
            own_prior,
            nominal[own],
            np.ones(len(p.radius)),
        )
        for p, start in zip(points, starts, strict=True)
    ]
    errors = np.tile(circle_std * CIRCLE, circles if circle_std > 0 else 0)
    expected = np.append(nominal[common], np.zeros(len(errors)))
    prior_std = np.append(np.array(list(shared.values())), errors)
    found = adjust(views, Common(expected, expected, prior_std), False, False, max_iterations)
    _check(found, list(adjusted), list(shared), names, max_iterations)
    return _poses(found)


def _poses(found: Adjusted[EdgeView]) -> EdgePoses:
    """What is asked for, without the rims and the circles' errors."""
    wanted: list[int] = []
    for place in found.places:
        every = range(place.start, place.stop)
        wanted += [k for k in every if k != place.start + RIM]
    first = found.places[-1].stop
    wanted += range(first, first + len(found.views[0].shared))
    scenes = [v.with_common(found.common.value) for v in found.views]
    each = zip(scenes, found.residual, found.variance, found.dof, strict=True)
    return EdgePoses(
        [
            EdgePose(s.rotation, s.origin, s.intrinsics, s.rim, r, float(np.sqrt(s2)), float(dof))
            for s, r, s2, dof in each
        ],
        found.covariance[np.ix_(wanted, wanted)],
    )


def _check(
    found: Adjusted[EdgeView],
    adjusted: list[str],
    shared: list[str],
    names: Sequence[str],
    max_iterations: int,
) -> None:
    """UserError if something was not determined or not found."""
    unknowns = [*EXTRINSICS, "rim", *adjusted]
    for name, share in zip(names, found.arrow.undetermined_own(), strict=True):
        if share.any():
            raise UserError(_undetermined(name, named(unknowns[RIM + 1 :], share[RIM + 1 :])))
    share = found.arrow.undetermined_common()[: len(shared)]
    if share.any():
        raise UserError(_undetermined("all views", named(shared, share)))
    if not found.converged:
        raise UserError(
            f"{' and '.join(names)}: the edges gave no pose in {max_iterations} iterations"
        )


def _undetermined(where: str, intrinsics: str) -> str:
    if intrinsics:
        return (
            f"{where}: the edges cannot tell {intrinsics} from a motion of the instrument: keep it "
            "fixed or give it a prior, or a narrower one"
        )
    return (
        f"{where}: the edges do not determine the pose; more circles, or some on a second plane, "
        "are needed"
    )
