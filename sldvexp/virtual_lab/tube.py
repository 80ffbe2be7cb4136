"""`scene=tube`: a vibrating closed circular tube, whose walls bend with hardly any stretch.

Its modes have n waves around and m half waves along it,

    u = U sin a f(t),   v = V cos a f'(t) / k,   w = W cos a f(t),   a = n (phi - phi_0),

u around, v along the axis and w outwards, with k = m pi / L and f = sin k t on supported ends,
which hold w and u and let v go, or f = 1 (m = 0) of a ring or a tube with free ends. The amplitudes
are eigenvectors of the tube's energy per area under this motion,

    potential  1/2 int e' C e (1 + z/R) dz,     kinetic  rho/2 omega^2 int |V|^2 (1 + z/R) dz,

with strains and motion at each height z as `sldvexp.virtual_lab.motion` has them, and plane stress
C. On supported ends that is exact in Love's theory; a ring's lowest are Rayleigh's ``U = -W / n``
nearly, with natural frequencies ``omega^2 = D n^2 (n^2 - 1)^2 / (rho h R^4 (n^2 + 1))``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.geometry import rotation_from_euler
from sldvexp.typing import Array
from sldvexp.virtual_lab.modes import Modes
from sldvexp.virtual_lab.motion import DampedModes, Sheet
from sldvexp.virtual_lab.plate import AnyPlate, VibratingScene
from sldvexp.virtual_lab.surface import CylinderSurface, PlateSurface

#: Gauss points through the wall.
THROUGH = 4


class TubeMotion(Enum):
    """Family of a tube's modes, from the softest to the stiffest of one shape.

    Attributes
    ----------
    bending
        The walls bend, and stretch hardly.
    shear, compression
        They move along themselves.
    """

    bending = 0
    shear = 1
    compression = 2


@dataclass
class TubeMode:
    """One damped mode of the tube.

    Parameters
    ----------
    waves : int
        Whole waves around.
    half_waves : int
        Along the tube between supported ends; 0 is the same all along.
    angle : float, deg
        Where w has an antinode, from the tube's own z axis towards x.
    motion : TubeMotion
    frequency : float, Hz, optional
        Of the undamped mode; without it the natural one.
    damping : float
        Over critical.
    velocity : float, m/s per V of excitation
        Peak of w at an antinode at resonance; of shear and compression that along the wall.
    """

    waves: int = 2
    half_waves: int = 0
    angle: float = 0.0
    motion: TubeMotion = TubeMotion.bending
    frequency: float | None = None
    damping: float = 0.01
    velocity: float = 0.02

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no mode can be."""
        message = f"must be 1 or more, not {self.waves}"
        checks.require(self.waves >= 1, f"{name}.waves", message)
        message = f"must be 0 or more, not {self.half_waves}"
        checks.require(self.half_waves >= 0, f"{name}.half_waves", message)
        rigid = self.motion is TubeMotion.bending and (self.waves, self.half_waves) == (1, 0)
        message = "of 1 without half waves moves the tube as a whole: no bending"
        checks.require(not rigid, f"{name}.waves", message)
        checks.finite(f"{name}.angle", self.angle)
        if self.frequency is not None:
            checks.positive(f"{name}.frequency", self.frequency)
        checks.positive(f"{name}.damping", self.damping)
        checks.finite(f"{name}.velocity", self.velocity)


@dataclass
class Tube(AnyPlate):
    """A closed circular tube; its own axes stand in its middle, the axis of revolution along y.

    Parameters
    ----------
    radius : float
        Of the middle surface.
    length : float
    modes : dict of str to TubeMode
    """

    radius: float = 0.06
    length: float = 0.2
    modes: dict[str, TubeMode] = field(default_factory=dict)

    @property
    def mode_names(self) -> tuple[str, ...]:
        """See `AnyPlate`."""
        return tuple(self.modes)

    @property
    def place(self) -> Array:
        """See `AnyPlate`: the surface's own center is where the tube's own z leaves it."""
        return super().place + self.unit.value * self.radius * rotation_from_euler(self.euler)[2]

    def surface(self) -> PlateSurface:
        """See `AnyPlate`."""
        radius, length = self.unit.value * self.radius, self.unit.value * self.length
        size = np.array([2 * math.pi * radius, length])
        height, none = self.unit.value * self.thickness / 2, np.empty((0, 2, 2))
        return CylinderSurface(size, height, none, radius)

    def vibration(self) -> DampedModes:
        """See `AnyPlate`."""
        unit = self.unit.value
        wall = TubeWall(unit * self.radius, unit * self.length, self.sheet)
        return wall.modes(self.modes.values())

    def check(self, checks: Checks, name: str) -> None:
        """See `AnyPlate`."""
        super().check(checks, name)
        checks.positive(f"{name}.thickness", self.thickness)
        checks.positive(f"{name}.length", self.length)
        message = f"must be above half the thickness, not {self.radius}"
        checks.require(self.radius > self.thickness / 2, f"{name}.radius", message)
        checks.require(bool(self.modes), f"{name}.modes", "give at least one mode")
        for mode_name, mode in self.modes.items():
            mode.check(checks, f"{name}.modes.{mode_name}")


