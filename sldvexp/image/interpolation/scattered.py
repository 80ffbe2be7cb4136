"""Pixels anywhere: Delaunay's triangles between the usable ones, holes left open."""

from __future__ import annotations

import numpy as np

from sldvexp.errors import UserError
from sldvexp.image.interpolation.base import ImagePixels
from sldvexp.image.interpolation.mesh import ImageMesh, cross
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray

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
        return self._flagged_pixel[self._every_pixel.query(places)[1]]


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
