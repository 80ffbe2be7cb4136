"""`material=isotropic`: what a thin structure is made of, and how well that is known."""

from __future__ import annotations

import math
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
    rho : float, kg/m^3
    """

    thickness: float = 0.0
    E: float = 0.0
    nu: float = 0.0
    rho: float = 0.0


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
    rho : float, kg/m^3
        Density; forces and the flow of power need it.
    tolerance : Tolerance
        Standard uncertainties, which go into the bounds.
    """

    thickness: float = 0.0
    E: float = 70.0e9
    nu: float = 0.33
    rho: float = 2700.0
    tolerance: Tolerance = field(default_factory=Tolerance)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.positive("E", self.E)
        checks.positive("rho", self.rho)
        checks.require(-1 < self.nu < 0.5, "nu", f"must lie between -1 and 0.5, not {self.nu}")
        message = (
            "must be given, in m, as in 0.003: strain and motion along the surface depend on it"
        )
        checks.require(self.thickness > 0, "thickness", message)
        for name in ("thickness", "E", "nu", "rho"):
            checks.non_negative(f"tolerance.{name}", getattr(self.tolerance, name))
        checks.done()

    @property
    def bending_stiffness(self) -> float:
        """D = E h^3 / (12 (1 - nu^2)), N m.

        Examples
        --------
        >>> round(Isotropic(thickness=0.003, E=70e9, nu=0.33).bending_stiffness, 2)
        176.75
        """
        return self.E * self.thickness**3 / (12 * (1 - self.nu**2))

    @property
    def mass(self) -> float:
        """Mass per area rho h, kg/m^2."""
        return self.rho * self.thickness

    @property
    def wave_uncertainty(self) -> float:
        """Relative standard uncertainty of rho h / D, which decides how long bending waves are."""
        known = self.tolerance
        parts = (
            known.rho / self.rho,
            known.E / self.E,
            2 * known.thickness / self.thickness,
            2 * self.nu * known.nu / (1 - self.nu**2),
        )
        return math.hypot(*parts)
