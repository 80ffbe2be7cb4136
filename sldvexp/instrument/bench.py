"""Questions of a person at the bench to an instrument: the beam's place, light, a picture.

A scan needs none of it. An instrument that can tell has the methods of `TellsAtBench`, of which
each gives None if it cannot; for one without them the functions here find the same by what every
instrument can (`sldvexp.instrument.protocol.Instrument`): the place from what was sent, the light
from the status of a pixel.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sldvexp.instrument.protocol import CHANNELS, Acquisition, Instrument, RawSamples, Status

#: Periods of the lowest frequency that a quick look takes, and its fewest samples.
PERIODS, FEWEST = 4, 32
#: Power at a line over the median of all lines, from which it is no chance.
STANDS_OUT = 10.0


@runtime_checkable
class TellsAtBench(Protocol):
    """An instrument that tells more than a scan needs; None means that it cannot."""

    def read_position(self) -> tuple[int, int] | None:
        """Read back at which (up_down, left_right) the mirrors stand, DAC steps."""

    def light_level(self) -> float | None:
        """Read how much of the laser's light comes back, from 0 to 1."""

    def picture(self) -> NDArray[np.uint8] | None:
        """Take a picture of the scene with the spot in it, shape (row, column), 0 is black."""


def read_position(instrument: Instrument, sent: tuple[int, int]) -> tuple[int, int]:
    """Read at which DAC steps the mirrors stand; where they were sent, if nothing tells it."""
    told = instrument.read_position() if isinstance(instrument, TellsAtBench) else None
    return sent if told is None else told


def light_level(instrument: Instrument, pixel: RawSamples) -> float:
    """Read how much light comes back, from 0 to 1.

    Parameters
    ----------
    pixel : RawSamples
        Sampled where the beam stands. Of an instrument that tells no level, a pixel that has
        dropped out has no light, and any other has all of it.
    """
    told = instrument.light_level() if isinstance(instrument, TellsAtBench) else None
    if told is not None:
        return told
    return 0.0 if np.any(pixel.status & Status.dropped_out) else 1.0


def picture(instrument: Instrument) -> NDArray[np.uint8] | None:
    """Take a picture of the scene with the spot; None of an instrument without a camera."""
    return instrument.picture() if isinstance(instrument, TellsAtBench) else None


def strongest_line(
    instrument: Instrument, acquisition: Acquisition, dac: NDArray[np.int64]
) -> float | None:
    """Find the line of a broadband signal at which most moves at some places, Hz.

    It is ``max_f sum |V_f|^2`` of one record at each place, with V the velocity's spectrum. None if
    none stands out, where nothing moves or no light comes back.

    Parameters
    ----------
    acquisition : Acquisition
        With a `drive`, and as many records as a scan takes.
    dac : ndarray of int, shape (place, 2), steps
    """
    design = acquisition.drive
    assert design is not None
    instrument.configure(replace(acquisition, records=1))
    samples = instrument.scan(dac)
    lost = samples.status & Status.dropped_out
    velocity = samples.counts[:, CHANNELS.index("velocity")].astype(float)
    good = velocity[lost == 0] if len(lost) else velocity
    power = np.square(np.abs(np.fft.rfft(good, axis=1)[:, design.lines])).sum(axis=0)
    strongest = int(np.argmax(power))
    if not power[strongest] > STANDS_OUT * np.median(power):
        return None
    return float(design.frequency[strongest])


def spread_out(count: int) -> NDArray[np.float64]:
    """Spread places over a square of side 1, on no line of symmetry (Roberts's sequence), (n, 2).

    Examples
    --------
    >>> spread_out(2).round(2).tolist()
    [[0.25, 0.07], [0.01, 0.64]]
    """
    plastic = 1.324717957244746  # the root of x^3 = x + 1
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] / [plastic, plastic**2]) % 1)


def quick(acquisition: Acquisition, hertz: float | None = None) -> Acquisition:
    """Shorten an acquisition to a quick look: some periods of the lowest frequency, no longer.

    A broadband signal is looked at by a sine of the frequency given, or else in the middle of its
    band.

    Examples
    --------
    >>> quick(Acquisition(rate=25600.0, samples=512, excitation=(450.0,))).samples
    228
    """
    if acquisition.drive is not None:
        middle = math.sqrt(math.prod(acquisition.drive.excitation.band))
        tone = replace(acquisition.silent, excitation=(hertz or middle,), records=1, lead=0)
        return quick(tone)
    periods = PERIODS * acquisition.rate / min(acquisition.excitation, default=acquisition.rate)
    return replace(acquisition, samples=min(acquisition.samples, max(FEWEST, math.ceil(periods))))


def make_safe(instrument: Instrument, acquisition: Acquisition) -> None:
    """Switch the generator off and send the mirrors home, without leaving the instrument.

    Parameters
    ----------
    acquisition : Acquisition
        That it was configured with last; it must be configured again before it goes on.
    """
    try:
        instrument.configure(acquisition.silent)
    finally:
        instrument.move((0, 0))
