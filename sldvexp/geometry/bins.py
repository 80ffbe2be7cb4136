"""Search for the boxes of a plane that may hold a place: boxes sorted into the bins of a grid.

A bin lists every box that reaches into it, so that a place need be compared with the boxes of its
own bin only. With about four bins a box the lists are short, whatever the boxes' number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array, IndexArray

#: Most bins along one side of the grid.
MOST_BINS = 512


@dataclass(frozen=True, eq=False)
class Bins:
    """Boxes by the bins that they reach into.

    Parameters
    ----------
    low, size : ndarray, shape (2,)
        Corner of the grid and size of a bin.
    count : int
        Bins along each side.
    start : ndarray of int, shape (count * count + 1,)
        Where each bin's boxes begin in `member`.
    member : ndarray of int
        Boxes, bin by bin, in ascending order.
    """

    low: Array
    size: Array
    count: int
    start: IndexArray
    member: IndexArray

    @classmethod
    def from_boxes(cls, least: Array, most: Array) -> Bins:
        """Sort boxes, of which there is one at least.

        Parameters
        ----------
        least, most : ndarray, shape (box, 2)
            Their corners.

        Examples
        --------
        >>> low = np.array([[0.0, 0.0], [2.0, 0.0]])
        >>> place, box = Bins.from_boxes(low, low + 1.0).pairs(np.array([[2.5, 0.5]]))
        >>> box
        array([1])
        """
        low = least.min(axis=0)
        count = int(min(np.ceil(2 * np.sqrt(len(least))), MOST_BINS))
        size = np.maximum((most.max(axis=0) - low) / count, np.finfo(float).tiny)
        first, last = (_bin(corner, low, size, count) for corner in (least, most))
        rows, columns = (last - first + 1).T
        box = np.repeat(np.arange(len(least)), rows * columns)
        k = _runs(np.zeros(len(least), np.intp), rows * columns)
        cell = (first[box, 0] + k // columns[box]) * count + first[box, 1] + k % columns[box]
        order = np.argsort(cell, kind="stable")
        start = np.searchsorted(cell[order], np.arange(count * count + 1))
        return cls(low, size, count, start, box[order])

    def pairs(self, places: Array) -> tuple[IndexArray, IndexArray]:
        """Pair every place with each of the boxes that may hold it.

        Parameters
        ----------
        places : ndarray, shape (place, 2)

        Returns
        -------
        place, box : ndarray of int, shape (pair,)
            In ascending order of the places, and of the boxes of each.
        """
        row, column = _bin(places, self.low, self.size, self.count).T
        cell = row * self.count + column
        many = self.start[cell + 1] - self.start[cell]
        return np.repeat(np.arange(len(places)), many), self.member[_runs(self.start[cell], many)]


def _bin(place: Array, low: Array, size: Array, count: int) -> IndexArray:
    """Find row and column of each place's bin, shape (..., 2), or of the nearest one."""
    return np.clip((place - low) / size, 0, count - 1).astype(np.intp)


def _runs(start: IndexArray, length: IndexArray) -> IndexArray:
    """Count ``start, start + 1, ...`` of each length, in a row."""
    before = np.cumsum(length) - length
    return np.arange(length.sum()) + np.repeat(start - before, length)
