"""Bending around holes: what splines, which are as smooth everywhere, cannot follow.

A free edge of a hole in a bent plate adds to w solutions of the plate equation that are singular
inside of the hole. About its middle, with the mean radius b as unit of length,

    ln r,   r^2 ln r,   and with cos n theta or sin n theta:   1/r,  r ln r  (n = 1),
                                                               r^-n,  r^(2-n)  (n >= 2).

Near the edge they vary over b and far from it not at all, so that one weight of smoothness for the
whole structure would either smooth the peaks of strain away or leave noise everywhere else. Inertia
makes them waves, whose difference is as smooth as the splines. Their coefficients are of the order
of the curvature of w times b^2; waves are longer than a cell of the splines, so that their prior
has the standard deviation of w times (b / cell)^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from sldvexp.typing import Array, ComplexArray

#: Highest number of waves around a hole.
ORDERS = 3
#: Functions about one hole.
FUNCTIONS = 2 + 4 * ORDERS


@dataclass(frozen=True, eq=False)
class HoleFunctions:
    """Singular functions about all holes of an outline.

    Attributes
    ----------
    middle : ndarray, shape (hole, 2), m
    radius : ndarray, shape (hole,), m
    cell : float, m
        Width of the splines' cells.
    """

    middle: Array
    radius: Array
    cell: float

    @classmethod
    def of(cls, holes: Sequence[tuple[Array, float]], cell: float) -> HoleFunctions:
        """Collect middles and radii."""
        middle = np.array([m for m, _ in holes]).reshape(-1, 2)
        return cls(middle, np.array([r for _, r in holes]), cell)

    @property
    def count(self) -> int:
        """Number of functions."""
        return len(self.radius) * FUNCTIONS

    @property
    def precision(self) -> Array:
        """Prior precision of each coefficient, over that of w's own size, shape (function,)."""
        return np.repeat((self.cell / self.radius) ** 4, FUNCTIONS)

    def __call__(self, coordinates: Array, i: int = 0, j: int = 0) -> Array:
        """Evaluate i-th derivatives by s and j-th by t, shape (point, function), 1/m^(i+j).

        Examples
        --------
        A hole of 20 mm radius, ln r at three of its radii:

        >>> import numpy as np
        >>> around = HoleFunctions.of([(np.zeros(2), 0.02)], 0.01)
        >>> around(np.array([[0.06, 0.0]]))[0, :2].round(3).tolist()
        [1.099, 9.888]
        """
        columns = [np.zeros((len(coordinates), 0))]
        for middle, radius in zip(self.middle, self.radius, strict=True):
            z = ((coordinates - middle) / radius) @ [1, 1j]
            # Inside of half the radius nothing is measured, and the functions have no end.
            z = np.where(np.abs(z) < 0.5, 0.5, z)
            columns.append(_about(z, i, j) / radius ** (i + j))
        return np.concatenate(columns, axis=1)


#: Those of a structure without holes.
NONE = HoleFunctions.of([], 1.0)


def _about(z: ComplexArray, i: int, j: int) -> Array:
    """Differentiate the functions about the origin, with the radius 1, shape (point, function)."""
    x, y = z.real, z.imag
    one, none = np.ones_like(x), np.zeros_like(x)
    # Polynomials p of p ln r by their derivatives, (order by x, order by y) -> values.
    bowl = {(0, 0): x**2 + y**2, (1, 0): 2 * x, (0, 1): 2 * y, (2, 0): 2 * one, (0, 2): 2 * one}
    factors = [{(0, 0): one}, bowl, {(0, 0): x, (1, 0): one}, {(0, 0): y, (0, 1): one}]
    columns = []
    for p in factors:
        total = none
        for (a, b), factor in p.items():
            if a <= i and b <= j:
                of_log = _power(z, None, 0, i - a, j - b).real
                total = total + comb(i, a) * comb(j, b) * factor * of_log
        columns.append(total)
    for n in range(1, ORDERS + 1):
        waves = [_power(z, -n, 0, i, j)] + ([_power(z, 1 - n, 1, i, j)] if n > 1 else [])
        columns += [part for wave in waves for part in (wave.real, wave.imag)]
    return np.stack(columns, axis=1)


def _power(z: ComplexArray, power: int | None, conjugate: int, i: int, j: int) -> ComplexArray:
    """Differentiate ``conj(z)^conjugate z^power``, or ``ln z``, i times by x and j times by y.

    With d/dx = d + d', d/dy = i (d - d'), d by z and d' by conj(z): of order n = i + j only
    ``i^j (d^n + (i - j) d^(n-1) d')`` is left, since conj(z) has the power 0 or 1.
    """

    def by_z(order: int) -> ComplexArray:
        if power is None:
            if order == 0:
                return np.log(z)
            factor, exponent = np.prod([-k for k in range(1, order)]), -order
        else:
            factor, exponent = np.prod([power - k for k in range(order)]), power - order
        return np.asarray(factor * z**exponent)

    n = i + j
    found = by_z(n) * (z.conj() if conjugate else 1.0)
    if conjugate and n:
        found = found + (i - j) * by_z(n - 1)
    return np.asarray(1j**j * found)
