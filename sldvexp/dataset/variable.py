"""Facts about one variable of the dataset: dimensions, unit, meaning, and how people read it."""

from __future__ import annotations

import math
from typing import NamedTuple

#: Unit of a mirror's reading, which has none in SI: steps of its digital-analogue converter.
DAC = "DAC steps"

#: Units in which people read what the dataset has in SI, where a variable says nothing else.
SHOWN = {"m": "mm", "m/s": "mm/s"}

#: Shown units in those of the dataset.
FACTORS = {"mm": 1e3, "mm/s": 1e3, "deg": 180.0 / math.pi}


class Variable(NamedTuple):
    """Facts about one variable of the dataset.

    Attributes
    ----------
    dims : str
        Dimensions, an optional one in brackets.
    units : str
        In the dataset, SI; ``1`` for a number without one.
    long_name : str
        Meaning.
    shown : str
        Unit in which people read it, if `SHOWN` has another or none.
    label : str
        Short name for headings and axes.

    Examples
    --------
    >>> speed = Variable("node component", "m/s", "velocity", label="velocity")
    >>> speed.titled(), speed.titled("bound"), speed.factor * 0.25
    ('velocity, mm/s', 'bound, mm/s', 250.0)
    """

    dims: str
    units: str
    long_name: str
    shown: str = ""
    label: str = ""

    @property
    def shown_unit(self) -> str:
        """Unit in which people read it; empty if it has none."""
        unit = self.shown or SHOWN.get(self.units, self.units)
        return "" if unit == "1" else unit

    @property
    def factor(self) -> float:
        """Number by which values of the dataset are multiplied for the shown unit."""
        return 1.0 if self.shown_unit == self.units else FACTORS.get(self.shown_unit, 1.0)

    def titled(self, text: str = "") -> str:
        """Join a text, or the label, and the shown unit, as headings and axes have it."""
        return ", ".join(part for part in (text or self.label, self.shown_unit) if part)


#: The coordinate of all that is given by frequency.
FREQUENCY = Variable("frequency", "Hz", "frequency", label="frequency")
