"""Second way through the samples: a region's nodes, with all samples that bear on them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array

from sldvexp.field.elements import Graph, Patch
from sldvexp.field.influence import influence
from sldvexp.field.looks import SAMPLES_AT_ONCE, Look, Looks
from sldvexp.field.model import FieldModel, Samples
from sldvexp.field.regions import Region, Surface

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Part:
    """A region with its samples.

    Attributes
    ----------
    looks : Looks
    model : FieldModel
    region : Region
    patch : Patch
        The region's triangles.
    look : Look
    at : Samples
    """

    looks: Looks
    model: FieldModel
    region: Region
    patch: Patch
    look: Look
    at: Samples

    @classmethod
    def of(cls, looks: Looks, model: FieldModel, region: Region) -> Part:
        """Look at the samples of a region."""
        patch = Patch.over(looks.prisms, looks.rule, region.triangles)
        look = looks.at(region.triangles)
        return cls(looks, model, region, patch, look, model.at(look))

    @cached_property
    def owned(self) -> NDArray[np.bool_]:
        """Samples that belong to this region and no other, shape (sample,)."""
        first = self.looks.prisms.triangles[self.region.triangles, 0]
        mine = np.isin(first, self.region.own)
        return np.broadcast_to(mine[None, :, None], self.patch.sample_shape).ravel()

    def influence(self, view: int) -> bsr_array:
        """The matrix R of one view's pixels."""
        return influence(self.patch, self.at.estimator[:, :, view], self.look.seen[view].weights)

    def velocities(self, data: list[Array]) -> Array:
        """Interpolated from the pixels' columns, shape (sample, view, column)."""
        each = zip(self.look.seen, data, strict=True)
        return np.stack([s.weights @ d for s, d in each], axis=1)

    def field(self, theta: Array) -> Array:
        """Parameters at the samples of nodal ones (layer, surface_node, parameter, column)."""
        nodal = theta[:, self.patch.nodes]
        layers, nodes, parameters, columns = nodal.shape
        flat = nodal.reshape(layers, nodes, parameters * columns)
        return self.patch.at_samples(flat).reshape(-1, parameters, columns)


def parts(
    looks: Looks, model: FieldModel, graph: Graph, rings: int, whole: bool
) -> Iterator[Part]:
    """Go through all regions, with so many rings of neighbours around each.

    Parameters
    ----------
    looks : Looks
    model : FieldModel
    graph : Graph
    rings : int
    whole : bool
        Make it one region, as is done anyway where there are few samples.
    """
    surface = Surface.of(looks.prisms, graph)
    each = looks.prisms.gaps * looks.rule.points
    nodes = looks.prisms.surface_nodes
    whole = whole or each * len(looks.prisms.triangles) <= SAMPLES_AT_ONCE
    largest = nodes if whole else max(1, SAMPLES_AT_ONCE // (2 * each))
    for region in surface.regions(largest, rings):
        yield Part.of(looks, model, region)
