"""Bitangent points of circles on planes in space, with the spread that machine accuracy leaves."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.geometry.circles import bitangent_jacobian, bitangent_points
from sldvexp.typing import Array


def bitangents_in_space(a: ArrayLike, b: ArrayLike, origin: ArrayLike, axes: ArrayLike) -> Array:
    """Bitangent points of pairs of circles, each pair on a plane of its own.

    Parameters
    ----------
    a, b : array_like, shape (pair, 3)
        x, y and radius of each circle on its plane, one unit.
    origin : array_like, shape (pair, 3), the same unit
        Zero of the plane's own axes.
    axes : array_like, shape (pair, 3, 3)
        The plane's own x, y and normal as unit rows.

    Returns
    -------
    ndarray, shape (pair, line, circle, 3), the same unit
        Lines in the order of `sldvexp.geometry.circles.LINES`.
    """
    flat = bitangent_points(a, b)
    in_plane = np.asarray(axes, float)[:, None, None, :2, :]
    return np.asarray(origin, float)[:, None, None] + np.einsum("...i,...ij->...j", flat, in_plane)


def bitangents_std(a: ArrayLike, b: ArrayLike, axes: ArrayLike, std: float) -> Array:
    """Standard deviations of `bitangents_in_space`, to first order.

    Parameters
    ----------
    a, b : array_like, shape (pair, 3)
        x, y and radius of each circle on its plane, one unit.
    axes : array_like, shape (pair, 3, 3)
        The plane's own x, y and normal as unit rows.
    std : float, the same unit
        Of every center coordinate and diameter, and of the height above the plane; independent.

    Returns
    -------
    ndarray, shape (pair, line, circle, 3), the same unit
        Along the object's axes.
    """
    jacobian = bitangent_jacobian(a, b)
    circle_variance = std**2 * np.array([1.0, 1.0, 0.25, 1.0, 1.0, 0.25])  # radius: diameter / 2
    covariance = np.zeros((*jacobian.shape[:-2], 3, 3))
    covariance[..., :2, :2] = np.einsum("...ik,k,...jk->...ij", jacobian, circle_variance, jacobian)
    covariance[..., 2, 2] = std**2
    turned = np.asarray(axes, float)[:, None, None]
    return np.sqrt(np.einsum("...ki,...kl,...li->...i", turned, covariance, turned))
