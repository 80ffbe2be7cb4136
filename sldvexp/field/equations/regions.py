"""Regions of a volume's samples: what views see of them, and what the method makes of it.

A surface is cut into regions of nodes, with the triangles around them, so that the samples of one
at a time are in memory. A small volume is one region and is kept. Disjoint regions serve sums over
samples; those that overlap have all samples that bear on their own nodes, as bounds need.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from sldvexp.field.equations.elements import Graph, Patch, influence
from sldvexp.field.equations.sample_model import FieldModel, SampleContributions
from sldvexp.field.visibility.visibility import SampleVisibility, VolumeVisibility
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray
from sldvexp.volume import Prisms


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
class SurfaceRegions:
    """Surface to walk over, region by region.

    Parameters
    ----------
    graph : Graph
        Of nodes that share a triangle.
    touching : csr_array of bool, shape (surface_node, triangle)
    """

    prisms: Prisms
    graph: Graph
    touching: scipy.sparse.csr_array

    @classmethod
    def from_prisms(cls, prisms: Prisms, graph: Graph) -> SurfaceRegions:
        """Prepare to walk over the surface of a volume."""
        nodes, count = prisms.surface_nodes, len(prisms.triangles)
        corner = prisms.triangles.ravel(), np.repeat(np.arange(count), 3)
        touching = scipy.sparse.csr_array((np.ones(3 * count, bool), corner), shape=(nodes, count))
        return cls(prisms, graph, touching)

    def around(self, own: IndexArray, rings: int) -> Region:
        """Find the region of these nodes."""
        support = self.graph.around(own, rings)
        return Region(own, support, np.unique(self.touching[support].indices).astype(np.intp))

    def of_own(self, own: IndexArray) -> Region:
        """Find the region of these nodes, with the triangles whose first corner is one of them."""
        first = np.isin(self.prisms.triangles[:, 0], own)
        return Region(own, own, np.flatnonzero(first))

    def parts(self, largest: int) -> Iterator[IndexArray]:
        """Go through all nodes, in compact parts of so many or fewer."""
        position = self.prisms.position.reshape(self.prisms.layers, -1, 3)[0]
        for nodes in _halved(np.arange(len(position)), position, largest):
            yield np.sort(nodes)


def _halved(nodes: IndexArray, position: Array, largest: int) -> Iterator[IndexArray]:
    """Cut nodes across their longest extent until each part is small enough."""
    if len(nodes) <= largest:
        yield nodes
        return
    here = position[nodes]
    axis = np.ptp(here, axis=0).argmax()
    order = np.argsort(here[:, axis], kind="stable")
    half = len(nodes) // 2
    yield from _halved(nodes[order[:half]], position, largest)
    yield from _halved(nodes[order[half:]], position, largest)


#: Samples up to which a volume is one part.
SAMPLES_IN_ALL = 200_000
#: Samples of each of several parts: with those around them they take some 3 kB each.
SAMPLES_AT_ONCE = 170_000


@dataclass(frozen=True, eq=False)
class RegionSamples:
    """A region with its samples.

    Attributes
    ----------
    patch : Patch
        The region's triangles.
    """

    visibility: VolumeVisibility
    model: FieldModel
    region: Region
    patch: Patch
    samples: SampleVisibility
    at: SampleContributions

    @classmethod
    def from_region(
        cls,
        visibility: VolumeVisibility,
        model: FieldModel,
        region: Region,
        *,
        determined: bool = False,
    ) -> RegionSamples:
        """Look at the samples of a region; for `determined` see `RowModel.at`."""
        patch = Patch.over(visibility.prisms, visibility.rule, region.triangles)
        samples = visibility.at(region.triangles)
        at = model.at(samples, determined=determined)
        return cls(visibility, model, region, patch, samples, at)

    def with_model(self, model: FieldModel, *, determined: bool = False) -> RegionSamples:
        """Return the same samples as they are in another model."""
        std = self.at.std if model.pixel_std is self.model.pixel_std else None
        at = model.at(self.samples, std, determined=determined)
        return replace(self, model=model, at=at)

    @cached_property
    def owned(self) -> BoolArray:
        """Samples that belong to this region and no other, shape (sample,)."""
        first = self.visibility.prisms.triangles[self.region.triangles, 0]
        mine = np.isin(first, self.region.own)
        return np.broadcast_to(mine[None, :, None], self.patch.sample_shape).ravel()

    @cached_property
    def influences(self) -> list[scipy.sparse.bsr_array]:
        """Matrices R of every view's pixels, ``b = sum_k R_k v_k``."""
        return [
            influence(self.patch, self.at.estimator[:, :, k], of_view.weights)
            for k, of_view in enumerate(self.samples.by_view)
        ]

    def velocities(self, data: list[Array]) -> Array:
        """Interpolate velocities from the pixels' columns, shape (sample, view, column)."""
        each = zip(self.samples.by_view, data, strict=True)
        return np.stack([s.weights @ d for s, d in each], axis=1)

    def velocities_last(self, data: list[Array], gap: int | None = None) -> Array:
        """Interpolate velocities at the samples, of one gap or all, (view, column, sample)."""
        gaps = self.patch.sample_shape[0]
        count = len(self.samples.position) // (1 if gap is None else gaps)
        here = slice(None) if gap is None else slice(gap * count, (gap + 1) * count)
        found = np.empty((len(data), data[0].shape[1], count))
        for k, (of_view, d) in enumerate(zip(self.samples.by_view, data, strict=True)):
            weights = of_view.weights if gap is None else _rows(of_view.weights, here)
            found[k] = (weights @ d).T
        return found

    def field_last(self, theta: Array, gap: int) -> Array:
        """Interpolate as `field` does in a gap, samples last: (parameter, column, sample)."""
        nodal = theta[gap : gap + 2, self.patch.nodes]
        values = self.patch.gap_at_samples(nodal.reshape(*nodal.shape[:2], -1))
        return values.reshape(*nodal.shape[2:], -1)

    def field(self, theta: Array) -> Array:
        """Interpolate parameters at the samples, (sample, parameter, column).

        Parameters
        ----------
        theta : ndarray, shape (layer, surface_node, parameter, column)
        """
        nodal = theta[:, self.patch.nodes]
        values = self.patch.at_samples(nodal.reshape(*nodal.shape[:2], -1))
        return values.reshape(-1, *nodal.shape[2:])


