"""Linear between the corners of a cell."""

from __future__ import annotations

import numpy as np

from sldvexp.image.interpolation.base import Interpolator, PixelWeights
from sldvexp.image.interpolation.mesh import ImageMesh
from sldvexp.typing import Array


class LinearInterpolator(Interpolator):
    """Bilinear in quadrilaterals, linear in triangles.

    Parameters
    ----------
    mesh : ImageMesh
    """

    def __init__(self, mesh: ImageMesh) -> None:
        self.mesh = mesh

    def at(self, dac: Array) -> PixelWeights:
        """Weights at places, shape (place, 2), steps."""
        at = self.mesh.locate(dac)
        value, up_down, left_right = (
            self.mesh.over_pixels(at.rows(at.corner, weight, len(self.mesh.vertices)))
            for weight in (at.weight, *np.moveaxis(at.gradient, -1, 0))
        )
        return PixelWeights(value, (up_down, left_right), at.outside, at.flagged)
