"""`instrument=uff`: what vibrometers and analysers wrote into universal files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from sldvexp.errors import Checks
from sldvexp.instrument.pointwise import Pointwise
from sldvexp.registry import register

if TYPE_CHECKING:
    from sldvexp.instrument.measured import Measured


class Kind(Enum):
    """Which functions are read; the value is their type in data set 58."""

    frf = 4
    spectrum = 12
    time = 1


@register("instrument", "uff")
@dataclass
class Uff(Pointwise):
    """Functions and geometry of universal files (data sets 58, 58b, 15, 2411, 2412, 82, ...).

    What a file does not say, and a setting does not either, is asked for.

    Parameters
    ----------
    geometry : str
        File with the nodes; empty for those in each view's own file.
    function : Kind, optional
        Needed if a file has more than one of frequency response functions, spectra, time records.
    containing : str
        Text that the identifying lines of a function must have, as ``H1``.
    averages : int
        Of spectra behind each response function: with it, standard errors come from the file's
        coherence functions. 0 if not known.
    time_reference : str
        Of time records: degree of freedom of the one whose phase is zero, as ``99+Z``, or
        ``trigger`` if all begin at one phase of the excitation.
    """

    geometry: str = ""
    function: Kind | None = None
    containing: str = ""
    averages: int = 0
    time_reference: str = ""

    def check(self, checks: Checks) -> None:
        """Note what cannot be."""
        both = self.std is not None and self.averages
        checks.require(not both, "averages", "give either std or averages, not both")
        message = f"must be zero or a positive integer, not {self.averages}"
        checks.require(self.averages >= 0, "averages", message)

    def inputs(self) -> list[str]:
        """The universal files."""
        return [*([self.geometry] if self.geometry else []), *super().inputs()]

    def measured(self) -> Iterator[Measured]:
        """What the views' files say; see `sldvexp.instrument.uff_views.measured`."""
        from sldvexp.instrument.uff_views import measured

        return measured(self)
