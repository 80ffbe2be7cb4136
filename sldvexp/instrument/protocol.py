"""Protocol of every instrument that scans; the rest of the program knows no more about it.

What every plugin of the group `instrument` that can scan has in common.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from enum import IntFlag
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sldvexp.laser import TwoMirror
from sldvexp.signal import RecordDesign
from sldvexp.targets import Target
from sldvexp.typing import Array, IntArray

#: Order of the channels in every block of samples.
CHANNELS = ("velocity", "reference")


class Status(IntFlag):
    """Word of the instrument itself about a record, of which a pixel has one or more."""

    good = 0
    dropped_out = 1
    over_range = 2
    untriggered = 4


@dataclass(frozen=True)
class Acquisition:
    """How each pixel is sampled.

    Parameters
    ----------
    rate : float, Hz
        Samples per second and channel.
    samples : int
        Samples per pixel and channel.
    excitation : tuple of float, Hz
        Frequencies that the generator plays; empty leaves it off.
    amplitude : float, V
        Peak amplitude of each generated frequency.
    drive : RecordDesign, optional
        What the generator plays instead of tones, in records of `samples`.
    records : int
        Of each pixel, one behind the other.
    lead : int
        Records that are let go by after a move, before the first.
    triggered : bool
        Whether each record starts where the generator begins one anew; otherwise a pixel's first
        starts anywhere.
    """

    rate: float
    samples: int
    excitation: tuple[float, ...]
    amplitude: float = 1.0
    drive: RecordDesign | None = None
    records: int = 1
    lead: int = 0
    triggered: bool = True

    @property
    def plays(self) -> bool:
        """True if the generator is on."""
        return bool(self.excitation) or self.drive is not None

    @property
    def seconds(self) -> float:
        """Time that a pixel takes, s, without that of the move."""
        return (self.lead + self.records) * self.samples / self.rate

    @property
    def silent(self) -> Acquisition:
        """The same with the generator off."""
        return replace(self, excitation=(), drive=None)


@dataclass(frozen=True, eq=False)
class RawSamples:
    """Raw samples of some pixels.

    Parameters
    ----------
    counts : ndarray of int16, shape (pixel * record, channel, sample)
        Channels in the order of `CHANNELS`; all records of a pixel, then those of the next. Each
        pixel starts at an arbitrary phase.
    volts_per_count : ndarray, shape (channel,)
    rate : float, Hz
    status : ndarray of uint8, shape (pixel * record,)
        Bits of `Status`.
    records : int
        Of each pixel.
    """

    counts: NDArray[np.int16]
    volts_per_count: Array
    rate: float
    status: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    records: int = 1


class InstrumentError(Exception):
    """Refusal or failure of the instrument; its text says what happened at which command.

    Parameters
    ----------
    why : str
        What happened.
    not_home : str
        How the instrument may have been left, if not with its mirrors home and its generator off.

    Examples
    --------
    >>> error = InstrumentError("sampling: no answer", "the mirrors may not be home")
    >>> str(error), error.why
    ('sampling: no answer; the mirrors may not be home', 'sampling: no answer')
    """

    def __init__(self, why: str, not_home: str = "") -> None:
        super().__init__("; ".join(part for part in (why, not_home) if part))
        self.why, self.not_home = why, not_home

    def __reduce__(self) -> tuple[type[InstrumentError], tuple[str, str]]:
        """Take the parts along to other processes."""
        return type(self), (self.why, self.not_home)


class Instrument(Protocol):
    """A scanning vibrometer with its boards and generator.

    Used as a context manager: on leaving, whatever happened, the mirrors go home and the generator
    is off. Methods raise `InstrumentError` for faults of the instrument (time-out, garbage,
    disconnection, an entry in its error queue).
    """

    def __enter__(self) -> Instrument: ...

    def __exit__(self, *exception: object) -> None: ...

    def configure(self, acquisition: Acquisition) -> None:
        """Set sampling and generator for all pixels that follow."""

    def move(self, dac: Sequence[int]) -> None:
        """Point the beam at (up_down, left_right) in DAC steps."""

    def acquire(self) -> RawSamples:
        """Sample one pixel, all its records, where the beam stands."""

    def scan(self, dac: IntArray, stream: int | None = None) -> RawSamples:
        """Move and sample a whole list, shape (pixel, 2), buffered by the instrument.

        A simulated instrument draws the noise of scan line `stream` again whenever it is given the
        same number; to others it means nothing.
        """


@runtime_checkable
class Foresees(Protocol):
    """An instrument that makes use of knowing which lines come next."""

    def expect(self, lines: Sequence[tuple[IntArray, int]]) -> None:
        """Hear of lines, pixels and streams, before they are scanned as `Instrument.scan` says.

        Some of them may never be, and others may come between them.
        """


class ScanningPlugin(ABC):
    """Base of the instruments that scan; `open` is what they add.

    Attributes
    ----------
    real : bool
        Whether mirrors move; what only tries a configuration out leaves such an instrument alone.
    """

    real: ClassVar[bool] = True

    @property
    def takes_views_itself(self) -> bool:
        """True if `open` puts the instrument where a view is; otherwise somebody must move it."""
        return True

    @property
    def source(self) -> dict[str, str]:
        """Settings that say whose lines these are, with their values; one run has lines of one."""
        return {}

    def inputs(self) -> list[str]:
        """List files that are read besides the configuration."""
        return []

    def left(self, view: str) -> tuple[str, int] | None:
        """Say after which lines, and how many of them, a recorded view was left; None if whole."""
        return None

    def recorded(self, view: str, name: str) -> list[IntArray]:
        """Give the pixels of a recording's lines of a name, in their order; none if measured."""
        return []

    @abstractmethod
    def open(
        self,
        scene: Any,
        laser: TwoMirror,
        target: Target | None = None,
        seed: int = 0,
        view: str = "",
    ) -> AbstractContextManager[Instrument]:
        """Open the instrument in one view; leaving it sends the mirrors home, the generator off.

        Parameters
        ----------
        scene : Scene or None
            Of the virtual lab; only a simulation looks at it.
        seed : int
            Of everything random in a simulation.
        view : str
            Empty stays where the instrument is.
        """
