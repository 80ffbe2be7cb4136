"""Surface of a model that beams meet: where, and how it moves there along the beam.

A beam ``b + r w`` meets the first of the elements, moved along the normals of their nodes by the
height of the surface seen. Of many beams and elements only pairs are tried whose directions from
the instrument are near one another.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.models.elements import halves_of, in_quadrilateral, of_quadrilateral, of_triangle
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.typing import Array, BoolArray, IntArray

#: By how much a beam may miss an element, of its size: neighbours leave no gap between them.
EDGE = 1e-6


@dataclass(frozen=True, eq=False)
class Met:
    """Places where beams meet a surface.

    Parameters
    ----------
    half : ndarray of int, shape (beam,)
        Triangle or half of a quadrilateral; -1 where a beam meets none.
    place : ndarray, shape (beam, 3), m
        NaN where a beam meets none.
    shares : ndarray, shape (beam, 3)
        Barycentric coordinates.
    """

    half: IntArray
    place: Array
    shares: Array

    @property
    def meets(self) -> BoolArray:
        """True for the beams that meet it."""
        return np.asarray(self.half >= 0)


@dataclass(frozen=True, eq=False)
class SeenSurface:
    """One side of a model's elements.

    Parameters
    ----------
    model : FiniteElementModel
    height : float, m
        Of the surface above the elements, along their normals.
    """

    model: FiniteElementModel
    height: float

    @cached_property
    def position(self) -> Array:
        """Nodes of the surface, shape (node, 3), m."""
        return self.model.position + self.height * self.model.normal

    @cached_property
    def motion(self) -> Array:
        """Motion of the nodes, shape (node, 3, mode)."""
        return self.model.motion(self.height)

    @cached_property
    def gradient(self) -> Array:
        """Gradient of that motion along the surface, shape (node, 3, component, mode), 1/m.

        The sheet is thin against its radius: lengths at the height are those of the elements.
        """
        of_middle, of_normal = self.model.gradients
        return np.asarray(of_middle + self.height * of_normal)

    def near(self, begin: Array, way: Array) -> tuple[IntArray, IntArray]:
        """Pair beams with triangles that they, or beams a step away, may meet."""
        return _near(begin, way, self.position[self.model.halves])

    def meet(self, begin: Array, way: Array, pairs: tuple[IntArray, IntArray]) -> Met:
        """Follow beams from their starts, m, along unit vectors, shape (beam, 3) each.

        Parameters
        ----------
        pairs : pair of ndarray of int
            Beams and triangles that are tried; see `near`.
        """
        corners = self.position[self.model.halves]
        beam, half = pairs
        a, ab, ac = (corners[half, 0], *(corners[half, i] - corners[half, 0] for i in (1, 2)))
        across = np.cross(way[beam], ac)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / np.einsum("ij,ij->i", ab, across)
            away = begin[beam] - a
            u = inverse * np.einsum("ij,ij->i", away, across)
            turned = np.cross(away, ab)
            v = inverse * np.einsum("ij,ij->i", way[beam], turned)
            far = inverse * np.einsum("ij,ij->i", ac, turned)
        inside = (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1 + EDGE) & (far > 0)
        kept = np.flatnonzero(inside)
        kept = kept[np.lexsort((far[kept], beam[kept]))]
        first, index = np.unique(beam[kept], return_index=True)
        kept = kept[index]
        count = len(way)
        found = Met(np.full(count, -1), np.full((count, 3), np.nan), np.full((count, 3), np.nan))
        found.half[first] = half[kept]
        found.place[first] = begin[first] + far[kept, None] * way[first]
        found.shares[first] = np.stack([1 - u[kept] - v[kept], u[kept], v[kept]], axis=-1)
        return found

    def along(self, met: Met, way: Array) -> Array:
        """Compute the motion towards the instrument where beams meet it, shape (beam, mode).

        NaN where a beam meets nothing.
        """
        model = self.model
        element = halves_of(len(model.triangles), len(model.quadrilaterals))[met.half]
        modes = model.modes
        found = np.full((len(way), modes), np.nan)
        for nodes, start in ((model.triangles, 0), (model.quadrilaterals, len(model.triangles))):
            own = np.flatnonzero(
                met.meets & (element >= start) & (element < start + len(nodes)) & (len(nodes) > 0)
            )
            if not len(own):
                continue
            corner = nodes[element[own] - start]
            toward = -way[own]
            values = np.einsum("pkcm,pc->pkm", self.motion[corner], toward)
            gradients = np.einsum("pkdcm,pc->pkdm", self.gradient[corner], toward)
            place = self.position[corner]
            if corner.shape[1] == 3:
                found[own] = of_triangle(place, met.shares[own], values, gradients)
            else:
                parent = in_quadrilateral(place, met.place[own])
                found[own] = of_quadrilateral(place, parent, values, gradients)
        return found


def _near(begin: Array, way: Array, corners: Array) -> tuple[IntArray, IntArray]:
    """Pair beams with triangles that they may meet, by directions from the beams' middle start."""
    middle = begin.mean(axis=0)
    seen = corners - middle
    seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
    centre = seen.mean(axis=1)
    # Starts of beams differ by less than the mirrors are apart: seen from the triangles, an angle.
    far = np.linalg.norm(corners - middle, axis=-1)
    seen_from_middle = begin - middle + np.median(far) * way
    toward = seen_from_middle / np.linalg.norm(seen_from_middle, axis=1, keepdims=True)
    parallax = np.abs(np.median(far) / far - 1).max()
    apart = np.linalg.norm(begin - middle, axis=1).max() / far.min() * parallax
    radius = np.linalg.norm(seen - centre[:, None], axis=-1).max(axis=1) * 1.05 + apart + 1e-4
    lists = scipy.spatial.KDTree(toward).query_ball_point(centre, radius)
    count = np.array([len(own) for own in lists])
    half = np.repeat(np.arange(len(corners)), count)
    beam = np.concatenate([np.asarray(own, np.int64) for own in lists]) if len(half) else half
    return beam.astype(np.int64), half
