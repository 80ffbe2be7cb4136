"""Cells between the pixels of an image: which one holds a place, and its corners' weights.

Pixels in rows and columns make a `Lattice` of quadrilaterals, straight, uneven or oblique; pixels
anywhere else make Delaunay's `Triangles`, in which the holes that flags leave stay open.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.geometry import Bins
from sldvexp.image.interpolation.base import ImagePixels, Located, rows_of
from sldvexp.image.interpolation.standing_in import stand_ins
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray

#: Rows and columns that patches with neighbours on one side are fitted to.
WIDER = 5
#: In cell sizes: by how much a place may be beside a cell and count as on its edge. Rounding only.
ROUNDING = 1e-10
#: Places that stay in the cache, whatever is computed of them.
PLACES_AT_ONCE = 8192


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

    @cached_property
    def _bins(self) -> Bins:
        """Cells by where they are."""
        corners = self.vertices[self.cells]
        slack = ROUNDING * np.ptp(corners, axis=1)
        return Bins.from_boxes(corners.min(axis=1) - slack, corners.max(axis=1) + slack)

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

    def weights(self, corner: NDArray[np.int32], places: Array) -> Array:
        """Compute the weights of places' corners alone, shape (place, k); see `Located`."""
        return self.shape_functions(self.vertices[corner], places)[0]

    @abstractmethod
    def neighbours(self) -> tuple[IndexArray, IndexArray]:
        """Pair each usable vertex with each usable one near it, in ascending order of the first."""

    def beyond_one_side(self) -> tuple[IndexArray, IndexArray] | None:
        """Pair usable vertices that lack some neighbours with more around; None where untold."""
        return None

    @abstractmethod
    def frames(self) -> Array:
        """Scale the neighbours of each vertex to about one, shape (vertex, 2, 2)."""

    def locate(self, places: Array) -> Located:
        """Locate places, shape (place, 2), steps: cells and weights."""
        count, corners = len(places), self._corners
        outside, flagged = np.zeros((2, count), bool)
        # Of the kind of all weights' indices: they are kept as long as what is seen.
        corner = np.empty((count, corners.shape[1]), np.int32)
        weight = np.empty(corner.shape)
        place, last = np.empty(count, np.intp), 0
        for first in range(0, count, PLACES_AT_ONCE):
            some = slice(first, first + PLACES_AT_ONCE)
            here = places[some]
            cell = self.find(here)
            inside = cell >= 0
            good = inside & self._whole[cell]
            if not good.all():
                flagged[some] = inside & ~good
                flagged[first + np.flatnonzero(~inside)] = self.in_hole(here[~inside])
                outside[some] = ~inside & ~flagged[some]
                cell, here = cell[good], here[good]
            found = slice(last, last + len(cell))
            last = found.stop
            place[found] = first + np.flatnonzero(good)
            corner[found] = corners.take(cell, axis=0)
            weight[found] = self.weights(corner[found], here)
        if last < count:
            place, corner, weight = place[:last].copy(), corner[:last].copy(), weight[:last].copy()
        return Located(place, corner, weight, outside, flagged)

    @cached_property
    def _corners(self) -> NDArray[np.int32]:
        """Corners of the cells, of the kind of all weights' indices."""
        return np.asarray(self.cells, np.int32)

    @cached_property
    def _whole(self) -> BoolArray:
        """Cells whose corners are all usable, shape (cell,)."""
        return np.asarray(self.usable[self.cells].all(axis=1))

    def gradients(self, corner: NDArray[np.int32], places: Array) -> Array:
        """Differentiate the weights of located places' corners by the place, 1/step.

        It is quicker done again than kept.

        Parameters
        ----------
        corner : ndarray of int, shape (place, k)
            See `Located`.
        places : ndarray, shape (place, 2), steps

        Returns
        -------
        ndarray, shape (place, k, 2)
        """
        return self.shape_functions(self.vertices[corner], places)[1]

    def slopes(self, at: Located, places: Array, values: Array) -> Array:
        """Differentiate what the corners' weights interpolate by the place, at located ones.

        Parameters
        ----------
        places : ndarray, shape (found, 2), steps
        values : ndarray, shape (vertex, column)

        Returns
        -------
        ndarray, shape (2, found, column), 1/step
        """
        gradient, count = self.gradients(at.corner, places), len(self.vertices)
        return np.stack([rows_of(at.corner, gradient[..., a], count) @ values for a in range(2)])

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

    def of_vertices(self, pixels: Array) -> Array:
        """Turn values of the pixels into values of the vertices, shape (vertex, column)."""
        return pixels if self.merge is None else np.asarray(self.merge @ pixels)

    def in_hole(self, places: Array) -> BoolArray:
        """Find which of the places outside of all cells are in a hole that flags have made."""
        return np.zeros(len(places), bool)

    def touches(self, places: Array, pixels: BoolArray) -> BoolArray:
        """Find which places are in a cell that has one of some flagged pixels at a corner."""
        cell = self.find(places)
        return np.asarray((cell >= 0) & pixels[self.cells[cell]].any(axis=1))


