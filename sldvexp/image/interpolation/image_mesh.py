"""The mesh of an image: a lattice if it is one, else triangles."""

from __future__ import annotations

import numpy as np

from sldvexp.errors import UserError
from sldvexp.image.interpolation.base import Pixels
from sldvexp.image.interpolation.lattice import lattice_of
from sldvexp.image.interpolation.mesh import Mesh
from sldvexp.image.interpolation.scattered import triangulate

#: Pixels that make a triangle.
LEAST_PIXELS = 3


def mesh_of(image: Pixels) -> Mesh:
    """The cells of an image.

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
