"""How far an edge point lies from its circle, and how that changes with pose and object.

Everything is in the laser frame: a circle of centre M, unit normal N and radius r, and the beam
``o + s u`` of an edge point. The beam meets the circle's plane at Q; the edge's equation is
``|Q - M| = r``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.laser.model import rays
from sldvexp.laser.two_mirror import TwoMirror

Array = NDArray[np.float64]

#: Numbers in which a machined circle errs: its centre along three axes and its radius.
ERRORS = 4


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Edge points of one view with the circle each belongs to.

    Parameters
    ----------
    angle : ndarray, shape (n, 2), rad
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
        Index of the circle, from 0.
    """

    angle: Array
    along: Array
    center: Array
    normal: Array
    radius: Array
    in_plane: Array
    circle: NDArray[np.intp]


def residuals(
    points: EdgePoints,
    rotation: Array,
    origin: Array,
    mirror_offset: float,
    moved: Array,
    rim: float,
) -> tuple[Array, Array]:
    """Distance of each edge point from its circle over its standard error, and the derivatives.

    Parameters
    ----------
    points : EdgePoints
    rotation : ndarray, shape (3, 3)
        World to laser.
    origin : ndarray, shape (3,), m
    mirror_offset : float, m
    moved : ndarray, shape (circle, ERRORS), m
        Error of each circle's centre in its plane (two axes) and across it, and of its radius.
    rim : float, m
        By how much every edge is seen outside of the circle.

    Returns
    -------
    residual : ndarray, shape (n,)
    jacobian : ndarray, shape (n, 8 + ERRORS * circles)
        By the rotation vector, the origin, the mirror offset, the rim, and `moved` flattened.
    """
    shift = moved[points.circle]
    axes = np.concatenate([points.in_plane, points.normal[:, None]], axis=1)
    center_world = points.center + np.einsum("ni,nij->nj", shift[:, :3], axes)
    m = (center_world - origin) @ rotation.T
    normal = points.normal @ rotation.T
    o, u = rays(points.angle, mirror_offset)
    slope = np.einsum("nj,nj->n", normal, u)
    q = o + (np.einsum("nj,nj->n", normal, m - o) / slope)[:, None] * u
    distance = np.linalg.norm(q - m, axis=-1)
    e = (q - m) / distance[:, None]
    eu = np.einsum("nj,nj->n", e, u) / slope
    scale = _step(points, mirror_offset, normal, m)

    # d|Q - M| = (e.u / N.u) (dN.(M - Q) + N.dM) - e.dM, with dM = w x M - R dO and dN = w x N.
    by_center = eu[:, None] * normal - e
    by_rotation = np.cross(m, by_center) + eu[:, None] * np.cross(normal, m - q)
    by_origin = -by_center @ rotation
    by_offset = _by_origin_of_beam(points.angle, e, eu, normal)
    circles = len(moved)
    jacobian = np.zeros((len(distance), 8 + ERRORS * circles))
    jacobian[:, :3], jacobian[:, 3:6] = by_rotation, by_origin
    jacobian[:, 6], jacobian[:, 7] = by_offset, -1.0
    row = np.arange(len(distance))
    by_shift = np.einsum("nij,nj->ni", axes, by_center @ rotation)
    for k in range(3):
        jacobian[row, 8 + ERRORS * points.circle + k] = by_shift[:, k]
    jacobian[row, 8 + ERRORS * points.circle + 3] = -1.0
    residual = distance - points.radius - shift[:, 3] - rim
    return residual / scale, jacobian / scale[:, None]


def _by_origin_of_beam(angle: Array, e: Array, eu: Array, normal: Array) -> Array:
    """Change of ``|Q - M|`` with the mirror offset, which moves the beam's origin along x."""
    tangent = np.tan(angle[:, 1])
    return tangent * (e[:, 0] - eu * normal[:, 0])


def _step(points: EdgePoints, mirror_offset: float, normal: Array, m: Array) -> Array:
    """Change of ``|Q - M|`` for one standard error of the edge along its scan line, positive."""

    def distance(sign: float) -> Array:
        o, u = rays(points.angle + sign * points.along, mirror_offset)
        slope = np.einsum("nj,nj->n", normal, u)
        q = o + (np.einsum("nj,nj->n", normal, m - o) / slope)[:, None] * u
        return np.linalg.norm(q - m, axis=-1)

    return np.abs(distance(0.5) - distance(-0.5))


def angles_along(laser: TwoMirror, dac: Array, direction: Array, std: Array) -> tuple[Array, Array]:
    """Angles of edge points, and their change for one standard error along the scan line."""
    step = direction * std[:, None]
    angle = laser.angle_from_dac(dac)
    return angle, laser.angle_from_dac(dac + step / 2) - laser.angle_from_dac(dac - step / 2)
