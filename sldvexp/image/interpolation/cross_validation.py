"""Cross-validation of an interpolation: pixels predicted from their neighbours, without themselves.

A lattice is thinned to every second row and column, in four ways; each predicts the pixels in the
middles of its cells. Scattered pixels are left out by turns and the others triangulated again. A
prediction is linear in the pixels, and so is what it misses beyond the noise: for a wave of wave
number k it misses ``(k h)^2 / 2`` (linear) or ``3 (k h)^4 / 8`` (cubic) of it along each direction
of a lattice of distance h, twice which the prediction has to span. Between all pixels the
interpolation itself changes the wave by ``-(k h)^2 / 12`` or ``-(k h)^4 / 80``, averaged over the
places between them: a sixth, or a thirtieth, of what the prediction misses. That mean is what
remains of its error in a field, whose elements average over many places.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sldvexp.errors import UserError
from sldvexp.image.interpolation.base import ImagePixels, Interpolator
from sldvexp.image.interpolation.mesh import ImageMesh, Lattice, cross, triangulate
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray

Make = Callable[[ImageMesh], Interpolator]

#: Turns in which scattered pixels are left out.
TURNS = 4


class Predictions(NamedTuple):
    """Pixels that others predict.

    Parameters
    ----------
    pixel : ndarray of int, shape (predicted,)
    weights : csr_array, shape (predicted, pixel)
        Of the others.
    """

    pixel: IndexArray
    weights: scipy.sparse.csr_array

    def missed(self, image: ImagePixels) -> tuple[Array, Array]:
        """Compute squares of what is missed, and their expectation from the noise alone.

        Both are sums over the frequencies, shape (predicted,), m2/s2.
        """
        velocity = np.where(image.usable[:, None], image.velocity, 0.0)
        error = self.weights @ velocity - velocity[self.pixel]
        frequencies = velocity.shape[1]
        variance = np.square(image.std).reshape(len(image.std), -1).mean(axis=1)
        variance = np.where(image.usable, variance, 0.0)
        noise = variance[self.pixel] + self.weights.power(2) @ variance
        return np.square(np.abs(error)).sum(axis=1), 2 * frequencies * noise


def predictions(image: ImagePixels, mesh: ImageMesh, make: Make) -> Predictions:
    """Predict the usable pixels of an image from others.

    Parameters
    ----------
    mesh : ImageMesh
        Of the image.
    make : callable
        From the cells between some pixels to their interpolation.

    Returns
    -------
    Predictions
        Empty where there are too few pixels.
    """
    count, found = len(image.dac), []
    for left_out, kept, thinned in _thinned(image, mesh):
        weights = make(thinned).at(image.dac[left_out])
        known = ~(weights.outside | weights.flagged)
        part = weights.value[np.flatnonzero(known)].tocoo()
        column = part.col if kept is None else kept[part.col]
        shape = (int(known.sum()), count)
        matrix = scipy.sparse.csr_array((part.data, (part.row, column)), shape=shape)
        found.append(Predictions(left_out[known], matrix))
    if not found:
        return Predictions(np.zeros(0, int), scipy.sparse.csr_array((0, count)))
    pixel = np.concatenate([p.pixel for p in found])
    return Predictions(pixel, scipy.sparse.vstack([p.weights for p in found], format="csr"))


def _thinned(
    image: ImagePixels, mesh: ImageMesh
) -> Iterator[tuple[IndexArray, IndexArray | None, ImageMesh]]:
    """Thin an image's cells: pixels left out, places of the others in the image, their cells."""
    if isinstance(mesh, Lattice):
        rows, columns = mesh.grid.shape[:2]
        number = np.arange(rows * columns).reshape(rows, columns)
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            kept, left_out = number[i::2, j::2], number[1 - i :: 2, 1 - j :: 2].ravel()
            if min(kept.shape) < 2:
                continue
            thinned = type(mesh)(mesh.grid[i::2, j::2], image.usable[kept].ravel())
            if _convex(thinned):
                yield left_out[image.usable[left_out]], kept.ravel(), thinned
    else:
        _, vertex = np.unique(image.dac[image.usable], axis=0, return_inverse=True)
        # In their order neighbours along a line take turns.
        turn = np.full(len(image.dac), -1)
        turn[image.usable] = vertex.ravel() % TURNS
        for k in range(TURNS):
            left_out = turn == k
            try:
                others = triangulate(_Thinned(image, image.usable & ~left_out))
            except (UserError, IndexError):  # too few are left
                continue
            yield np.flatnonzero(left_out), None, others


