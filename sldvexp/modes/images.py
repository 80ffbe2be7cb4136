"""Modal images: the velocity that each pixel has of every mode, with its noise.

For given poles the residues of a pixel are weighted least squares of its lines,
``X = (P' W P)^-1 P' W y``. Noise of pixels is independent; what the poles' own uncertainty adds,
``dX = -(P' W P)^-1 P' W dP X``, is the same matrix for all pixels: mostly a factor of a whole mode,
and a small admixture of its neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sldvexp.modes.model import (
    basis,
    basis_derivatives,
    split,
    velocity_per_residue,
)
from sldvexp.modes.responses import Responses, ViewResponses
from sldvexp.typing import Array, ComplexArray


@dataclass(frozen=True, eq=False)
class ModalImage:
    """Modes in one view.

    Parameters
    ----------
    view : ViewResponses
        Lines that it was made of.
    velocity : ndarray of complex, shape (pixel, mode), m/s
        Peak at resonance, of the mode alone.
    std : ndarray, shape (pixel, mode), m/s
        Per real and imaginary part, of the pixel's noise alone.
    residual : ndarray of complex, shape (pixel, line), m/s
        Measured minus synthesised.
    """

    view: ViewResponses
    velocity: ComplexArray
    std: Array
    residual: ComplexArray


@dataclass(frozen=True, eq=False)
class ModalProjection:
    """Least squares from lines to modes at given poles.

    Parameters
    ----------
    pole : ndarray of complex, shape (mode,), rad/s
    beyond : ndarray of complex, shape (other,), rad/s
        Poles of the model whose modes are not told.
    frequency : ndarray, shape (line,), Hz
    weight : ndarray, shape (line,)
    added : float, 1/s
        Decay rate that a window added to all poles; velocities are told without it.
    """

    pole: ComplexArray
    beyond: ComplexArray
    frequency: Array
    weight: Array
    added: float = 0.0

    @property
    def scale(self) -> ComplexArray:
        """Velocity at resonance, without the window's damping, per residue."""
        return velocity_per_residue(self.pole + self.added)

    @property
    def omega(self) -> Array:
        """Lines, rad/s."""
        return 2 * np.pi * self.frequency

    @cached_property
    def rows(self) -> Array:
        """Matrix of the model: Re R, then Im R of all modes told, then all others."""
        whole, told = np.append(self.pole, self.beyond), len(self.pole)
        columns = basis(whole, self.omega)
        rest = np.delete(columns, np.r_[:told, len(whole) : len(whole) + told], axis=1)
        return np.hstack([columns[:, :told], columns[:, len(whole) : len(whole) + told], rest])

    @cached_property
    def inverse(self) -> Array:
        """Matrix of the least squares, (coefficient, 2 line)."""
        weight = np.tile(self.weight, 2)
        return np.asarray(np.linalg.pinv(weight[:, None] * self.rows) * weight)

    def images(self, responses: Responses) -> Iterator[ModalImage]:
        """Make the modal image of one view after the other."""
        scale = self.scale
        modes = len(self.pole)
        power = self.inverse[: 2 * modes] ** 2
        for view in responses.views(flagged=True):
            found = self.inverse @ split(view.velocity.T)
            residue = found[:modes] + 1j * found[modes : 2 * modes]
            variance = power @ np.tile(view.std**2, 2).T
            std = np.abs(scale)[:, None] * np.sqrt((variance[:modes] + variance[modes:]) / 2)
            synthesis = self.rows @ found
            lines = len(self.frequency)
            left = view.velocity - (synthesis[:lines] + 1j * synthesis[lines:]).T
            yield ModalImage(view, (scale[:, None] * residue).T, std.T, left)

    def mixing(self, covariance: Array) -> Array:
        """Compute how the poles' uncertainty changes shapes, alike in all pixels.

        Parameters
        ----------
        covariance : ndarray, shape (2 mode, 2 mode)
            Of ln w and ln zeta.

        Returns
        -------
        ndarray, shape (2, mode, mode)
            Standard errors of real and imaginary part of the share of the second mode's image in
            the first's.
        """
        modes = len(self.pole)
        scale = self.scale
        slopes = []
        for k, change in enumerate(
            basis_derivatives(self.pole, self.omega).reshape(2 * modes, -1, 2)
        ):
            mode = k % modes
            moved = -(self.inverse[: 2 * modes] @ change)  # of Re and Im of this mode's residue
            into = (moved[:modes, 0] + moved[modes:, 1]) / 2
            turned = (moved[modes:, 0] - moved[:modes, 1]) / 2
            slope = np.zeros((modes, modes), complex)
            slope[:, mode] = (into + 1j * turned) * scale / scale[mode]
            slope[mode, mode] += self.scale_change(mode, k >= modes)
            slopes.append(slope)
        parts = np.array(slopes)
        real = np.einsum("iab,ij,jab->ab", parts.real, covariance, parts.real)
        imaginary = np.einsum("iab,ij,jab->ab", parts.imag, covariance, parts.imag)
        return np.sqrt(np.stack([real, imaginary]))

    def scale_change(self, mode: int, by_damping: bool) -> float:
        """Differentiate ln of v / R, the damped frequency over the decay rate, by an unknown."""
        rate = -self.pole[mode].real
        damping = rate / abs(self.pole[mode])
        told = rate / (rate - self.added)
        return float(-(damping**2) / (1 - damping**2) - told) if by_damping else float(1 - told)
