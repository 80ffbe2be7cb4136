"""Lattices: rows and columns of pixels on whole DAC steps, even or not, straight or oblique."""

from __future__ import annotations

import numpy as np

from sldvexp.image.interpolation.base import ImagePixels
from sldvexp.image.interpolation.mesh import ImageMesh, cross
from sldvexp.typing import Array, BoolArray, IndexArray


class Lattice(ImageMesh):
    """Quadrilaterals between rows and columns; where pixels really are counts, rounding included.

    Parameters
    ----------
    grid : ndarray, shape (rows, columns, 2), steps
    usable : ndarray of bool, shape (rows * columns,)
    """

    biquadratic = True

    def __init__(self, grid: Array, usable: BoolArray) -> None:
        super().__init__(grid.reshape(-1, 2), corners_of_cells(grid), usable)
        self.grid = grid

    def shape_functions(self, corners: Array, places: Array) -> tuple[Array, Array]:
        """Compute the corners' bilinear weights in a cell's own coordinates, with derivatives."""
        u, v = _cell_coordinates(corners, places)
        weight, by_u, by_v = _bilinear(u, v)
        along_u, along_v = (np.einsum("nk,nki->ni", by, corners) for by in (by_u, by_v))
        area = cross(along_u, along_v)
        # Rows of the inverse of d(place)/d(u, v).
        du = np.stack([along_v[:, 1], -along_v[:, 0]], axis=-1) / area[:, None]
        dv = np.stack([-along_u[:, 1], along_u[:, 0]], axis=-1) / area[:, None]
        return weight, by_u[..., None] * du[:, None] + by_v[..., None] * dv[:, None]

    def neighbours(self) -> tuple[IndexArray, IndexArray]:
        """List the eight around each pixel.

        At the lattice's border of the 3 x 3 pixels next to it.
        """
        rows, columns = self.grid.shape[:2]
        number = np.arange(rows * columns)
        row, column = _block(number // columns, rows), _block(number % columns, columns)
        near = (row[:, :, None] * columns + column[:, None, :]).reshape(len(number), -1)
        first = np.repeat(number, near.shape[1])
        second = near.ravel()
        kept = (first != second) & self.usable[first] & self.usable[second]
        return first[kept], second[kept]

    def frames(self) -> Array:
        """Compute inverses of the mean steps from row to row and from column to column."""
        steps = np.stack([np.gradient(self.grid, axis=a) for a in (0, 1)], axis=-1)
        return np.linalg.inv(steps.reshape(-1, 2, 2))


class StraightLattice(Lattice):
    """Rows of one up_down step each and columns of one left_right step each."""

    def find(self, places: Array) -> IndexArray:
        """Find the cell of each place, by bisection."""
        rows, columns = self.grid[:, 0, 0], self.grid[0, :, 1]
        (row, above), (column, beside) = (
            _interval(axis, x) for axis, x in ((rows, places[:, 0]), (columns, places[:, 1]))
        )
        return np.where(above | beside, -1, row * (len(columns) - 1) + column)

    def shape_functions(self, corners: Array, places: Array) -> tuple[Array, Array]:
        """Compute the corners' bilinear weights in a cell's own coordinates, with derivatives."""
        side = corners[:, 2] - corners[:, 0]
        weight, *by_own = _bilinear(*((places - corners[:, 0]) / side).T)
        return weight, np.stack(by_own, axis=-1) / side[:, None]


def lattice_of(image: ImagePixels) -> Lattice | None:
    """Find the lattice of an image.

    None if it is not rectangular or has a cell that is not convex.
    """
    if image.shape is None or min(image.shape) < 2:
        return None
    grid = np.asarray(image.dac, float).reshape(*image.shape, 2)
    corners = grid.reshape(-1, 2)[corners_of_cells(grid)]
    edge = np.roll(corners, -1, axis=1) - corners
    if (cross(edge, np.roll(edge, -1, axis=1)) <= 0).any():
        return None
    straight = np.ptp(grid[..., 0], axis=1).max() == 0 and np.ptp(grid[..., 1], axis=0).max() == 0
    return (StraightLattice if straight else Lattice)(grid, image.usable)


def corners_of_cells(grid: Array) -> IndexArray:
    """List pixels round each cell, counterclockwise, shape (cell, 4)."""
    rows, columns = grid.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    cells = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    diagonals = grid[-1, -1] - grid[0, 0], grid[0, -1] - grid[-1, 0]
    return cells if cross(*diagonals) > 0 else cells[:, ::-1]


def _bilinear(u: Array, v: Array) -> tuple[Array, Array, Array]:
    """Weight the corners (0, 0), (1, 0), (1, 1), (0, 1), with derivatives by u and by v."""
    weight = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=-1)
    by_u = np.stack([v - 1, 1 - v, v, -v], axis=-1)
    by_v = np.stack([u - 1, -u, u, 1 - u], axis=-1)
    return weight, by_u, by_v


def _cell_coordinates(corners: Array, places: Array) -> tuple[Array, Array]:
    """Solve ``q = u a + v b + u v c`` for places in convex cells, q from the first corner.

    Multiplied by a + v c it is quadratic in v; the root whose cell is not folded is taken, in the
    form that holds for a parallelogram (c = 0) as well.
    """
    p = np.moveaxis(corners, 1, 0)
    q, a, b, c = places - p[0], p[1] - p[0], p[3] - p[0], p[0] - p[1] + p[2] - p[3]
    constant, slope, bend = cross(q, a), cross(q, c) + cross(a, b), -cross(b, c)
    root = np.sqrt(np.maximum(slope**2 - 4 * bend * constant, 0.0))
    v = -2 * constant / (slope + root)
    side = a + v[:, None] * c
    u = np.sum((q - v[:, None] * b) * side, axis=1) / np.square(side).sum(axis=1)
    return u, v


def _interval(axis: Array, x: Array) -> tuple[IndexArray, BoolArray]:
    """Find the interval of a monotonic axis that holds each x, and whether none does."""
    way = np.sign(axis[-1] - axis[0])
    k = np.searchsorted(way * axis, way * x, side="right") - 1
    beside = (way * x < way * axis[0]) | (way * x > way * axis[-1])
    return np.clip(k, 0, len(axis) - 2), beside


def _block(number: IndexArray, size: int) -> IndexArray:
    """Acquire counts and status of at most BLOCK pixels."""
    width = min(3, size)
    return np.clip(number - 1, 0, size - width)[:, None] + np.arange(width)
