"""Units of vibrometry, with their spellings, their size in SI and the powers of their dimensions.

A name is a spelling of a unit with that of a prefix before it and perhaps a plural's s behind it.
Assumed is that nothing else is a unit: a table of all units there are would understand ``pt/s`` as
pints a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import pi
from typing import NamedTuple

#: Prefixes by their factor, each with its spellings, in the order in which they are tried.
PREFIXES = {
    "": (1.0, ""),
    "quecto": (1e-30, "q"),
    "ronto": (1e-27, "r"),
    "yocto": (1e-24, "y"),
    "zepto": (1e-21, "z"),
    "atto": (1e-18, "a"),
    "femto": (1e-15, "f"),
    "pico": (1e-12, "p"),
    "nano": (1e-9, "n"),
    "micro": (1e-6, "µ μ u mu mc"),
    "milli": (1e-3, "m"),
    "centi": (1e-2, "c"),
    "deci": (1e-1, "d"),
    "deca": (1e1, "da deka"),
    "hecto": (1e2, "h"),
    "kilo": (1e3, "k"),
    "mega": (1e6, "M"),
    "giga": (1e9, "G"),
    "tera": (1e12, "T"),
    "peta": (1e15, "P"),
    "exa": (1e18, "E"),
    "zetta": (1e21, "Z"),
    "yotta": (1e24, "Y"),
    "ronna": (1e27, "R"),
    "quetta": (1e30, "Q"),
}
_POUND, _INCH, _G = 0.45359237, 0.0254, 9.80665
#: Size in SI, powers of length, time, mass, current and temperature, and further spellings.
UNITS: dict[str, tuple[float, tuple[int, int, int, int, int], str]] = {
    "meter": (1.0, (1, 0, 0, 0, 0), "m metre"),
    "angstrom": (1e-10, (1, 0, 0, 0, 0), "Å ångström Å"),
    "micron": (1e-6, (1, 0, 0, 0, 0), "µ μ"),
    "thou": (1e-3 * _INCH, (1, 0, 0, 0, 0), "th mil_length"),
    "inch": (_INCH, (1, 0, 0, 0, 0), "in inches international_inch international_inches"),
    "foot": (12 * _INCH, (1, 0, 0, 0, 0), "ft feet international_foot international_feet"),
    "yard": (36 * _INCH, (1, 0, 0, 0, 0), "yd international_yard"),
    "second": (1.0, (0, 1, 0, 0, 0), "s sec"),
    "minute": (60.0, (0, 1, 0, 0, 0), "min"),
    "hour": (3600.0, (0, 1, 0, 0, 0), "h hr"),
    "hertz": (1.0, (0, -1, 0, 0, 0), "Hz"),
    "galileo": (1e-2, (1, -2, 0, 0, 0), "Gal"),
    "standard_gravity": (_G, (1, -2, 0, 0, 0), "g_0 g0 g_n gravity"),
    "radian": (1.0, (0, 0, 0, 0, 0), "rad"),
    "degree": (pi / 180, (0, 0, 0, 0, 0), "deg arcdeg arcdegree angular_degree"),
    "gram": (1e-3, (0, 0, 1, 0, 0), "g"),
    "newton": (1.0, (1, -2, 1, 0, 0), "N"),
    "dyne": (1e-5, (1, -2, 1, 0, 0), "dyn"),
    "force_kilogram": (_G, (1, -2, 1, 0, 0), "kgf kilogram_force"),
    "force_pound": (_POUND * _G, (1, -2, 1, 0, 0), "lbf pound_force"),
    "pascal": (1.0, (-1, -2, 1, 0, 0), "Pa"),
    "bar": (1e5, (-1, -2, 1, 0, 0), ""),
    "pound_force_per_square_inch": (_POUND * _G / _INCH**2, (-1, -2, 1, 0, 0), "psi"),
    "joule": (1.0, (2, -2, 1, 0, 0), "J"),
    "watt": (1.0, (2, -3, 1, 0, 0), "W"),
    "ampere": (1.0, (0, 0, 0, 1, 0), "A amp"),
    "coulomb": (1.0, (0, 1, 0, 1, 0), "C"),
    "volt": (1.0, (2, -3, 1, -1, 0), "V"),
    "ohm": (1.0, (2, -3, 1, -2, 0), "Ω"),
    "kelvin": (1.0, (0, 0, 0, 0, 1), "K degK °K degree_Kelvin degreeK"),
}
DIMENSIONS = ("length", "time", "mass", "current", "temperature")

_PREFIX_OF = {said: name for name, (_, more) in PREFIXES.items() for said in (name, *more.split())}
_UNIT_OF = {said: name for name, (_, _, more) in UNITS.items() for said in (name, *more.split())}


class PrefixedUnit(NamedTuple):
    """A unit by its name, with that of its prefix, which may be empty."""

    prefix: str
    unit: str


@dataclass(frozen=True)
class UnitProduct:
    """Product of powers of units.

    Parameters
    ----------
    above, below : float
        Size in SI of the units that are multiplied, and of those that it is divided by: a
        kilometre an hour is 1000 / 3600 then, and not 1000 times a rounded number.
    exponents : tuple of float
        Of `DIMENSIONS`.
    """

    above: float = 1.0
    below: float = 1.0
    exponents: tuple[float, ...] = (0.0,) * len(DIMENSIONS)

    @classmethod
    def from_unit(cls, unit: PrefixedUnit) -> UnitProduct:
        """Make the product of a unit alone."""
        size, exponents, _ = UNITS[unit.unit]
        return cls(PREFIXES[unit.prefix][0] * size, 1.0, tuple(map(float, exponents)))

    def __pow__(self, exponent: float) -> UnitProduct:
        above, below = (self.above, self.below) if exponent > 0 else (self.below, self.above)
        exponents = tuple(exponent * e for e in self.exponents)
        return UnitProduct(above ** abs(exponent), below ** abs(exponent), exponents)

    def __mul__(self, other: UnitProduct) -> UnitProduct:
        exponents = tuple(a + b for a, b in zip(self.exponents, other.exponents, strict=True))
        return UnitProduct(self.above * other.above, self.below * other.below, exponents)

    @property
    def size(self) -> float:
        """Size in SI."""
        return self.above / self.below

    @property
    def powers(self) -> dict[str, float]:
        """Powers of the dimensions that it has."""
        return {name: e for name, e in zip(DIMENSIONS, self.exponents, strict=True) if e}


@lru_cache(maxsize=512)
def readings(name: str) -> tuple[PrefixedUnit, ...]:
    """Find all units that a name may mean, the likelier first.

    Examples
    --------
    >>> readings("min")
    (PrefixedUnit(prefix='', unit='minute'), PrefixedUnit(prefix='milli', unit='inch'))
    """
    return tuple(_readings(name))


def _readings(name: str) -> Iterator[PrefixedUnit]:
    for suffix in ("", "s"):
        if not name.endswith(suffix):
            continue
        stem = name.removesuffix(suffix) if suffix else name
        for said, prefix in _PREFIX_OF.items():
            rest = stem.removeprefix(said)
            if not stem.startswith(said) or (suffix and len(rest) == 1):
                continue
            if rest in _UNIT_OF:
                yield PrefixedUnit(prefix, _UNIT_OF[rest])
