"""Modes of a rectangular plate or cylindrical panel in closed form.

On supported edges bending is ``w = sin(k_s s) sin(k_t t)``, on free ones a product of cosines. The
natural frequencies are those of the sheet, with ``k^2 = k_s^2 + k_t^2``, ``D = E h^3 / 12 (1 -
nu^2)``, ``C = E h / (1 - nu^2)`` and the share c by which normals turn:

    bending                  rho h omega^2 = c D k^4,   c = 1 / (1 + D k^2 / (5/6 G h)) with shear
    compression, grad sin sin              = C k^2
    shear, curl sin sin                    = G h k^2
    a curved panel                         eigenvalues of the three together (Donnell)

`Coupling.donnell` solves ``K - omega^2 rho h = 0`` of ``u = U cos sin``, ``v = V sin cos`` and
``w = W sin sin``, with the strains ``u,s + w/R``, ``v,t``, ``u,t + v,s`` of the middle and the
bending of a flat plate; it is exact for edges that hold w and what is along them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from sldvexp.errors import Checks
from sldvexp.typing import Array
from sldvexp.virtual_lab.motion import DampedModes, Derivative, Sheet

#: Part of the section that carries shear (Mindlin).
KAPPA = 5 / 6


class EdgeSupport(Enum):
    """How the plate's edges are held; decides the shapes of bending."""

    supported = "supported"
    free = "free"


class Direction(Enum):
    """Where a mode moves the middle surface.

    Attributes
    ----------
    x, y
        Along the plate's own x or y alone.
    normal
        Along its normal: bending.
    compression, shear
        Along the plate, as waves of tension or of shear that are in equilibrium by themselves.
    """

    x = 0
    y = 1
    normal = 2
    compression = 3
    shear = 4


class Coupling(Enum):
    """Motion of a curved panel's middle surface along itself while it bends.

    Attributes
    ----------
    none
        It has none.
    inextensional
        As much as keeps the arc's length: ``du/ds = -w / R``.
    donnell
        That of Donnell's equations.
    """

    none = "none"
    inextensional = "inextensional"
    donnell = "donnell"


@dataclass
class Mode:
    """One damped mode of the plate.

    Bending has the shape ``sin(x pi s / a) sin(y pi t / b)`` of supported or
    ``cos(x pi s / a) cos(y pi t / b)`` of free edges, motion along x or y always the latter.

    Parameters
    ----------
    x, y : int
        Half waves along the plate's two sides.
    frequency : float, Hz, optional
        Of the undamped mode; without it the natural one of the plate's sheet.
    damping : float
        Over critical.
    velocity : float, m/s per V of excitation
        Peak at an antinode of the middle surface, at resonance, where it is in phase with the
        excitation; negative for opposite phase. Of compression and shear the root of the squares
        of both components' peaks.
    direction : Direction
    membrane : list of 2 float
        Motion of the middle surface along itself in phase with the bending, ``w,s / k_s`` and
        ``w,t / k_t`` times these; none without it.
    """

    x: int = 1
    y: int = 1
    frequency: float | None = None
    damping: float = 0.01
    velocity: float = 0.02
    direction: Direction = Direction.normal
    membrane: list[float] = field(default_factory=list)

    def check(self, checks: Checks, name: str, edges: EdgeSupport) -> None:
        """Note under `name` what no mode can be."""
        if self.frequency is not None:
            checks.positive(f"{name}.frequency", self.frequency)
        checks.positive(f"{name}.damping", self.damping)
        checks.finite(f"{name}.velocity", self.velocity)
        both = self.direction in (Direction.compression, Direction.shear)
        sines = self.direction is Direction.normal and edges is EdgeSupport.supported
        least = 1 if sines or both else 0
        for key in ("x", "y"):
            message = f"must be {least} or more half waves, not {getattr(self, key)}"
            checks.require(getattr(self, key) >= least, f"{name}.{key}", message)
        checks.require(
            max(self.x, self.y) > 0, name, "has no half waves: a rigid motion is not a mode"
        )
        self._check_membrane(checks, f"{name}.membrane")

    def _check_membrane(self, checks: Checks, name: str) -> None:
        if not self.membrane:
            return
        message = f"must be 2 numbers, along x and y, not {len(self.membrane)}"
        checks.require(len(self.membrane) == 2, name, message)
        checks.finite(name, *self.membrane)
        bends = self.direction is Direction.normal
        checks.require(bends, name, f"goes with bending, not with direction: {self.direction.name}")


@dataclass(frozen=True, eq=False)
class Modes(DampedModes):
    """Waves: every component of a mode is a product of a sine or cosine of s and one of t.

    ``f = amplitude cos(k_s s + phase_s) cos(k_t t + phase_t)``, f any of u, v and w.

    Parameters
    ----------
    wave_number : ndarray, shape (mode, 2), rad/m
    amplitude : ndarray, shape (mode, 3)
        Of u, v and w.
    phase : ndarray, shape (mode, 3, 2), rad
        Along s and t; 0 for cosines, -pi/2 for sines.
    """

    wave_number: Array
    amplitude: Array
    phase: Array

    def derivatives(self, coordinates: Array) -> tuple[Derivative, Derivative, Derivative]:
        """See `DampedModes`."""

        def of(component: int) -> Derivative:
            angle = coordinates[:, None, :] * self.wave_number + self.phase[:, component]
            amplitude = self.amplitude[:, component]

            def derivative(i: int, j: int) -> Array:
                order = np.array([i, j])
                waves = self.wave_number**order * np.cos(angle + order * np.pi / 2)
                return np.asarray(amplitude * waves.prod(axis=-1))

            return derivative

        return of(0), of(1), of(2)


