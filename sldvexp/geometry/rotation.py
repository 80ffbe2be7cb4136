"""Rotations: Euler angles in the x-convention, rotation vectors, rigid motions.

A rotation `R` takes world vectors into the laser frame, ``P_laser = R (P_world - origin)``.
All functions work on stacks: leading dimensions are carried through. `KnownPose` is a pose as a
configuration states it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import Checks
from sldvexp.lazy import scipy
from sldvexp.typing import Array
from sldvexp.units import AngleUnit, LengthUnit, beyond_belief

#: Below this sine of phi2, only the sum or difference of the other angles is determined.
GIMBAL_LOCK = 1e-6


def rotation_from_euler(euler: ArrayLike) -> Array:
    """Make the rotation matrix of Euler angles in the x-convention (z-x'-z'').

    Parameters
    ----------
    euler : array_like, shape (..., 3), rad
        phi1 about z, phi2 about the new x, phi3 about the newest z.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        World to laser; the product BCD of Goldstein's *Classical Mechanics*, as in Figure 4.29.

    Examples
    --------
    >>> rotation_from_euler([np.pi / 2, 0.0, 0.0]).round(6) @ [1.0, 0.0, 0.0]
    array([ 0., -1.,  0.])
    """
    phi1, phi2, phi3 = np.moveaxis(np.asarray(euler, float), -1, 0)
    c1, s1, c2, s2, c3, s3 = (f(a) for a in (phi1, phi2, phi3) for f in (np.cos, np.sin))
    rows = [
        [c3 * c1 - c2 * s1 * s3, c3 * s1 + c2 * c1 * s3, s3 * s2],
        [-s3 * c1 - c2 * s1 * c3, -s3 * s1 + c2 * c1 * c3, c3 * s2],
        [s2 * s1, -s2 * c1, c2],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def euler_from_rotation(rotation: ArrayLike) -> Array:
    """Give the Euler angles in the x-convention, with phi2 in [0, pi].

    Where sin(phi2) vanishes only phi1 + phi3 (or phi1 - phi3) is determined; phi1 is then zero.

    Parameters
    ----------
    rotation : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 3), rad

    Examples
    --------
    >>> euler_from_rotation(rotation_from_euler([-1.153, 2.547, 1.913])).round(3)
    array([-1.153,  2.547,  1.913])
    """
    r = np.asarray(rotation, float)
    sine = np.hypot(r[..., 2, 0], r[..., 2, 1])
    phi2 = np.arctan2(sine, r[..., 2, 2])
    locked = sine < GIMBAL_LOCK
    phi1 = np.where(locked, 0.0, np.arctan2(r[..., 2, 0], -r[..., 2, 1]))
    phi3 = np.where(
        locked, np.arctan2(-r[..., 1, 0], r[..., 0, 0]), np.arctan2(r[..., 0, 2], r[..., 1, 2])
    )
    return np.stack([phi1, phi2, phi3], axis=-1)


def rotation_towards(origin: ArrayLike, point: ArrayLike) -> Array:
    """Make the rotations of upright instruments that look at a point, shape (..., 3, 3).

    The laser frame's z points there, and its x is level: across the world's y, which is up, or
    across the world's z where the instrument looks along y.

    Parameters
    ----------
    origin, point : array_like, shape (..., 3)

    Examples
    --------
    >>> rotation_towards([0, 0, 1.5], [0, 0, 0])
    array([[-1.,  0.,  0.],
           [ 0.,  1.,  0.],
           [ 0.,  0., -1.]])
    """
    ahead = np.asarray(point, float) - np.asarray(origin, float)
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    along_up = np.hypot(ahead[..., 0], ahead[..., 2]) <= GIMBAL_LOCK
    level = np.cross(np.where(along_up[..., None], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]), ahead)
    level /= np.linalg.norm(level, axis=-1, keepdims=True)
    return np.stack([level, np.cross(ahead, level), ahead], axis=-2) + 0.0


def euler_jacobian(rotation: ArrayLike) -> Array:
    """Differentiate the Euler angles by a small rotation of the laser frame.

    Parameters
    ----------
    rotation : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 3, 3)
        d(phi1, phi2, phi3) / d(rotation vector), for ``R -> exp([rotation vector]) R``.
        Infinite rows where sin(phi2) is zero: there the angles are not determined.

    Examples
    --------
    >>> euler_jacobian(rotation_from_euler([0.4, np.pi / 4, 0.3]))[0, :2].round(3)
    array([-0.418, -1.351])
    """
    euler = euler_from_rotation(rotation)
    phi2, phi3 = euler[..., 1], euler[..., 2]
    s2, c2, s3, c3 = np.sin(phi2), np.cos(phi2), np.sin(phi3), np.cos(phi3)
    zero, one = np.zeros_like(s2), np.ones_like(s2)
    # exp([w]) R: the frame's own angular velocity is -w; columns are the axes of phi1, phi2, phi3.
    axes = [[s3 * s2, c3, zero], [c3 * s2, -s3, zero], [c2, zero, one]]
    matrix = -np.stack([np.stack(row, axis=-1) for row in axes], axis=-2)
    locked = s2 < GIMBAL_LOCK
    safe = np.where(locked[..., None, None], np.eye(3), matrix)
    return np.where(locked[..., None, None], np.inf, np.linalg.inv(safe))


def skew(vector: ArrayLike) -> Array:
    """Make the matrix [v] with ``[v] a = v x a``, shape (..., 3, 3).

    Examples
    --------
    >>> skew([0.0, 0.0, 1.0]) @ [1.0, 0.0, 0.0]
    array([0., 1., 0.])
    """
    v = np.asarray(vector, float)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    found = np.zeros((*v.shape, 3))
    found[..., 0, 1], found[..., 0, 2] = -z, y
    found[..., 1, 0], found[..., 1, 2] = z, -x
    found[..., 2, 0], found[..., 2, 1] = -y, x
    return found


def rotation_from_vector(vector: ArrayLike) -> Array:
    """Make the rotation matrix of a rotation vector (Rodrigues), ``exp([v])``, shape (..., 3, 3).

    Examples
    --------
    >>> rotation_from_vector([0.0, 0.0, np.pi / 2]).round(6) @ [1.0, 0.0, 0.0]
    array([0., 1., 0.])
    """
    v = np.asarray(vector, float)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    k = skew(v)
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    sinc = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    cosc = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    return np.eye(3) + sinc * k + cosc * (k @ k)


def vector_from_rotation(rotation: ArrayLike) -> Array:
    """Give the rotation vector of a rotation matrix, of length at most pi, shape (..., 3).

    Examples
    --------
    >>> vector_from_rotation(rotation_from_vector([0.1, 0.2, 0.3])).round(6)
    array([0.1, 0.2, 0.3])
    """
    r = np.asarray(rotation, float)
    return (
        scipy.spatial.transform.Rotation.from_matrix(r.reshape(-1, 3, 3))
        .as_rotvec()
        .reshape(r.shape[:-1])
    )


def nearest_rotation(matrix: ArrayLike) -> Array:
    """Find the proper rotation nearest to each matrix in the Frobenius norm, shape (..., 3, 3).

    Examples
    --------
    >>> nearest_rotation(np.diag([1.1, 0.9, 1.0])).round(6).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    u, _, vt = np.linalg.svd(np.asarray(matrix, float))
    u[..., :, 2] *= np.linalg.det(u @ vt)[..., None]
    return u @ vt


