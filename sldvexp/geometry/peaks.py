"""Local maxima of values on a surface of triangles, and how far each stands out.

A maximum's prominence is how far one must go down from it on the way to a higher one: values are
gone through from the highest, nodes join the basin of the higher nodes that they touch, and where
two basins meet the one with the lower peak ends. Peaks that stand out by less than their values are
uncertain are ripples of the same one.
"""

from __future__ import annotations

import numpy as np

from sldvexp.geometry.triangle_sides import sides
from sldvexp.typing import Array, IntArray


def peaks(values: Array, triangles: IntArray, bound: Array, most: int) -> list[int]:
    """Find the highest local maxima that are above their bounds and stand out by them.

    Parameters
    ----------
    values, bound : ndarray, shape (node,)
    triangles : ndarray of int, shape (triangle, 3)
    most : int
        How many at most.

    Returns
    -------
    list of int
        Nodes, the highest first.

    Examples
    --------
    A strip with two maxima, and one that is a ripple:

    >>> import numpy as np
    >>> values = np.array([0, 3, 2, 2.1, 0, 2, 1.0])
    >>> strip = np.array([[i, i + 1, i + 1] for i in range(6)])
    >>> peaks(values, strip, np.full(7, 0.2), 5)
    [1, 5]
    """
    joined: list[list[int]] = [[] for _ in values]
    for a, b in sides(triangles).tolist():
        joined[a].append(b)
        joined[b].append(a)
    rank = np.empty(len(values), int)
    order = np.argsort(-values, kind="stable")
    rank[order] = np.arange(len(values))
    basin = np.full(len(values), -1)  # each node's way to the peak of its basin
    ends: dict[int, float] = {}

    def peak_of(node: int) -> int:
        while basin[node] != node:
            basin[node] = basin[basin[node]]
            node = int(basin[node])
        return node

    for node in order.tolist():
        touched = {peak_of(other) for other in joined[node] if basin[other] >= 0}
        highest = min(touched, key=lambda peak: rank[peak], default=node)
        basin[node] = highest
        ends.setdefault(highest, 0.0)
        for lower in touched - {highest}:
            basin[lower] = highest
            ends[lower] = float(values[node])
    clear = [p for p, end in ends.items() if values[p] - end > bound[p]]
    return sorted(clear, key=lambda peak: rank[peak])[:most]
