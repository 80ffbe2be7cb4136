"""Rays against planes and triangles: the first place that a ray from an instrument meets."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.typing import Array

#: By how much a ray may miss a triangle, of its size: neighbours leave no gap between them.
EDGE = 1e-9


def meets_plane(origin: Array, direction: Array, point: ArrayLike, normal: ArrayLike) -> float:
    """Find how far along a ray a plane is; infinite where it is behind, or along the ray.

    Parameters
    ----------
    origin, direction : ndarray, shape (3,)
        The direction of length 1.
    point, normal : array_like, shape (3,)

    Returns
    -------
    float, unit of the origin

    Examples
    --------
    >>> meets_plane(np.array([0, 0, 1.5]), np.array([0, 0, -1.0]), [3, 4, 0], [0, 0, 1])
    1.5
    """
    across = float(np.dot(normal, direction))
    height = float(np.dot(normal, np.asarray(point, float) - origin))
    distance = height / across if across else np.inf
    return distance if distance > 0 else np.inf


def meets_triangles(origin: Array, direction: Array, corners: Array) -> float:
    """Find how far along a ray the first of many triangles is; infinite if it meets none.

    The ray's point ``origin + t direction = a + u (b - a) + v (c - a)`` lies inside where
    u, v and 1 - u - v are not negative (Moeller and Trumbore).

    Parameters
    ----------
    origin, direction : ndarray, shape (3,)
        The direction of length 1.
    corners : ndarray, shape (triangle, 3, 3)

    Returns
    -------
    float, unit of the origin

    Examples
    --------
    >>> corner = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]])
    >>> meets_triangles(np.array([0.2, 0.2, 2]), np.array([0, 0, -1.0]), corner)
    2.0
    """
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(direction, ac)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.sum(ab * across, axis=1)
        away = origin - a
        u = inverse * np.sum(away * across, axis=1)
        turned = np.cross(away, ab)
        v = inverse * (turned @ direction)
        distance = inverse * np.sum(ac * turned, axis=1)
        inside = (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1 + EDGE) & (distance > 0)
    return float(distance[inside].min(initial=np.inf))
