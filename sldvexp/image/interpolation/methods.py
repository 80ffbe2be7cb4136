"""The ways to interpolate, by the names a configuration uses."""

from __future__ import annotations

from enum import Enum

from sldvexp.image.interpolation.base import Interpolator, Pixels
from sldvexp.image.interpolation.cubic import Cubic
from sldvexp.image.interpolation.image_mesh import mesh_of
from sldvexp.image.interpolation.linear import Linear


class Interpolation(Enum):
    """Between the pixels around a place; whether the image is a lattice decides how they are found.

    Attributes
    ----------
    linear
        Bilinear in the cells of a lattice, linear in the triangles of scattered pixels. Errs by
        the square of the pixels' distance.
    cubic
        Parabolic patches through each pixel and its neighbours, blended linearly: on an even
        lattice the Catmull-Rom (Keys) cubic. Errs by the cube of the pixels' distance.
    """

    linear = "linear"
    cubic = "cubic"

    def prepare(self, image: Pixels) -> Interpolator:
        """What interpolates in one image, to be used for any number of places.

        Parameters
        ----------
        image : Pixels
            For example a `sldvexp.field.visibility.view.View`.

        Raises
        ------
        UserError
            If the image has fewer than three usable pixels, all on a line, or differing
            velocities at one place.
        """
        mesh = mesh_of(image)
        return Linear(mesh) if self is Interpolation.linear else Cubic(mesh)
