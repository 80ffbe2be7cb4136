"""Symmetric points inside triangles, and points on the line, from which sample rules are made."""

from __future__ import annotations

import math

import numpy as np

from sldvexp.typing import Array
from sldvexp.volume.samples import SampleRule

#: Generators of symmetric Gauss points of the triangle (Dunavant 1985; degrees 1, 2, 4, 5
#: and 6 are exact): the centroid, (a, a, 1 - 2a) with its 3 places, (a, b, 1 - a - b) with its 6.
_ROOT = math.sqrt(15.0)
_CENTROID = (1.0 / 3.0, 1.0 / 3.0)
TRIANGLE_POINTS: dict[int, tuple[tuple[float, float], ...]] = {
    1: (_CENTROID,),
    3: ((1.0 / 6.0, 1.0 / 6.0),),
    6: ((0.445948490915965,) * 2, (0.091576213509771,) * 2),
    7: (_CENTROID, ((6.0 - _ROOT) / 21.0,) * 2, ((6.0 + _ROOT) / 21.0,) * 2),
    12: (
        (0.249286745170910,) * 2,
        (0.063089014491502,) * 2,
        (0.310352451033785, 0.053145049844816),
    ),
}  # fmt: skip


def tensor_rule(triangle: int, line: int) -> SampleRule:
    """Gauss points of the triangle times Gauss points of the line.

    Parameters
    ----------
    triangle : int
        One of `TRIANGLE_POINTS`.
    line : int
        Through the thickness of each prism, 1 or more.
    """
    return SampleRule.tensor(triangle_points(triangle), np.polynomial.legendre.leggauss(line)[0])


def triangle_points(count: int) -> Array:
    """Barycentric coordinates of symmetric points inside a triangle, shape (count, 3)."""
    places: list[tuple[float, ...]] = []
    for a, b in TRIANGLE_POINTS[count]:
        places += _orbit(a, b, 1.0 - a - b)
    return np.array(places)


def _orbit(a: float, b: float, c: float) -> list[tuple[float, ...]]:
    """The different permutations of barycentric coordinates with a = b, or with none alike."""
    turned: list[tuple[float, ...]] = [(a, b, c), (c, a, b), (b, c, a)]
    if math.isclose(a, b):
        return turned[:1] if math.isclose(a, c) else turned
    return [*turned, *((p[1], p[0], p[2]) for p in turned)]
