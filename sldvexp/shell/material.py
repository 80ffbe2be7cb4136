"""`material=isotropic`: what a thin structure is made of, and how well that is known."""

from __future__ import annotations

from dataclasses import dataclass, field

from sldvexp.config.registry import register
from sldvexp.errors import Checks


@dataclass
class Tolerance:
    """Standard uncertainties of a material's properties, in the properties' own units.

    Parameters
    ----------
    thickness : float, m
    E : float, Pa
    nu : float
    """

    thickness: float = 0.0
    E: float = 0.0
    nu: float = 0.0


@register("material", "isotropic")
@dataclass
class Isotropic:
    """A sheet of the same properties everywhere and in all directions.

    Parameters
    ----------
    thickness : float, m
        Of the sheet, everywhere.
    E : float, Pa
        Young's modulus; stresses need it.
    nu : float
        Poisson's ratio.
    tolerance : Tolerance
        Standard uncertainties, which go into the bounds.
    """

    thickness: float = 0.0
    E: float = 70.0e9
    nu: float = 0.33
    tolerance: Tolerance = field(default_factory=Tolerance)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.positive("E", self.E)
        checks.require(-1 < self.nu < 0.5, "nu", f"must lie between -1 and 0.5, not {self.nu}")
        message = (
            "must be given, in m, as in 0.003: strain and motion along the surface depend on it"
        )
        checks.require(self.thickness > 0, "thickness", message)
        for name in ("thickness", "E", "nu"):
            checks.non_negative(f"tolerance.{name}", getattr(self.tolerance, name))
        checks.done()
