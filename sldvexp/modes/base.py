"""Contract of the group `modal`: response functions of all pixels in, poles with covariance out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.modes.compression import PrincipalResponses
from sldvexp.modes.harmonics import LineHarmonics
from sldvexp.modes.likelihood import PoleFit
from sldvexp.modes.participation import Participation
from sldvexp.modes.responses import Responses
from sldvexp.modes.stabilisation import Stabilisation
from sldvexp.typing import Array, ComplexArray


@dataclass(frozen=True, eq=False)
class ModalFit:
    """Poles that a method found.

    Parameters
    ----------
    pole : ndarray of complex, shape (mode,), rad/s
        In rising order of their natural frequencies, with positive imaginary parts.
    beyond : ndarray of complex, shape (other,), rad/s
        Of modes beside the band that are in the model, but no result.
    covariance : ndarray, shape (2 mode, 2 mode)
        Of ``ln w_r`` of all modes, then of ``ln zeta_r``, as the stated noise makes it. NaN of a
        method that has none.
    chi_square, dof : float
        Weighted squares of what the modes leave over of the lines, and their expectation.
    weight : ndarray, shape (line,)
        Of the lines: 1 over what noise and harmonics are there, in units of a pixel's noise.
    harmonics : LineHarmonics
        Those that the weights rest on.
    by_line : ndarray, shape (line,)
        Ratio of the two, line by line.
    responses : int
        How many responses stand out of the noise, whose squares these are.
    noise_ratio : float
        Root of the variance of all that is no signal, over the stated one.
    stabilisation : Stabilisation
        Poles of all orders, and which became modes.
    participation : Participation, optional
        Of modes of several references; modes that share a pole have the same in `pole`.
    joint_covariance : ndarray, shape (unknown, unknown), optional
        Of all its unknowns.
    """

    pole: ComplexArray
    beyond: ComplexArray
    covariance: Array
    chi_square: float
    dof: float
    by_line: Array
    weight: Array
    harmonics: LineHarmonics
    responses: int
    noise_ratio: float
    stabilisation: Stabilisation
    participation: Participation | None = None
    joint_covariance: Array | None = None

    def widened(self, factor: float) -> ModalFit:
        """Multiply covariances by a factor."""
        joint = None if self.joint_covariance is None else factor * self.joint_covariance
        return replace(self, covariance=factor * self.covariance, joint_covariance=joint)

    def freed(self, rate: float) -> ModalFit:
        """Take the decay rate off all poles, 1/s, that a window ``exp(-rate t)`` added.

        Of ``s = zeta w`` and the damped frequency d, which stays: ``s' = s - rate`` and
        ``w'^2 = s'^2 + d^2``.

        Raises
        ------
        UserError
            If a mode has no damping but the window's.
        """
        natural, left = np.abs(self.pole), -self.pole.real - rate
        if (left <= 0).any():
            hertz = float(natural[left.argmin()] / (2 * np.pi))
            raise UserError(
                f"the mode at {hertz:.5g} Hz is damped by the exponential window alone, as far as "
                "lines tell; take longer records and a longer scan.sampling.decay"
            )
        slope = self.slope(rate)
        return replace(
            self,
            pole=self.pole + rate,
            covariance=slope @ self.covariance @ slope.T,
            stabilisation=replace(self.stabilisation, pole=self.stabilisation.pole + rate),
        )

    def slope(self, rate: float) -> Array:
        """Differentiate ln w and ln zeta without a window's decay rate by those with it."""
        own, left = -self.pole.real, -self.pole.real - rate
        free = left**2 + self.pole.imag**2
        # Of s by ln w and ln zeta alike; of d^2 / 2 by either.
        by_natural = (left * own + self.pole.imag**2) / free, (left * own - own**2) / free
        by_damping = own / left - by_natural[0], own / left - by_natural[1]
        return np.block([[np.diag(part) for part in row] for row in (by_natural, by_damping)])

    @classmethod
    def from_poles(
        cls,
        fit: PoleFit,
        principal: PrincipalResponses,
        harmonics: LineHarmonics,
        stabilisation: Stabilisation,
    ) -> ModalFit:
        """Join poles with what they were found in; their starts are numbers of stable modes."""
        return cls(
            fit.pole,
            fit.beyond,
            fit.covariance,
            fit.chi_square,
            fit.dof,
            fit.by_line,
            principal.weight,
            harmonics,
            len(principal.values),
            principal.noise_ratio,
            stabilisation.renumbered(fit.start),
        )


class ModalMethod(ABC):
    """Base of what finds modes in response functions.

    A method is a dataclass of its settings that implements `identify`. It keeps these promises:

    - It takes all views' pixels together: poles belong to the structure, not to a view.
    - It asks nobody anything, and draws no random numbers: the same images give the same bits.
    - Pixels with a flag have no say. Views are read one by one, and not kept.
    - Uncertainties are those of the stated noise; whoever asks for modes compares ``chi_square``
      with ``dof`` and inflates them where that is due.
    - A band without modes, or with too few lines, is a `UserError` of one sentence.

    Residues, modal images and fields are made of the poles afterwards, alike for all methods.
    """

    @property
    @abstractmethod
    def lines(self) -> tuple[float, float] | None:
        """Band whose lines are used, Hz; all of them without one."""

    @property
    def left_out(self) -> Sequence[float]:
        """Lines that are not used, Hz."""
        return ()

    @abstractmethod
    def identify(self, responses: Responses) -> ModalFit:
        """Find the poles.

        Parameters
        ----------
        responses : Responses
            Lines of all views' pixels with their noise.

        Raises
        ------
        UserError
            If there is no mode in the band, or there are fewer lines than unknowns.
        """
