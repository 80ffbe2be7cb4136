"""Tensor products of B-splines over a rectangle, their derivatives, and penalties on roughness.

Lengths inside are measured in a unit of the structure's own size, so that derivatives of all orders
are of one size and the weights of penalties mean the same whatever the structure's size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array


@dataclass(frozen=True, eq=False)
class Splines:
    """B-splines along one coordinate, on even cells.

    Parameters
    ----------
    low, high : float
        Ends, in the unit.
    cells : int
    degree : int
    """

    low: float
    high: float
    cells: int
    degree: int

    @property
    def count(self) -> int:
        """Number of functions."""
        return self.cells + self.degree

    @cached_property
    def knots(self) -> Array:
        """Knots with the ends repeated."""
        inner = np.linspace(self.low, self.high, self.cells + 1)
        return np.r_[[inner[0]] * self.degree, inner, [inner[-1]] * self.degree]

    def __call__(self, x: Array, order: int = 0) -> Array:
        """Evaluate a derivative of all functions, shape (point, function)."""
        spline = scipy.interpolate.BSpline(self.knots, np.eye(self.count), self.degree)
        return np.asarray(spline(x, nu=order))

    def gram(self, order: int) -> Array:
        """Integrate products of two derivatives, shape (function, function); exactly."""
        node, weight = np.polynomial.legendre.leggauss(self.degree + 1)
        cell = np.unique(self.knots)
        width = np.diff(cell)[:, None]
        x = (cell[:-1, None] + width * (node + 1) / 2).ravel()
        of_x = self(x, order)
        return np.asarray(of_x.T @ ((width * weight / 2).ravel()[:, None] * of_x))


@dataclass(frozen=True, eq=False)
class TensorSplines:
    """Products of splines along s and along t.

    Parameters
    ----------
    along_s, along_t : Splines
    unit : float, m
    """

    along_s: Splines
    along_t: Splines
    unit: float

    @classmethod
    def over(cls, low: Array, high: Array, cells: int, degree: int, unit: float) -> TensorSplines:
        """Lay splines over a rectangle.

        Parameters
        ----------
        low, high : ndarray, shape (2,), m
            Its corners.
        cells : int
            Along the longer side; about as wide along the other.
        degree : int
        unit : float, m
        """
        width = (high - low).max() / cells
        number = np.maximum(np.rint((high - low) / width), 1).astype(int)
        s, t = (
            Splines(a, b, int(n), degree)
            for a, b, n in zip(low / unit, high / unit, number, strict=True)
        )
        return cls(s, t, unit)

    @property
    def count(self) -> int:
        """Number of functions."""
        return self.along_s.count * self.along_t.count

    def __call__(self, coordinates: Array, i: int = 0, j: int = 0) -> Array:
        """Evaluate i-th derivatives by s and j-th by t, shape (point, function), 1/m^(i+j)."""
        of_s, of_t = self.along(coordinates, 0, i), self.along(coordinates, 1, j)
        both = of_s[:, :, None] * of_t[:, None, :]
        return np.asarray(both.reshape(len(of_s), self.count))

    def along(self, coordinates: Array, axis: int, order: int) -> Array:
        """Evaluate derivatives of the splines along s (0) or t (1), shape (point, function)."""
        own = (self.along_s, self.along_t)[axis]
        return own(coordinates[:, axis] / self.unit, order) / self.unit**order

    def penalty(self, order: int) -> Array:
        """Integrate squared derivatives of that order, which no turn of the axes changes.

        ``sum_i binomial(order, i) int (d^order f / ds^(order-i) dt^i)^2``, shape (function,
        function), in the unit.
        """
        return np.asarray(
            sum(
                comb(order, i) * np.kron(self.along_s.gram(order - i), self.along_t.gram(i))
                for i in range(order + 1)
            )
        )
