"""Motion of everything that the beam can hit while the generator plays any signal.

One long period of N samples g_n of the generator's voltage, played over and over, has the lines
``G_k = sum_n g_n exp(-2 pi i k n / N)``. A term of an object with the spectrum H_m moves as

    q_m = irfft(H_m(f_k) G_k),

exact with all transients, computed once. A record of a pixel is a stretch of ``sum_m c_m q_m`` from
wherever it starts. The generator and the converter are taken to share a clock.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.signal import ExcitationKind, RecordDesign
from sldvexp.typing import Array, ComplexArray

Array32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Transients:
    """Responses of some terms to one long period of what the generator plays.

    Parameters
    ----------
    played : ndarray of float32, shape (sample,), V
    responses : ndarray of float32, shape (term, sample), m/s
    """

    played: Array32
    responses: Array32

    @classmethod
    def computed(
        cls, played: Array, rate: float, spectra: Callable[[Array], ComplexArray]
    ) -> Transients:
        """Compute the responses.

        Parameters
        ----------
        played : ndarray, shape (sample,), V
        rate : float, Hz
        spectra : callable
            Of frequencies (line,) in Hz: what each term does, shape (term, line), m/s per V.
        """
        lines = np.fft.rfft(played)
        found = spectra(np.asarray(np.fft.rfftfreq(len(played), 1.0 / rate), float))
        responses = [np.fft.irfft(row * lines, len(played)) for row in found]
        return cls(played.astype(np.float32), np.array(responses, np.float32))

    def record(self, coefficient: Array, start: int, samples: int) -> tuple[Array32, Array32]:
        """Give velocity and voltage of one record of one pixel, each of shape (sample,)."""
        place = (start + np.arange(samples)) % len(self.played)
        velocity = np.zeros(samples, np.float32)
        for c, response in zip(coefficient.astype(np.float32), self.responses, strict=True):
            if c:
                velocity += c * response[place]
        return velocity, self.played[place]

    def power(self, coefficient: Array) -> Array:
        """Compute the mean square of pixels' velocities, shape (pixel,), of (pixel, term)."""
        gram = self.responses.astype(float) @ self.responses.T.astype(float) / len(self.played)
        return np.asarray(np.einsum("pm,mn,pn->p", coefficient, gram, coefficient))


#: Records of different noise in the long period, at least; a multiple of it if more are taken.
DIFFERENT = 128
#: Silent records behind a hammer's blow, in which the response dies.
SILENT = 15


def long_period(design: RecordDesign, records: int = 1) -> Array:
    """Make what the generator plays before it begins again, shape (sample,), V.

    A periodic signal repeats with the record; noise goes on for many of them, and for more than a
    pixel takes, so that no two records of a pixel have the same. A blow of the hammer is padded
    with silence, so that each meets a structure at rest.

    Parameters
    ----------
    design : RecordDesign
    records : int
        That are taken of a pixel.

    Examples
    --------
    >>> from sldvexp.signal import Excitation, ExcitationKind
    >>> design = Excitation(ExcitationKind.random).design(5120.0, 64)
    >>> [len(long_period(design, records)) // 64 for records in (1, 128, 129)]
    [128, 128, 256]
    """
    if design.excitation.periodic:
        return design.waveform()
    if design.excitation.kind is ExcitationKind.hammer:
        return np.concatenate([design.waveform(), np.zeros(SILENT * design.samples)])
    return design.waveform(DIFFERENT * -(-records // DIFFERENT))
