"""An instrument at one view, seen as a camera: scan lines in, complex pixels out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sldvexp.instrument.protocol import Acquisition, Samples, Status
from sldvexp.session.journal import Journal
from sldvexp.signal.image import ComplexImage

if TYPE_CHECKING:
    from sldvexp.instrument.protocol import Instrument
    from sldvexp.signal.sine_fit import SineFit


class Camera:
    """Takes complex images line by line, from the journal where it has the line already.

    Parameters
    ----------
    instrument : Instrument
    signal : SineFit
    acquisition : Acquisition
    journal : Journal
        Of this view.
    """

    def __init__(
        self, instrument: Instrument, signal: SineFit, acquisition: Acquisition, journal: Journal
    ) -> None:
        self.instrument = instrument
        self.signal = signal
        self.acquisition = acquisition
        self.journal = journal
        self._taken = 0

    def image(self, name: str, lines: NDArray[np.int64]) -> ComplexImage:
        """Complex pixels of some scan lines.

        Parameters
        ----------
        name : str
            Of these lines, unique in the view.
        lines : ndarray of int, shape (line, pixel, 2)

        Returns
        -------
        ComplexImage
            Of ``line * pixel`` pixels, in their order.
        """
        samples = [self._line(f"{name}_{k:03d}", dac) for k, dac in enumerate(lines)]
        times = np.arange(self.acquisition.samples) / samples[0].rate
        return self.signal.demodulate(
            np.concatenate([s.counts for s in samples]),
            times,
            self.acquisition.excitation,
            volts_per_count=samples[0].volts_per_count,
            quality=np.concatenate([s.status & Status.dropped_out == 0 for s in samples]),
        )

    def _line(self, name: str, dac: NDArray[np.int64]) -> Samples:
        """One scan line; its number in the view makes a repeated one the same on a virtual lab."""
        number, self._taken = self._taken, self._taken + 1
        return self.journal.line(
            name, dac, self.acquisition, lambda: self.instrument.scan(dac, stream=number)
        )
