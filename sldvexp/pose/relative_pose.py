"""Two views of the same unknown points: how the second instrument stands to the first.

Rays f and g of one point from two places, with the rotation R from the axes of the first to those
of the second and the direction t of the baseline in the second, lie in one plane::

    t . (g x R f) = 0

For a given R the best t is the least singular vector of the rows ``g x R f``, so that a search over
R alone finds all relative poses (Kneip and Lynen, ICCV 2013): a grid of all rotations, of which the
best are refined by Gauss-Newton on R and t. Beams are taken to start in one place, which mirrors an
offset apart do only nearly; `sldvexp.pose.free_points` adjusts the true model. Points that lie on
one plane, or few points, allow several relative poses. All are given, and other views decide.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sldvexp.pose.initial_pose import rotation_grid
from sldvexp.pose.least_squares import cross_matrix, turned
from sldvexp.typing import Array, BoolArray

#: Rotations of the grid that are refined, and Gauss-Newton steps of each.
CANDIDATES, REFINEMENTS = 64, 25
#: Relative poses that are given at most.
MOST = 12
#: Rotations nearer than this are one, rad.
DISTINCT = 1e-3
#: Part of the points that must lie before both instruments: a wrong one may not.
IN_FRONT = 0.75
#: Keeps the Gauss-Newton matrix positive, as a part of its trace.
DAMPING = 1e-9


class RelativePose(NamedTuple):
    """A relative pose of two views: ``P_second = rotation P_first + shift``, the shift of length 1.

    Parameters
    ----------
    error : float
        Root mean square of ``t . (g x R f)``.
    """

    rotation: Array
    shift: Array
    error: float


def relative_poses(first: Array, second: Array) -> list[RelativePose]:
    """Find all relative poses with the points before both instruments, the best first.

    Parameters
    ----------
    first, second : ndarray, shape (N, 3)
        Unit vectors along the rays of five points or more, each in its own laser frame.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> points = rng.uniform(-0.3, 0.3, (8, 3)) + [0, 0, 2]
    >>> def unit(p):
    ...     return p / np.linalg.norm(p, axis=1, keepdims=True)
    >>> best = relative_poses(unit(points), unit(points + [0.5, 0.0, 0.1]))[0]
    >>> bool(abs(best.rotation - np.eye(3)).max() < 1e-9), best.shift.round(2)
    (True, array([0.98, 0.  , 0.2 ]))
    """
    rotation, shift = _refined(*_lowest_on_grid(first, second), first, second)
    residual = _triple(rotation, first, second) @ shift[..., None]
    error = np.sqrt(np.mean(residual[..., 0] ** 2, axis=-1))
    found: list[RelativePose] = []
    for k in np.argsort(error):
        for sign in (1.0, -1.0):
            pose = RelativePose(rotation[k], sign * shift[k], float(error[k]))
            if np.mean(in_front(pose, first, second)) >= IN_FRONT and _is_new(pose, found):
                found.append(pose)
    return found[:MOST]


def in_front(pose: RelativePose, first: Array, second: Array) -> BoolArray:
    """Tell which points lie before both instruments, by the depths where their rays come closest.

    Examples
    --------
    >>> ray = np.array([[0.0, 0.0, 1.0]])
    >>> across = RelativePose(np.eye(3), np.array([1.0, 0.0, 0.0]), 0.0)
    >>> in_front(across, ray, np.array([[0.6, 0.0, 0.8]]))
    array([ True])
    """
    along = first @ pose.rotation.T
    cosine = np.sum(along * second, axis=1)
    near, far = along @ pose.shift, second @ pose.shift
    # Least squares of ``a R f + t - b g`` in the depths a and b, times sin^2 of the rays' angle.
    return (cosine * far - near > 0) & (far - cosine * near > 0)


def _lowest_on_grid(first: Array, second: Array) -> tuple[Array, Array]:
    rotation, _, _ = rotation_grid()
    rows = _triple(rotation, first, second)
    value, vector = np.linalg.eigh(rows.swapaxes(-1, -2) @ rows)
    best = np.argsort(value[:, 0])[:CANDIDATES]
    return rotation[best], vector[best, :, 0]


def _triple(rotation: Array, first: Array, second: Array) -> Array:
    """Evaluate ``g x R f``, shape (rotation, N, 3)."""
    return np.cross(second, first @ rotation.swapaxes(-1, -2))


def _refined(rotation: Array, shift: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """Take Gauss-Newton steps of R and t."""
    for _ in range(REFINEMENTS):
        along = first @ rotation.swapaxes(-1, -2)
        rows = np.cross(second, along)
        residual = (rows @ shift[..., None])[..., 0]
        # t . (g x (w x Rf)) = w . (Rf x (t x g)); t turns by u x t.
        by_turn = np.cross(along, np.cross(shift[:, None], second))
        by_shift = np.cross(shift[:, None], rows)
        jacobian = np.concatenate([by_turn, by_shift], axis=-1)
        matrix = jacobian.swapaxes(-1, -2) @ jacobian
        trace = np.einsum("mkk->m", matrix)
        matrix += (DAMPING * trace)[:, None, None] * np.eye(6)
        right = -(jacobian.swapaxes(-1, -2) @ residual[..., None])
        step = np.linalg.solve(matrix, right)[..., 0]
        # Far from the best rotation a full step may be wild.
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        step *= np.minimum(1.0, 0.3 / np.maximum(length, 1e-30))
        rotation = turned(rotation, step[:, :3])
        shift = shift + (cross_matrix(step[:, 3:]) @ shift[..., None])[..., 0]
        shift /= np.linalg.norm(shift, axis=-1, keepdims=True)
    return rotation, shift


def _is_new(pose: RelativePose, found: list[RelativePose]) -> bool:
    for other in found:
        same = np.trace(pose.rotation @ other.rotation.T) > 1 + 2 * np.cos(DISTINCT)
        if same and pose.shift @ other.shift > np.cos(DISTINCT):
            return False
    return True
