"""Strain gages: strain that one would show at a place of the surface, as one row of the splines.

A gage shows the strain along it, averaged over its grid: with the direction d and Gauss points p of
its length and width, ``g = sum_p w_p d' e(p) d``, a linear functional of the coefficients, whose
interval has all correlations between the places in it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import Checks
from sldvexp.shell.love import ThinShell
from sldvexp.typing import Array

#: Gauss points along each side of a gage.
POINTS = 5


@dataclass
class Gage:
    """A strain gage on the measured face.

    Parameters
    ----------
    place : list of 2 float, m
        Of its middle, along the surface's first and second direction, from where both are 0: the
        center of a grid.
    direction : float, deg
        From the first direction towards the second.
    length, width : float, m
        Of its grid.
    """

    place: list[float] = field(default_factory=list)
    direction: float = 0.0
    length: float = 0.006
    width: float = 0.003

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no gage can be."""
        message = f"must be 2 numbers in m, as in [0.02, -0.03], not {self.place}"
        checks.require(len(self.place) == 2, f"{name}.place", message)
        checks.finite(f"{name}.place", *self.place)
        checks.positive(f"{name}.length", self.length)
        checks.positive(f"{name}.width", self.width)

    @property
    def along(self) -> Array:
        """Unit vector along the gage, shape (2,)."""
        angle = np.radians(self.direction)
        return np.array([np.cos(angle), np.sin(angle)])

    def points(self) -> tuple[Array, Array]:
        """Lay Gauss points over the grid.

        Returns
        -------
        coordinates : ndarray, shape (point, 2), m
        weight : ndarray, shape (point,)
            They add up to 1.

        Examples
        --------
        >>> coordinates, weight = Gage(place=[0.1, 0.2], direction=90.0, length=0.01).points()
        >>> coordinates.mean(axis=0).round(6).tolist(), float(weight.sum().round(12))
        ([0.1, 0.2], 1.0)
        """
        node, weight = np.polynomial.legendre.leggauss(POINTS)
        a, b = np.meshgrid(node * self.length / 2, node * self.width / 2, indexing="ij")
        across = np.array([-self.along[1], self.along[0]])
        spread = a.reshape(-1, 1) * self.along + b.reshape(-1, 1) * across
        return np.asarray(self.place) + spread, np.outer(weight, weight).ravel() / 4

    def row(self, shell: ThinShell, height: float) -> Array:
        """Make the row of the strain that it shows at a height, shape (coefficient,), 1/m."""
        coordinates, weight = self.points()
        return np.asarray(weight @ along(shell.strain(coordinates, height), self.along))


def along(strain: tuple[NDArray[Any], ...], direction: Array) -> NDArray[Any]:
    """Compute the strain along a direction: ``c^2 e_ss + s^2 e_tt + 2 c s e_st``."""
    (ss, tt, st), (c, s) = strain, direction
    return np.asarray(c * c * ss + s * s * tt + 2 * c * s * st)
