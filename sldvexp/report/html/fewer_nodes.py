"""A surface of fewer nodes that looks the same: one node for all that lie in a cube.

Vertices are clustered (Rossignac and Borrel 1993): of each cube of a lattice the node nearest to
the middle of its nodes stays, with its own place and velocity, and a triangle stays whose corners
lie in three cubes. No number is made that was not there before, and what is lost can be told: how
far the velocity of each node is from that of the one that stands for it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sldvexp.typing import Array, IndexArray

#: By how much cubes grow until there are few enough.
GROWTH = 1.1


class FewerNodes(NamedTuple):
    """Nodes that stay.

    Parameters
    ----------
    kept : ndarray of int, shape (k,)
        Their indices, in order.
    stands_in : ndarray of int, shape (n,)
        For each node of before the index into `kept` of the one that stands for it.
    triangles : ndarray of int, shape (m, 3)
        Indices into `kept`, each once.
    """

    kept: IndexArray
    stands_in: IndexArray
    triangles: IndexArray


def fewer_nodes(position: Array, triangles: IndexArray, most: int) -> FewerNodes:
    """Choose nodes for all others; all of them if there are no more than wanted.

    Parameters
    ----------
    position : ndarray, shape (n, 3), m
    triangles : ndarray of int, shape (m, 3)
    most : int
        How many may stay.

    Examples
    --------
    >>> x, y = np.indices((4, 4)).reshape(2, -1)
    >>> few = fewer_nodes(np.stack([x, y, 0 * x], 1).astype(float), np.array([[0, 1, 4]]), 4)
    >>> len(few.kept), np.bincount(few.stands_in)
    (4, array([4, 4, 4, 4]))
    """
    count = len(position)
    if count <= most:
        return FewerNodes(np.arange(count), np.arange(count), np.asarray(triangles))
    extent = np.ptp(position, axis=0)
    cube = float(np.prod(np.sort(extent)[1:]) / most) ** 0.5 or float(extent.max()) / most
    while True:
        corner = np.floor((position - position.min(axis=0)) / cube).astype(np.int64)
        _, stands_in = np.unique(corner, axis=0, return_inverse=True)
        if stands_in.max() < most:
            break
        cube *= GROWTH
    members = np.bincount(stands_in)
    middle = np.stack([np.bincount(stands_in, x) / members for x in position.T], axis=1)
    off = np.linalg.norm(position - middle[stands_in], axis=1)
    order = np.lexsort((off, stands_in))
    nearest = order[np.concatenate([[0], np.cumsum(members)[:-1]])]
    rank = np.argsort(np.argsort(nearest))
    stands_in = rank[stands_in]
    return FewerNodes(np.sort(nearest), stands_in, _whole(stands_in[triangles]))


def _whole(triangles: IndexArray) -> IndexArray:
    """Keep triangles that have three corners, each once."""
    a, b, c = triangles.T
    whole = triangles[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(whole, axis=1), axis=0, return_index=True)
    kept: IndexArray = whole[np.sort(first)]
    return kept
