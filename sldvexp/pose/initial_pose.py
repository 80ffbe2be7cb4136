"""Closed-form start of a pose: no guess of where the instrument stood is needed.

The beam of an angle pair is the line where two planes meet, ``n1 . P = 0`` and
``n2 . P = mirror_offset sin(left_right)``. The squared distances of the object points from their
beams are a quadratic form in the pose. With the translation eliminated it is left with the ten
numbers ``r = (vec R, 1)`` however many points there are, so that trying a grid of all rotations
costs one matrix product. Points lie in the last dimension of every array here.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from sldvexp.geometry import golden_sphere, rotation_from_euler
from sldvexp.pose.least_squares import SKEW, solve, turned
from sldvexp.typing import Array

#: Viewing directions over the sphere and turns about each: about 30 deg from one to the next.
DIRECTIONS, TURNS = 50, 12

#: Rotations of the grid that are refined; the lowest valley may begin at a higher grid point.
CANDIDATES = 16

#: Gauss-Newton steps of each refinement.
REFINEMENTS = 5

#: ``vec(R) GENERATORS`` is d vec(exp([w]) R) / dw, for the three components of w in turn.
GENERATORS = np.hstack([np.kron(axis.reshape(3, 3), np.eye(3)).T for axis in SKEW])


def start_poses(
    points: Array, normal: Array, angles: Array, mirror_offset: Array
) -> tuple[Array, Array]:
    """Find two poses to start from: the best of a global search, and its mirror image in depth.

    Parameters
    ----------
    points : ndarray, shape (batch or 1, 3, points), m
        In the world, relative to their centroid.
    normal : ndarray, shape (batch or 1, 3)
        Direction in which the points spread least: of a plane object its normal.
    angles : ndarray, shape (batch, 2, points), rad
    mirror_offset : ndarray, shape (batch, 1), m

    Returns
    -------
    rotation : ndarray, shape (batch, 2, 3, 3)
    centre : ndarray, shape (batch, 2, 3), m
        Position of the centroid in the laser frame.
    """
    form = object_space_form(points, *beam_planes(angles, mirror_offset))
    form = ObjectSpaceForm(form.quadratic[:, None], form.translation[:, None])
    candidates = refined(lowest_on_grid(form)[:, 0], form)
    lowest = np.argmin(form.error(lift(candidates)), axis=-1)
    best = candidates[np.arange(len(lowest)), lowest][:, None]
    mirrored = flipped(best, form.centre(lift(best)), normal[:, None])
    rotation = refined(np.concatenate([best, mirrored], axis=1), form)
    return rotation, form.centre(lift(rotation))


class ObjectSpaceForm(NamedTuple):
    """Squared distances of the points from their beams, summed: ``E(R) = r' Q r``.

    Parameters
    ----------
    quadratic : ndarray, shape (..., 10, 10), m^2
        Q, with the translation eliminated.
    translation : ndarray, shape (..., 3, 10), m
        The best position of the points' centroid in the laser frame is ``translation r``.
    """

    quadratic: Array
    translation: Array

    def error(self, lifted: Array) -> Array:
        """Evaluate ``r' Q r``, shape (...), m^2."""
        return ((self.quadratic @ lifted[..., None])[..., 0] * lifted).sum(axis=-1)

    def centre(self, lifted: Array) -> Array:
        """Give the position of the points' centroid in the laser frame, shape (..., 3), m."""
        return (self.translation @ lifted[..., None])[..., 0]


def beam_planes(angles: Array, mirror_offset: Array) -> tuple[Array, Array]:
    """Give the two planes that meet in each beam (Eqs 4.2 and 4.3).

    Parameters
    ----------
    angles : ndarray, shape (..., 2, points), rad
        (up_down, left_right).
    mirror_offset : ndarray, shape (..., 1), m

    Returns
    -------
    normal : ndarray, shape (..., 3, 2, points)
        Two orthonormal vectors a beam.
    distance : ndarray, shape (..., 2, points), m
        ``normal . P = distance`` for every point P of the beam, in the laser frame.
    """
    (sin_up, sin_left), (cos_up, cos_left) = (
        (f[..., 0, :], f[..., 1, :]) for f in (np.sin(angles), np.cos(angles))
    )
    normal = np.zeros((*angles.shape[:-2], 3, *angles.shape[-2:]))
    normal[..., 1, 0, :], normal[..., 2, 0, :] = cos_up, -sin_up
    normal[..., 0, 1, :] = cos_left
    normal[..., 1, 1, :], normal[..., 2, 1, :] = -sin_left * sin_up, -sin_left * cos_up
    distance = np.zeros_like(angles)
    distance[..., 1, :] = mirror_offset * sin_left
    return normal, distance


