"""Contract of the group `modal`: response functions of all pixels in, poles with covariance out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from sldvexp.modes.compression import PrincipalResponses
from sldvexp.modes.harmonics import LineHarmonics
from sldvexp.modes.likelihood import PoleFit
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
