"""Ellipses as point conics and as line conics, and the distance of points from them.

An ellipse is five numbers, ``(x, y, s_xx, s_yy, s_xy)``: its centre c and its shape matrix S. It is
the set of points ``(p - c)' S^-1 (p - c) = 1``, and the line with unit normal n touches it at the
distance ``n . c +- sqrt(n' S n)`` from the origin. Unlike the coefficients of Eq 4.17 these numbers
have no free scale, stay finite wherever the origin is, and, unlike two semi-axes and an angle, are
smooth for a circle. Everything is vectorised over leading dimensions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.typing import Array, BoolArray

#: Newton's steps for the foot of a perpendicular, near the curve three; the last one, over the way
#: to the pole, whose square is what is left of the error.
FOOT_ITERATIONS, FOOT_SETTLED = 100, 1e-9

#: Derivative of a line conic by s_xx, s_yy and s_xy.
SHAPE_ENTRIES = np.zeros((3, 3, 3))
SHAPE_ENTRIES[0, 0, 0] = SHAPE_ENTRIES[1, 1, 1] = 1.0
SHAPE_ENTRIES[2, 0, 1] = SHAPE_ENTRIES[2, 1, 0] = 1.0


@dataclass(frozen=True, eq=False, repr=False)
class Ellipse:
    """An ellipse with the covariance of its five numbers.

    Parameters
    ----------
    parameters : ndarray, shape (5,)
        x, y (steps), s_xx, s_yy, s_xy (steps^2).
    covariance : ndarray, shape (5, 5)
    """

    parameters: Array
    covariance: Array

    def __repr__(self) -> str:
        (x, y), (larger, smaller) = self.centre, self.semi_axes
        turn = np.degrees(self.angle)
        return f"ellipse at ({x:.6g}, {y:.6g}), {larger:.4g} x {smaller:.4g}, turned {turn:.1f} deg"

    @property
    def centre(self) -> Array:
        """Centre of the ellipse, shape (2,), steps."""
        return self.parameters[:2]

    @property
    def semi_axes(self) -> Array:
        """Larger and smaller semi-axis, shape (2,), steps."""
        return semi_axes(self.parameters)

    @property
    def angle(self) -> float:
        """Direction of the larger axis from the first coordinate, in [-pi/2, pi/2), rad."""
        x, y = principal_axes(self.parameters)[1][:, 0]
        return float((np.arctan2(y, x) + np.pi / 2) % np.pi - np.pi / 2)

    @property
    def semi_axes_std(self) -> Array:
        """Standard errors of `semi_axes` to first order, shape (2,), steps."""
        directions = principal_axes(self.parameters)[1]
        _, by_shape = half_width(directions.T, shape_matrix(self.parameters))
        return np.sqrt(np.einsum("ki,ij,kj->k", by_shape, self.covariance[2:, 2:], by_shape))

    @property
    def coefficients(self) -> Array:
        """Coefficients A, B, C, D, E of Eq 4.17 with F = 1, shape (5,)."""
        return coefficients(self.parameters)

    @property
    def coefficients_covariance(self) -> Array:
        """Covariance of `coefficients`, shape (5, 5)."""
        jacobian = coefficients_jacobian(self.parameters)
        return jacobian @ self.covariance @ jacobian.T


def shape_matrix(parameters: ArrayLike) -> Array:
    """Give S of each ellipse, shape (..., 2, 2)."""
    p = np.asarray(parameters, float)
    return p[..., [[2, 4], [4, 3]]]


def is_ellipse(parameters: ArrayLike) -> BoolArray:
    """Tell whether S is positive definite, so that the conic is a real ellipse, shape (...)."""
    _, _, s_xx, s_yy, s_xy = np.moveaxis(np.asarray(parameters, float), -1, 0)
    return (s_xx > 0) & (s_yy > 0) & (s_xx * s_yy > s_xy**2)


def semi_axes(parameters: ArrayLike) -> Array:
    """Give the larger and the smaller semi-axis, shape (..., 2)."""
    return principal_axes(parameters)[0]


def principal_axes(parameters: ArrayLike) -> tuple[Array, Array]:
    """Give the semi-axes, the larger first, and their directions as columns.

    Returns
    -------
    semi_axes : ndarray, shape (..., 2)
    directions : ndarray, shape (..., 2, 2)
    """
    square, directions = np.linalg.eigh(shape_matrix(parameters))
    return np.sqrt(square[..., ::-1]), directions[..., ::-1]


def line_conic(parameters: ArrayLike) -> Array:
    """Make the line conic: ``X' line_conic X = 0`` for every tangent line X (Eq 4.23).

    For the line ``X = (n, -d)`` it reads ``n' S n = (n . c - d)^2``.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``[[S - c c', -c], [-c', -1]]``, the inverse of `point_conic`.
    """
    p = np.asarray(parameters, float)
    centre = np.concatenate([p[..., :2], np.ones_like(p[..., :1])], axis=-1)
    matrix = -centre[..., :, None] * centre[..., None, :]
    matrix[..., :2, :2] += shape_matrix(p)
    return matrix


def point_conic(parameters: ArrayLike) -> Array:
    """Make the point conic: ``x' point_conic x = 0`` for every point x of the ellipse (Eq 4.22).

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Scaled so that it is negative inside: ``(p - c)' S^-1 (p - c) - 1``.
    """
    p = np.asarray(parameters, float)
    centre = p[..., :2]
    inverse = np.linalg.inv(shape_matrix(p))
    beside = -np.einsum("...ij,...j->...i", inverse, centre)
    matrix = np.empty((*p.shape[:-1], 3, 3))
    matrix[..., :2, :2] = inverse
    matrix[..., :2, 2] = matrix[..., 2, :2] = beside
    matrix[..., 2, 2] = -(beside * centre).sum(axis=-1) - 1.0
    return matrix


def from_line_conic(matrix: ArrayLike) -> Array:
    """Give the five numbers of a line conic of any scale; `is_ellipse` tells whether it is one.

    Parameters
    ----------
    matrix : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 5)
        Not finite for a parabola.
    """
    m = np.asarray(matrix, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        m = m / -m[..., 2, 2, None, None]
        x, y = -m[..., 0, 2], -m[..., 1, 2]
        square = m[..., 0, 0] + x**2, m[..., 1, 1] + y**2, m[..., 0, 1] + x * y
    return np.stack([x, y, *square], axis=-1)


def from_point_conic(matrix: ArrayLike) -> Array:
    """Give the five numbers of a point conic of any scale, by its adjugate (`from_line_conic`)."""
    rows = np.moveaxis(np.asarray(matrix, float), -2, 0)
    adjugate = [np.cross(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)]
    return from_line_conic(np.stack(adjugate, axis=-1))


def transformed(parameters: ArrayLike, homography: ArrayLike) -> Array:
    """Transform each ellipse by a homography, ``H line_conic H'``, shape (..., 5)."""
    h = np.asarray(homography, float)
    return from_line_conic(h @ line_conic(parameters) @ np.swapaxes(h, -1, -2))


