"""Colours over a surface of triangles, pixel by pixel.

Maps of one surface beside each other differ in their values alone: which pixel is of which triangle
is found once for all of them, where matplotlib draws every triangle of every map.

Inside of a triangle a value is linear: v(x, y) = a + b x + c y, whose three numbers follow from the
values at its corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from matplotlib.collections import TriMesh
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from sldvexp.typing import Array, BoolArray, IntArray

#: Share of white over values below their bounds.
VEIL = 0.72
#: Of a pixel, by which a triangle's edge may miss the middle of one that is on it.
ON_EDGE = 1e-6
#: Square pixels of a triangle that has none, being thinner than `ON_EDGE` if it is long.
FLAT = 1e-4


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Pixels of a surface.

    Attributes
    ----------
    shape : tuple of int
        Rows and columns of the picture.
    triangle, number : ndarray of int, shape (pixel,)
        Of each pixel that has a triangle: which, and its place in the picture, row by row from the
        lowest.
    x, y : ndarray, shape (pixel,)
        Their middles, pixels.
    plane : ndarray, shape (triangle, 3, 3)
        Numbers a, b, c of a triangle by the values at its corners.
    """

    shape: tuple[int, int]
    triangle: IntArray
    number: IntArray
    x: Array
    y: Array
    plane: Array

    @classmethod
    def from_triangles(cls, place: Array, triangles: IntArray) -> _Pixels:
        """Find them row by row: between which of its edges a triangle has pixels there.

        Parameters
        ----------
        place : ndarray, shape (node, 2), pixels
            From the picture's lower left corner; the middle of its first pixel is at 0.5.
        triangles : ndarray of int, shape (triangle, 3)
        """
        width, height = np.maximum(np.ceil(place.max(axis=0)), 1).astype(int).tolist()
        corner = place[triangles]
        x, y = corner[..., 0], corner[..., 1]
        next_x, next_y = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
        last_x, last_y = np.roll(x, 1, axis=1), np.roll(y, 1, axis=1)
        to_x, to_y = next_x - x, next_y - y
        twice_area = to_x[:, 0] * to_y[:, 1] - to_x[:, 1] * to_y[:, 0]
        flat = np.abs(twice_area) < FLAT
        first = np.ceil(y.min(axis=1) - 0.5 - ON_EDGE).astype(int)
        last = np.minimum(np.floor(y.max(axis=1) - 0.5 + ON_EDGE).astype(int), height - 1)
        of, row = _counted(np.where(flat, 0, last - first + 1), first)
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = x[of] + (row[:, None] + 0.5 - y[of]) * to_x[of] / to_y[of]
        # counter-clockwise, an edge goes up at the triangle's right and down at its left
        up = to_y[of] * np.sign(twice_area[of])[:, None]
        left = np.where(up < 0, cut, 0.0).max(axis=1)
        right = np.where(up > 0, cut, float(width)).min(axis=1)
        begin = np.ceil(left - 0.5 - ON_EDGE).astype(int)
        end = np.minimum(np.floor(right - 0.5 + ON_EDGE).astype(int), width - 1)
        among, column = _counted(end - begin + 1, begin)
        by_corner = next_x * last_y - last_x * next_y, next_y - last_y, last_x - next_x
        plane = np.stack(by_corner, axis=1) / np.where(flat, 1.0, twice_area)[:, None, None]
        row = row[among]
        size = height, width
        x, y = 0.5 + column.astype(float), 0.5 + row.astype(float)
        return cls(size, of[among], row * width + column, x, y, plane)

    def values(self, corner: Array) -> Array:
        """Interpolate between corners.

        Parameters
        ----------
        corner : ndarray, shape (triangle, 3)

        Returns
        -------
        ndarray, shape (pixel,)
        """
        a, b, c = np.einsum("tij,tj->it", self.plane, corner)[:, self.triangle]
        return np.asarray(a + b * self.x + c * self.y)


def _counted(count: IntArray, first: IntArray) -> tuple[IntArray, IntArray]:
    """Count on from each first number so many times; whose turn it is, and the number."""
    count = np.maximum(count, 0)
    whose = np.repeat(np.arange(len(count)), count)
    return whose, np.arange(len(whose)) - (np.cumsum(count) - count - first)[whose]


#: Pixels of surfaces by where their nodes are, for as long as somebody has the surface.
_KNOWN: WeakKeyDictionary[Triangulation, dict[bytes, _Pixels]] = WeakKeyDictionary()


def _pixels(mesh: Triangulation, place: Array) -> _Pixels:
    """Find the pixels of a surface, or find them again."""
    known = _KNOWN.setdefault(mesh, {})
    name = place.round(3).tobytes()
    if name not in known:
        known[name] = _Pixels.from_triangles(place, mesh.triangles)
    return known[name]


class TriangleMap(TriMesh):
    """Values over a surface of triangles as colours; where none is shown, what is below is seen.

    Parameters
    ----------
    mesh : Triangulation
    corner : ndarray, shape (triangle, 3)
        Values at the corners of each triangle.
    shown : ndarray of bool, shape (triangle,)
    veiled : ndarray of bool, shape (triangle,)
        Which triangles are pale.
    **look
        As of a ``TriMesh``: ``array``, ``cmap`` and ``norm``.
    """

    def __init__(
        self, mesh: Triangulation, corner: Array, shown: BoolArray, veiled: BoolArray, **look: Any
    ) -> None:
        super().__init__(mesh, **look)
        self.corner, self.shown, self.veiled = corner, shown, veiled

    def draw(self, renderer: Any) -> None:
        """Draw one picture of all triangles."""
        if not self.get_visible():
            return
        mesh = self._triangulation  # type: ignore[attr-defined]
        place = self.get_transform().transform(np.column_stack([mesh.x, mesh.y]))
        low = place.min(axis=0)
        found = _pixels(mesh, renderer.get_image_magnification() * (place - low))
        gc = renderer.new_gc()
        self._set_gc_clip(gc)  # type: ignore[attr-defined]
        renderer.draw_image(gc, *low.tolist(), self._painted(found))
        gc.restore()
        self.stale = False

    def _painted(self, found: _Pixels) -> NDArray[np.uint8]:
        """Paint pixels red, green, blue and opaque, shape (row, column, 4)."""
        picture = np.zeros((*found.shape, 4), np.uint8)
        colours = np.asarray(self.to_rgba(found.values(self.corner), bytes=True))
        pale = np.flatnonzero(self.veiled[found.triangle])
        colours[pale, :3] = 255 * VEIL + (1 - VEIL) * colours[pale, :3]
        seen = self.shown[found.triangle]
        picture.reshape(-1, 4)[found.number[seen]] = colours[seen]
        return picture
