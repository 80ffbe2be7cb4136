"""Cells between the pixels of an image: which one holds a place, and its corners' weights."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from sldvexp.geometry import Bins
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray

#: In cell sizes: by how much a place may be beside a cell and count as on its edge. Rounding only.
ROUNDING = 1e-10


class Located(NamedTuple):
    """Places in the cells of a mesh.

    Parameters
    ----------
    place : ndarray of int, shape (found,)
        Those in a cell whose corners are all usable, in ascending order.
    corner : ndarray of int, shape (found, k)
        Vertices of the cell.
    weight : ndarray, shape (found, k)
        Of these vertices.
    gradient : ndarray, shape (found, k, 2), 1/step
        Derivative of `weight` by the place.
    outside, flagged : ndarray of bool, shape (place,)
        Places that are in no cell, or in one with a flagged pixel.
    """

    place: IndexArray
    corner: IndexArray
    weight: Array
    gradient: Array
    outside: BoolArray
    flagged: BoolArray

    def rows(self, column: IndexArray, weight: Array, columns: int) -> scipy.sparse.csr_array:
        """Make a matrix with these weights (found, n) in each found place's row."""
        length = np.zeros(len(self.outside) + 1, np.intp)
        length[self.place + 1] = column.shape[1]
        shape = len(self.outside), columns
        return scipy.sparse.csr_array(
            (weight.ravel(), column.ravel(), np.cumsum(length)), shape=shape
        )


class ImageMesh(ABC):
    """Convex cells between the vertices of an image.

    Parameters
    ----------
    vertices : ndarray, shape (vertex, 2), steps
    cells : ndarray of int, shape (cell, k)
        Corners of each cell, counterclockwise in the plane (up_down, left_right).
    usable : ndarray of bool, shape (vertex,)
        False at flagged pixels.
    merge : csr_array, shape (vertex, pixel), optional
        Velocities of the vertices from those of the pixels; without it these are the same.

    Attributes
    ----------
    biquadratic : bool
        Whether neighbours stand in rows and columns, so that they determine biquadratic patches.
    """

    biquadratic = False

    def __init__(
        self,
        vertices: Array,
        cells: IndexArray,
        usable: BoolArray,
        merge: scipy.sparse.csr_array | None = None,
    ) -> None:
        self.vertices = vertices
        self.cells = cells
        self.usable = usable
        self.merge = merge
        corners = vertices[cells]
        slack = ROUNDING * np.ptp(corners, axis=1)
        self._bins = Bins.from_boxes(corners.min(axis=1) - slack, corners.max(axis=1) + slack)

    @abstractmethod
    def shape_functions(self, corners: Array, places: Array) -> tuple[Array, Array]:
        """Compute weights of a cell's corners and their derivatives, exact for linear functions.

        Parameters
        ----------
        corners : ndarray, shape (place, k, 2), steps
        places : ndarray, shape (place, 2), steps

        Returns
        -------
        weight : ndarray, shape (place, k)
        gradient : ndarray, shape (place, k, 2), 1/step
        """

    @abstractmethod
    def neighbours(self) -> tuple[IndexArray, IndexArray]:
        """Pair each usable vertex with each usable one near it, in ascending order of the first."""

    @abstractmethod
    def frames(self) -> Array:
        """Scale the neighbours of each vertex to about one, shape (vertex, 2, 2)."""

    def locate(self, places: Array) -> Located:
        """Locate places, shape (place, 2), steps: cells, weights and gradients."""
        cell = self.find(places)
        inside = cell >= 0
        usable = np.asarray(self.usable[self.cells].all(axis=1))
        flagged = inside & ~usable[cell]
        flagged[~inside] = self.in_hole(places[~inside])
        place = np.flatnonzero(inside & ~flagged)
        corner = self.cells[cell[place]]
        weight, gradient = self.shape_functions(self.vertices[corner], places[place])
        return Located(place, corner, weight, gradient, ~inside & ~flagged, flagged)

    def find(self, places: Array) -> IndexArray:
        """Find the cell of each place, shape (place,), -1 where there is none."""
        place, cell = self._bins.pairs(places)
        corners = self.vertices[self.cells[cell]]
        edge = np.roll(corners, -1, axis=1) - corners
        aside = cross(edge, places[place][:, None] - corners)
        least = -ROUNDING * np.square(edge).sum(axis=-1).max(axis=1)
        inside = (aside >= least[:, None]).all(axis=1)
        found = np.full(len(places), -1)
        # The first of several cells on whose common edge a place is: written last.
        found[place[inside][::-1]] = cell[inside][::-1]
        return found

    def over_pixels(self, weights: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
        """Turn weights of the vertices into weights of the pixels, shape (place, pixel)."""
        return weights if self.merge is None else weights @ self.merge

    def in_hole(self, places: Array) -> BoolArray:
        """Find which of the places outside of all cells are in a hole that flags have made."""
        return np.zeros(len(places), bool)


def cross(a: Array, b: Array) -> Array:
    """Compute the third component of a x b, shape (...)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
