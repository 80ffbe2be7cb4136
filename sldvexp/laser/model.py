"""The two-mirror model: where the beam goes and which angles reach a point.

The laser frame has z towards the scene and x along the up-down mirror's axis. Everything is
vectorised; the last dimension of angles is (up_down, left_right), that of points (x, y, z).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.typing import Array


def project(points: ArrayLike, mirror_offset: ArrayLike = 0.0) -> Array:
    """Give the mirror angles that point the beam at each point (Eqs 4.2 and 4.3).

    Parameters
    ----------
    points : array_like, shape (..., 3), m
        In the laser frame.
    mirror_offset : array_like, broadcastable to (...), m
        Distance between the two mirrors' axes, added outside the root of Eq 4.3.

    Returns
    -------
    ndarray, shape (..., 2), rad
        ``up_down = atan2(y, z)`` and ``left_right = atan2(x, hypot(y, z) + mirror_offset)``.

    Examples
    --------
    >>> project([0.1, 0.2, 2.0], mirror_offset=0.03).round(4)
    array([0.0997, 0.049 ])
    """
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    up_down = np.arctan2(y, z)
    left_right = np.arctan2(x, np.hypot(y, z) + mirror_offset)
    return np.stack([up_down, left_right], axis=-1)


def project_with_directions(points: Array, mirror_offset: float) -> tuple[Array, Array]:
    """Give the mirror angles of points, see `project`, with their `direction_cosines`.

    Both come from the same lengths, without functions of the angles.

    Parameters
    ----------
    points : ndarray, shape (point, 3), m
        In the laser frame.

    Returns
    -------
    angles : ndarray, shape (point, 2), rad
    directions : ndarray, shape (point, 3)
        In laser axes. Of both an entry of all points is contiguous.

    Examples
    --------
    >>> angles, directions = project_with_directions(np.array([[0.1, 0.2, 2.0]]), 0.03)
    >>> angles.round(4), directions.round(4)
    (array([[0.0997, 0.049 ]]), array([[-0.049 , -0.0994, -0.9938]]))
    """
    x, y, z = np.ascontiguousarray(points.T)
    radius = np.sqrt(y * y + z * z)
    reach = radius + mirror_offset
    distance = np.sqrt(x * x + reach * reach)
    angles = np.stack([np.arctan2(y, z), np.arctan2(x, reach)]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        turned = reach / (distance * radius)
        directions = -np.stack([x / distance, turned * y, turned * z]).T
    if not radius.all():  # on the axis of a mirror, where an angle is taken to be 0
        directions[radius == 0] = direction_cosines(angles[radius == 0])
    return angles, directions


def project_jacobian(points: ArrayLike, mirror_offset: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Differentiate `project` by the point and by the mirror offset.

    Parameters
    ----------
    points : array_like, shape (..., 3), m
    mirror_offset : array_like, broadcastable to (...), m

    Returns
    -------
    by_point : ndarray, shape (..., 2, 3), rad/m
    by_offset : ndarray, shape (..., 2), rad/m

    Examples
    --------
    >>> by_point, by_offset = project_jacobian([1.0, 0.0, 2.0])
    >>> by_point[1, [0, 2]].round(2), by_offset.round(2)
    (array([ 0.4, -0.2]), array([ 0. , -0.2]))
    """
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    radius = np.hypot(y, z)
    reach = radius + mirror_offset
    square = x**2 + reach**2
    by_point = np.zeros((*x.shape, 2, 3))
    by_point[..., 0, 1] = z / radius**2
    by_point[..., 0, 2] = -y / radius**2
    by_point[..., 1, 0] = reach / square
    by_point[..., 1, 1] = -x * y / (radius * square)
    by_point[..., 1, 2] = -x * z / (radius * square)
    by_offset = np.stack([np.zeros_like(x), -x / square], axis=-1)
    return by_point, by_offset


def rays(angles: ArrayLike, mirror_offset: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Follow the beam of each angle pair: its virtual origin and unit direction in the laser frame.

    Parameters
    ----------
    angles : array_like, shape (..., 2), rad
        (up_down, left_right).
    mirror_offset : array_like, broadcastable to (...), m

    Returns
    -------
    origin : ndarray, shape (..., 3), m
        ``(mirror_offset tan(left_right), 0, 0)``: on the up-down mirror's axis (A.2.2, step G).
    direction : ndarray, shape (..., 3)
        Along ``(tan(left_right), sin(up_down), cos(up_down))``, from the instrument outwards.

    Examples
    --------
    >>> origin, direction = rays([0.0, 0.1], mirror_offset=0.03)
    >>> origin.round(5), direction.round(4)
    (array([0.00301, 0.     , 0.     ]), array([0.0998, 0.    , 0.995 ]))
    """
    up_down, left_right = np.moveaxis(np.asarray(angles, float), -1, 0)
    tangent = np.tan(left_right)
    zero = np.zeros_like(tangent)
    origin = np.stack([mirror_offset * tangent, zero, zero], axis=-1)
    along = np.stack([tangent, np.sin(up_down), np.cos(up_down)], axis=-1)
    return origin, along / np.linalg.norm(along, axis=-1, keepdims=True)


def direction_cosines(angles: ArrayLike, rotation: ArrayLike | None = None) -> Array:
    """Give unit vectors D from the surface to the instrument, ``v = V . D``.

    Parameters
    ----------
    angles : array_like, shape (..., 2), rad
    rotation : array_like, shape (..., 3, 3), optional
        World to laser; with it the cosines are in world axes, without it in laser axes.

    Returns
    -------
    ndarray, shape (..., 3)

    Examples
    --------
    >>> direction_cosines([0.0, 0.0])
    array([-0., -0., -1.])
    """
    _, direction = rays(angles)
    if rotation is None:
        return -direction
    return -np.einsum("...ji,...j->...i", np.asarray(rotation, float), direction)
