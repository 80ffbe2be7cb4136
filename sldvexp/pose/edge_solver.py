"""Maximum-likelihood poses from all edge points of a calibration object's circles, in all views.

Everything is in the laser frame: a circle of centre M, unit normal N and radius r, and the beam
``o + s u`` of an edge point. The beam meets the circle's plane at Q; the edge's equation is
``|Q - M| = r``, its residual the distance ``|Q - M| - r`` over the standard error that the edge's
own error along its scan line makes of it.

The views have the object in common: the errors of its circles are the same in each, and so are the
intrinsics that are said to be shared. The errors of the edges are taken as normal, as large as they
are said to be, pointing noise included (`sldvexp.pose.pointing` finds that), and as independent but
for what an uneven motion's growth adds to all edges of a circle (`EdgePoints.decorrelated`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.geometry import rotation_from_vector
from sldvexp.laser import rays
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import EXTRINSICS, JointCovariance, describe_pose, pose_to_dataset
from sldvexp.pose.bundle_adjustment import (
    Adjusted,
    Common,
    LinearisedResiduals,
    adjust_views,
)
from sldvexp.pose.edge_points import EdgePoints
from sldvexp.pose.intrinsics import named, nominal_intrinsics, places, true_angles
from sldvexp.pose.single_view import solve_points
from sldvexp.typing import Array

#: Numbers in which a machined circle errs: its centre along three axes and its radius.
ERRORS = 4

#: Places in the Jacobian of `residuals`; the circles' errors follow from `MOVED` on.
RIM, FIRST_INTRINSIC, MOVED = 6, 7, 12

#: Standard deviations of a circle's errors over that of a coordinate: a radius is half a diameter.
CIRCLE = np.array([1.0, 1.0, 1.0, 0.5])


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
    sse : float, squared DAC steps
        Sum of the squared residuals, each as a distance along its scan line.
    dof : float
        Degrees of freedom of the residuals.
    """

    rotation: Array
    origin: Array
    intrinsics: Array
    rim: float
    residual: Array
    sse: float
    dof: float

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residuals along the scan lines, DAC steps."""
        return float(np.sqrt(self.sse / len(self.residual)))


@dataclass(frozen=True, eq=False, repr=False)
class EdgePoses:
    """Poses of all views and their covariance.

    Parameters
    ----------
    poses : list of EdgePose
        One a view.
    joint : JointCovariance
        Names of the views, and the covariance of their poses and intrinsics.
    moved : ndarray, shape (circle, ERRORS), m
        Estimated errors of the circles, in the order of their numbers.
    cost : float
        Sum of squared residuals and of what is known beforehand over its standard deviations.
    """

    GROUP: ClassVar[str] = "pose"

    poses: list[EdgePose]
    joint: JointCovariance
    moved: Array
    cost: float

    def __repr__(self) -> str:
        each = zip(self.joint.views, self.poses, self.joint.of_views(), strict=True)
        return "\n".join(
            f"view {name}, pose from {len(p.residual)} edges: "
            + describe_pose(p.origin, np.sqrt(np.diag(own)[3:6]), p.residual_rms)
            for name, p, own in each
        )

    def to_dataset(
        self, confidence: float = 0.95, noise_dof: Sequence[float] | None = None
    ) -> xr.Dataset:
        """Make the group ``pose`` of a run, with intervals of a level.

        Parameters
        ----------
        noise_dof : sequence of float, optional
            Degrees of freedom behind each view's edges' errors; without it they are known.
        """
        poses, joint = self.poses, self.joint
        dof = np.full(len(poses), np.inf) if noise_dof is None else np.asarray(noise_dof)
        variance = [p.sse / p.dof for p in poses]
        return pose_to_dataset(
            joint.views,
            np.array([p.rotation for p in poses]),
            np.array([p.origin for p in poses]),
            joint.of_views(),
            dof,
            confidence,
            adjusted=joint.adjusted,
            intrinsic=np.array([p.intrinsics[places(joint.adjusted)] for p in poses]),
            joint=joint,
            residual_rms=np.array([p.residual_rms for p in poses]),
            s=np.sqrt(variance),
            rim=np.array([p.rim for p in poses]),
        )


def solve_edges(
    points: Sequence[EdgePoints],
    *,
    mirror_offset: float,
    views: Sequence[str] = (),
    starts: Sequence[tuple[Array, Array]] = (),
    adjust: Mapping[str, float] | None = None,
    shared: Mapping[str, float] | None = None,
    circle_std: ArrayLike = 0.0,
    max_iterations: int = 200,
) -> EdgePoses:
    """Adjust the poses until every edge point lies on its circle as well as its error allows.

    The circles' own errors (a coordinate measuring machine's) enter as errors of each circle's
    centre and radius with a prior, the same in all views. All edges of a view may be seen outside
    or inside of the circles by one free amount, the rim.

    Parameters
    ----------
    points : sequence of EdgePoints
        Of each view.
    mirror_offset : float, m
        Nominal.
    views : sequence of str, optional
        Their names; numbered from 1 without them.
    starts : sequence of (rotation, origin), optional
        Where each view starts, from the bitangents. Without them, the pose in which the circles'
        centres lie in the middle of their edges, which asks for three circles or more.
    adjust, shared : mapping of str to float
        Intrinsics to adjust for each view and for all views, with the standard deviation of what is
        known of them, infinite for a free one.
    circle_std : array_like, shape () or (circle,), m
        Standard deviation of the circles' centre coordinates and diameters.

    Raises
    ------
    UserError
        If the iteration does not settle or the edges do not determine the poses.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.laser import TwoMirror, project
    >>> from sldvexp.targets import Circle, Circles
    >>> target = Circles(circles={1: Circle(0, 0, 0.04), 2: Circle(0.2, 0, 0.04),
    ...                           3: Circle(0.2, 0.3, 0.04), 4: Circle(0, 0.2, 0.04)})
    >>> laser, turn = TwoMirror(mirror_offset=0.03), np.linspace(0, 2 * np.pi, 12, endpoint=False)
    >>> out = np.tile(np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1), (4, 1))
    >>> number = np.repeat([1, 2, 3, 4], 12)
    >>> center = np.array([[c.x, c.y, 0] for c in target.circles.values()])[number - 1]
    >>> stand, facing = np.array([0.1, 0.2, 1.5]), np.diag([1.0, -1.0, -1.0])
    >>> dac = laser.dac_from_angle(project((center + 0.02 * out - stand) @ facing, 0.03))
    >>> edges = EdgePoints.from_dac(target, laser, number, dac, out[:, [1, 0]], np.full(48, 0.01))
    >>> solve_edges([edges], mirror_offset=0.03).poses[0].origin.round(6)
    array([0.1, 0.2, 1.5])
    """
    adjust, shared = adjust or {}, shared or {}
    names = list(views) or [f"{k}" for k in range(1, len(points) + 1)]
    nominal, common = nominal_intrinsics(mirror_offset), places(shared)
    circles = 1 + max(int(p.circle.max()) for p in points)
    _check_enough(points, adjust, names)
    none = np.zeros((circles, ERRORS))
    named_points = zip(points, names, strict=True)
    starts = starts or [_start_from_centers(p, n, mirror_offset) for p, n in named_points]
    terms = [
        EdgeView.at_start(p, EdgeScene(*start, 0.0, nominal, none), adjust, common)
        for p, start in zip(points, starts, strict=True)
    ]
    each = np.broadcast_to(np.asarray(circle_std, float), circles)
    errors = np.outer(each, CIRCLE).ravel() if each.any() else np.empty(0)
    expected = np.append(nominal[common], np.zeros(len(errors)))
    prior_std = np.append(np.array(list(shared.values())), errors)
    given = Common(expected, expected, prior_std)
    found = adjust_views(
        terms, given, noise_known=True, pooled=False, max_iterations=max_iterations
    )
    _check(found, list(adjust), list(shared), names, max_iterations)
    return _poses(found, JointCovariance(names, [*adjust], [*shared], found.covariance))


def _check_enough(
    points: Sequence[EdgePoints], adjust: Mapping[str, float], names: Sequence[str]
) -> None:
    """Refuse a view that has no more edges than unknowns."""
    free = RIM + 1 + sum(np.isinf(std) for std in adjust.values())
    for p, name in zip(points, names, strict=True):
        if len(p.radius) <= free:
            raise UserError(f"view {name}: {len(p.radius)} edges are too few to determine the pose")


def _start_from_centers(points: EdgePoints, name: str, mirror_offset: float) -> tuple[Array, Array]:
    """Solve for a pose as if each circle's centre were seen in the middle of its edges."""
    circle, first = np.unique(points.circle, return_index=True)
    middle = [points.angle[points.circle == k].mean(axis=0) for k in circle]
    try:
        start = solve_points(
            points.center[first], middle, step=points.step, mirror_offset=mirror_offset
        )
    except UserError as error:
        raise UserError(
            f"view {name}: the circles' centres give no pose to start from ({error}); give starts"
        ) from None
    return start.rotation, start.origin


