"""Settings that sums of records are made with, and which are in them for good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.typing import Array

#: Settings of the group `signal`, by their names here; all others are of the scan's sampling.
OF_SIGNAL = {
    "velocity_per_volt": "signal.velocity_per_volt",
    "dropout_factor": "signal.flags.dropout_factor",
    "reference_minimum": "signal.flags.reference_minimum",
}


@dataclass(frozen=True)
class SumsSettings:
    """Settings that `ResponseSums` are made with.

    A journal keeps them as numbers in this order, so that new ones come last.

    Parameters
    ----------
    velocity_per_volt : float, m/s/V
        A plain factor, which alone can be exchanged in sums.
    dropout_factor, reference_minimum : float
        Of `FlagRules`: which records were left out.
    force : float, s
    overlap : bool
        Of `Excitation`: how records were windowed and cut.
    again : int
        Records of each pixel at most that were taken in the place of spoilt ones.

    Examples
    --------
    >>> made, asked = SumsSettings(0.01, 5.0, 0.1), SumsSettings(0.02, 5.0, 0.1, again=3)
    >>> list(made.unlike(asked))
    [('sampling.again', 0, 3)]
    """

    velocity_per_volt: float
    dropout_factor: float
    reference_minimum: float
    force: float = 0.0
    overlap: bool = False
    again: int = 0

    def to_array(self) -> Array:
        """Give the numbers that a journal keeps."""
        return np.array(astuple(self), float)

    @classmethod
    def from_array(cls, kept: ArrayLike) -> Self:
        """Make the settings of what `to_array` gave.

        Raises
        ------
        ValueError
            If these are not as many numbers.
        """
        numbers = np.asarray(kept, float)
        if numbers.shape != (len(fields(cls)),):
            raise ValueError("no settings of sums")
        volts, dropout, least, force, overlap, again = numbers.tolist()
        return cls(volts, dropout, least, force, bool(overlap), int(again))

    def unlike(self, asked: SumsSettings) -> Iterator[tuple[str, float, float]]:
        """Name the settings that are asked for otherwise and cannot be exchanged, with both values.

        Parameters
        ----------
        asked : SumsSettings
        """
        for each in fields(self)[1:]:
            here, there = (getattr(settings, each.name) for settings in (self, asked))
            if here != there:
                yield OF_SIGNAL.get(each.name, f"sampling.{each.name}"), here, there