def object_space_form(points: Array, normal: Array, distance: Array) -> ObjectSpaceForm:
    """Make the quadratic form of the distances from the beams, ``n . (R p + t) - distance``.

    Parameters
    ----------
    points : ndarray, shape (..., 3, points), m
        Relative to their centroid.
    normal, distance : ndarray, shapes (..., 3, 2, points) and (..., 2, points)
        Of `beam_planes`.
    """
    *lead, _, _, n = normal.shape
    by_rotation = normal[..., :, None, :, :] * points[..., None, :, None, :]
    rows = [by_rotation.reshape(*lead, 9, 2 * n), -distance.reshape(*lead, 1, 2 * n)]
    by_r = np.concatenate(rows, axis=-2)
    by_t = normal.reshape(*lead, 3, 2 * n)
    mixed = by_t @ by_r.swapaxes(-1, -2)
    translation = -np.linalg.inv(by_t @ by_t.swapaxes(-1, -2)) @ mixed
    quadratic = by_r @ by_r.swapaxes(-1, -2) + mixed.swapaxes(-1, -2) @ translation
    return ObjectSpaceForm(quadratic, translation)


def lift(rotation: Array) -> Array:
    """Write rotations as ``r = (vec R, 1)``, shape (..., 10)."""
    lifted = np.ones((*rotation.shape[:-2], 10))
    lifted[..., :9] = rotation.reshape(*rotation.shape[:-2], 9)
    return lifted


@functools.cache
def rotation_grid() -> tuple[Array, Array, Array]:
    """Spread rotations evenly; with `r` (grid, 10) and ``r r'`` flattened (100, grid)."""
    azimuth, polar = (angle[:, None] for angle in golden_sphere(DIRECTIONS))
    turn = 2 * np.pi * np.arange(TURNS) / TURNS
    euler = np.stack(np.broadcast_arrays(azimuth, polar, turn), axis=-1)
    rotation = rotation_from_euler(euler.reshape(-1, 3))
    lifted = lift(rotation)
    return rotation, lifted, (lifted[:, :, None] * lifted[:, None, :]).reshape(-1, 100).T


def lowest_on_grid(form: ObjectSpaceForm) -> Array:
    """Take the rotations of the grid with the smallest error, shape (..., candidates, 3, 3).

    A line has no front: rotations that put the object behind the instrument are left out.
    """
    rotation, lifted, products = rotation_grid()
    error = form.quadratic.reshape(*form.quadratic.shape[:-2], 100) @ products
    error[form.translation[..., 2, :] @ lifted.T <= 0] = np.inf
    return rotation[np.argpartition(error, CANDIDATES, axis=-1)[..., :CANDIDATES]]


def refined(rotation: Array, form: ObjectSpaceForm) -> Array:
    """Take `REFINEMENTS` damped Gauss-Newton steps down the object-space error."""
    for _ in range(REFINEMENTS):
        lifted = lift(rotation)
        tangent = (lifted[..., :9] @ GENERATORS).reshape(*lifted.shape[:-1], 3, 9)
        pull = tangent @ form.quadratic[..., :9, :]
        gradient = (pull @ lifted[..., None])[..., 0]
        # Gauss-Newton leaves the curvature of R itself out, which keeps the matrix positive.
        hessian = pull[..., :9] @ tangent.swapaxes(-1, -2)
        diagonal = np.einsum("...kk->...k", hessian)
        diagonal += 1e-4 * diagonal.sum(axis=-1, keepdims=True)
        rotation = turned(rotation, -solve(hessian, gradient))
    return rotation


def reflection(normal: Array) -> Array:
    """Make the reflection in the plane across a unit vector, shape (..., 3, 3)."""
    return np.eye(3) - 2 * normal[..., :, None] * normal[..., None, :]


def flipped(rotation: Array, centre: Array, normal: Array) -> Array:
    """Give the other rotation in which a small plane object looks nearly the same.

    The object is mirrored in depth, along the line of sight to its centroid, and in its own plane,
    which leaves it as it is.

    Parameters
    ----------
    rotation : ndarray, shape (..., 3, 3)
    centre : ndarray, shape (..., 3), m
        Centroid in the laser frame.
    normal : ndarray, shape (..., 3)
        Unit normal of the object's plane, in the world.
    """
    sight = centre / np.linalg.norm(centre, axis=-1, keepdims=True)
    return reflection(sight) @ rotation @ reflection(normal)