@dataclass(frozen=True)
class _Thinned:
    """Some pixels of an image, as if the others were flagged."""

    image: ImagePixels
    usable: BoolArray

    def __getattr__(self, name: str) -> Any:
        return getattr(self.image, name)


def _convex(mesh: Lattice) -> bool:
    corners = mesh.vertices[mesh.cells]
    edge = np.roll(corners, -1, axis=1) - corners
    return bool((cross(edge, np.roll(edge, -1, axis=1)) > 0).all())


#: Of a comparison of two interpolations: standard errors by which the better one must be better.
SURE = 3.0
#: Predictions share pixels, so that they are worth this part of as many independent ones.
INDEPENDENT = 0.25


#: Mean error of interpolation over the noise of a pixel, below which a better one is not sought:
#: even over a thousand pixels to an element the noise's mean is larger.
NEGLIGIBLE = 0.02


def is_negligible(images: Sequence[ImagePixels], each: Sequence[Predictions], part: float) -> bool:
    """Tell whether interpolation leaves out so little that the noise hides it anywhere.

    Parameters
    ----------
    part : float
        Of what predictions miss; see `mean_error`.
    """
    beyond = noise = 0.0
    for image, found in zip(images, each, strict=True):
        missed, expected = found.missed(image)
        own = np.square(image.std).reshape(len(image.std), -1).mean(axis=1)[found.pixel]
        beyond += float(np.sum(missed - expected))
        noise += 2 * image.velocity.shape[1] * float(own.sum())
    return part**2 * beyond <= NEGLIGIBLE**2 * noise


def is_better(
    images: Sequence[ImagePixels], each: Sequence[tuple[Predictions, Predictions]]
) -> bool:
    """Tell whether the second of two interpolations surely misses less beyond the noise.

    All images count together: samples join all views, and the test of one that has few pixels
    would be decided by its noise.
    """
    gained = []
    for image, pair in zip(images, each, strict=True):
        both = set(pair[0].pixel.tolist()) & set(pair[1].pixel.tolist())
        beyond = []
        for of in pair:
            missed, noise = of.missed(image)
            kept = np.isin(of.pixel, list(both))
            order = np.argsort(of.pixel[kept])
            beyond.append((missed - noise)[kept][order])
        gained.append(beyond[0] - beyond[1])
    gain = np.concatenate(gained)
    if len(gain) < 2:
        return False
    spread = gain.std(ddof=1) / np.sqrt(INDEPENDENT * len(gain))
    return bool(gain.mean() > SURE * spread)


def mean_error(image: ImagePixels, found: Predictions, part: float) -> scipy.sparse.csr_array:
    """Estimate by how much interpolation near each pixel is off on the average, as a matrix.

    Parameters
    ----------
    part : float
        Of what predictions miss.

    Returns
    -------
    csr_array, shape (pixel, pixel)
        From the pixels' velocities to estimated errors, interpolated minus true. A pixel that none
        predicts, as those of the rim, has the error of the nearest that is; rows of flagged pixels
        are empty, and all if no pixel is predicted.
    """
    count, predicted = len(image.dac), len(found.pixel)
    if not predicted:
        return scipy.sparse.csr_array((count, count))
    own = scipy.sparse.csr_array(
        (np.ones(predicted), (np.arange(predicted), found.pixel)), shape=(predicted, count)
    )
    nearest = scipy.spatial.KDTree(image.dac[found.pixel]).query(image.dac)[1]
    usable = np.flatnonzero(image.usable)
    pick = scipy.sparse.csr_array(
        (np.full(len(usable), part), (usable, nearest[usable])), shape=(count, predicted)
    )
    return scipy.sparse.csr_array(pick @ (found.weights - own))
