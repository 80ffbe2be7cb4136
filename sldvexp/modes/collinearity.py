"""Complexity of modes: how far their points are from moving in phase.

With the sums over pixels ``xx = sum Re v^2``, ``yy`` and ``xy``, each without the noise's part, the
modal phase collinearity is ``((l1 - l2) / (l1 + l2))^2`` of the eigenvalues of ``[xx xy; xy yy]``:
1 of a real mode of any phase (Pappa, Elliott, Schenk).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array, ComplexArray


@dataclass(frozen=True, eq=False)
class PhaseSums:
    """Sums over pixels, (mode,) each.

    Parameters
    ----------
    squares : ndarray of complex, shape (mode,), m2/s2
        Of v^2, which the noise has no part in.
    power : ndarray, shape (mode,), m2/s2
        Of ``|v|^2``, without the noise's part.
    noise2, noise4 : ndarray, shape (mode,)
        Of the second and fourth power of the standard error.
    product : ndarray, shape (mode,), m4/s4
        Of power times squared standard error.
    pixels : int
    """

    squares: ComplexArray
    power: Array
    noise2: Array
    noise4: Array
    product: Array
    pixels: int = 0

    @classmethod
    def empty(cls, modes: int) -> PhaseSums:
        """Make sums of no pixels."""
        return cls(np.zeros(modes, complex), *np.zeros((4, modes)))

    @classmethod
    def of(cls, velocity: ComplexArray, std: Array) -> PhaseSums:
        """Sum over pixels, shape (pixel, mode)."""
        power = np.abs(velocity) ** 2 - 2 * std**2
        parts = (velocity**2, power, std**2, std**4, power * std**2)
        squares, *sums = (np.asarray(a.sum(axis=0)) for a in parts)
        return cls(squares, sums[0], sums[1], sums[2], sums[3], len(velocity))

    def __add__(self, other: PhaseSums) -> PhaseSums:
        return PhaseSums(
            self.squares + other.squares,
            self.power + other.power,
            self.noise2 + other.noise2,
            self.noise4 + other.noise4,
            self.product + other.product,
            self.pixels + other.pixels,
        )

    def complexity(self) -> Array:
        """Compute 1 - collinearity, noise subtracted; it may be below 0 by its error."""
        return np.asarray(1 - (np.abs(self.squares) / self.power) ** 2)

    def complexity_std(self) -> Array:
        """Compute its standard error from the noise of the pixels.

        Near a real mode the complexity is four times the power out of phase, over all power.
        """
        out = np.maximum(self.power - np.abs(self.squares), 0) / 2
        mean = self.noise4 / self.noise2
        return np.asarray(4 * np.sqrt(2 * self.noise4 + 4 * mean * out) / self.power)

    def rms(self) -> Array:
        """Compute the r.m.s. over the pixels, m/s."""
        return np.asarray(np.sqrt(self.power / self.pixels))

    def rms_relative_std(self) -> Array:
        """Compute its relative standard error from the noise of the pixels."""
        return np.asarray(np.sqrt(np.maximum(self.product + self.noise4, 0)) / self.power)

    def phase(self) -> Array:
        """Compute the phase of most motion, within -pi/2 to pi/2."""
        return np.asarray(np.angle(self.squares) / 2)
