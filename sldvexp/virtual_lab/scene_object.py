"""What every object in a scene must tell: where the beam hits it and how it moves there."""

from __future__ import annotations

from abc import ABC, abstractmethod

from sldvexp.typing import Array, ComplexArray
from sldvexp.virtual_lab.beam import Beams


class SceneObject(ABC):
    """Something that the beam can hit. A new object implements the one hook `seen`."""

    @abstractmethod
    def seen(self, beams: Beams, frequency: Array) -> tuple[Array, ComplexArray]:
        """What the instrument sees of this object.

        Parameters
        ----------
        beams : Beams
        frequency : ndarray, shape (tone,), Hz

        Returns
        -------
        distance : ndarray, shape (beam,), m
            From the beam's origin; infinite where it misses the object.
        velocity : ndarray of complex, shape (beam, tone), m/s per V of excitation
            Along the line of sight, positive towards the instrument (v = V . D), averaged over
            the spot; finite, but without meaning, where the beam misses.
        """
