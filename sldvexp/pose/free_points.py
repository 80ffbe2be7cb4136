"""Unknown points that several views see, adjusted together with the views' poses.

The recorded angles of point j in view i are ``project(R_i (p_j - o_i)) + noise``, a known distance
is ``|p_j - p_k| + noise``, a range ``|p_j - o_i| + noise``. All poses and points are adjusted by
least squares over known standard deviations (a bundle adjustment). Angles and distances do not
change if everything is moved as a whole, so that six directions of the unknowns are free. What the
world's axes are fixes them as constraints ``C dx = 0`` (Meissl, 1965), and the covariance is the
upper left block of::

    [ N  C' ]^-1
    [ C  0  ]

`frame_of_points` takes axes from three points, `frame_of_rough` those in which all points fit rough
coordinates best. Errors are normal, independent, and as large as stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sldvexp.geometry import rigid_transform, skew
from sldvexp.laser import project, project_jacobian
from sldvexp.pose.least_squares import turned
from sldvexp.typing import Array, BoolArray, IndexArray

#: Levenberg-Marquardt: first and least damping, relative to the curvature; steps.
DAMPING, LEAST_DAMPING, STEPS = 1e-4, 1e-10, 100
#: Decrease of the cost that is none.
TOLERANCE = 1e-13
#: Information in the worst direction, as a part of its best: nothing but rounding errors below.
UNDETERMINED = 1e-13


class Configuration(NamedTuple):
    """Poses of V views and places of P points.

    Parameters
    ----------
    rotation : ndarray, shape (V, 3, 3)
        World to laser.
    origin : ndarray, shape (V, 3), m
    points : ndarray, shape (P, 3), m
    """

    rotation: Array
    origin: Array
    points: Array

    def moved(self, step: Array) -> Configuration:
        """Make a step: rotation vector and displacement of each view, then of each point."""
        count = 6 * len(self.origin)
        views, points = step[:count].reshape(-1, 6), step[count:].reshape(-1, 3)
        return Configuration(
            turned(self.rotation, views[:, :3]), self.origin + views[:, 3:], self.points + points
        )

    def seen_from(self, turn: Array, shift: Array) -> Configuration:
        """Change the world's axes: ``p -> turn p + shift``."""
        return Configuration(
            self.rotation @ turn.T, self.origin @ turn.T + shift, self.points @ turn.T + shift
        )

    def scaled(self, factor: float) -> Configuration:
        """Make everything larger."""
        return Configuration(self.rotation, factor * self.origin, factor * self.points)


@dataclass(frozen=True, eq=False)
class Sightings:
    """Marks seen from views, and known distances between them.

    Parameters
    ----------
    view, point : ndarray of int, shape (M,)
        Indices of each sighting.
    angle : ndarray, shape (M, 2), rad
    step : ndarray, shape (2,), rad
        Angle of one DAC step of each mirror.
    std : float, DAC steps
        Standard deviation of each angle.
    mirror_offset : float, m
    pairs : ndarray of int, shape (D, 2)
        Ends of each known distance: points, and after them the views for their origins.
    length, length_std : ndarray, shape (D,), m
    """

    view: IndexArray
    point: IndexArray
    angle: Array
    step: Array
    std: float
    mirror_offset: float
    pairs: IndexArray
    length: Array
    length_std: Array

    def __len__(self) -> int:
        return len(self.view)

    def only(self, kept: IndexArray) -> Sightings:
        """Take some sightings."""
        return replace(self, view=self.view[kept], point=self.point[kept], angle=self.angle[kept])

    def without(self, left_out: IndexArray) -> Sightings:
        """Leave some sightings out."""
        return self.only(np.setdiff1d(np.arange(len(self)), left_out))

    def with_angles(self, angle: Array) -> Sightings:
        """Give the sightings other angles."""
        return replace(self, angle=angle)

    def with_views(self, view: IndexArray) -> Sightings:
        """Give the views other numbers."""
        return replace(self, view=view)

    def with_distances(self, kept: BoolArray) -> Sightings:
        """Take some of the known distances."""
        return replace(
            self,
            pairs=self.pairs[kept],
            length=self.length[kept],
            length_std=self.length_std[kept],
        )

    def apart(self, at: Configuration) -> Array:
        """Give the first less the second end of each of `pairs`, shape (D, 3), m."""
        ends = np.concatenate([at.points, at.origin])
        return np.asarray(ends[self.pairs[:, 0]] - ends[self.pairs[:, 1]])

    def distances(self, at: Configuration) -> Array:
        """Give the distances of `pairs`, shape (D,), m."""
        return np.linalg.norm(self.apart(at), axis=1)

    def residual(self, at: Configuration) -> Array:
        """Give observed minus predicted of angles and distances over their standard deviations.

        Infinite where a point is not before an instrument that sees it.
        """
        seen = self._seen(at)
        angle = (self.angle - project(seen, self.mirror_offset)) / (self.step * self.std)
        angle[seen[:, 2] <= 0] = np.inf
        distance = (self.length - self.distances(at)) / self.length_std
        return np.concatenate([angle.ravel(), distance])

    def jacobian(self, at: Configuration) -> Array:
        """Differentiate the predictions behind `residual`, shape (2 M + D, 6 V + 3 P)."""
        views, rows = len(at.origin), np.arange(len(self))
        by_place, _ = project_jacobian(self._seen(at), self.mirror_offset)
        by_place /= (self.step * self.std)[:, None]
        by_point = by_place @ at.rotation[self.view]
        by_view = np.concatenate([by_place @ -skew(self._seen(at)), -by_point], axis=-1)
        of_angles = np.zeros((len(self), 2, 6 * views + 3 * len(at.points)))
        for k in range(6):
            of_angles[rows, :, 6 * self.view + k] = by_view[..., k]
        for k in range(3):
            of_angles[rows, :, 6 * views + 3 * self.point + k] = by_point[..., k]
        of_distances = np.zeros((len(self.pairs), of_angles.shape[-1]))
        along = self.apart(at) / (self.distances(at) * self.length_std)[:, None]
        # Unknowns of a view are its turn, then its origin.
        first = np.concatenate(
            [6 * views + 3 * np.arange(len(at.points)), 6 * np.arange(views) + 3]
        )
        for k in range(3):
            for end, sign in ((0, 1.0), (1, -1.0)):
                place = first[self.pairs[:, end]] + k
                of_distances[np.arange(len(self.pairs)), place] = sign * along[:, k]
        return np.concatenate([of_angles.reshape(-1, of_angles.shape[-1]), of_distances])

    def _seen(self, at: Configuration) -> Array:
        """Give the points in the laser frames of the views that see them, shape (M, 3), m."""
        away = at.points[self.point] - at.origin[self.view]
        return np.einsum("mij,mj->mi", at.rotation[self.view], away)


