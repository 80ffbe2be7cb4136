"""Bitangents of two circles in a plane, in closed form, and how errors of the circles move them.

The four common tangent lines of an ordered pair (a, b) stand in the order of `LINES`; left and
right are those of a walker from a to b. Everything is vectorised over leading dimensions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.typing import Array

#: The common tangents of an ordered pair: "left-right" touches a on the left and b on the right.
LINES = ("external left", "external right", "internal left-right", "internal right-left")

#: Side on which each line touches a and b: +1 left, -1 right. Turns radii into signed radii.
SIDES = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]])


def bitangent_normals(a: ArrayLike, b: ArrayLike) -> Array:
    """Give the unit normals of the four common tangents, pointing left.

    A line with normal n touches both circles where ``n . (center + side radius n)`` is the same
    for both, hence ``n . (center_b - center_a) = side_a radius_a - side_b radius_b``.

    Parameters
    ----------
    a, b : array_like, shape (..., 3)
        x, y and radius of each circle, one unit. The circles must lie outside each other:
        circles that overlap have no internal tangents, and NaN comes back for those.

    Returns
    -------
    ndarray, shape (..., line, 2)
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    between = b[..., :2] - a[..., :2]
    distance = np.linalg.norm(between, axis=-1)[..., None]
    ahead = (between / distance)[..., None, :]
    left = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
    sine = (SIDES[:, 0] * a[..., 2, None] - SIDES[:, 1] * b[..., 2, None]) / distance
    with np.errstate(invalid="ignore"):
        cosine = np.sqrt(1.0 - sine**2)
    return cosine[..., None] * left + sine[..., None] * ahead


def bitangent_points(a: ArrayLike, b: ArrayLike) -> Array:
    """Find where the four common tangents of two circles touch them.

    Parameters
    ----------
    a, b : array_like, shape (..., 3)
        x, y and radius of each circle, one unit.

    Returns
    -------
    ndarray, shape (..., line, circle, 2), the circles' unit
        Lines in the order of `LINES`, circles in the order a, b.

    Examples
    --------
    >>> bitangent_points([0.0, 0.0, 1.0], [4.0, 0.0, 1.0])[0].tolist()
    [[0.0, 1.0], [4.0, 1.0]]
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    normal = bitangent_normals(a, b)[..., :, None, :]
    pair = np.stack([a, b], axis=-2)[..., None, :, :]
    signed_radius = SIDES * pair[..., 2]
    return pair[..., :2] + signed_radius[..., None] * normal


def bitangent_jacobian(a: ArrayLike, b: ArrayLike) -> Array:
    """Differentiate `bitangent_points` by the six numbers of the two circles.

    Differentiating ``n . (center_b - center_a) = side_a radius_a - side_b radius_b`` gives the
    angle by which the line turns; each point follows its centre, its radius and that turn.

    Parameters
    ----------
    a, b : array_like, shape (..., 3)
        x, y and radius of each circle, one unit.

    Returns
    -------
    ndarray, shape (..., line, circle, 2, 6)
        Last dimension: x, y, radius of a, then of b.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    normal = bitangent_normals(a, b)
    turned = np.stack([-normal[..., 1], normal[..., 0]], axis=-1)
    gradient = np.empty((*normal.shape[:-1], 6))
    gradient[..., 0:2], gradient[..., 2] = normal, SIDES[:, 0]
    gradient[..., 3:5], gradient[..., 5] = -normal, -SIDES[:, 1]
    between = (b - a)[..., None, :2]
    turn = gradient / (turned * between).sum(axis=-1, keepdims=True)

    jacobian = np.zeros((*normal.shape[:-1], 2, 2, 6))
    for k, circle in enumerate((a, b)):
        signed_radius = SIDES[:, k] * circle[..., 2, None]
        lever = signed_radius[..., None] * turned
        jacobian[..., k, :, :] = lever[..., :, None] * turn[..., None, :]
        jacobian[..., k, :, 3 * k : 3 * k + 2] += np.eye(2)
        jacobian[..., k, :, 3 * k + 2] += SIDES[:, k, None] * normal
    return jacobian