@dataclass(frozen=True)
class TubeWall:
    """What decides the shapes and natural frequencies of a tube.

    Parameters
    ----------
    radius, length : float, m
    sheet : Sheet
    """

    radius: float
    length: float
    sheet: Sheet

    def modes(self, configured: Iterable[TubeMode]) -> Modes:
        """Make the modes of a configuration, on coordinates (s, t) from one corner."""
        modes = list(configured)
        wave = np.array(
            [[m.waves / self.radius, m.half_waves * math.pi / self.length] for m in modes]
        )
        found = [self.natural(m.waves, m.half_waves, m.motion) for m in modes]
        amplitude = np.array([shape for shape, _ in found])
        # s is half the circumference where phi is none; sines are a quarter behind cosines.
        start = [-m.waves * (math.pi + math.radians(m.angle)) for m in modes]
        quarter, phase = math.pi / 2, np.zeros((len(modes), 3, 2))
        phase[:, :, 0] = np.array(start)[:, None] - [quarter, 0, 0]
        supported = wave[:, 1] > 0
        phase[:, :, 1] = np.where(supported[:, None], [-quarter, 0.0, -quarter], 0.0)
        natural = [
            own if m.frequency is None else m.frequency
            for m, (_, own) in zip(modes, found, strict=True)
        ]
        return Modes(
            frequency=np.array(natural),
            damping=np.array([m.damping for m in modes]),
            velocity=np.array([m.velocity for m in modes]),
            turning=np.ones(len(modes)),
            wave_number=wave,
            amplitude=amplitude,
            phase=phase,
        )

    def natural(self, waves: int, half_waves: int, motion: TubeMotion) -> tuple[Array, float]:
        """Find amplitudes of u, v, w and the natural frequency, Hz.

        Examples
        --------
        >>> from sldvexp.virtual_lab.motion import Sheet
        >>> wall = TubeWall(0.06, 0.2, Sheet(70e9, 0.33, 2700.0, 0.003))
        >>> shape, hertz = wall.natural(2, 0, TubeMotion.bending)
        >>> shape[[0, 2]].round(3).tolist(), round(hertz)
        ([-0.5, 1.0], 554)
        """
        potential, kinetic = self._energies(waves / self.radius, half_waves * math.pi / self.length)
        used = np.arange(3) if half_waves else np.array([0, 2])
        stiff, mass = potential[np.ix_(used, used)], kinetic[np.ix_(used, used)]
        root = np.linalg.inv(np.linalg.cholesky(mass))
        values, vectors = np.linalg.eigh(root @ stiff @ root.T)
        shape = np.zeros(3)
        nth = min(motion.value, len(used) - 1)
        shape[used] = root.T @ vectors[:, nth]
        bends = motion is TubeMotion.bending
        size = shape[2] if bends else math.copysign(math.hypot(*shape[:2]), shape[0])
        return shape / size, math.sqrt(max(values[nth], 0.0)) / (2 * math.pi)

    def _energies(self, around: float, along: float) -> tuple[Array, Array]:
        """Compute both energies as forms of (U, V, W), for wave numbers around and along, rad/m."""
        k, h, nu = 1 / self.radius, self.sheet.thickness, self.sheet.nu
        stiff = self.sheet.E / (1 - nu**2)
        law = stiff * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
        potential, kinetic = np.zeros((3, 3)), np.zeros((3, 3))
        for node, weight in zip(*np.polynomial.legendre.leggauss(THROUGH), strict=True):
            z = node * h / 2
            wide = 1 + k * z
            # Of u sin f, v cos f'/k, w cos f: each strain's own sine or cosine left out.
            strain = np.array(
                [
                    [around, 0, (k + z * around**2) / wide],
                    [0, -along, z * along**2],
                    [wide * along, -around / wide, z * around * along * (1 + 1 / wide)],
                ]
            )
            motion = np.array([[wide, 0, z * around], [0, 1, -z * along], [0, 0, 1]])
            share = weight * h / 2 * wide
            potential += share * strain.T @ law @ strain
            kinetic += share * self.sheet.rho * motion.T @ motion
        return potential, kinetic


@register("scene", "tube")
@dataclass
class TubeScene(VibratingScene):
    """A vibrating tube; beside it the calibration object, if `target` has circles.

    Parameters
    ----------
    plate : Tube
    """

    plate: Tube = field(default_factory=Tube)
