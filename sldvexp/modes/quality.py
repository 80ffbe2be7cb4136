"""Synthesis of all pixels' lines against the measured ones, as sums over pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.modes.images import ModalImage
from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True, eq=False)
class LineSums:
    """Sums of squares over pixels, (line,) each, m2/s2.

    Parameters
    ----------
    pixels : int
    measured, synthesis, residual, noise, harmonics : ndarray, shape (line,)
    """

    pixels: int
    measured: Array
    synthesis: Array
    residual: Array
    noise: Array
    harmonics: Array

    @classmethod
    def empty(cls, lines: int) -> LineSums:
        """Make sums of no pixels."""
        return cls(0, *np.zeros((5, lines)))

    @classmethod
    def of(cls, modal: ModalImage, used: BoolArray) -> LineSums:
        """Sum over the pixels of a view that are used."""
        measured, left = modal.view.velocity[used], modal.residual[used]
        both = (measured, measured - left, left)
        sums = [np.asarray(np.sum(np.abs(a) ** 2, axis=0)) for a in both]
        noise = np.asarray(2 * np.sum(modal.view.std[used] ** 2, axis=0))
        harmonics = np.asarray(2 * np.sum(modal.harmonic_variance[used], axis=0))
        return cls(int(used.sum()), sums[0], sums[1], sums[2], noise, harmonics)

    def __add__(self, other: LineSums) -> LineSums:
        return LineSums(
            self.pixels + other.pixels,
            self.measured + other.measured,
            self.synthesis + other.synthesis,
            self.residual + other.residual,
            self.noise + other.noise,
            self.harmonics + other.harmonics,
        )

    def rms(self, of: str) -> Array:
        """Take the root mean square over the pixels of one of the sums."""
        return np.asarray(np.sqrt(getattr(self, of) / self.pixels))
