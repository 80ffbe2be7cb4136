"""`scan=by_digitizer`: the beam goes to given DAC steps, a digitizer measures where it falls."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.io import read_centres
from sldvexp.scan.base import PersonPart, check_pairs, check_view_names
from sldvexp.typing import IntArray
from sldvexp.units import LengthUnit


@dataclass
class Spots:
    """Where the beam is sent in one view, in DAC steps (up_down, left_right).

    Parameters
    ----------
    dac : list of pairs
    path : str
        A file of them (`Scan6pt`), instead.
    """

    dac: list[list[int]] = field(default_factory=list)
    path: str = ""


@register("scan", "by_digitizer")
@dataclass
class ByDigitizer(PersonPart):
    """Known DAC steps, and the places on the structure that a digitizer finds for them.

    The first of the three methods that Section 4.6.4 compares.

    Parameters
    ----------
    views : dict of str to Spots
    samples : int
        How often every spot is digitised; their mean counts (Section 4.6.3).
    unit : LengthUnit
        In which the digitizer shows coordinates.
    """

    kind: ClassVar[str] = "spots"

    views: dict[str, Spots] = field(default_factory=dict)
    samples: int = 7
    unit: LengthUnit = LengthUnit.m

    def __post_init__(self) -> None:
        checks = Checks()
        check_view_names(checks, self.views)
        for name, spots in self.views.items():
            check_pairs(checks, f"views.{name}", "dac", spots.dac, spots.path)
        checks.require(self.samples >= 1, "samples", f"must be at least 1, not {self.samples}")
        checks.done()

    def known_pixels(self, view: str) -> IntArray:
        """See `ScanPart`."""
        given = self.views[view]
        return read_centres(locate(given.path)) if given.path else np.array(given.dac, np.int64)