def _poses(found: Adjusted[EdgeView], joint: JointCovariance) -> EdgePoses:
    """Take what is asked for, without the rims and the circles' errors."""
    wanted: list[int] = []
    for place in found.places:
        every = range(place.start, place.stop)
        wanted += [k for k in every if k != place.start + RIM]
    first = found.places[-1].stop
    wanted += range(first, first + len(found.views[0].shared))
    scenes = [v.with_common(found.common.value) for v in found.views]
    poses = [
        EdgePose(
            s.rotation,
            s.origin,
            s.intrinsics,
            s.rim,
            residual,
            float(np.sum((residual * view.points.std) ** 2)),
            float(dof),
        )
        for s, view, residual, dof in zip(
            scenes, found.views, found.residual, found.dof, strict=True
        )
    ]
    moved = scenes[0].moved
    joint = replace(joint, matrix=found.covariance[np.ix_(wanted, wanted)])
    return EdgePoses(poses, joint, moved, found.cost)


def _check(
    found: Adjusted[EdgeView],
    adjusted: list[str],
    shared: list[str],
    names: Sequence[str],
    max_iterations: int,
) -> None:
    """Refuse poses if something was not determined or not found."""
    unknowns = [*EXTRINSICS, "rim", *adjusted]
    for name, share in zip(names, found.arrow.undetermined_own(), strict=True):
        if share.any():
            raise UserError(
                _undetermined(f"view {name}", named(unknowns[RIM + 1 :], share[RIM + 1 :]))
            )
    share = found.arrow.undetermined_common()[: len(shared)]
    if share.any():
        raise UserError(_undetermined("all views", named(shared, share)))
    if not found.converged:
        raise UserError(
            f"{' and '.join(f'view {n}' for n in names)}: the edges gave no pose in "
            f"{max_iterations} iterations"
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


@dataclass(frozen=True, eq=False)
class EdgeView:
    """One view's edges in the adjustment; its unknowns are pose, rim and own intrinsics.

    Parameters
    ----------
    scene : EdgeScene
        As far as it is known by now; what is shared comes from the common unknowns.
    own, shared : list of int
        Positions in `INTRINSICS` of those adjusted for the view and for all views.
    own_prior : ndarray, shape (own,)
        Standard deviations; infinite for a free one.
    expected : ndarray, shape (own,)
    scale : ndarray, shape (n,), m
        Standard errors of the residuals.
    outwards : ndarray, shape (n,)
        Sense of the scan lines, as in `EdgePoints.decorrelated`.
    """

    points: EdgePoints
    scene: EdgeScene
    own: list[int]
    shared: list[int]
    own_prior: Array
    expected: Array
    scale: Array
    outwards: Array

    @classmethod
    def at_start(
        cls, points: EdgePoints, scene: EdgeScene, adjust: Mapping[str, float], shared: list[int]
    ) -> EdgeView:
        """Begin with a scene whose intrinsics are as they are expected."""
        own, prior = places(adjust), np.array(list(adjust.values()))
        unit = np.ones(len(points.radius))
        return cls(points, scene, own, shared, prior, scene.intrinsics[own], unit, 0.0 * unit)

    def with_common(self, common: Array) -> EdgeScene:
        """Give the scene the common unknowns: shared intrinsics, then the circles' errors."""
        intrinsics = self.scene.intrinsics.copy()
        intrinsics[self.shared] = common[: len(self.shared)]
        moved = common[len(self.shared) :].reshape(-1, ERRORS)
        # Without machining errors there are none among the unknowns.
        return replace(
            self.scene, intrinsics=intrinsics, moved=moved if len(moved) else self.scene.moved
        )

    def linearise(self, common: Array) -> LinearisedResiduals:
        """See `sldvexp.pose.bundle_adjustment.ViewTerms`."""
        residual, jacobian = residuals(self.points, self.with_common(common))
        values = np.column_stack([residual, jacobian]) / self.scale[:, None]
        residual, jacobian = np.split(self.points.decorrelated(values, self.outwards), [1], axis=1)
        own = [*range(RIM + 1), *(FIRST_INTRINSIC + k for k in self.own)]
        shared = [FIRST_INTRINSIC + k for k in self.shared]
        circles = range(MOVED, MOVED + len(common) - len(shared))
        return LinearisedResiduals(
            residual[:, 0], jacobian[:, own], jacobian[:, [*shared, *circles]]
        )

    def moved(self, step: Array) -> EdgeView:
        """See `sldvexp.pose.bundle_adjustment.ViewTerms`."""
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
        """See `sldvexp.pose.bundle_adjustment.ViewTerms`."""
        change = spread(self.points, self.with_common(common))
        return replace(self, scale=np.abs(change), outwards=np.sign(change))

    def prior(self) -> tuple[Array, Array]:
        """See `sldvexp.pose.bundle_adjustment.ViewTerms`."""
        free = np.zeros(RIM + 1)
        away = self.scene.intrinsics[self.own] - self.expected
        return np.append(free, self.own_prior**-2.0), np.append(free, away)


@dataclass(frozen=True, eq=False)
class EdgeScene:
    """Places of the laser and the circles, as far as one view's edges are concerned.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        World to laser.
    origin : ndarray, shape (3,), m
    rim : float, m
        By how much every edge is seen outside of the circle.
    intrinsics : ndarray, shape (5,)
        In the order of `INTRINSICS`.
    moved : ndarray, shape (circle, ERRORS), m
        Error of each circle's centre in its plane (two axes) and across it, and of its radius.
    """

    rotation: Array
    origin: Array
    rim: float
    intrinsics: Array
    moved: Array


def residuals(points: EdgePoints, scene: EdgeScene) -> tuple[Array, Array]:
    """Measure the distance of each edge point from its circle's rim, and differentiate it.

    Returns
    -------
    residual : ndarray, shape (n,), m
    jacobian : ndarray, shape (n, 12 + ERRORS * circles)
        By the rotation vector, the origin, the rim, the intrinsics, and `moved` flattened.
    """
    met = _meet(points, scene)
    e, normal, m = met.outward, met.normal, met.center

    # d|Q - M| = (e.u / N.u) (dN.(M - Q) + N.dM) - e.dM, with dM = w x M - R dO and dN = w x N.
    by_center = met.tilt[:, None] * normal - e
    by_rotation = np.cross(m, by_center) + met.tilt[:, None] * np.cross(normal, m - met.point)
    by_origin = -by_center @ scene.rotation
    circles, row = len(scene.moved), np.arange(len(e))
    jacobian = np.zeros((len(e), MOVED + ERRORS * circles))
    jacobian[:, :3], jacobian[:, 3:6], jacobian[:, RIM] = by_rotation, by_origin, -1.0
    jacobian[:, FIRST_INTRINSIC:MOVED] = _by_intrinsics(points, scene, met)
    by_shift = np.einsum("nij,nj->ni", points.axes, by_center @ scene.rotation)
    for k in range(3):
        jacobian[row, MOVED + ERRORS * points.circle + k] = by_shift[:, k]
    jacobian[row, MOVED + ERRORS * points.circle + 3] = -1.0
    radius = points.radius + scene.moved[points.circle, 3] + scene.rim
    return met.distance - radius, jacobian


def spread(points: EdgePoints, scene: EdgeScene) -> Array:
    """Give the change of ``|Q - M|`` for one standard error of each edge ahead on its line, m."""
    ends = (_meet(points, scene, sign * points.along).distance for sign in (0.5, -0.5))
    return np.asarray(np.subtract(*ends))


class _Met(NamedTuple):
    """Points where the beams meet the planes of their circles, in the laser frame.

    `distance` is ``|Q - M|``, `outward` its unit vector e, `tilt` is ``e.u / N.u``, and `reach` is
    s in ``Q = o + s (tan left_right, sin up_down, cos up_down)``.
    """

    center: Array
    normal: Array
    point: Array
    distance: Array
    outward: Array
    tilt: Array
    reach: Array


def _meet(points: EdgePoints, scene: EdgeScene, aside: float | Array = 0.0) -> _Met:
    """Follow the beams, moved aside by some recorded angles, to the planes."""
    shift = scene.moved[points.circle, :3]
    center = points.center + np.einsum("ni,nij->nj", shift, points.axes)
    m = (center - scene.origin) @ scene.rotation.T
    normal = points.normal @ scene.rotation.T
    angle = true_angles(points.angle + aside, scene.intrinsics)
    o, u = rays(angle, scene.intrinsics[0])
    slope = np.einsum("nj,nj->n", normal, u)
    s = np.einsum("nj,nj->n", normal, m - o) / slope
    q = o + s[:, None] * u
    distance = np.linalg.norm(q - m, axis=-1)
    e = (q - m) / distance[:, None]
    tilt = np.einsum("nj,nj->n", e, u) / slope
    # u is a unit vector; its up-down part is as long as the cosine of left_right.
    return _Met(m, normal, q, distance, e, tilt, s * np.cos(angle[:, 1]))


def _by_intrinsics(points: EdgePoints, scene: EdgeScene, met: _Met) -> Array:
    """Differentiate ``|Q - M|`` by `INTRINSICS`, shape (n, 5).

    They move the beam's origin and turn it: ``d|Q - M| = (e - (e.u / N.u) N) . (do + s du)``.
    """
    across = met.outward - met.tilt[:, None] * met.normal
    up_down, left_right = true_angles(points.angle, scene.intrinsics).T
    turned = across[:, 1] * np.cos(up_down) - across[:, 2] * np.sin(up_down)
    by_up_down = met.reach * turned
    by_left_right = across[:, 0] * (met.reach + scene.intrinsics[0]) / np.cos(left_right) ** 2
    return np.stack(
        [
            across[:, 0] * np.tan(left_right),
            by_up_down * points.angle[:, 0],
            by_up_down,
            by_left_right * points.angle[:, 1],
            by_left_right,
        ],
        axis=-1,
    )
