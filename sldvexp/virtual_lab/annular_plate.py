"""`scene=annular_plate`: a vibrating disc with a round hole, whose strain peaks at the hole."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.typing import Array, BoolArray
from sldvexp.virtual_lab.annular import AnnularMode, AnnularModes, Annulus, EdgeCondition
from sldvexp.virtual_lab.motion import DampedModes
from sldvexp.virtual_lab.plate import AnyPlate, VibratingScene
from sldvexp.virtual_lab.surface import FlatSurface, PlateSurface

#: How far beyond an edge, over the radius, still counts as on it: round-off.
RIM = 1e-9


@dataclass(frozen=True, eq=False)
class AnnularSurface(FlatSurface):
    """A flat ring; its coordinates are those of the square around it.

    Parameters
    ----------
    hole : float, m
        Radius of the hole.
    """

    hole: float

    def inside(self, coordinates: Array) -> BoolArray:
        """See `PlateSurface`."""
        radius = self.size[0] / 2
        r = np.linalg.norm(coordinates - radius, axis=-1)
        return np.asarray((r <= (1 + RIM) * radius) & (r >= self.hole - RIM * radius))


@dataclass
class AnnularPlate(AnyPlate):
    """A disc with a round hole in its middle, by Kirchhoff's theory.

    Parameters
    ----------
    radius : float
        Of the disc.
    hole : float
        Radius of the hole, whose edge is free.
    edge : EdgeCondition
        How the outer edge is held.
    modes : dict of str to AnnularMode
    """

    radius: float = 0.125
    hole: float = 0.03
    edge: EdgeCondition = EdgeCondition.supported
    modes: dict[str, AnnularMode] = field(default_factory=dict)

    @property
    def mode_names(self) -> tuple[str, ...]:
        """See `AnyPlate`."""
        return tuple(self.modes)

    def surface(self) -> PlateSurface:
        """See `AnyPlate`."""
        unit = self.unit.value
        size = np.full(2, 2 * unit * self.radius)
        none = np.empty((0, 2, 2))
        return AnnularSurface(size, unit * self.thickness / 2, none, unit * self.hole)

    def vibration(self) -> DampedModes:
        """See `AnyPlate`."""
        radius, hole = self.unit.value * self.radius, self.unit.value * self.hole
        plate = Annulus(radius, hole, self.nu, self.edge)
        return AnnularModes.built(self.modes.values(), plate, self.sheet, np.full(2, radius))

    def check(self, checks: Checks, name: str) -> None:
        """See `AnyPlate`."""
        super().check(checks, name)
        checks.positive(f"{name}.radius", self.radius)
        least, most = 0.01 * self.radius, 0.95 * self.radius
        message = (
            f"must lie between {least:.6g} and {most:.6g} {self.unit.name}, 0.01 and 0.95 of the "
            f"disc's radius, not {self.hole}"
        )
        checks.require(least <= self.hole <= most, f"{name}.hole", message)
        checks.positive(f"{name}.thickness", self.thickness)
        checks.require(bool(self.modes), f"{name}.modes", "give at least one mode")
        for mode_name, mode in self.modes.items():
            mode.check(checks, f"{name}.modes.{mode_name}")


@register("scene", "annular_plate")
@dataclass
class AnnularScene(VibratingScene):
    """A vibrating disc with a hole; beside it the calibration object, if `target` has circles.

    Parameters
    ----------
    plate : AnnularPlate
    """

    plate: AnnularPlate = field(default_factory=AnnularPlate)