def cross(a: Array, b: Array) -> Array:
    """Compute the third component of a x b, shape (...)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


class Lattice(ImageMesh):
    """Quadrilaterals between rows and columns; where pixels really are counts, rounding included.

    Parameters
    ----------
    grid : ndarray, shape (rows, columns, 2), steps
    usable : ndarray of bool, shape (rows * columns,)
    merge : csr_array, optional
        As of `ImageMesh`.
    """

    biquadratic = True

    def __init__(
        self, grid: Array, usable: BoolArray, merge: scipy.sparse.csr_array | None = None
    ) -> None:
        super().__init__(grid.reshape(-1, 2), corners_of_cells(grid), usable, merge)
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

    def weights(self, corner: NDArray[np.int32], places: Array) -> Array:
        """Compute the corners' bilinear weights, see `ImageMesh.weights`."""
        u, v = self.cell_coordinates(corner, places)
        return _weights(u, v)

    def cell_coordinates(self, corner: NDArray[np.int32], places: Array) -> tuple[Array, Array]:
        """Find places in their cells, 0 to 1 from the first corner to the second and the fourth."""
        return _cell_coordinates(self.vertices[corner], places)

    def slopes(self, at: Located, places: Array, values: Array) -> Array:
        """Differentiate, see `ImageMesh.slopes`, by the cell's own coordinates, values alone.

        Weights that were found before are in the order of a matrix's columns by now.
        """
        value = values.T.copy()
        found = np.empty((2, len(at.corner), values.shape[1]))
        for first in range(0, len(at.corner), PLACES_AT_ONCE):
            some = slice(first, first + PLACES_AT_ONCE)
            corner = at.corner[some]
            u, v = self.cell_coordinates(corner, places[some])
            by_own = _along(value, corner, u, v)
            for axis, by_place in enumerate(self._by_place(corner, u, v, *by_own)):
                found[axis, some] = by_place.T
        return found

    def _by_place(
        self, corner: NDArray[np.int32], u: Array, v: Array, by_u: Array, by_v: Array
    ) -> tuple[Array, Array]:
        """Turn derivatives by a cell's own coordinates, (column, place), into those by place."""
        (x_u, y_u), (x_v, y_v) = _along(self._axes, corner, u, v)
        area = x_u * y_v - y_u * x_v
        return (by_u * y_v - by_v * y_u) / area, (by_v * x_u - by_u * x_v) / area

    @cached_property
    def _axes(self) -> Array:
        """Coordinates of the vertices, shape (2, vertex)."""
        return self.vertices.T.copy()

    def neighbours(self) -> tuple[IndexArray, IndexArray]:
        """List the eight around each pixel.

        At the lattice's border of the 3 x 3 pixels next to it.
        """
        return self._around(np.arange(len(self.vertices)), 3)

    def beyond_one_side(self) -> tuple[IndexArray, IndexArray]:
        """Pair usable vertices that lack one of their eight neighbours with two rings around them.

        At the lattice's border with the 5 x 5 pixels next to it.
        """
        rows, columns = self.grid.shape[:2]
        whole = scipy.ndimage.binary_erosion(
            self.usable.reshape(rows, columns), np.ones((3, 3), bool)
        )
        number = np.flatnonzero(self.usable & ~whole.ravel())
        return self._around(number, WIDER)

    def _around(self, number: IndexArray, width: int) -> tuple[IndexArray, IndexArray]:
        """Pair some pixels with the usable ones of a block around each."""
        rows, columns = self.grid.shape[:2]
        row = _block(number // columns, rows, width)
        column = _block(number % columns, columns, width)
        near = (row[:, :, None] * columns + column[:, None, :]).reshape(len(number), -1)
        first, second = np.repeat(number, near.shape[1]), near.ravel()
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

    def cell_coordinates(self, corner: NDArray[np.int32], places: Array) -> tuple[Array, Array]:
        """Find places in their cells, see `Lattice.cell_coordinates`."""
        (x, y), (width, height) = self._sides(corner)
        return (places[:, 0] - x) / width, (places[:, 1] - y) / height

    def _sides(self, corner: NDArray[np.int32]) -> tuple[list[Array], list[Array]]:
        """Find the first corner of each cell, and how far the opposite one is along the axes."""
        first, opposite = corner[:, 0], corner[:, 2]
        begin = [axis.take(first) for axis in self._axes]
        ends = zip(self._axes, begin, strict=True)
        return begin, [axis.take(opposite) - start for axis, start in ends]

    def _by_place(
        self, corner: NDArray[np.int32], u: Array, v: Array, by_u: Array, by_v: Array
    ) -> tuple[Array, Array]:
        """Turn derivatives by a cell's own coordinates, see `Lattice._by_place`."""
        width, height = self._sides(corner)[1]
        return by_u / width, by_v / height

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
    kind = StraightLattice if straight else Lattice
    if not image.dropped.any():
        return kind(grid, image.usable)
    merge, usable = stand_ins(grid, image.usable, image.dropped)
    return kind(grid, usable, merge)


def corners_of_cells(grid: Array) -> IndexArray:
    """List pixels round each cell, counterclockwise, shape (cell, 4)."""
    rows, columns = grid.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    cells = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    diagonals = grid[-1, -1] - grid[0, 0], grid[0, -1] - grid[-1, 0]
    return cells if cross(*diagonals) > 0 else cells[:, ::-1]


def _weights(u: Array, v: Array) -> Array:
    """Weight the corners (0, 0), (1, 0), (1, 1), (0, 1), shape (place, corner)."""
    found = np.empty((len(u), 4))
    for k, (a, b) in enumerate(((1 - u, 1 - v), (u, 1 - v), (u, v), (1 - u, v))):
        np.multiply(a, b, out=found[:, k])
    return found


def _bilinear(u: Array, v: Array) -> tuple[Array, Array, Array]:
    """Weight the corners (0, 0), (1, 0), (1, 1), (0, 1), with derivatives by u and by v."""
    weight = _weights(u, v)
    by_u = np.stack([v - 1, 1 - v, v, -v], axis=-1)
    by_v = np.stack([u - 1, -u, u, 1 - u], axis=-1)
    return weight, by_u, by_v


def _along(values: Array, corner: NDArray[np.int32], u: Array, v: Array) -> tuple[Array, Array]:
    """Differentiate values of the vertices by u and by v, shape (column, place) each.

    Parameters
    ----------
    values : ndarray, shape (column, vertex)
    corner : ndarray of int, shape (place, 4)
    """
    a, b, c, d = (values.take(number, axis=1) for number in corner.T)
    return (b - a) + v * ((c - d) - (b - a)), (d - a) + u * ((c - b) - (d - a))


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
    if axis[-1] < axis[0]:
        axis, x = -axis, -x
    k = np.searchsorted(axis, x, side="right") - 1
    last = len(axis) - 1
    beside = (k < 0) | ((k == last) & (x > axis[-1]))
    return np.clip(k, 0, last - 1, out=k), beside


def _block(number: IndexArray, size: int, width: int) -> IndexArray:
    """List rows or columns around some, as many as there are: of `width` in the middle."""
    width = min(width, size)
    return np.clip(number - width // 2, 0, size - width)[:, None] + np.arange(width)


#: Triangles with a side this much longer than the median triangle's longest span a hole.
HOLE = 3.0
#: A triangle lower than this part of its longest side is none.
SLIVER = 1e-9
#: Pixels at one place may differ by this many standard errors; chance does in 1 of 10^7.
AGREE = 6.0


class Triangles(ImageMesh):
    """Triangles between usable pixels.

    Parameters
    ----------
    vertices : ndarray, shape (vertex, 2), steps
    cells : ndarray of int, shape (triangle, 3)
    merge : csr_array, shape (vertex, pixel)
    pixels : ndarray, shape (pixel, 2), steps
        All of them.
    flagged : ndarray of bool, shape (pixel,)
    """

    def __init__(
        self,
        vertices: Array,
        cells: IndexArray,
        merge: scipy.sparse.csr_array,
        pixels: Array,
        flagged: BoolArray,
    ) -> None:
        super().__init__(vertices, cells, np.ones(len(vertices), bool), merge)
        self._every_pixel = scipy.spatial.KDTree(pixels)
        self._flagged_pixel = flagged

    def shape_functions(self, corners: Array, places: Array) -> tuple[Array, Array]:
        """Compute barycentric coordinates, with derivatives."""
        opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        area = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        inward = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
        gradient = inward / area[:, None, None]
        aside = cross(opposite, places[:, None] - np.roll(corners, -1, axis=1))
        return aside / area[:, None], gradient

    def neighbours(self) -> tuple[IndexArray, IndexArray]:
        """List all that are two sides of triangles away or less."""
        sides = np.concatenate([self.cells, np.roll(self.cells, 1, axis=1)]).reshape(2, -1)
        first, second = np.concatenate([sides, sides[::-1]], axis=1)
        n = len(self.vertices)
        near = scipy.sparse.csr_array(
            (np.ones(len(first), np.int32), (first, second)), shape=(n, n)
        )
        near = (near + near @ near).tocsr()
        near.sort_indices()
        one, other = np.repeat(np.arange(n), np.diff(near.indptr)), near.indices.astype(np.intp)
        return one[one != other], other[one != other]

    def frames(self) -> Array:
        """Compute one over the distance of the neighbours (root mean square)."""
        first, second = self.neighbours()
        square = np.square(self.vertices[first] - self.vertices[second]).sum(axis=1)
        n = len(self.vertices)
        many = np.bincount(first, minlength=n)
        mean = np.bincount(first, square, n) / np.maximum(many, 1)
        return np.eye(2) / np.sqrt(np.where(many > 0, mean, 1.0))[:, None, None]

    def in_hole(self, places: Array) -> BoolArray:
        """Find which places are nearest to a flagged pixel."""
        return self.touches(places, self._flagged_pixel)

    def touches(self, places: Array, pixels: BoolArray) -> BoolArray:
        """Find which places are nearest to one of some flagged pixels, which have no cells."""
        return np.asarray(pixels[self._every_pixel.query(places)[1]])


def triangulate(image: ImagePixels) -> Triangles:
    """Triangulate an image; the triangles do not depend on the order of its pixels.

    Raises
    ------
    UserError
        If all usable pixels are on a line, or velocities at one place differ by more than their
        errors explain.
    """
    # Sorted first: Delaunay's triangles are not unique on a lattice.
    vertices, vertex = np.unique(image.dac[image.usable], axis=0, return_inverse=True)
    merge = _merge(image, vertex.ravel(), len(vertices))
    try:
        cells = scipy.spatial.Delaunay(vertices - vertices.mean(axis=0)).simplices.astype(np.intp)
    except (scipy.spatial.QhullError, ValueError):
        cells = np.empty((0, 3), np.intp)
    corners = vertices[cells]
    edge = np.roll(corners, -1, axis=1) - corners
    twice = cross(edge[:, 0], edge[:, 1])
    longest = np.sqrt(np.square(edge).sum(axis=-1).max(axis=1, initial=0.0))
    real = twice > SLIVER * longest**2
    if not real.any():
        raise UserError(
            f"view {image.name}: its {len(vertices)} usable pixels all lie on one line of DAC "
            "steps; nothing is known beside it"
        )
    kept = real & (longest <= HOLE * np.median(longest[real]))
    return Triangles(vertices, cells[kept], merge, image.dac, ~image.usable)


def _merge(image: ImagePixels, vertex: IndexArray, vertices: int) -> scipy.sparse.csr_array:
    """Average the usable pixels at each vertex, weighted by their accuracy."""
    pixel = np.flatnonzero(image.usable)
    _require_agreement(image, pixel, vertex, vertices)
    variance = np.square(image.std).reshape(len(image.std), -1).mean(axis=1)[pixel]
    exact = np.bincount(vertex, variance == 0, vertices)[vertex] > 0
    accuracy = np.where(exact, 1.0, 1.0 / np.where(exact, 1.0, variance))
    share = accuracy / np.bincount(vertex, accuracy, vertices)[vertex]
    return scipy.sparse.csr_array((share, (vertex, pixel)), shape=(vertices, len(image.dac)))


def _require_agreement(
    image: ImagePixels, pixel: IndexArray, vertex: IndexArray, vertices: int
) -> None:
    """Require that pixels at one place agree with the first of them within their errors."""
    if vertices == len(pixel):
        return
    first = np.full(vertices, -1)
    first[vertex[::-1]] = pixel[::-1]
    other = first[vertex]
    std = image.std.reshape(len(image.std), -1)
    gap = np.abs(image.velocity[pixel] - image.velocity[other])
    accepted = AGREE * np.hypot(std[pixel], std[other])
    rounding = 1e-12 * np.abs(image.velocity[pixel])
    wrong = np.flatnonzero((gap > accepted + rounding).any(axis=1))
    if len(wrong):
        k = wrong[0]
        place = ", ".join(f"{x:g}" for x in image.dac[pixel[k]])
        raise UserError(
            f"view {image.name}: pixels {other[k]} and {pixel[k]} both stand at the DAC steps "
            f"({place}), but their velocities differ by {gap[k].max():.3g} m/s, more than their "
            "standard errors explain; remove or flag one"
        )
