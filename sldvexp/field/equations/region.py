"""A surface in regions: nodes that belong to each, and the triangles around them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sldvexp.field.equations.elements import Graph
from sldvexp.lazy import scipy
from sldvexp.typing import Array, IndexArray
from sldvexp.volume.prisms import Prisms


@dataclass(frozen=True, eq=False)
class Region:
    """Some surface nodes with what is around them.

    Attributes
    ----------
    own : ndarray of int
        Nodes of the region, ascending; every node belongs to one.
    support : ndarray of int
        These and their neighbours, so many rings of them.
    triangles : ndarray of int
        All triangles that touch the support, ascending.
    """

    own: IndexArray
    support: IndexArray
    triangles: IndexArray


@dataclass(frozen=True, eq=False)
class Surface:
    """What is needed to walk over a surface.

    Parameters
    ----------
    prisms : Prisms
    neighbours : csr_array of bool, shape (surface_node, surface_node)
        Nodes that share a triangle, a node with itself as well.
    touching : csr_array of bool, shape (surface_node, triangle)
    """

    prisms: Prisms
    neighbours: scipy.sparse.csr_array
    touching: scipy.sparse.csr_array

    @classmethod
    def of(cls, prisms: Prisms, graph: Graph) -> Surface:
        """The surface of a volume."""
        nodes, count = prisms.surface_nodes, len(prisms.triangles)
        corner = prisms.triangles.ravel(), np.repeat(np.arange(count), 3)
        touching = scipy.sparse.csr_array((np.ones(3 * count, bool), corner), shape=(nodes, count))
        return cls(prisms, graph.neighbours, touching)

    def around(self, own: IndexArray, rings: int) -> Region:
        """The region of these nodes."""
        support = own
        for _ in range(rings):
            support = np.unique(self.neighbours[support].indices)
        return Region(own, support, np.unique(self.touching[support].indices).astype(np.intp))

    def of_own(self, own: IndexArray) -> Region:
        """The region of these nodes, with the triangles whose first corner is one of them."""
        first = np.isin(self.prisms.triangles[:, 0], own)
        return Region(own, own, np.flatnonzero(first))

    def parts(self, largest: int) -> Iterator[IndexArray]:
        """All nodes, in compact parts of so many or fewer."""
        position = self.prisms.position.reshape(self.prisms.layers, -1, 3)[0]
        for nodes in _halved(np.arange(len(position)), position, largest):
            yield np.sort(nodes)


def _halved(nodes: IndexArray, position: Array, largest: int) -> Iterator[IndexArray]:
    """Parts of the nodes, cut across their longest extent until each is small enough."""
    if len(nodes) <= largest:
        yield nodes
        return
    here = position[nodes]
    axis = np.ptp(here, axis=0).argmax()
    order = np.argsort(here[:, axis], kind="stable")
    half = len(nodes) // 2
    yield from _halved(nodes[order[:half]], position, largest)
    yield from _halved(nodes[order[half:]], position, largest)