@dataclass(frozen=True)
class RectangularPlate:
    """What decides the shapes and natural frequencies of a rectangular plate.

    Parameters
    ----------
    size : tuple of 2 float, m
    edges : EdgeSupport
    sheet : Sheet
    curvature : float, 1/m
    coupling : Coupling
    shear : float, m^2
        ``1/c - 1`` over ``k^2``: how much less than the slope the normals turn.
    """

    size: tuple[float, float]
    edges: EdgeSupport
    sheet: Sheet
    curvature: float = 0.0
    coupling: Coupling = Coupling.none
    shear: float = 0.0

    def modes(self, configured: Iterable[Mode]) -> Modes:
        """Make the modes of a configuration."""
        modes = list(configured)
        wave = np.pi * np.array([[m.x, m.y] for m in modes]) / self.size
        along = (Direction.x, Direction.y)
        held = self.edges is EdgeSupport.supported
        start = np.array([-np.pi / 2 if held and m.direction not in along else 0.0 for m in modes])
        # u and v of bending are derivatives of w by s and t; those along x and y cosines as w is.
        ahead = np.array([[0.0, 0.0] if m.direction in along else [np.pi / 2] * 2 for m in modes])
        phase = np.repeat(start[:, None, None], 3, axis=1).repeat(2, axis=2)
        phase[:, 0, 0] += ahead[:, 0]
        phase[:, 1, 1] += ahead[:, 1]
        found = [self._amplitude(m, k) for m, k in zip(modes, wave, strict=True)]
        natural = [
            own if mode.frequency is None else mode.frequency
            for mode, (_, own) in zip(modes, found, strict=True)
        ]
        bends = np.array([m.direction is Direction.normal for m in modes])
        return Modes(
            frequency=np.array(natural),
            damping=np.array([m.damping for m in modes]),
            velocity=np.array([m.velocity for m in modes]),
            turning=np.where(bends, self._turning(wave), 1.0),
            wave_number=wave,
            amplitude=np.array([a for a, _ in found]),
            phase=phase,
        )

    def _turning(self, wave: Array) -> Array:
        """Compute the part of the slope by which normals turn."""
        return np.asarray(1 / (1 + self.shear * (wave**2).sum(axis=-1)))

    def _amplitude(self, mode: Mode, wave: Array) -> tuple[Array, float]:
        """Find a mode's amplitudes of u, v, w, and its natural frequency, Hz."""
        k = float(np.hypot(*wave))
        own: dict[Direction, tuple[list[float], float]] = {
            Direction.x: ([1.0, 0.0, 0.0], self._resisting(wave[0], wave[1])),
            Direction.y: ([0.0, 1.0, 0.0], self._resisting(wave[1], wave[0])),
            Direction.normal: (
                [0.0, 0.0, 1.0],
                float(self._turning(wave)) * self.sheet.bending * k**4,
            ),
            Direction.compression: ([wave[0] / k, wave[1] / k, 0], self.sheet.stretching * k**2),
            Direction.shear: ([wave[1] / k, -wave[0] / k, 0], self.sheet.shearing * k**2),
        }
        amplitude, stiffness = own[mode.direction]
        shape = np.array(amplitude)
        if self.coupling is Coupling.donnell and mode.direction not in (Direction.x, Direction.y):
            shape, stiffness = self._donnell(mode.direction, wave)
        if self.coupling is Coupling.inextensional and mode.direction is Direction.normal:
            shape[0] = self.curvature / wave[0]
        if mode.membrane:
            shape[:2] += mode.membrane
        mass = self.sheet.mass
        return shape, float(np.sqrt(stiffness / mass) / (2 * np.pi)) if mass else 0.0

    def _resisting(self, along: float, across: float) -> float:
        """Compute the stiffness against motion along one side alone, N/m^3."""
        return float(self.sheet.stretching * along**2 + self.sheet.shearing * across**2)

    def _donnell(self, direction: Direction, wave: Array) -> tuple[Array, float]:
        """Solve the three equations of a panel; bending is softest, compression stiffest."""
        (a, b), k, nu = wave, self.curvature, self.sheet.nu
        # Strains ss, tt and the doubled st of amplitudes U, V, W.
        strain = np.array([[-a, 0, k], [0, -b, 0], [b, a, 0]])
        law = np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
        matrix = self.sheet.stretching * strain.T @ law @ strain
        matrix[2, 2] += self._turning(wave) * self.sheet.bending * (a**2 + b**2) ** 2
        stiffness, shapes = np.linalg.eigh(matrix)
        nth = [Direction.normal, Direction.shear, Direction.compression].index(direction)
        shape = shapes[:, nth]
        size = shape[2] if direction is Direction.normal else np.hypot(*shape[:2])
        sign = 1.0 if direction is Direction.normal else np.sign(shape[0])
        return shape * sign / size, float(stiffness[nth])
