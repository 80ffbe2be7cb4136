"""Modes of a thin plate or cylindrical panel: motion and strain of its surface, in closed form.

With u, v along the middle surface's coordinates s, t, w along the normal, curvature k along s, and
z the height above the middle surface, normals stay straight and normal (Love, Kirchhoff):

    u(z) = (1 + k z) u - z dw/ds,    v(z) = v - z dw/dt,    w(z) = w.

A flat plate has k = 0. The strains are the exact ones of this motion on the surface at height z.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from sldvexp.errors import Checks
from sldvexp.typing import Array, ComplexArray, IntArray


class EdgeSupport(Enum):
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

    def check(self, checks: Checks, name: str, edges: EdgeSupport) -> None:
        """Note under `name` what no mode can be."""
        checks.positive(f"{name}.frequency", self.frequency)
        checks.positive(f"{name}.damping", self.damping)
        checks.finite(f"{name}.velocity", self.velocity)
        sines = self.direction is Direction.normal and edges is EdgeSupport.supported
        least = 1 if sines else 0
        for key in ("x", "y"):
            message = f"must be {least} or more half waves, not {getattr(self, key)}"
            checks.require(getattr(self, key) >= least, f"{name}.{key}", message)
        checks.require(
            max(self.x, self.y) > 0, name, "has no half waves: a rigid motion is not a mode"
        )


@dataclass(frozen=True, eq=False)
class Modes:
    """Damped modes, all arrays with one entry a mode.

    Parameters
    ----------
    wave_number : ndarray, shape (mode, 2), rad/m
    phase : ndarray, shape (mode,), rad
        0 for cosines, -pi/2 for sines.
    direction : ndarray of int, shape (mode,)
        Values of `Direction`.
    frequency : ndarray, shape (mode,), Hz
    damping : ndarray, shape (mode,)
    velocity : ndarray, shape (mode,), m/s per V
        At resonance.
    """

    wave_number: Array
    phase: Array
    direction: IntArray
    frequency: Array
    damping: Array
    velocity: Array

    @classmethod
    def built(cls, modes: Iterable[Mode], size: Array, edges: EdgeSupport) -> Modes:
        """Make the modes of a configuration on a plate of that size, m."""
        modes = list(modes)
        sines = [m.direction is Direction.normal and edges is EdgeSupport.supported for m in modes]
        return cls(
            wave_number=np.pi * np.array([[m.x, m.y] for m in modes]) / size,
            phase=np.where(sines, -np.pi / 2, 0.0),
            direction=np.array([m.direction.value for m in modes]),
            frequency=np.array([m.frequency for m in modes]),
            damping=np.array([m.damping for m in modes]),
            velocity=np.array([m.velocity for m in modes]),
        )

    def response(self, frequency: Array) -> ComplexArray:
        """Compute ``v 2i zeta r / (1 - r^2 + 2i zeta r)``, r = frequency / own frequency.

        Parameters
        ----------
        frequency : ndarray, shape (tone,), Hz

        Returns
        -------
        ndarray of complex, shape (mode, tone), m/s per V
        """
        r = frequency / self.frequency[:, None]
        damped = 2j * self.damping[:, None] * r
        return np.asarray(self.velocity[:, None] * damped / (1.0 - r**2 + damped), complex)

    def motion(self, coordinates: Array, height: float, curvature: float) -> Array:
        """Compute shape of each mode on the surface at a height: u, v, w along its local axes.

        Parameters
        ----------
        coordinates : ndarray, shape (point, 2), m
        height : float, m
        curvature : float, 1/m

        Returns
        -------
        ndarray, shape (point, mode, 3)
        """
        u, v, w = (self._derivative(coordinates, d) for d in Direction)
        stretch = 1.0 + curvature * height
        return np.stack(
            [stretch * u(0, 0) - height * w(1, 0), v(0, 0) - height * w(0, 1), w(0, 0)], axis=-1
        )

    def strain(self, coordinates: Array, height: float, curvature: float) -> Array:
        """Compute strains e_ss, e_tt, e_st (tensor) of each mode on the surface at a height.

        Parameters
        ----------
        coordinates : ndarray, shape (point, 2), m
        height : float, m
        curvature : float, 1/m

        Returns
        -------
        ndarray, shape (point, mode, 3), 1/m
            Per unit of the mode's displacement.
        """
        u, v, w = (self._derivative(coordinates, d) for d in Direction)
        stretch = 1.0 + curvature * height
        along_s = u(1, 0) + (curvature * w(0, 0) - height * w(2, 0)) / stretch
        along_t = v(0, 1) - height * w(0, 2)
        shear = (v(1, 0) - height * w(1, 1)) / stretch + stretch * u(0, 1) - height * w(1, 1)
        return np.stack([along_s, along_t, shear / 2], axis=-1)

    def _derivative(self, coordinates: Array, direction: Direction) -> Callable[[int, int], Array]:
        """Make the function (i, j) -> i-th derivative by s, j-th by t, in one direction."""
        angle = coordinates[:, None, :] * self.wave_number + self.phase[:, None]
        moving = self.direction == direction.value

        def derivative(i: int, j: int) -> Array:
            order = np.array([i, j])
            waves = self.wave_number**order * np.cos(angle + order * np.pi / 2)
            return np.where(moving, waves.prod(axis=-1), 0.0)

        return derivative
