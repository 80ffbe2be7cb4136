"""Points of space through the two-mirror model: image points, directions, and their derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from sldvexp.field.visibility.view import View
from sldvexp.geometry.rotation import skew
from sldvexp.laser.model import direction_cosines, project, project_jacobian
from sldvexp.laser.two_mirror import MIRRORS, TwoMirror
from sldvexp.typing import Array, BoolArray


class ProjectedPoints(NamedTuple):
    """Where points are in a view.

    Parameters
    ----------
    dac : ndarray, shape (point, 2), steps
        Not rounded; NaN where one of the two below holds.
    behind, off_board : ndarray of bool, shape (point,)
    directions : ndarray, shape (point, 3)
        Unit vectors from the point to the instrument, in world axes.
    """

    dac: Array
    behind: BoolArray
    off_board: BoolArray
    directions: Array


def sight(view: View, laser: TwoMirror, points: Array) -> ProjectedPoints:
    """Image points of points in space (Section 5.3.5) and direction cosines from their angles.

    Parameters
    ----------
    view : View
    laser : TwoMirror
        As configured; see `View.laser`.
    points : ndarray, shape (point, 3), m
        In the world.
    """
    laser = view.laser(laser)
    in_laser = to_laser(view, points)
    angles = project(in_laser, laser.mirror_offset)
    low, high = reach(laser)
    behind = in_laser[:, 2] <= 0
    off_board = ~behind & ((angles < low) | (angles > high)).any(axis=1)
    dac = laser.dac_from_angle(np.clip(angles, low, high))
    dac[behind | off_board] = np.nan
    return ProjectedPoints(dac, behind, off_board, direction_cosines(angles) @ view.rotation)


def to_laser(view: View, points: Array) -> Array:
    """Points in the view's laser frame, ``R (P - origin)``, shape (point, 3), m."""
    return points @ view.rotation.T - view.rotation @ view.origin


def reach(laser: TwoMirror) -> tuple[Array, Array]:
    """Smallest and largest angle of each mirror, shape (mirror,), rad."""
    ends = laser.angle_from_dac(np.array([[step, step] for step in laser.board.value]))
    return ends.min(axis=0), ends.max(axis=0)


def pose_derivative(view: View, laser: TwoMirror, points: Array, dac: Array) -> tuple[Array, Array]:
    """How image points and directions change with the pose; see `Seen.pose_derivative`.

    A small rotation w and a displacement t of the origin move a point in the laser frame by
    ``w x P - R t``. With the beam's direction d in the laser frame, ``D = -R' d`` changes by
    ``R' (w x d) - R' dd/dP (w x P - R t)``.
    """
    laser = view.laser(laser)
    known = np.asarray(np.isfinite(dac).all(axis=1))[:, None, None]
    steps = np.where(known[:, 0], dac, 0.0)
    in_laser = to_laser(view, points)
    by_point, _ = project_jacobian(in_laser, laser.mirror_offset)
    turned = -np.broadcast_to(view.rotation, (len(points), 3, 3))
    moved = np.concatenate([-skew(in_laser), turned], axis=2)
    angle_by_pose = by_point @ moved
    direction, by_angle = beam(project(in_laser, laser.mirror_offset))
    spun = np.concatenate([skew(direction), np.zeros_like(turned)], axis=2)
    dac_by_pose = angle_by_pose / angle_slope(laser, steps)[:, :, None]
    by_pose = -view.rotation.T @ (spun + by_angle @ angle_by_pose)
    return np.where(known, dac_by_pose, 0.0), np.where(known, by_pose, 0.0)


def beam(angles: Array) -> tuple[Array, Array]:
    """Beam directions in the laser frame and their derivatives by the angles.

    Parameters
    ----------
    angles : ndarray, shape (point, 2), rad

    Returns
    -------
    direction : ndarray, shape (point, 3)
        ``(sin lr, cos lr sin ud, cos lr cos ud)``, the unit vector of `sldvexp.laser.model.rays`.
    by_angle : ndarray, shape (point, 3, 2), 1/rad
    """
    sine_ud, sine_lr = np.moveaxis(np.sin(angles), -1, 0)
    cosine_ud, cosine_lr = np.moveaxis(np.cos(angles), -1, 0)
    zero = np.zeros_like(sine_ud)
    direction = np.stack([sine_lr, cosine_lr * sine_ud, cosine_lr * cosine_ud], axis=-1)
    by_ud = np.stack([zero, cosine_lr * cosine_ud, -cosine_lr * sine_ud], axis=-1)
    by_lr = np.stack([cosine_lr, -sine_lr * sine_ud, -sine_lr * cosine_ud], axis=-1)
    return direction, np.stack([by_ud, by_lr], axis=-1)


def angle_slope(laser: TwoMirror, dac: Array) -> Array:
    """Change of the angle with the DAC step, shape (..., 2), rad/step."""
    largest = laser.board.value[1]
    slopes = [polynomial.polyder(getattr(laser, m).coefficients) for m in MIRRORS]
    each = [polynomial.polyval(dac[..., i] / largest, s) for i, s in enumerate(slopes)]
    return np.stack(each, axis=-1) / largest
