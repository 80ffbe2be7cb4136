"""Colours for the nodes of a graph, so that nodes of one colour are far apart."""

from __future__ import annotations

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import IndexArray


def within(neighbours: scipy.sparse.csr_array, rings: int) -> scipy.sparse.csr_array:
    """Nodes within so many rings of each, itself among them, sorted.

    Parameters
    ----------
    neighbours : csr_array of bool, shape (node, node)
        With every node its own neighbour.
    rings : int
    """
    reached, power = None, neighbours
    while rings:
        if rings % 2:
            reached = power if reached is None else (reached @ power).astype(bool)
        rings //= 2
        power = (power @ power).astype(bool) if rings else power
    assert reached is not None
    reached.sort_indices()
    return reached


def colours(near: scipy.sparse.csr_array) -> IndexArray:
    """A colour for every node that no node near it has, few of them in all.

    Parameters
    ----------
    near : csr_array of bool, shape (node, node)
    """
    found = np.full(near.shape[0], -1)
    for node, (first, last) in enumerate(zip(near.indptr[:-1], near.indptr[1:], strict=True)):
        taken = np.zeros(last - first + 2, bool)
        others = found[near.indices[first:last]]
        taken[others[others < len(taken)]] = True
        taken[-1] = False  # where -1 pointed to
        found[node] = np.argmin(taken)
    return found
