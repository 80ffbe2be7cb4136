"""From points of the world to DAC steps of a known pose, and from steps to a better pose.

``steps = board(project(R (P - origin)))``; by a small turn w of the laser frame and a small shift
of its origin a point moves by ``dP_laser = w x P_laser - R d_origin``. A rough pose is corrected
by Gauss-Newton on the squares of steps and, weighted by how wrong it may be, on the correction
itself, so that a single point is enough to begin with.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.geometry import rotation_from_vector, skew
from sldvexp.laser.model import project, project_jacobian
from sldvexp.laser.two_mirror import MIRRORS, TwoMirror
from sldvexp.typing import Array

#: Standard deviation of a rough pose in rotation, rad, and in place, m.
ROUGH = np.array([0.03] * 3 + [0.04] * 3)
#: Standard deviation of points that a scan has found, DAC steps: the centre of a circle's image
#: is not that of the circle.
FOUND = 2.0
#: Part of a step that is rounding.
STEP_ROUNDING = 1e-6
#: Corrections of a pose; each leaves a hundredth of the error or less.
ITERATIONS = 8


def dac_of_points(
    points: ArrayLike, rotation: Array, origin: Array, laser: TwoMirror, names: list[str]
) -> Array:
    """Predict the DAC steps, not rounded, that bring the beam to points of the world.

    Parameters
    ----------
    points : array_like, shape (N, 3), m
    rotation : ndarray, shape (3, 3)
        World to laser.
    origin : ndarray, shape (3,), m
    names : list of str, length N
        Of the points in messages.

    Returns
    -------
    ndarray, shape (N, 2), steps

    Raises
    ------
    UserError
        That names a point behind the instrument, or one that the mirrors do not reach.

    Examples
    --------
    >>> dac_of_points([[0.1, 0, 2]], np.eye(3), np.zeros(3), TwoMirror(), ["mark 1"]).round(2)
    array([[  0.  , 468.98]])
    """
    seen = (np.asarray(points, float) - origin) @ rotation.T
    if (behind := seen[:, 2] <= 0).any():
        raise UserError(
            f"{names[int(behind.argmax())]} lies behind the instrument; correct the pose of the "
            "view, or the point"
        )
    try:
        return laser.dac_from_angle(project(seen, laser.mirror_offset), names)
    except UserError as error:
        told = str(error).removeprefix("point ").replace(": ", " is out of reach: ", 1)
        raise UserError(told) from None


def beyond_told(angle: Array, laser: TwoMirror) -> str:
    """Say how far a place is beyond the mirrors' reach; empty if the beam can go there.

    Parameters
    ----------
    angle : ndarray, shape (2,), rad
        NaN of a place behind the instrument.

    Examples
    --------
    >>> beyond_told(np.radians([26.0, -25.5]), TwoMirror())
    "164 steps (1 deg) beyond the up-down mirror's reach and 82 steps (0.5 deg) beyond the \
left-right mirror's reach"
    >>> beyond_told(np.radians([25.0, 0.0]), TwoMirror())
    ''
    """
    if np.isnan(angle).any():
        return "behind the instrument"
    if laser.reaches(angle):
        return ""
    steps = np.abs(laser.steps_beyond(angle))
    degrees = np.rad2deg(steps * laser.step)
    told = np.ceil(steps - STEP_ROUNDING)
    farthest = int(np.argmax(steps))
    told[farthest] = max(told[farthest], 1.0)  # it is beyond, by however little
    each = zip(MIRRORS, told, degrees, strict=True)
    return " and ".join(
        f"{step:.0f} steps ({degree:.2g} deg) beyond the {mirror.replace('_', '-')} mirror's reach"
        for mirror, step, degree in each
        if step
    )


def dac_jacobian(points: ArrayLike, rotation: Array, origin: Array, laser: TwoMirror) -> Array:
    """Differentiate `dac_of_points` by a small turn of the laser frame and by its origin.

    Returns
    -------
    ndarray, shape (N, 2, 6), steps per rad and per m
        By the rotation vector w of ``R -> exp([w]) R``, then by the origin, as covariances of poses
        are laid out.

    Examples
    --------
    >>> dac_jacobian([[0, 0, 2.0]], np.eye(3), np.zeros(3), TwoMirror())[0].round(0) + 0.0
    array([[-9387.,     0.,     0.,     0., -4694.,     0.],
           [    0.,  9387.,     0., -4694.,     0.,     0.]])
    """
    seen = (np.asarray(points, float) - origin) @ rotation.T
    by_point, _ = project_jacobian(seen, laser.mirror_offset)
    moved = np.concatenate([-skew(seen), np.broadcast_to(-rotation, (len(seen), 3, 3))], axis=-1)
    dac = laser.dac_from_angle(project(seen, laser.mirror_offset))
    low, high = laser.board.value
    before, after = np.clip(dac - 0.5, low, high), np.clip(dac + 0.5, low, high)
    angle_per_step = laser.angle_from_dac(after) - laser.angle_from_dac(before)
    steps_per_angle = (after - before) / angle_per_step
    return np.asarray(steps_per_angle[..., None] * (by_point @ moved))


def corrected_pose(
    points: ArrayLike,
    dac: ArrayLike,
    rotation: Array,
    origin: Array,
    laser: TwoMirror,
    names: list[str],
    std: ArrayLike = FOUND,
) -> tuple[Array, Array]:
    """Correct a rough pose by points of the world that were found at DAC steps.

    Parameters
    ----------
    points : array_like, shape (N, 3), m
        One or more.
    dac : array_like, shape (N, 2), steps
    rotation, origin : ndarray
        The rough pose, wrong by as much as `ROUGH` says.
    names : list of str, length N
        Of the points in messages.
    std : array_like, broadcastable to (N, 2), steps
        Standard deviations of what was found.

    Returns
    -------
    rotation : ndarray, shape (3, 3)
    origin : ndarray, shape (3,), m

    Examples
    --------
    The beam met a point 100 steps to the left of where a pose without error has it:

    >>> point, laser = [[0, 0, 2.0]], TwoMirror()
    >>> pose = corrected_pose(point, [[0, 100]], np.eye(3), np.zeros(3), laser, ["mark 1"])
    >>> dac_of_points(point, *pose, laser, ["mark 1"]).round() + 0.0
    array([[  0., 100.]])
    """
    at, found = np.asarray(points, float), np.asarray(dac, float)
    turned, there, gone = rotation, np.array(origin, float), np.zeros(6)
    error = np.broadcast_to(np.asarray(std, float), found.shape).ravel()
    for _ in range(ITERATIONS):
        missed = found - dac_of_points(at, turned, there, laser, names)
        rows = np.concatenate(
            [
                dac_jacobian(at, turned, there, laser).reshape(-1, 6) / error[:, None],
                np.diag(1 / ROUGH),
            ]
        )
        right = np.concatenate([missed.ravel() / error, -gone / ROUGH])
        step = np.linalg.lstsq(rows, right, rcond=None)[0]
        turned, there, gone = rotation_from_vector(step[:3]) @ turned, there + step[3:], gone + step
    return turned, there