class AdjustedPoints(NamedTuple):
    """Least squares of sightings.

    Parameters
    ----------
    at : Configuration
    residual : ndarray, shape (2 M + D,)
    cost : float
    """

    at: Configuration
    residual: Array
    cost: float


def adjust_points(sightings: Sightings, start: Configuration) -> AdjustedPoints | None:
    """Follow a start down to the least squares; None where a point is not before its views.

    Damping, which is relative to the curvature, holds the six free directions.
    """
    at, residual = start, sightings.residual(start)
    cost, damping, growth = float(residual @ residual), DAMPING, 2.0
    if not np.isfinite(cost):
        return None
    jacobian = sightings.jacobian(at)
    for _ in range(STEPS):
        matrix, right = jacobian.T @ jacobian, jacobian.T @ residual
        extra = damping * np.diag(matrix)
        step = np.asarray(np.linalg.solve(matrix + np.diag(extra), right), np.float64)
        expected = float(step @ (right + extra * step))
        trial = at.moved(step)
        then = sightings.residual(trial)
        trial_cost = float(then @ then)
        done = expected <= TOLERANCE * (1 + cost)
        if trial_cost <= cost * (1 + TOLERANCE * done):
            at, residual, cost = trial, then, trial_cost
            jacobian = sightings.jacobian(at)
            damping, growth = max(damping / 10, LEAST_DAMPING), 2.0
        else:
            damping, growth = damping * growth, 2 * growth
        if done:
            break
    return AdjustedPoints(at, residual, cost)


def gauged_covariance(sightings: Sightings, at: Configuration, constraints: Array) -> Array | None:
    """Invert the information of sightings where constraints hold the world's axes.

    Parameters
    ----------
    constraints : ndarray, shape (6, 3 P)
        Directions in which the points do not move, as `frame_of_points` gives them.

    Returns
    -------
    ndarray, shape (6 V + 3 P, 6 V + 3 P), or None
        None if the sightings do not determine everything.
    """
    jacobian = sightings.jacobian(at)
    information = jacobian.T @ jacobian
    scale = 1 / np.sqrt(np.diag(information))
    rows = np.zeros((6, len(information)))
    rows[:, 6 * len(at.origin) :] = constraints
    # Only motions that leave the constraints at zero are free: a basis of their null space.
    free = np.linalg.svd(rows * scale)[2][6:].T
    inner = free.T @ (information * scale[:, None] * scale) @ free
    value, vector = np.linalg.eigh(inner)
    if value[0] <= UNDETERMINED * value[-1]:
        return None
    basis = scale[:, None] * (free @ vector)
    return np.asarray((basis / value) @ basis.T)


def frame_of_points(points: Array, three: Sequence[int]) -> tuple[Array, Array, Array]:
    """Take the world's axes from three points.

    Parameters
    ----------
    points : ndarray, shape (P, 3), m
    three : sequence of 3 int
        Of the points: the origin, one on the x axis, one in the x-y plane on y's positive side.

    Returns
    -------
    turn : ndarray, shape (3, 3)
    shift : ndarray, shape (3,), m
        ``turn p + shift`` are the points in those axes.
    constraints : ndarray, shape (6, 3 P)
        Directions in which points in those axes do not move.
    """
    corner, ahead, beside = points[list(three)]
    x = (ahead - corner) / np.linalg.norm(ahead - corner)
    z = np.cross(x, beside - corner)
    z /= np.linalg.norm(z)
    turn = np.stack([x, np.cross(z, x), z])
    constraints = np.zeros((6, len(points), 3))
    a, b, c = three
    held = [(a, 0), (a, 1), (a, 2), (b, 1), (b, 2), (c, 2)]
    for row, (point, axis) in enumerate(held):
        constraints[row, point, axis] = 1.0
    return turn, -turn @ corner, constraints.reshape(6, -1)


def frame_of_rough(points: Array, rough: Array) -> tuple[Array, Array, Array]:
    """Take the world's axes in which points fit their rough coordinates best.

    Parameters
    ----------
    rough : ndarray, shape (P, 3), m

    Returns
    -------
    turn, shift, constraints : ndarray
        As of `frame_of_points`.
    """
    turn, shift = rigid_transform(points, rough)
    still = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    # The best fit has no sum of ``p - rough``, and none of ``rough x p``.
    rows = np.concatenate([still, skew(rough - rough.mean(axis=0))], axis=1)
    return turn, shift, np.moveaxis(rows, 0, 1).reshape(6, -1)
