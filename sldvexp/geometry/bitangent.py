"""All four bitangents of two ellipses from their line conics, and how errors move them.

The common tangents of two conics are the lines that both line conics share (Section 4.5.2, Eqs 4.22
to 4.24). The first ellipse is made the unit circle; its tangents are ``n . p = 1`` with
``n = (cos t, sin t)``, and those which the other's line conic shares, ``(n . c - 1)^2 = n' S n``,
are the roots of a quartic in ``z = exp(i t)``. For four real tangents all roots lie on the unit
circle, where the leading coefficient is never small: no case needs an exception.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.geometry.circles import SIDES
from sldvexp.geometry.conic import (
    SHAPE_ENTRIES,
    Ellipse,
    distance_jacobian,
    half_width,
    semi_axes,
    shape_matrix,
)
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray

#: How far the modulus of a root may be from one. Ellipses that touch have a double root, which
#: rounding moves by the square root of its size.
REAL = 1e-6

#: Where each of `sldvexp.geometry.circles.LINES` stands in a mirror image: left and right swap.
MIRRORED = np.array([1, 0, 3, 2])


class BitangentPoints(NamedTuple):
    """Bitangent points of pairs of ellipses and their joint covariance.

    Parameters
    ----------
    points : ndarray, shape (pair, line, ellipse, 2)
        Lines in the order of `sldvexp.geometry.circles.LINES`.
    covariance : ndarray, shape (pair, line, ellipse, 2, pair, line, ellipse, 2)
        Of rank 5 per ellipse at most: points on one ellipse share its five numbers.
    """

    points: Array
    covariance: Array


def bitangents(
    ellipses: Sequence[Ellipse], pairs: Sequence[tuple[int, int]], names: Sequence[str]
) -> BitangentPoints:
    """Find the bitangent points of pairs of fitted ellipses.

    Parameters
    ----------
    ellipses : sequence of Ellipse
        Fitted independently of each other.
    pairs : sequence of (int, int)
        Indices of the ellipses of each ordered pair (a, b).
    names : sequence of str
        Names of the ellipses in messages.

    Raises
    ------
    UserError
        If the ellipses of a pair overlap or lie one inside the other.

    Examples
    --------
    >>> unit, none = [0.0, 0.0, 1.0, 1.0, 0.0], np.zeros((5, 5))
    >>> two = [Ellipse(np.array(unit), none), Ellipse(np.array([4.0, *unit[1:]]), none)]
    >>> bitangents(two, [(0, 1)], ["left", "right"]).points[0, 0].round(6)[1]
    array([4., 1.])
    """
    parameters = np.array([e.parameters for e in ellipses])
    first, second = np.array(pairs).T
    points = bitangent_points(parameters[first], parameters[second])
    for (i, j), touched in zip(pairs, points, strict=True):
        if np.isnan(touched).any():
            raise UserError(_not_apart(parameters[i], parameters[j], names[i], names[j]))
    by_pair = bitangent_jacobian(parameters[first], parameters[second], points)
    jacobian = np.zeros((*points.shape, len(ellipses), 5))
    for k, (i, j) in enumerate(pairs):
        jacobian[k, ..., i, :], jacobian[k, ..., j, :] = by_pair[k, ..., :5], by_pair[k, ..., 5:]
    spread = np.array([e.covariance for e in ellipses])
    covariance = np.einsum("plexij,ijk,qmfyik->plexqmfy", jacobian, spread, jacobian, optimize=True)
    return BitangentPoints(points, covariance)


def bitangent_points(a: ArrayLike, b: ArrayLike) -> Array:
    """Find where the four common tangents of two ellipses touch them.

    Parameters
    ----------
    a, b : array_like, shape (..., 5)
        Five numbers of each ellipse (`sldvexp.geometry.conic`), any unit.

    Returns
    -------
    ndarray, shape (..., line, ellipse, 2), the unit of the ellipses' centres
        Lines in the order of `sldvexp.geometry.circles.LINES`; left and right are those of a walker
        from a to b where the second coordinate points to the left of the first. NaN for a pair that
        has fewer than four: its ellipses overlap or lie one inside the other.
    """
    a, b = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float))
    root = np.linalg.cholesky(shape_matrix(a))
    inverse = np.linalg.inv(root)
    centre = np.einsum("...ij,...j->...i", inverse, b[..., :2] - a[..., :2])
    shape = inverse @ shape_matrix(b) @ np.swapaxes(inverse, -1, -2)
    z, real = _unit_roots(_quartic(centre, shape))
    normal = np.stack([z.real, z.imag], axis=-1)
    # Eq 4.24 for the line X = (n, -1): x = C^-1 X is n itself on the unit circle, and on the other
    beside = 1.0 - np.einsum("...li,...i->...l", normal, centre)
    contact = centre[..., None, :] + (normal @ shape) / beside[..., None]
    touched = np.stack([normal, contact], axis=-2)
    order, complete = _by_sides(touched, centre)
    touched = np.take_along_axis(touched, order[..., None, None], axis=-3)
    points = touched @ np.swapaxes(root, -1, -2)[..., None, :, :] + a[..., None, None, :2]
    return np.where((real & complete)[..., None, None, None], points, np.nan)


def bitangent_jacobian(a: ArrayLike, b: ArrayLike, points: ArrayLike) -> Array:
    """Differentiate `bitangent_points` by the ten numbers of the two ellipses.

    With the half-width ``r = sqrt(n' S n)`` a common tangent with normal n, to the left, has
    ``n . c_a + side_a r_a = n . c_b + side_b r_b``, as for circles. Differentiating it gives the
    angle by which the line turns; each point follows its centre, its shape and that turn.

    Parameters
    ----------
    a, b : array_like, shape (..., 5)
    points : array_like, shape (..., line, ellipse, 2)
        Of `bitangent_points`.

    Returns
    -------
    ndarray, shape (..., line, ellipse, 2, 10)
        Last dimension: the five numbers of a, then of b.
    """
    pair = np.stack(np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float)), axis=-2)
    points = np.asarray(points, float)
    way = points[..., 1, :] - points[..., 0, :]
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    ahead = way / length
    left = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
    outward = SIDES[:, :, None] * left[..., None, :]  # from each ellipse, (..., line, ellipse, 2)

    support = -np.stack(
        [distance_jacobian(outward[..., k, :], pair[..., k, :]) for k in (0, 1)], axis=-2
    )
    difference = np.array([[-1.0], [1.0]]) * SIDES[..., None] * support
    turn = difference.reshape(*difference.shape[:-2], 10) / length

    by_normal, by_shape = _contact_derivatives(outward, shape_matrix(pair)[..., None, :, :, :])
    by_turn = -SIDES[..., None] * np.einsum("...kij,...j->...ki", by_normal, ahead)
    jacobian = by_turn[..., None] * turn[..., None, None, :]
    for k in (0, 1):
        jacobian[..., k, :, 5 * k : 5 * k + 2] += np.eye(2)
        jacobian[..., k, :, 5 * k + 2 : 5 * k + 5] += by_shape[..., k, :, :]
    return jacobian


def _contact_derivatives(normal: Array, shape: Array) -> tuple[Array, Array]:
    """Differentiate ``S n / r``, the way from the centre to the point of contact, by n and by S."""
    width, width_by_shape = half_width(normal, shape)
    r = width[..., None, None]
    moment = np.einsum("...ij,...j->...i", shape, normal)[..., :, None]
    by_normal = shape / r - moment * np.swapaxes(moment, -1, -2) / r**3
    entries = np.moveaxis(np.einsum("kij,...j->k...i", SHAPE_ENTRIES[:, :2, :2], normal), 0, -1)
    by_shape = entries / r - moment * width_by_shape[..., None, :] / r**2
    return by_normal, by_shape


def _quartic(centre: Array, shape: Array) -> ComplexArray:
    """Give the coefficients of z^4 to z^0 in ``z^2 ((n . c - 1)^2 - n' S n)``, shape (..., 5)."""
    c = centre[..., 0] + 1j * centre[..., 1]
    s_xx, s_yy, s_xy = shape[..., 0, 0], shape[..., 1, 1], shape[..., 0, 1]
    leading = (c**2 / 4 - ((s_xx - s_yy) / 2 + 1j * s_xy) / 2).conj()
    middle = np.abs(c) ** 2 / 2 + 1.0 - (s_xx + s_yy) / 2
    return np.stack([leading, -c.conj(), middle + 0j, -c, leading.conj()], axis=-1)


def _unit_roots(
    quartic: ComplexArray,
) -> tuple[ComplexArray, BoolArray]:
    """Find the roots by the companion matrix, brought to modulus one, and whether all had it.

    Four roots of modulus one leave no coefficient above the binomial's multiple of the first.
    """
    size = np.abs(quartic[..., :3])
    most = (1.0 + REAL) * np.array([4.0, 6.0]) * size[..., :1]
    possible = (size[..., 0] > 0) & np.all(size[..., 1:] <= most, axis=-1)
    leading = np.where(possible, quartic[..., 0], 1.0 + size.max(axis=-1))
    companion = np.zeros((*quartic.shape[:-1], 4, 4), complex)
    companion[..., 0, :] = -quartic[..., 1:] / leading[..., None]
    companion[..., (1, 2, 3), (0, 1, 2)] = 1.0
    root = np.linalg.eigvals(companion)
    modulus = np.abs(root)
    real = possible & np.all(np.abs(modulus - 1.0) < REAL, axis=-1)
    unit = np.asarray(root / np.where(modulus > 0, modulus, 1.0), np.complex128)
    return unit, real


def _by_sides(touched: Array, centre: Array) -> tuple[IndexArray, BoolArray]:
    """Order the lines by the sides they touch, and tell whether each of the four is there once.

    A line touches an ellipse on its left if the ellipse is on the right of the way along the line
    from the first to the second; no homography that keeps orientation changes that.
    """
    way = touched[..., 1, :] - touched[..., 0, :]
    inward = np.stack([np.zeros_like(centre), centre], axis=-2)[..., None, :, :] - touched
    cross = way[..., None, 0] * inward[..., 1] - way[..., None, 1] * inward[..., 0]
    side = -np.sign(cross)
    line = np.argmax((side[..., None, :] == SIDES).all(axis=-1), axis=-1)
    order = np.argsort(line, axis=-1)
    complete = np.take_along_axis(line, order, axis=-1) == np.arange(4)
    return order, complete.all(axis=-1)


def _not_apart(a: Array, b: Array, name_a: str, name_b: str) -> str:
    """Say what is wrong with a pair that has fewer than four bitangents."""
    distance = np.linalg.norm(b[:2] - a[:2])
    sizes = " and ".join("{:.4g} x {:.4g}".format(*semi_axes(p)) for p in (a, b))
    return (
        f"the ellipses of {name_a} and {name_b} overlap or lie one inside the other: their centres "
        f"are {distance:.4g} steps apart with semi-axes of {sizes} steps; four bitangents need "
        f"ellipses that stand apart, so look whether both are edges of the same circle"
    )
