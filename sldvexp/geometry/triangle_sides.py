"""Sides of triangles, each an ascending pair of nodes: all of them, and those of the rim.

A side of a surface's rim belongs to one triangle, any other side to two.
"""

from __future__ import annotations

import numpy as np

from sldvexp.typing import IntArray


def sides(triangles: IntArray) -> IntArray:
    """Find the sides, each once, shape (side, 2).

    Examples
    --------
    >>> sides(np.array([[0, 1, 2], [1, 3, 2]])).tolist()
    [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]
    """
    return np.unique(_of_each(triangles), axis=0)


def rim(triangles: IntArray) -> IntArray:
    """Find the sides that only one triangle has, shape (side, 2).

    Examples
    --------
    >>> rim(np.array([[0, 1, 2], [1, 3, 2]])).tolist()
    [[0, 1], [0, 2], [1, 3], [2, 3]]
    """
    found, count = np.unique(_of_each(triangles), axis=0, return_counts=True)
    return np.asarray(found[count == 1])


def _of_each(triangles: IntArray) -> IntArray:
    """List the sides of each triangle, shape (3 triangles, 2)."""
    three = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.sort(three, axis=1)
