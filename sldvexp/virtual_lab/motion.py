"""Modes of thin plates: motion and strain of their surface, exact at every height.

With u, v along the middle surface's coordinates s, t, w along the normal, curvature k along s, and
z the height above the middle surface, normals stay straight and turn by a part c of the slope:

    u(z) = (1 + k z) u - z c dw/ds,    v(z) = v - z c dw/dt,    w(z) = w.

With c = 1 they stay normal (Love, Kirchhoff); a plate that shears turns them by less (Mindlin). A
flat plate has k = 0. The strains are the exact ones of this motion on the surface at height z.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array, ComplexArray

#: The function (i, j) -> i-th derivative by s and j-th by t, shape (point, mode).
Derivative = Callable[[int, int], Array]


@dataclass(frozen=True)
class Sheet:
    """What a plate is made of.

    Parameters
    ----------
    E : float, Pa
    nu : float
    rho : float, kg/m^3
    thickness : float, m
    """

    E: float
    nu: float
    rho: float
    thickness: float

    @property
    def bending(self) -> float:
        """Bending stiffness ``D = E h^3 / 12 (1 - nu^2)``, N m."""
        return float(self.stretching * self.thickness**2 / 12)

    @property
    def stretching(self) -> float:
        """Stiffness against stretching ``C = E h / (1 - nu^2)``, N/m."""
        return float(self.E * self.thickness / (1 - self.nu**2))

    @property
    def shearing(self) -> float:
        """Stiffness against shear of the middle surface ``G h = E h / 2 (1 + nu)``, N/m."""
        return float(self.E * self.thickness / (2 * (1 + self.nu)))

    @property
    def mass(self) -> float:
        """Mass of an area ``rho h``, kg/m^2."""
        return self.rho * self.thickness


@dataclass(frozen=True, eq=False)
class DampedModes(ABC):
    """Damped modes of a middle surface, all arrays with one entry a mode.

    Another kind of modes implements the one hook `derivatives`.

    Parameters
    ----------
    frequency : ndarray, shape (mode,), Hz
    damping : ndarray, shape (mode,)
    velocity : ndarray, shape (mode,), m/s per V
        At resonance.
    turning : ndarray, shape (mode,)
        Part of the slope by which the normals turn.
    """

    frequency: Array
    damping: Array
    velocity: Array
    turning: Array

    @abstractmethod
    def derivatives(self, coordinates: Array) -> tuple[Derivative, Derivative, Derivative]:
        """Make the derivatives of u, v and w of the middle surface at points (point, 2), m."""

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
        u, v, w = self.derivatives(coordinates)
        stretch, lever = 1.0 + curvature * height, height * self.turning
        return np.stack(
            [stretch * u(0, 0) - lever * w(1, 0), v(0, 0) - lever * w(0, 1), w(0, 0)], axis=-1
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
        u, v, w = self.derivatives(coordinates)
        stretch, lever = 1.0 + curvature * height, height * self.turning
        along_s = u(1, 0) + (curvature * w(0, 0) - lever * w(2, 0)) / stretch
        along_t = v(0, 1) - lever * w(0, 2)
        shear = (v(1, 0) - lever * w(1, 1)) / stretch + stretch * u(0, 1) - lever * w(1, 1)
        return np.stack([along_s, along_t, shear / 2], axis=-1)
