"""Tensor products of B-splines over a rectangle, their derivatives, and penalties on roughness.

Lengths inside are measured in a unit of the structure's own size, so that derivatives of all orders
are of one size and the weights of penalties mean the same whatever the structure's size.

Around a closed structure the coordinate comes back: its splines are periodic ones, on knots that go
on beyond both ends, where the functions that leave at one end come in at the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, IntArray

#: Fewest cells around a closed structure: three waves around it are smooth on them.
AROUND = 16


@dataclass(frozen=True, eq=False)
class Splines:
    """B-splines along one coordinate, on even cells.

    Parameters
    ----------
    low, high : float
        Ends, in the unit.
    cells : int
    degree : int
    periodic : bool
        Whether the high end is the low one again.
    """

    low: float
    high: float
    cells: int
    degree: int
    periodic: bool = False

    @property
    def count(self) -> int:
        """Number of functions."""
        return self.cells if self.periodic else self.cells + self.degree

    @cached_property
    def ends(self) -> Array:
        """Ends of the cells."""
        return np.linspace(self.low, self.high, self.cells + 1)

    @cached_property
    def knots(self) -> Array:
        """Knots with the ends repeated, or going on around."""
        inner = self.ends
        if self.periodic:
            beyond = np.arange(1, self.degree + 1) * (self.high - self.low) / self.cells
            return np.r_[inner[0] - beyond[::-1], inner, inner[-1] + beyond]
        return np.r_[[inner[0]] * self.degree, inner, [inner[-1]] * self.degree]

    def __call__(self, x: Array, order: int = 0) -> Array:
        """Evaluate a derivative of all functions, shape (point, function)."""
        count = self.cells + self.degree
        spline = scipy.interpolate.BSpline(self.knots, np.eye(count), self.degree)
        if not self.periodic:
            return np.asarray(spline(x, nu=order))
        found = np.asarray(spline(self.low + (x - self.low) % (self.high - self.low), nu=order))
        around = np.arange(count) % self.cells == np.arange(self.cells)[:, None]
        return np.asarray(found @ around.T)

    @cached_property
    def functions(self) -> IntArray:
        """Numbers of the functions that are not zero in a cell, shape (cell, degree + 1)."""
        number = np.arange(self.cells)[:, None] + np.arange(self.degree + 1)
        return number % self.cells if self.periodic else number

    def cell_of(self, x: Array) -> tuple[IntArray, Array]:
        """Find the cells of places, and where these are within the period.

        Beyond the ends it is the last cell, whose polynomials go on there.
        """
        from_low, width = x - self.low, (self.high - self.low) / self.cells
        if self.periodic:
            from_low = from_low % (self.high - self.low)
            x = self.low + from_low
        return np.clip((from_low / width).astype(np.intp), 0, self.cells - 1), x

    def local(self, cell: IntArray, x: Array, order: int) -> Array:
        """Evaluate a derivative of the functions that are not zero, shape (point, degree + 1).

        De Boor's recursion adds up what is positive, so that even a value that is nearly zero, by
        which alone a pixel may tell of a function at the rim, has all of its digits.

        Parameters
        ----------
        cell, x : ndarray, shape (point,)
            As `cell_of` has them.
        order : int
        """
        if order > self.degree:
            return np.zeros((len(cell), self.degree + 1))
        beside = np.arange(1 - self.degree, self.degree + 1)[:, None]
        near = self.knots[np.arange(self.cells) + self.degree + beside]  # of one cell, (knot, cell)
        off, middle = near.take(cell, axis=1) - x, self.degree
        found = np.ones((1, len(cell)))
        for degree in range(1, self.degree + 1):
            after, before = slice(middle, middle + degree), slice(middle - degree, middle)
            found = found * (1 / (near[after] - near[before])).take(cell, axis=1)
            raised = np.zeros((degree + 1, len(cell)))
            if degree <= self.degree - order:
                raised[:-1] = off[after] * found
                raised[1:] -= off[before] * found
            else:
                raised[:-1] = -degree * found
                raised[1:] += degree * found
            found = raised
        return np.ascontiguousarray(found.T)

    def gram(self, order: int) -> Array:
        """Integrate products of two derivatives, shape (function, function); exactly."""
        node, weight = np.polynomial.legendre.leggauss(self.degree + 1)
        cell = self.ends
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
    def over(
        cls,
        low: Array,
        high: Array,
        cells: int,
        degree: int,
        unit: float,
        around: bool = False,
    ) -> TensorSplines:
        """Lay splines over a rectangle.

        Parameters
        ----------
        low, high : ndarray, shape (2,), m
            Its corners.
        cells : int
            Along the longer side; about as wide along the other.
        degree : int
        unit : float, m
        around : bool
            Whether s comes back to where it began, as around a tube.
        """
        width = (high - low).max() / cells
        number = np.maximum(np.rint((high - low) / width), [AROUND if around else 1, 1])
        (s, t), (low_s, low_t), (high_s, high_t) = number.astype(int), low / unit, high / unit
        along_s = Splines(low_s, high_s, int(s), degree, around)
        return cls(along_s, Splines(low_t, high_t, int(t), degree), unit)

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
