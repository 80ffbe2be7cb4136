"""Tensor products of B-splines over a rectangle, their derivatives, and penalties on roughness.

Lengths inside are measured in a unit of the structure's own size, so that derivatives of all orders
are of one size and the weights of penalties mean the same whatever the structure's size.

Around a closed structure the coordinate comes back: its splines are periodic ones, on knots that go
on beyond both ends, where the functions that leave at one end come in at the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial

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

    @cached_property
    def _polynomials(self) -> list[Array]:
        """Polynomials of these functions and of their derivatives, (cell, power, function) each.

        They are those of the distance from a cell's middle over half its width: of all the places
        where a polynomial can be developed that is the one with the least round-off.
        """
        count, half = self.cells + self.degree, self.half_width
        spline = scipy.interpolate.BSpline(self.knots, np.eye(count), self.degree)
        middle = (self.ends[1:] + self.ends[:-1]) / 2
        cell = np.arange(self.cells)[:, None]
        own = cell + np.arange(self.degree + 1)
        powers = [
            spline(middle, nu=k)[cell, own] * half**k / factorial(k) for k in range(self.degree + 1)
        ]
        found = [np.stack(powers, axis=1)]
        for _ in range(self.degree):
            power = np.arange(1, found[-1].shape[1])[:, None]
            found.append(found[-1][:, 1:] * power / half)
        return found

    @property
    def half_width(self) -> float:
        """Half the width of a cell, in the unit."""
        return (self.high - self.low) / self.cells / 2

    def cell_of(self, x: Array) -> tuple[IntArray, Array]:
        """Find the cells of places, and how far these are from its middle, over half its width.

        Beyond the ends it is the last cell, whose polynomials go on there.
        """
        from_low = x - self.low
        if self.periodic:
            from_low = from_low % (self.high - self.low)
        width = 2 * self.half_width
        cell = np.clip((from_low / width).astype(np.intp), 0, self.cells - 1)
        return cell, (from_low - (cell + 0.5) * width) / self.half_width

    def local(self, cell: IntArray, off: Array, order: int) -> Array:
        """Evaluate a derivative of the functions that are not zero, shape (point, degree + 1).

        Parameters
        ----------
        cell, off : ndarray, shape (point,)
            As `cell_of` has them.
        order : int
        """
        if order > self.degree:
            return np.zeros((len(cell), self.degree + 1))
        polynomial = self._polynomials[order]
        found = polynomial[cell, -1]
        for power in range(polynomial.shape[1] - 2, -1, -1):
            found *= off[:, None]
            found += polynomial[cell, power]
        return np.asarray(found)

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
