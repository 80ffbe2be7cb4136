"""Ways to interpolate, by the names a configuration uses.

The mesh of an image: a lattice if it is one, else triangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from weakref import WeakKeyDictionary

import numpy as np

from sldvexp.errors import UserError
from sldvexp.image.interpolation.base import (
    ImagePixels,
    Interpolator,
    Located,
    PixelWeights,
    rows_of,
)
from sldvexp.image.interpolation.cross_validation import (
    Predictions,
    is_better,
    is_negligible,
    mean_error,
    predictions,
)
from sldvexp.image.interpolation.cubic import CubicInterpolator
from sldvexp.image.interpolation.mesh import ImageMesh, Lattice, lattice_of, triangulate
from sldvexp.lazy import scipy
from sldvexp.typing import Array


class Interpolation(Enum):
    """Between the pixels around a place; whether the image is a lattice decides how they are found.

    Attributes
    ----------
    auto
        Cubic if that surely predicts pixels better from their neighbours than linear does, which
        shares the pixels' noise among more of them; see `cross_validation`.
    linear
        Bilinear in the cells of a lattice, linear in the triangles of scattered pixels. Errs by
        the square of the pixels' distance.
    cubic
        Parabolic patches through each pixel and its neighbours, blended linearly: on an even
        lattice the Catmull-Rom (Keys) cubic. Errs by the cube of the pixels' distance.
    """

    auto = "auto"
    linear = "linear"
    cubic = "cubic"

    def prepare(self, image: ImagePixels) -> Interpolator:
        """Prepare one image for interpolation at any number of places.

        Parameters
        ----------
        image : ImagePixels
            For example a `sldvexp.field.visibility.view.View`.

        Raises
        ------
        UserError
            If the image has fewer than three usable pixels, all on a line, or differing
            velocities at one place.
        """
        return self.chosen([image])._make(mesh_of(image))

    def chosen(self, images: Sequence[ImagePixels]) -> Interpolation:
        """Choose linear or cubic for all images together, by cross-validation if it is auto.

        Examples
        --------
        >>> Interpolation.cubic.chosen([])
        <Interpolation.cubic: 'cubic'>
        """
        if self is not Interpolation.auto:
            return self
        meshes = [mesh_of(image) for image in images]
        both = list(zip(images, meshes, strict=True))
        linear = [_predicted(i, m, LinearInterpolator) for i, m in both]
        if is_negligible(images, linear, PART_ON_A_LATTICE["linear"]):
            return Interpolation.linear
        cubic = [_predicted(i, m, CubicInterpolator) for i, m in both]
        pairs = list(zip(linear, cubic, strict=True))
        return Interpolation.cubic if is_better(images, pairs) else Interpolation.linear

    def mean_error(self, image: ImagePixels) -> scipy.sparse.csr_array:
        """Estimate by how much interpolation near each pixel is off, as a matrix of the pixels.

        See `sldvexp.image.interpolation.cross_validation.mean_error`.
        """
        method, mesh = self.chosen([image]), mesh_of(image)
        parts = PART_ON_A_LATTICE if isinstance(mesh, Lattice) else PART_OF_SCATTERED
        found = mean_error(image, _predicted(image, mesh, method._make), parts[method.name])
        wider = mesh.beyond_one_side() if method is Interpolation.cubic else None
        if wider is None:
            return found
        more = np.ones(len(image.dac))
        more[np.unique(wider[0])] = OF_ONE_SIDE
        return scipy.sparse.csr_array(scipy.sparse.diags_array(more) @ found)

    @property
    def _make(self) -> type[LinearInterpolator | CubicInterpolator]:
        return CubicInterpolator if self is Interpolation.cubic else LinearInterpolator


#: Bytes of an image's predictions up to which they are remembered: cubic ones of 130,000 pixels.
CACHE_BYTES = 2**24
#: Predictions of images that are still there, by the interpolation: its choice and its error are
#: told by the same.
_known: WeakKeyDictionary[ImagePixels, dict[type, Predictions]] = WeakKeyDictionary()


def _predicted(
    image: ImagePixels, mesh: ImageMesh, make: type[LinearInterpolator | CubicInterpolator]
) -> Predictions:
    """Predict an image's pixels from others, or recall it."""
    try:
        known = _known.setdefault(image, {})
    except TypeError:  # it can be changed, and so has no hash
        known = {}
    found = known[make] if make in known else predictions(image, mesh, make)
    if found.weights.data.nbytes <= CACHE_BYTES:
        known[make] = found
    return found


#: What is left of the misses of predictions, on the average between pixels: of waves on a lattice.
PART_ON_A_LATTICE = {"linear": 1 / 6, "cubic": 1 / 30}
#: How much larger it is at pixels without neighbours on one side, found by trial: 1.3 to 1.9 times
#: of waves in images of 17 to 31 pixels, even and oblique, at their borders and beside holes.
OF_ONE_SIDE = 2.0
#: In triangles: of a parabola, the mean over both halves of a square against its corner without
#: itself; and what triangles with parabolas leave of the third power, found by trial.
PART_OF_SCATTERED = {"linear": 1 / 3, "cubic": 1 / 6}
#: Pixels that make a triangle.
LEAST_PIXELS = 3


def mesh_of(image: ImagePixels) -> ImageMesh:
    """Make the cells of an image.

    A rectangular image whose cells are not convex, because rounding to whole steps has folded them
    or lines were taken to and fro, is triangulated like scattered pixels.

    Raises
    ------
    UserError
        See `Interpolation.prepare`.
    """
    usable, pixels = int(np.count_nonzero(image.usable)), len(image.dac)
    if pixels and not usable:
        raise UserError(
            f"view {image.name}: all {pixels} pixels are flagged; scan it again or leave it out"
        )
    if usable < LEAST_PIXELS:
        raise UserError(
            f"view {image.name}: {usable} of {pixels} pixels are usable, but interpolation needs "
            f"{LEAST_PIXELS} at least; scan it again or leave it out"
        )
    return lattice_of(image) or triangulate(image)


class LinearInterpolator(Interpolator):
    """Bilinear in quadrilaterals, linear in triangles.

    Parameters
    ----------
    mesh : ImageMesh
    """

    def __init__(self, mesh: ImageMesh) -> None:
        self.mesh = mesh

    def at(self, dac: Array) -> PixelWeights:
        """Find weights at places, shape (place, 2), steps."""
        at = self.mesh.locate(dac)
        rows = rows_of(at.corner, at.weight, len(self.mesh.vertices))
        return PixelWeights(at.spread(self.mesh.over_pixels(rows)), at)

    def slopes(self, at: Located, dac: Array, values: Array) -> Array:
        """Differentiate by both steps, shape (2, found, column)."""
        return self.mesh.slopes(at, dac, self.mesh.of_vertices(values))
