"""Contract of every interpolation: weights of the pixels, and why there may be none.

An interpolated value is a sum of weights times pixel values, ``v = W v_pixel``. From the sparse W
follow the value, its standard error and the correlation of samples that share pixels.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray


class ImagePixels(Protocol):
    """Pixels and their accuracy, as far as interpolation needs a velocity image.

    Pixels that are not usable have no say; in place of those that `dropped` out one by one stand
    the pixels around, on a lattice.
    """

    @property
    def name(self) -> str: ...
    @property
    def dac(self) -> Array: ...
    @property
    def velocity(self) -> ComplexArray: ...
    @property
    def std(self) -> Array: ...
    @property
    def usable(self) -> BoolArray: ...
    @property
    def dropped(self) -> BoolArray: ...
    @property
    def shape(self) -> tuple[int, int] | None: ...


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
    outside, flagged : ndarray of bool, shape (place,)
        Places that are in no cell, or in one with a flagged pixel.
    """

    place: IndexArray
    corner: NDArray[np.int32]
    weight: Array
    outside: BoolArray
    flagged: BoolArray

    def spread(self, rows: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
        """Give every place a row, empty where it was not found, from a row of each found one."""
        return spread(rows, self.place, len(self.outside))


def spread(matrix: scipy.sparse.csr_array, rows: IndexArray, count: int) -> scipy.sparse.csr_array:
    """Put the rows of a matrix into one with `count` rows, the others empty.

    Parameters
    ----------
    rows : ndarray of int, shape (row,)
        Where each goes, ascending.
    """
    if len(rows) == count:
        return matrix
    length = np.zeros(count + 1, matrix.indptr.dtype)
    length[rows + 1] = np.diff(matrix.indptr)
    start = np.cumsum(length, dtype=length.dtype)
    entries = matrix.data, matrix.indices, start
    return scipy.sparse.csr_array(entries, shape=(count, matrix.shape[1]))


def rows_of(
    column: IndexArray | NDArray[np.int32], weight: Array, columns: int
) -> scipy.sparse.csr_array:
    """Make a matrix with these weights, shape (row, n), in so many columns.

    It has the weights' own memory, whose rows a product with it may sort.
    """
    rows, each = column.shape
    start = np.arange(0, rows * each + 1, each, dtype=np.int32)
    index = column.ravel().astype(np.int32)
    return scipy.sparse.csr_array((weight.ravel(), index, start), shape=(rows, columns))


@dataclass(frozen=True, eq=False)
class PixelWeights:
    """Weights of the pixels at some places.

    Parameters
    ----------
    value : csr_array, shape (place, pixel)
        A row sums to one; it is empty where there is no value.
    located : Located
        Cells that the places are in, or why there is no value.
    """

    value: scipy.sparse.csr_array
    located: Located

    @property
    def outside(self) -> BoolArray:
        """Places in no cell, shape (place,)."""
        return self.located.outside

    @property
    def flagged(self) -> BoolArray:
        """Places in a cell with a flagged pixel, shape (place,)."""
        return self.located.flagged


class Interpolator(ABC):
    """Interpolates in one image."""

    @abstractmethod
    def at(self, dac: Array) -> PixelWeights:
        """Find weights at places of the image.

        Parameters
        ----------
        dac : ndarray, shape (place, 2), steps
        """

    @abstractmethod
    def slopes(self, at: Located, dac: Array, values: Array) -> Array:
        """Differentiate the interpolated image by both steps, at places that are found already.

        Parameters
        ----------
        at : Located
        dac : ndarray, shape (found, 2), steps
            Of those in a cell.
        values : ndarray, shape (pixel, column)

        Returns
        -------
        ndarray, shape (2, found, column), 1/step
            By the up_down and by the left_right step.
        """
