"""Interpolation inside surface elements from values and gradients at their corners.

Nodal values of a bending shape are right, what linear functions make of them between the nodes is
not: a wave of k loses (k h)^2 / 8. With the slopes at the corners the error is of fourth order:

* quadrilateral: cubic Hermite functions of both parent coordinates, the twist at a corner from the
  values and slopes of the four (Adini), which makes it the element ACM on a parallelogram,
* triangle: cubic Bezier functions with the middle point of quadratic precision (BCIZ).
"""

from __future__ import annotations

import numpy as np

from sldvexp.typing import Array, IntArray

#: Corners of the parent quadrilateral, and the corner across each of its two edges by axis.
PARENT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
#: Start and end of the edge through a corner along each parent axis.
EDGES = (((0, 1), (0, 1), (3, 2), (3, 2)), ((0, 3), (1, 2), (1, 2), (0, 3)))
#: Newton steps from a place to its parent coordinates.
STEPS = 12
#: Step after which they are good enough.
CLOSE = 1e-9


def in_quadrilateral(corners: Array, place: Array) -> Array:
    """Find parent coordinates of places in quadrilaterals, shape (place, 2).

    Parameters
    ----------
    corners : ndarray, shape (place, 4, 3), m
    place : ndarray, shape (place, 3), m

    Examples
    --------
    >>> square = 2 * np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
    >>> in_quadrilateral(square, np.array([[0.5, 1.0, 0.0]])).round(6).tolist()
    [[0.25, 0.5]]
    """
    parent = np.full((len(place), 2), 0.5)
    for _ in range(STEPS):
        x, y = parent.T
        shape = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=-1)
        off = place - np.einsum("pk,pkd->pd", shape, corners)
        along = np.stack(
            [
                np.einsum("pk,pkd->pd", np.stack([y - 1, 1 - y, y, -y], axis=-1), corners),
                np.einsum("pk,pkd->pd", np.stack([x - 1, -x, x, 1 - x], axis=-1), corners),
            ],
            axis=1,
        )
        gram = along @ along.swapaxes(1, 2)
        step = np.linalg.solve(gram, np.einsum("pad,pd->pa", along, off)[..., None])
        parent = np.clip(parent + step[..., 0], -0.5, 1.5)
        if not len(step) or np.abs(step).max() < CLOSE:
            break
    return parent


def of_quadrilateral(corners: Array, parent: Array, values: Array, gradients: Array) -> Array:
    """Interpolate in quadrilaterals, shape (place, component).

    Parameters
    ----------
    corners : ndarray, shape (place, 4, 3), m
    parent : ndarray, shape (place, 2)
    values : ndarray, shape (place, 4, component)
        At the corners.
    gradients : ndarray, shape (place, 4, 3, component), 1/m

    Examples
    --------
    >>> square = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
    >>> bent = square[..., :1] ** 3
    >>> slope = np.concatenate([3 * square[..., :1] ** 2, 0 * bent, 0 * bent], axis=2)[..., None]
    >>> of_quadrilateral(square, np.array([[0.5, 0.2]]), bent, slope).round(9).tolist()
    [[0.125]]
    """
    slope = []
    for ends in EDGES:
        edge = np.stack([corners[:, b] - corners[:, a] for a, b in ends], axis=1)
        slope.append(np.einsum("pkd,pkdc->pkc", edge, gradients))
    one, two = slope
    four = values[:, 0] - values[:, 1] + values[:, 2] - values[:, 3]
    found = np.zeros((len(parent), values.shape[2]))
    for k in range(4):
        (a, b), (c, d) = EDGES[0][k], EDGES[1][k]
        twist = two[:, b] - two[:, a] + one[:, d] - one[:, c] - four
        (v, s), (w, t) = (_hermite(parent[:, i], PARENT[k, i]) for i in (0, 1))
        found += (v * w)[:, None] * values[:, k] + (s * w)[:, None] * one[:, k]
        found += (v * t)[:, None] * two[:, k] + (s * t)[:, None] * twist
    return found


def _hermite(x: Array, end: float) -> tuple[Array, Array]:
    """Compute cubic functions of 0..1 whose value, or slope, is 1 at one end."""
    if end:
        return x**2 * (3 - 2 * x), x**2 * (x - 1)
    return (1 - x) ** 2 * (1 + 2 * x), x * (1 - x) ** 2


def of_triangle(corners: Array, shares: Array, values: Array, gradients: Array) -> Array:
    """Interpolate in triangles, shape (place, component).

    Parameters
    ----------
    corners : ndarray, shape (place, 3, 3), m
    shares : ndarray, shape (place, 3)
        Barycentric coordinates.
    values, gradients
        As of `of_quadrilateral`, at three corners.

    Examples
    --------
    >>> corner = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    >>> bent = corner[..., :1] ** 2
    >>> slope = np.concatenate([2 * corner[..., :1], 0 * bent, 0 * bent], axis=2)[..., None]
    >>> of_triangle(corner, np.array([[0.25, 0.5, 0.25]]), bent, slope).round(9).tolist()
    [[0.25]]
    """
    found = np.einsum("pk,pkc->pc", shares**3, values)
    edges = np.zeros_like(found)
    for i in range(3):
        for j in {0, 1, 2} - {i}:
            side = corners[:, j] - corners[:, i]
            point = values[:, i] + np.einsum("pd,pdc->pc", side, gradients[:, i]) / 3
            found += (3 * shares[:, i] ** 2 * shares[:, j])[:, None] * point
            edges += point
    middle = edges / 4 - values.sum(axis=1) / 6
    return np.asarray(found + (6 * shares.prod(axis=1))[:, None] * middle)


def halves_of(triangles: int, quadrilaterals: int) -> IntArray:
    """Give the elements that triangles and both halves of quadrilaterals belong to, from 0.

    Examples
    --------
    >>> halves_of(2, 1).tolist()
    [0, 1, 2, 2]
    """
    own = np.arange(triangles)
    return np.concatenate([own, triangles + np.repeat(np.arange(quadrilaterals), 2)])
