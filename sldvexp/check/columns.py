"""Columns of nodes through the layers of a volume, and where they cross a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, IndexArray


@dataclass(frozen=True, eq=False)
class Columns:
    """Where the columns of nodes cross a surface.

    Attributes
    ----------
    layers : int
    inside : ndarray of int, shape (column,)
        Surface nodes whose column crosses it.
    below : ndarray of int, shape (column,)
        Layer below the crossing.
    share : ndarray, shape (column,)
        Of the layer above it.
    """

    layers: int
    inside: IndexArray
    below: IndexArray
    share: Array

    @classmethod
    def of(cls, volume: xr.Dataset, height: Array) -> Columns:
        """Columns that cross height 0.

        Parameters
        ----------
        volume : xarray.Dataset
            The group ``volume``.
        height : ndarray, shape (node,), m
            Of every node above the surface; NaN where it has none below or above.

        Raises
        ------
        UserError
            If no column crosses it.
        """
        layers = volume.sizes["layer"]
        by_layer = height.reshape(layers, -1)
        crossing = (by_layer[:-1] <= 0) & (by_layer[1:] >= 0)
        inside = np.flatnonzero(crossing.any(axis=0))
        if not len(inside):
            raise UserError(
                f"the surface lies outside of the volume: its layers are {np.nanmin(height):.3g} "
                f"to {np.nanmax(height):.3g} m above it; move the volume with volume.offset"
            )
        below = crossing[:, inside].argmax(axis=0)
        low, high = by_layer[below, inside], by_layer[below + 1, inside]
        share = np.divide(-low, high - low, out=np.zeros(len(inside)), where=high > low)
        return cls(layers, inside, below, share)

    def at_surface(self, nodal: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Nodal values (node, ...) on the surface, shape (column, ...)."""
        by_layer = nodal.reshape(self.layers, -1, *nodal.shape[1:])
        share = self.share.reshape(-1, *[1] * (nodal.ndim - 1))
        low, high = by_layer[self.below, self.inside], by_layer[self.below + 1, self.inside]
        return np.asarray((1 - share) * low + share * high)
