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

from sldvexp.modes.harmonics import LineHarmonics
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
        Per real and imaginary part, of the pixel's noise and its harmonics alone.
    residual : ndarray of complex, shape (pixel, line), m/s
        Measured minus synthesised.
    harmonic_variance : ndarray, shape (pixel, line), m2/s2
        Of each part of the lines, from harmonics of others.
    """

    view: ViewResponses
    velocity: ComplexArray
    std: Array
    residual: ComplexArray
    harmonic_variance: Array


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
    harmonics : LineHarmonics
        Of each pixel's strong lines, which add to its noise at others.
    """

    pole: ComplexArray
    beyond: ComplexArray
    frequency: Array
    weight: Array
    harmonics: LineHarmonics

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
        scale = velocity_per_residue(self.pole)
        modes = len(self.pole)
        power = self.inverse[: 2 * modes] ** 2
        for view in responses.views(flagged=True):
            found = self.inverse @ split(view.velocity.T)
            residue = found[:modes] + 1j * found[modes : 2 * modes]
            added = self.harmonics.variance(np.abs(view.every_line) ** 2 / 2) * responses.level**2
            variance = power @ np.tile(view.std**2 + added, 2).T
            std = np.abs(scale)[:, None] * np.sqrt((variance[:modes] + variance[modes:]) / 2)
            synthesis = self.rows @ found
            lines = len(self.frequency)
            left = view.velocity - (synthesis[:lines] + 1j * synthesis[lines:]).T
            yield ModalImage(view, (scale[:, None] * residue).T, std.T, left, added)

    @cached_property
    def changes(self) -> ComplexArray:
        """How errors of the poles change shapes, alike in all pixels, (2 mode, mode).

        Share of an unknown's own mode that enters a mode's image, for each unit of ln w of all
        modes, then of ln zeta.
        """
        modes = len(self.pole)
        scale = velocity_per_residue(self.pole)
        slopes = np.zeros((2 * modes, modes), complex)
        for k, change in enumerate(
            basis_derivatives(self.pole, self.omega).reshape(2 * modes, -1, 2)
        ):
            mode = k % modes
            moved = -(self.inverse[: 2 * modes] @ change)  # of Re and Im of this mode's residue
            into = (moved[:modes, 0] + moved[modes:, 1]) / 2
            turned = (moved[modes:, 0] - moved[:modes, 1]) / 2
            slopes[k] = (into + 1j * turned) * scale / scale[mode]
            slopes[k, mode] += self._scale_change(k)
        return slopes

    def mixing(self, covariance: Array) -> Array:
        """Compute how uncertain shapes are that way.

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
        by_mode = self.changes.reshape(2, modes, modes)  # by ln w or ln zeta of the second
        own = covariance.reshape(2, modes, 2, modes)[:, range(modes), :, range(modes)]
        parts = (by_mode.real, by_mode.imag)
        return np.sqrt(np.stack([np.einsum("pba,bpq,qba->ab", p, own, p) for p in parts]))

    def _scale_change(self, unknown: int) -> float:
        """Differentiate ln of v / R, which knows the damping alone, by an unknown."""
        mode, by_damping = unknown % len(self.pole), unknown >= len(self.pole)
        damping = -self.pole[mode].real / abs(self.pole[mode])
        return float(-1 / (1 - damping**2)) if by_damping else 0.0
