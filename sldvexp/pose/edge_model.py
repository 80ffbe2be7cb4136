"""How far an edge point lies from its circle, and how that changes with pose and object.

Everything is in the laser frame: a circle of centre M, unit normal N and radius r, and the beam
``o + s u`` of an edge point. The beam meets the circle's plane at Q; the edge's equation is
``|Q - M| = r``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sldvexp.laser.model import rays
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.pose.intrinsics import true_angles
from sldvexp.typing import Array, IndexArray

#: Numbers in which a machined circle errs: its centre along three axes and its radius.
ERRORS = 4


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Edge points of one view with the circle each belongs to.

    Parameters
    ----------
    angle : ndarray, shape (n, 2), rad
        By the nominal calibration.
    along : ndarray, shape (n, 2), rad
        Change of the angles along the scan line for one standard error of the edge.
    center : ndarray, shape (n, 3), m
        Of the point's circle, in the world.
    normal : ndarray, shape (n, 3)
        Unit normal of the circle's plane, in the world.
    radius : ndarray, shape (n,), m
    in_plane : ndarray, shape (n, 2, 3)
        Unit vectors of the circle's plane, in the world.
    circle : ndarray of int, shape (n,)
        Index of the circle, from 0, the same in all views.
    """

    angle: Array
    along: Array
    center: Array
    normal: Array
    radius: Array
    in_plane: Array
    circle: IndexArray

    @property
    def axes(self) -> Array:
        """Axes of the circle's plane, its normal last, in the world, shape (n, 3, 3)."""
        return np.concatenate([self.in_plane, self.normal[:, None]], axis=1)


@dataclass(frozen=True, eq=False)
class EdgeScene:
    """Where the laser and the circles are, as far as one view's edges are concerned.

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


#: Places in the Jacobian of `residuals`; the circles' errors follow from `MOVED` on.
RIM, FIRST_INTRINSIC, MOVED = 6, 7, 12


def residuals(points: EdgePoints, scene: EdgeScene) -> tuple[Array, Array]:
    """Distance of each edge point from its circle's rim, and the derivatives.

    Parameters
    ----------
    points : EdgePoints
    scene : EdgeScene

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
    """Change of ``|Q - M|`` for one standard error of each edge along its scan line, m."""
    ends = (_meet(points, scene, sign * points.along).distance for sign in (0.5, -0.5))
    return np.asarray(np.abs(np.subtract(*ends)))


class _Met(NamedTuple):
    """Where the beams meet the planes of their circles, in the laser frame.

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
    """Change of ``|Q - M|`` with `INTRINSICS`, shape (n, 5).

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


def angles_along(laser: TwoMirror, dac: Array, direction: Array, std: Array) -> tuple[Array, Array]:
    """Angles of edge points, and their change for one standard error along the scan line."""
    step = direction * std[:, None]
    angle = laser.angle_from_dac(dac)
    return angle, laser.angle_from_dac(dac + step / 2) - laser.angle_from_dac(dac - step / 2)