def _rows(matrix: scipy.sparse.csr_array, here: slice) -> scipy.sparse.csr_array:
    """Take some rows that follow one another, with the matrix's own memory."""
    start = matrix.indptr[here.start : here.stop + 1]
    entries = slice(start[0], start[-1])
    rows = matrix.data[entries], matrix.indices[entries], start - start[0]
    return scipy.sparse.csr_array(rows, shape=(len(start) - 1, matrix.shape[1]))


@dataclass(eq=False)
class RegionIterator:
    """A way through all samples; a volume of one part stays in memory.

    Attributes
    ----------
    determined : bool
        Whether the rows have been found to determine all parameters at every sample: what goes
        through them a second time need not look again.
    """

    visibility: VolumeVisibility
    model: FieldModel
    determined: bool = field(init=False, default=False)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the samples: another process finds them faster than they are sent."""
        return {"visibility": self.visibility, "model": self.model}

    @cached_property
    def graph(self) -> Graph:
        """Graph of surface nodes that share a triangle."""
        return Graph.from_prisms(self.visibility.prisms)

    @cached_property
    def surface(self) -> SurfaceRegions:
        """Surface to walk over."""
        return SurfaceRegions.from_prisms(self.visibility.prisms, self.graph)

    def with_model(self, model: FieldModel) -> RegionIterator:
        """Return the same way through samples of another model, which are looked at once for both.

        Samples are shared where they stay in memory.
        """
        other = RegionIterator(self.visibility, model)
        other.graph, other.surface = self.graph, self.surface
        if self._fits:
            other._whole = self._whole.with_model(model)
        return other

    def of_region(self, part: RegionSamples) -> RegionSamples:
        """Return the same region as another model's part."""
        if part.model is self.model:
            return part
        if self._fits:
            return self._whole
        return part.with_model(self.model, determined=self.determined)

    def disjoint(self) -> Iterator[RegionSamples]:
        """Go through all samples once."""
        if self._fits:
            yield self._whole
            return
        for own in self.own_nodes():
            yield self._look(self.surface.of_own(own))

    def overlapping(self, rings: int, whole: bool) -> Iterator[RegionSamples]:
        """Go through regions with all samples that bear on their own nodes.

        Parameters
        ----------
        rings : int
            Of neighbours around the own nodes whose samples belong to the part.
        whole : bool
            Make it one region, as is done anyway where there are few samples.
        """
        if whole or self._fits:
            yield self._whole
            return
        for own in self.own_nodes():
            yield self._look(self.surface.around(own, rings))

    def own_nodes(self) -> Iterator[IndexArray]:
        """Go through the surface nodes of the regions, every node once."""
        if self._fits:
            yield np.arange(self.visibility.prisms.surface_nodes)
        else:
            yield from self.surface.parts(self._largest)

    @cached_property
    def _whole(self) -> RegionSamples:
        return self._look(self.surface.around(np.arange(self.visibility.prisms.surface_nodes), 0))

    def _look(self, region: Region) -> RegionSamples:
        return RegionSamples.from_region(
            self.visibility, self.model, region, determined=self.determined
        )

    @property
    def _column(self) -> int:
        """Samples over a triangle."""
        return self.visibility.prisms.gaps * self.visibility.rule.points

    @property
    def _fits(self) -> bool:
        return self._column * len(self.visibility.prisms.triangles) <= SAMPLES_IN_ALL

    @property
    def _largest(self) -> int:
        """Nodes of a part; there are about half as many as triangles."""
        return max(1, SAMPLES_AT_ONCE // (2 * self._column))
