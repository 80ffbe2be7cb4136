"""Size of the spot over a circle, and where a spot of that size sees the circle's edges.

A spot whose light has the covariance C (DAC steps squared) sees of an ellipse the part of its light
that falls inside (`sldvexp.geometry.blurred_disc`). Across a straight edge with the normal n that
is the profile of `sldvexp.image.edge_profile` with ``width^2 = n' C n``, over the squared cosine
between scan line and normal. At a curved edge it is another one. Of a round spot of width w the
light at x along the normal and y along an edge of curvature k is cut where ``x + k y^2 / 2`` is,
and that sum of a normal and a chi-square variable has the cumulants

    mean k w^2 / 2,    variance w^2 (1 + (k w)^2 / 2),    third (k w)^3 w^3:

the edge is seen inside of where it is, and wider, and the profile of a straight one is fitted
between mean and median. For small k w all that remains is ``k w^2 / 2``, which with the width as
seen says 7 % too much at k w = 0.3 and half too much at 1. An ellipse's tip bends faster than its
parabola besides, and a line of pixels ends where the profile still changes. `seen_edges` therefore
computes the profile on the line's length and fits it as measured ones are; the spot's covariance
follows from the widths of all edges of a circle, each over the ratio of what is seen there to what
would be at a straight edge. Over a circle the spot is taken as the same everywhere.
"""

from __future__ import annotations

import numpy as np

from sldvexp.geometry import conic
from sldvexp.geometry.blurred_disc import part_of_disc
from sldvexp.image.edge_profile import fit_places
from sldvexp.statistics import NORMAL_MEDIAN
from sldvexp.typing import Array

#: Pixels of a computed profile, and nodes of its light: exact to 1e-5 of it at 70 degrees.
PIXELS, NODES = 17, 32
#: How far from an edge pixels can matter, and how far they are taken to be where nobody knows, in
#: widths of a straight edge.
FARTHEST, USUAL = 5.0, 3.0
#: How far from its place an edge is seen at most, in widths, and by what factor wider; where k w is
#: 2 it is half of one and 1.7.
MOST_ASIDE, WIDENED = 1.0, 2.0
#: By how much a beam is out of round, relative: standard deviation of what pinhole coordinates
#: and a mirror offset make of a round one.
ROUND = 0.2
#: Bound of a spot's variances over the mean one.
SLENDER = 3.0
#: Widths farther than this many robust standard deviations from the spot's do not count.
REJECT = 4.0
#: Widths below this part of the usual one are no better known than it.
NARROW = 0.1
#: Smallest cosine between a scan line and an edge's normal for which the line crosses the edge.
GRAZING = 0.1
#: Least relative scatter of squared widths.
SCATTER = 1e-6


def seen_edges(
    parameters: Array,
    covariance: Array,
    place: Array,
    direction: Array,
    reach: Array | None = None,
) -> tuple[Array, Array]:
    """Find where a spot sees edges of an ellipse along scan lines, and how wide.

    Parameters
    ----------
    parameters : ndarray, shape (5,)
        Of the ellipse.
    covariance : ndarray, shape (2, 2)
        Of the spot's light; positive definite.
    place : ndarray, shape (n, 2)
        On the ellipse, where scan lines cross it.
    direction : ndarray, shape (n, 2)
        Unit vectors of the scan lines.
    reach : ndarray, shape (n, 2), optional
        How far the pixels that place the edge go, back from its place and on; NaN if it is not
        known. Of a profile that is not quite one of a straight edge those that are farther pull the
        edge elsewhere.

    Returns
    -------
    offset, widening : ndarray, shape (n,)
        Of the seen edge from its place, along the line; width over that at a straight edge.
    """
    root = np.linalg.cholesky(conic.shape_matrix(parameters))
    to_disc = np.linalg.inv(root)
    light = to_disc @ covariance @ to_disc.T
    _, normal = conic.signed_distance(place, parameters)
    across = np.sqrt(np.einsum("ni,ij,nj->n", normal, covariance, normal))
    width = across / np.maximum(np.abs((normal * direction).sum(axis=-1)), GRAZING)

    far = np.full((len(width), 2), np.nan) if reach is None else reach / width[:, None]
    far = np.clip(np.where(np.isfinite(far), far, USUAL), 1.0, FARTHEST)
    back, on = (far * width[:, None]).T
    along = np.linspace(-back, on, PIXELS, axis=-1)
    points = place[:, None] + along[..., None] * direction[:, None]
    seen = part_of_disc((points - parameters[:2]) @ to_disc.T, light, NODES)
    start = np.stack([np.zeros_like(width), np.log(width), seen[:, 0], seen[:, -1]], axis=-1)
    pitch = along[:, 1] - along[:, 0]
    edge, wide = fit_places(along, seen, start, pitch)
    # Of a line that hardly crosses the ellipse no profile tells where.
    offset = np.clip(edge, -MOST_ASIDE * width, MOST_ASIDE * width)
    return offset, np.clip(wide / width, 1.0 / WIDENED, WIDENED)


def spot_of_widths(width: Array, std: Array, normal: Array) -> Array:
    """Fit ``width^2 = n' C n`` to the widths of straight edges with normals n.

    Few edges do not tell how far from round a spot is; it is held at round by `ROUND`.

    Parameters
    ----------
    width : ndarray, shape (n,), steps
        Across the edge; zero, or nearly, where a line does not resolve it.
    std : ndarray, shape (n,), steps
        In proportion to the widths' standard errors.
    normal : ndarray, shape (n, 2)

    Returns
    -------
    ndarray, shape (2, 2), steps^2
        Covariance of the spot's light.
    """
    usual = float(np.median(width**2))
    square = width**2 / usual
    x, y = normal.T
    rows = np.stack([x**2, y**2, 2.0 * x * y], axis=-1)
    error = std * np.maximum(width, NARROW * np.sqrt(usual))
    weight = np.median(error) / error
    prior = np.array([[1.0, -1.0, 0.0], [0.0, 0.0, 2.0]]) / ROUND
    numbers, counts, scatter = np.array([1.0, 1.0, 0.0]), np.ones(len(width), bool), 1.0
    for _ in range(5):
        size = np.abs(weight * (square - rows @ numbers))
        scatter = max(float(np.median(size)) / NORMAL_MEDIAN, SCATTER)
        counts = size <= REJECT * scatter
        scaled = weight[counts, None] / scatter
        design = np.concatenate([scaled * rows[counts], prior])
        told = np.concatenate([scaled[:, 0] * square[counts], np.zeros(2)])
        numbers = np.linalg.lstsq(design, told, rcond=None)[0]
    length, axes = np.linalg.eigh(numbers[[[0, 2], [2, 1]]])
    length = np.clip(length, 1.0 / SLENDER, SLENDER)
    spot: Array = usual * (axes * length) @ axes.T
    return spot