def rigid_transform(source: ArrayLike, destination: ArrayLike) -> tuple[Array, Array]:
    """Fit the least-squares rigid motion ``destination = R source + t`` between matched points.

    Parameters
    ----------
    source, destination : array_like, shape (..., points, 3)

    Returns
    -------
    rotation : ndarray, shape (..., 3, 3)
    translation : ndarray, shape (..., 3), the points' unit

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> rotation, shift = rigid_transform(corners, corners + [0.0, 0.0, 2.0])
    >>> shift.round(6).tolist()
    [0.0, 0.0, 2.0]
    """
    a, b = np.asarray(source, float), np.asarray(destination, float)
    a_mean, b_mean = a.mean(axis=-2), b.mean(axis=-2)
    covariance = np.swapaxes(b - b_mean[..., None, :], -1, -2) @ (a - a_mean[..., None, :])
    rotation = nearest_rotation(covariance)
    return rotation, b_mean - np.einsum("...ij,...j->...i", rotation, a_mean)


@dataclass
class KnownPose:
    """One view's pose as numbers: Euler angles, or a point that the instrument looks at.

    Parameters
    ----------
    euler : list of float
        phi1, phi2, phi3 in the x-convention, world to laser.
    look_at : list of float
        Instead of euler: a point of the world that the instrument's z axis goes through, in the
        unit of the origin.
    roll : float
        With look_at: by how much the instrument is turned about its z axis, clockwise as who
        stands behind it sees it; at 0 its x axis is level, and world y is up.
    origin : list of float
        x, y, z of the laser frame's origin in the world.
    euler_std, origin_std : list of float
        Standard deviations; empty if unknown.
    samples : int
        With samples, the deviations are those of a sample of that size and the pose is its mean;
        with 0 they are the standard errors of the pose itself, exactly known.
    unit : LengthUnit
        Of origin, look_at and origin_std.
    angle_unit : AngleUnit
        Of euler, euler_std and roll.
    """

    euler: list[float] = field(default_factory=list)
    origin: list[float] = field(default_factory=list)
    euler_std: list[float] = field(default_factory=list)
    origin_std: list[float] = field(default_factory=list)
    samples: int = 0
    unit: LengthUnit = LengthUnit.m
    look_at: list[float] = field(default_factory=list)
    roll: float = 0.0
    angle_unit: AngleUnit = AngleUnit.rad

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what makes this no pose."""
        one = bool(self.euler) != bool(self.look_at)
        checks.require(one, name, "give either euler or look_at, and the origin")
        there = not self.look_at or self.look_at != self.origin
        checks.require(there, f"{name}.look_at", "must be another point than the origin")
        alone = not (self.roll and self.euler)
        checks.require(alone, f"{name}.roll", "belongs to look_at; euler says it already")
        checks.finite(f"{name}.roll", self.roll)
        for key in ("euler", "look_at", "origin", "euler_std", "origin_std"):
            values = getattr(self, key)
            sizes = (3,) if key == "origin" else (0, 3)
            message = f"must be three numbers, not {len(values)}"
            checks.require(len(values) in sizes, f"{name}.{key}", message)
            checks.finite(f"{name}.{key}", *values)
            told = beyond_belief(self.unit, *values) if key in ("look_at", "origin") else ""
            checks.require(not told, f"{name}.{key}", told)

    @property
    def rotation(self) -> Array:
        """Rotation from world to laser frame, shape (3, 3)."""
        if not self.look_at:
            return rotation_from_euler(self.angle_unit.value * np.array(self.euler))
        upright = rotation_towards(self.origin, self.look_at)
        about_z = rotation_from_euler([self.angle_unit.value * self.roll, 0.0, 0.0])
        return np.asarray(about_z @ upright)

    @property
    def place(self) -> Array:
        """Origin of the laser frame in the world, shape (3,), m."""
        return self.unit.value * np.array(self.origin, float)
