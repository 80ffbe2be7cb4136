"""Scan lines in DAC steps: across a circle whose place is roughly known, and along an ellipse.

Pixels are whole steps, (up_down, left_right).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.typing import Array, IntArray


def across(centre: ArrayLike, lines: int, pixels: int, stride: ArrayLike = 1) -> IntArray:
    """Lay lines through a rough centre, turned evenly against one another.

    Parameters
    ----------
    centre : array_like, shape (2,), steps
    lines : int
        The dissertation's three give six edge points, one more than a conic needs.
    stride : int or array_like of int, shape (line,), steps
        From one pixel to the next along the mirror that moves faster; 1 scans contiguously.

    Returns
    -------
    ndarray of int, shape (line, pixel, 2)
    """
    along = np.arange(pixels) - pixels // 2
    paces = np.asarray(stride).reshape(-1, 1, 1) * directions(lines)[:, None]
    return _whole(np.asarray(centre, float) + along[:, None] * paces)


def directions(lines: int) -> Array:
    """Give the directions of `across`, one step of the faster mirror long, shape (line, 2).

    Examples
    --------
    >>> directions(2).round(3) + 0.0
    array([[0., 1.],
           [1., 0.]])
    """
    angle = np.pi * np.arange(lines) / lines
    direction = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    return np.asarray(direction / np.abs(direction).max(axis=-1, keepdims=True))


def half_chords(outline: ArrayLike, lines: int) -> Array:
    """Find how far an ellipse reaches from its middle along each line of `across`, shape (line,).

    Parameters
    ----------
    outline : array_like, shape (corner, 2), steps
        Points around the ellipse, even in its parameter: their covariance is half of ``A A'``, and
        ``x = t d`` is on the ellipse where ``t^2 d' (A A')^-1 d = 1``.

    Returns
    -------
    ndarray, steps of the mirror that moves faster

    Examples
    --------
    >>> turn = np.arange(8) * np.pi / 4
    >>> half_chords(np.stack([5 * np.sin(turn), 20 * np.cos(turn)], axis=-1), 2).round(6)
    array([20.,  5.])
    """
    corners = np.asarray(outline, float)
    shape = 2 * np.cov(corners.T, bias=True)
    along = directions(lines)
    return np.asarray(1 / np.sqrt(np.einsum("li,ij,lj->l", along, np.linalg.inv(shape), along)))


def along_ellipse(
    centre: ArrayLike, axes: ArrayLike, lines: int, pixels: int, stride: int = 1
) -> IntArray:
    """Lay short lines across an ellipse, normal to it, spaced evenly in its parameter.

    Parameters
    ----------
    centre : array_like, shape (2,), steps
    axes : array_like, shape (2, 2), steps
        Rows are the semi-axes as vectors, ``x(t) = centre + cos(t) axes[0] + sin(t) axes[1]``.
    lines : int
        The dissertation's 44.
    pixels : int
        The dissertation's 25; the ellipse crosses each line in its middle.
    stride : int, steps
        As in `across`.

    Returns
    -------
    ndarray of int, shape (line, pixel, 2)
        Every line runs from the inside outwards.
    """
    t = 2 * np.pi * (np.arange(lines) + 0.5) / lines
    a, b = np.asarray(axes, float)
    point = np.asarray(centre, float) + np.cos(t)[:, None] * a + np.sin(t)[:, None] * b
    tangent = -np.sin(t)[:, None] * a + np.cos(t)[:, None] * b
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)
    normal *= np.sign(np.sum(normal * (point - centre), axis=-1, keepdims=True))
    return laid(point, normal, pixels, stride)


def laid(point: ArrayLike, direction: ArrayLike, pixels: int, stride: int = 1) -> IntArray:
    """Lay lines through places along directions, the places in their middles.

    Parameters
    ----------
    point, direction : array_like, shape (line, 2), steps and unit vectors
    stride : int, steps
        As in `across`.

    Returns
    -------
    ndarray of int, shape (line, pixel, 2)
    """
    ahead = np.asarray(direction, float)
    ahead = ahead / np.abs(ahead).max(axis=-1, keepdims=True)
    offset = stride * (np.arange(pixels) - pixels // 2)
    return _whole(np.asarray(point, float)[:, None, :] + offset[:, None] * ahead[:, None, :])


def rectangle(corners: ArrayLike, rows: int, columns: int) -> IntArray:
    """Lay a grid over the box that holds four corners (Section 3.2.1).

    Parameters
    ----------
    corners : array_like, shape (4, 2), steps
    rows, columns : int
        Along up_down and along left_right.

    Returns
    -------
    ndarray of int, shape (row, column, 2)
        Fewer rows or columns than asked for where the box has fewer steps.
    """
    axes = []
    for low, high, count in zip(*_box(corners), (rows, columns), strict=True):
        places = np.linspace(low, high, count)
        axes.append(np.unique(np.rint(places).astype(np.int64)))
    return _grid(axes)


def strided(corners: ArrayLike, stride: int) -> IntArray:
    """Lay a grid of every so many steps over the box that holds four corners.

    Parameters
    ----------
    corners : array_like, shape (4, 2), steps
    stride : int, steps
        1 for every step, contiguous.

    Returns
    -------
    ndarray of int, shape (row, column, 2)
    """
    return _grid([np.arange(a, b + 1, stride) for a, b in zip(*_box(corners), strict=True)])


def box_corners(
    low: ArrayLike, high: ArrayLike, ways: ArrayLike, seen: ArrayLike | None = None
) -> IntArray:
    """Put the corners of a box of steps into the order of their numbers, everywhere alike.

    From the lower left one, as seen from the instrument, to the right and on around. Of a region
    of four corners they have that region's numbers, so that the k-th is where its k-th is seen.

    Parameters
    ----------
    low, high : array_like, shape (2,), whole steps
    ways : array_like, shape (2,)
        Signs of steps that go up and to the left (`sldvexp.laser.TwoMirror.ways`).
    seen : array_like, shape (n, 2), steps, optional
        Corners of the region that the box holds, in order around it.

    Returns
    -------
    ndarray of int, shape (4, 2), steps

    Examples
    --------
    >>> box_corners([-5, 2], [5, 9], ways=(1, 1)).tolist()
    [[-5, 9], [-5, 2], [5, 2], [5, 9]]
    >>> region = [[5, 9], [5, 2], [-4, 2], [-5, 8]]  # from the upper left one, clockwise
    >>> box_corners([-5, 2], [5, 9], (1, 1), region).tolist()
    [[5, 9], [5, 2], [-5, 2], [-5, 9]]
    """
    ends = np.stack([low, high]).astype(np.int64)
    upwards, leftwards = (np.asarray(ways) > 0).astype(int)
    bottom, top = ends[[1 - upwards, upwards], 0]
    right, left = ends[[1 - leftwards, leftwards], 1]
    around = np.array([[bottom, left], [bottom, right], [top, right], [top, left]])
    if seen is None or len(np.asarray(seen)) != len(around):
        return around
    size = np.maximum(ends[1] - ends[0], 1)
    numbered = [np.roll(order, k, axis=0) for order in (around, around[::-1]) for k in range(4)]
    beside = [float(np.sum(((order - np.asarray(seen)) / size) ** 2)) for order in numbered]
    return numbered[int(np.argmin(beside))]


def _box(corners: ArrayLike) -> tuple[IntArray, IntArray]:
    """Find smallest and largest up_down and left_right."""
    return np.min(corners, axis=0), np.max(corners, axis=0)


def _grid(axes: list[IntArray]) -> IntArray:
    """Combine each up_down with each left_right."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _whole(steps: Array) -> IntArray:
    """Round to the nearest whole steps."""
    return np.rint(steps).astype(np.int64)