def coefficients(parameters: ArrayLike) -> Array:
    """Give A, B, C, D, E of Eq 4.17 with F = 1, shape (..., 5).

    Large beyond bounds for an ellipse through the origin, which has F = 0.
    """
    conic = point_conic(parameters)
    return _terms(conic) / conic[..., 2, 2, None]


def coefficients_jacobian(parameters: ArrayLike) -> Array:
    """Differentiate `coefficients` by the five numbers, shape (..., 5, 5).

    The point conic is the inverse of the line conic, ``d point = -point (d line) point``.
    """
    p = np.asarray(parameters, float)
    centre = np.concatenate([p[..., :2], np.ones_like(p[..., :1])], axis=-1)
    shift = centre[..., None, :, None] * np.eye(3)[:2, None, :]
    line = np.empty((*p.shape, 3, 3))
    line[..., :2, :, :] = -shift - np.swapaxes(shift, -1, -2)
    line[..., 2:, :, :] = SHAPE_ENTRIES
    conic = point_conic(p)[..., None, :, :]
    change = -conic @ line @ conic
    scale = conic[..., 2, 2, None]
    by_row = _terms(change) - change[..., 2, 2, None] * coefficients(p)[..., None, :]
    return np.swapaxes(by_row / scale, -1, -2)


def _terms(matrix: Array) -> Array:
    """Take the coefficients of x^2, y^2, xy, x, y in ``(x, y, 1) matrix (x, y, 1)'`` (Eq 4.22)."""
    m = matrix
    terms = m[..., 0, 0], m[..., 1, 1], 2 * m[..., 0, 1], 2 * m[..., 0, 2], 2 * m[..., 1, 2]
    return np.stack(terms, axis=-1)


