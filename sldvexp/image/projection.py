"""Projective maps between points of the calibration object and of the image, many at once."""

from __future__ import annotations

import numpy as np

from sldvexp.typing import Array


def fit_projection(points: Array, image: Array) -> tuple[Array, Array]:
    """Projective map that takes object points to image points, by the direct linear transformation.

    Of points in a plane it is a homography, of points in space a camera matrix. Both sides are
    moved to their mean and scaled to their spread first.

    Parameters
    ----------
    points : ndarray, shape (..., K, d), any unit
        In a plane (d = 2) or in space (d = 3).
    image : ndarray, shape (..., K, 2), steps

    Returns
    -------
    projection : ndarray, shape (..., 3, d + 1)
    residual : ndarray, shape (...), steps
        Root mean square distance of the points from their images; infinite where the map sends one
        of the points behind the image, or an image point is not a number.
    """
    d = points.shape[-1]
    known = np.nan_to_num(image)
    object_frame, image_frame = _frame(points), _frame(known)
    x = homogeneous(points) @ np.swapaxes(object_frame, -1, -2)
    u, v, _ = np.moveaxis(homogeneous(known) @ np.swapaxes(image_frame, -1, -2), -1, 0)
    x, u, v = np.broadcast_arrays(x, u[..., None], v[..., None])
    none = np.zeros_like(x)
    rows = [np.concatenate(r, axis=-1) for r in ((x, none, -u * x), (none, x, -v * x))]
    design = np.concatenate(rows, axis=-2)
    _, vectors = np.linalg.eigh(np.swapaxes(design, -1, -2) @ design)
    normalised = vectors[..., 0].reshape(*vectors.shape[:-2], 3, d + 1)
    projection = np.linalg.inv(image_frame) @ normalised @ object_frame
    return projection, _residual(projection, points, image)


def apply(projection: Array, points: Array) -> tuple[Array, Array]:
    """Images of points, shape (..., K, 2), and depths to a common factor, shape (..., K)."""
    mapped = homogeneous(points) @ np.swapaxes(projection, -1, -2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return mapped[..., :2] / mapped[..., 2:], mapped[..., 2]


def homogeneous(points: Array) -> Array:
    """Points with a one appended, shape (..., K, d + 1)."""
    return np.concatenate([points, np.ones_like(points[..., :1])], axis=-1)


def _frame(points: Array) -> Array:
    """Similarity that moves points to mean zero and mean square one, shape (..., d + 1, d + 1)."""
    mean = points.mean(axis=-2)
    scale = 1.0 / np.sqrt(((points - mean[..., None, :]) ** 2).sum(-1).mean(-1))
    d = points.shape[-1]
    frame = np.zeros((*points.shape[:-2], d + 1, d + 1))
    frame[..., range(d), range(d)] = scale[..., None]
    frame[..., :d, d] = -scale[..., None] * mean
    frame[..., d, d] = 1.0
    return frame


def _residual(projection: Array, points: Array, image: Array) -> Array:
    mapped, depth = apply(projection, points)
    square = ((mapped - image) ** 2).sum(axis=-1).mean(axis=-1)
    before = np.all(depth > 0, axis=-1) | np.all(depth < 0, axis=-1)
    return np.where(before & np.isfinite(square), np.sqrt(square), np.inf)
