"""Parabolic patches through each pixel and its neighbours, blended by the linear weights.

``v(x) = sum_i w_i(x) q_i(x)`` over the corners i of the cell, with linear weights w and patches q
of second order through each corner. In one dimension this is Overhauser's blend of two parabolas,
the Catmull-Rom cubic; on a lattice of even steps it is that of both directions.
"""

from __future__ import annotations

import numpy as np

from sldvexp.image.interpolation.base import Interpolator, PixelWeights
from sldvexp.image.interpolation.mesh import ImageMesh, Located
from sldvexp.image.interpolation.patches import TERMS, fit_patches, monomials
from sldvexp.lazy import scipy
from sldvexp.typing import Array

#: How many places are weighted at once.
BLOCK = 65536


class CubicInterpolator(Interpolator):
    """Blended patches: exact for functions of second order.

    Parameters
    ----------
    mesh : ImageMesh
    """

    def __init__(self, mesh: ImageMesh) -> None:
        self.mesh = mesh
        self._frame = mesh.frames()
        # Rows: the value of every patch at its own pixel, then its coefficients term by term.
        self._patches = fit_patches(
            mesh.vertices, self._frame, *mesh.neighbours(), mesh.biquadratic
        )

    def at(self, dac: Array) -> PixelWeights:
        """Weights at places, shape (place, 2), steps."""
        blocks = [self._at(dac[k : k + BLOCK]) for k in range(0, max(len(dac), 1), BLOCK)]
        if len(blocks) == 1:
            return blocks[0]
        value, up_down, left_right = (
            scipy.sparse.vstack(each, format="csr")
            for each in zip(*((b.value, *b.gradient) for b in blocks), strict=True)
        )
        return PixelWeights(
            value,
            (up_down, left_right),
            np.concatenate([b.outside for b in blocks]),
            np.concatenate([b.flagged for b in blocks]),
        )

    def _at(self, dac: Array) -> PixelWeights:
        at = self.mesh.locate(dac)
        frame = self._frame[at.corner]
        away = dac[at.place][:, None] - self.mesh.vertices[at.corner]
        term, by_own = monomials(np.einsum("nkab,nkb->nka", frame, away))
        by_dac = np.einsum("nkmb,nkba->nkma", by_own, frame)
        value = at.weight[..., None] * term
        gradient = at.gradient[:, :, None] * term[..., None]
        gradient += at.weight[..., None, None] * by_dac
        up_down, left_right = (self._over_pixels(at, gradient[..., a]) for a in range(2))
        both = up_down, left_right
        return PixelWeights(self._over_pixels(at, value), both, at.outside, at.flagged)

    def _over_pixels(self, at: Located, weight: Array) -> scipy.sparse.csr_array:
        """Weights of the pixels from those (found, k, term) of the patches' coefficients."""
        vertices = len(self.mesh.vertices)
        column = at.corner[..., None] + vertices * np.arange(TERMS)
        flat = len(at.place), at.corner.shape[1] * TERMS
        of_patches = at.rows(column.reshape(flat), weight.reshape(flat), TERMS * vertices)
        return self.mesh.over_pixels(of_patches @ self._patches)
