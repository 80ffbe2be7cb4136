"""`scene=plate`: a vibrating plate or cylindrical panel beside the calibration object."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.targets.circles import Circles
from sldvexp.units import LengthUnit
from sldvexp.virtual_lab.calibration_scene import Calibration

if TYPE_CHECKING:
    import numpy as np

    from sldvexp.targets.base import Target
    from sldvexp.virtual_lab.scene_object import SceneObject


class Edges(Enum):
    """How the plate's edges are held; decides the shapes of bending."""

    supported = "supported"
    free = "free"


class Direction(Enum):
    """Where a mode moves the middle surface: along the plate's own x, its y, or its normal."""

    x = 0
    y = 1
    normal = 2


@dataclass
class Mode:
    """One damped mode of the plate.

    Bending has the shape ``sin(x pi s / a) sin(y pi t / b)`` of supported or
    ``cos(x pi s / a) cos(y pi t / b)`` of free edges, motion in the plane always the latter.

    Parameters
    ----------
    x, y : int
        Half waves along the plate's two sides.
    frequency : float, Hz
        Of the undamped mode.
    damping : float
        Over critical.
    velocity : float, m/s per V of excitation
        Peak at an antinode of the middle surface, at resonance, where it is in phase with the
        excitation; negative for opposite phase.
    direction : Direction
        `normal` is bending; `x` and `y` are motion in the plane.
    """

    x: int = 1
    y: int = 1
    frequency: float = 200.0
    damping: float = 0.01
    velocity: float = 0.02
    direction: Direction = Direction.normal

    def check(self, checks: Checks, name: str, edges: Edges) -> None:
        """Note under `name` what no mode can be."""
        checks.positive(f"{name}.frequency", self.frequency)
        checks.positive(f"{name}.damping", self.damping)
        checks.finite(f"{name}.velocity", self.velocity)
        sines = self.direction is Direction.normal and edges is Edges.supported
        least = 1 if sines else 0
        for key in ("x", "y"):
            message = f"must be {least} or more half waves, not {getattr(self, key)}"
            checks.require(getattr(self, key) >= least, f"{name}.{key}", message)
        checks.require(
            max(self.x, self.y) > 0, name, "has no half waves: a rigid motion is not a mode"
        )


@dataclass
class Plate:
    """A rectangular thin plate, flat or bent to a cylinder about its own y axis.

    The plate's own axes stand at the center of its middle surface, z along its normal.

    Parameters
    ----------
    unit : LengthUnit
        Unit of all lengths below.
    center : list of 3 float
        Where the center stands in the world.
    euler : list of 3 float, rad
        phi1, phi2, phi3 in the x-convention, world to plate.
    size : list of 2 float
        Sides along its own x (the arc, if it is curved) and y.
    thickness : float
        The beam sees the surface half of this above the middle surface.
    radius : float, optional
        Of the middle surface's curvature; positive if the normal points away from the axis of
        the cylinder, negative towards it. Without it the plate is flat.
    edges : Edges
        How they are held; decides the shapes of bending.
    modes : dict of str to Mode
    """

    unit: LengthUnit = LengthUnit.m
    center: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    euler: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    size: list[float] = field(default_factory=lambda: [0.3, 0.25])
    thickness: float = 0.003
    radius: float | None = None
    edges: Edges = Edges.supported
    modes: dict[str, Mode] = field(default_factory=dict)

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no plate can be."""
        known = len(checks.problems)
        for key, count in (("center", 3), ("euler", 3), ("size", 2)):
            values = getattr(self, key)
            message = f"must be {count} numbers, not {len(values)}"
            checks.require(len(values) == count, f"{name}.{key}", message)
            checks.finite(f"{name}.{key}", *values)
        for side in self.size:
            checks.positive(f"{name}.size", side)
        checks.non_negative(f"{name}.thickness", self.thickness)
        checks.require(bool(self.modes), f"{name}.modes", "give at least one mode")
        for mode_name, mode in self.modes.items():
            mode.check(checks, f"{name}.modes.{mode_name}", self.edges)
        if self.radius is not None and len(checks.problems) == known:
            self._check_radius(checks, f"{name}.radius", self.radius)

    def _check_radius(self, checks: Checks, name: str, radius: float) -> None:
        least = max(self.thickness / 2, self.size[0] / (2 * math.pi))
        checks.require(
            math.isfinite(radius) and abs(radius) > least,
            name,
            f"must be finite and beyond +-{least:.6g} {self.unit.name}, where the panel would "
            f"close to a tube or its surface vanish, not {radius}",
        )


@register("scene", "plate")
@dataclass
class PlateScene(Calibration):
    """A vibrating plate; beside it the calibration object, if `target` has circles.

    Parameters
    ----------
    plate : Plate
    """

    plate: Plate = field(default_factory=Plate)

    def check(self, checks: Checks) -> None:
        """Note what is wrong with the plate, the speakers and washers."""
        super().check(checks)
        self.plate.check(checks, "plate")

    def objects(self, target: Target | None, rng: np.random.Generator) -> list[SceneObject]:
        """The plate, and the calibration object if there is one."""
        from sldvexp.virtual_lab.plate import VibratingPlate

        objects = super().objects(target, rng) if isinstance(target, Circles) else []
        return [*objects, VibratingPlate.built(self.plate)]