def boundary(parameters: ArrayLike, turn: ArrayLike) -> tuple[Array, Array]:
    """Give points of the ellipse and its outward unit normals there.

    Parameters
    ----------
    parameters : array_like, shape (..., 5)
    turn : array_like, shape (n,), rad
        Position along the ellipse: the angle at the centre once it is stretched to a circle.

    Returns
    -------
    points, normals : ndarray, shape (..., n, 2)
    """
    p = np.asarray(parameters, float)
    root = np.linalg.cholesky(shape_matrix(p))
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    points = p[..., None, :2] + circle @ np.swapaxes(root, -1, -2)
    normals = circle @ np.linalg.inv(root)
    return points, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def signed_distance(points: ArrayLike, parameters: ArrayLike) -> tuple[Array, Array]:
    """Measure orthogonal distances of points from an ellipse, with its outward normals there.

    In the principal frame the foot of (x, y) is ``a^2 x / (t + a^2), b^2 y / (t + b^2)`` with t the
    largest root of ``F(t) = (a x / (t + a^2))^2 + (b y / (t + b^2))^2 = 1``. ``1 / sqrt(F)``, a
    mean of two straight lines, rises there and is concave, so that Newton's method never ends
    beyond the root, wherever it comes from; of a circle one step finds it.

    Parameters
    ----------
    points : array_like, shape (..., n, 2)
    parameters : array_like, shape (..., 5)

    Returns
    -------
    distance : ndarray, shape (..., n)
        Positive outside.
    normal : ndarray, shape (..., n, 2)
    """
    p = np.asarray(parameters, float)
    axes, directions = principal_axes(p)
    local = (np.asarray(points, float) - p[..., None, :2]) @ directions
    # Both coordinates of all points together, (2, ..., n): of few points calls take most time.
    own, place = np.empty((2, *axes.shape[:-1], 1)), np.empty((2, *local.shape[:-1]))
    for k in range(2):
        own[k, ..., 0] = axes[..., k]
        np.abs(local[..., k], out=place[k])
    np.maximum(place, 1e-8 * own, out=place)  # on an axis the root may hide at a pole
    scaled, square = own * place, own**2
    least = scaled - square
    least = np.maximum(least[0], least[1])
    scaled *= scaled
    t = np.zeros_like(least)
    for _ in range(FOOT_ITERATIONS):
        by = 1.0 / (t + square)
        of = scaled * by * by
        total = of[0] + of[1]
        of *= by
        step = total * (np.sqrt(total) - 1.0) / (of[0] + of[1])
        t = np.maximum(t + step, least)
        if (np.abs(step) * by[1]).max(initial=0.0) <= FOOT_SETTLED:
            break
    gradient = place / (t + square)
    length = np.sqrt(gradient[0] * gradient[0] + gradient[1] * gradient[1])
    gradient /= length
    for k in range(2):
        np.copysign(gradient[k], local[..., k], out=local[..., k])
    return t * length, local @ directions.swapaxes(-1, -2)


def distance_jacobian(normal: ArrayLike, parameters: ArrayLike) -> Array:
    """Differentiate `signed_distance` by the five numbers, shape (..., n, 5).

    The distance is ``n . p - n . c - sqrt(n' S n)``, stationary in n, so that n may be held fixed.
    """
    n = np.asarray(normal, float)
    _, by_shape = half_width(n, shape_matrix(parameters)[..., None, :, :])
    return -np.concatenate([n, by_shape], axis=-1)


def curvature(normal: ArrayLike, parameters: ArrayLike) -> Array:
    """Give the curvature of the ellipse where its outward normal is n, ``(n' S n)^(3/2) / det S``.

    Parameters
    ----------
    normal : array_like, shape (..., n, 2)
    parameters : array_like, shape (..., 5)

    Returns
    -------
    ndarray, shape (..., n), one over the unit of the centre
    """
    shape = shape_matrix(parameters)
    width, _ = half_width(np.asarray(normal, float), shape[..., None, :, :])
    return width**3 / np.linalg.det(shape)[..., None]


def half_width(normal: Array, shape: Array) -> tuple[Array, Array]:
    """Give ``r = sqrt(n' S n)``, half the width across a unit normal n, and its derivative by S.

    Parameters
    ----------
    normal : ndarray, shape (..., 2)
    shape : ndarray, shape (..., 2, 2)

    Returns
    -------
    width : ndarray, shape (...)
    by_shape : ndarray, shape (..., 3)
        By s_xx, s_yy and s_xy.
    """
    width = np.sqrt(np.einsum("...i,...ij,...j->...", normal, shape, normal))
    x, y = normal[..., 0], normal[..., 1]
    return width, np.stack([x**2, y**2, 2 * x * y], axis=-1) / (2.0 * width[..., None])
