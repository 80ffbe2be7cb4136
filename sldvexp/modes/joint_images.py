"""Modal images of several references: weighted least squares of the lines of all of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from sldvexp.modes.images import ModalProjection
from sldvexp.modes.participation import Participation
from sldvexp.typing import Array, ComplexArray


@dataclass(frozen=True, eq=False)
class JointProjection(ModalProjection):
    """Least squares from the lines of all references to the shapes of modes.

    Parameters
    ----------
    participation : Participation
        Poles, and the shares that make one shape of all references' lines.
    """

    participation: Participation = field(kw_only=True)

    @property
    def omega(self) -> Array:
        """Lines of one reference, rad/s."""
        references = len(self.participation.share)
        return 2 * np.pi * self.frequency[: len(self.frequency) // references]

    @cached_property
    def rows(self) -> Array:
        """See `ModalProjection`."""
        columns, own = self.participation.columns(self.omega), 2 * len(self.pole)
        return np.hstack([columns[:, 0:own:2], columns[:, 1:own:2], columns[:, own:]])

    @cached_property
    def slopes(self) -> ComplexArray:
        """How errors of all unknowns change shapes, (unknown, mode, mode it belongs to)."""
        modes, scale = len(self.pole), self.scale
        count = len(self.participation.poles) + len(self.participation.beyond)
        slopes = np.zeros((len(self.participation.unknowns), modes, modes), complex)
        for k, (own, change) in enumerate(self.participation.changes(self.omega)):
            if own[0] >= 2 * modes:
                continue  # a pole beside the band, whose shapes are not told
            moved = -(self.inverse[: 2 * modes] @ change)
            for place, mode in enumerate(column // 2 for column in own[::2]):
                real, imaginary = moved[:, 2 * place], moved[:, 2 * place + 1]
                into = (real[:modes] + imaginary[modes:]) / 2
                turned = (real[modes:] - imaginary[:modes]) / 2
                slopes[k, :, mode] = (into + 1j * turned) * scale / scale[mode]
                if k < 2 * count:
                    slopes[k, mode, mode] += self.scale_change(mode, k >= count)
        return slopes

    @property
    def changes(self) -> ComplexArray:
        """See `ModalProjection`; shares are no part of it."""
        of_pole, modes = self.participation.pole_of_mode, np.arange(len(self.pole))
        count = len(self.participation.poles) + len(self.participation.beyond)
        return np.concatenate([self.slopes[first + of_pole, :, modes] for first in (0, count)])

    def mixing(self, covariance: Array) -> Array:
        """See `ModalProjection`; the covariance is that of all unknowns of the participation."""
        parts = [
            np.einsum("iab,ij,jab->ab", part, covariance, part)
            for part in (self.slopes.real, self.slopes.imag)
        ]
        return np.sqrt(np.stack(parts))
