"""Smooth field on a surface, which views are tested with, whatever method reconstructs the result.

``V(P) = sum_i m_i N_i(P)`` with products of cubic B-splines along the surface's principal axes.
Along an axis in which the surface extends by less than half the knots' distance the field does not
change. Its knots are wider apart than the result's nodes: derivatives of a test field that follows
the noise would carry noise into the poses' columns, and the tests would reject too much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array

DEGREE = 3
#: Knots reach beyond the surface by this part of its extent, for points that poses move outwards.
BEYOND = 0.03


@dataclass(frozen=True, eq=False)
class SmoothField:
    """Basis functions of a smooth vector field near a surface.

    Attributes
    ----------
    middle : ndarray, shape (3,), m
    axes : ndarray, shape (3, 3)
        Rows are the principal axes.
    knots : tuple of ndarray or None
        Along each axis; None where the field does not change.
    """

    middle: Array
    axes: Array
    knots: tuple[Array | None, ...]

    @classmethod
    def on(cls, surface: Array, intervals: int) -> SmoothField:
        """Lay knots over a surface.

        Parameters
        ----------
        surface : ndarray, shape (node, 3), m
        intervals : int
            Along the longest axis; as wide along the others.
        """
        middle = surface.mean(axis=0)
        axes = np.linalg.svd(surface - middle, full_matrices=False)[2]
        along = (surface - middle) @ axes.T
        low, high = along.min(axis=0), along.max(axis=0)
        step = (high - low).max() / intervals
        knots = [
            _knots(a, b, int(np.ceil((b - a) / step - 1e-9))) if b - a > step / 2 else None
            for a, b in zip(low, high, strict=True)
        ]
        return cls(middle, axes, tuple(knots))

    @property
    def count(self) -> int:
        """Number of functions."""
        return int(np.prod([len(k) - DEGREE - 1 for k in self.knots if k is not None]))

    def evaluate(self, points: Array) -> tuple[Array, list[tuple[Array, Array]]]:
        """Evaluate the basis functions and their slopes.

        Returns
        -------
        basis : ndarray, shape (point, function)
        slopes : list of (axis, slope)
            For every axis along which the field changes: a unit vector, shape (3,), and the
            derivatives, shape (point, function), 1/m.
        """
        factors = self._factors(points)
        changing = [axis for axis, k in zip(self.axes, self.knots, strict=True) if k is not None]
        slopes = [
            (axis, product([s if i == j else f for j, (f, s) in enumerate(factors)]))
            for i, axis in enumerate(changing)
        ]
        return product([f for f, _ in factors]), slopes

    def values(self, points: Array) -> Array:
        """Evaluate the basis functions alone, shape (point, function)."""
        return product([value for value, _ in self._factors(points)])

    def _factors(self, points: Array) -> list[Array]:
        """Evaluate splines along every axis, and their slopes, shape (2, point, spline)."""
        along = (points - self.middle) @ self.axes.T
        return [splines_on(x, k) for x, k in zip(along.T, self.knots, strict=True) if k is not None]


def product(factors: list[Array]) -> Array:
    """Multiply the factors of every point with one another (rows' Kronecker product)."""
    found = factors[0]
    for factor in factors[1:]:
        both = found[:, :, None] * factor[:, None, :]
        found = both.reshape(len(found), found.shape[1] * factor.shape[1])
    return found


def _knots(low: float, high: float, intervals: int) -> Array:
    """Lay even knots that reach a little beyond both ends."""
    beyond = BEYOND * (high - low)
    inner = np.linspace(low - beyond, high + beyond, max(intervals, 1) + 1)
    return np.r_[[inner[0]] * DEGREE, inner, [inner[-1]] * DEGREE]


def splines_on(x: Array, knots: Array) -> Array:
    """Evaluate B-splines and their derivatives, (2, point, spline); beyond the ends, at them.

    With ``C_i = B_i,k-1 / (t_i+k - t_i)`` of the degree before (Cox and de Boor)

        B_i,k = (x - t_i) C_i + (t_i+k+1 - x) C_i+1,    B'_i,k = k (C_i - C_i+1).
    """
    inside, t = np.clip(x, knots[0], np.nextafter(knots[-1], -np.inf)), knots[:, None]
    value = ((t[:-1] <= inside) & (inside < t[1:])).astype(float)  # (spline, point)
    for degree in range(1, DEGREE + 1):
        span = t[degree:] - t[:-degree]
        over = value / np.where(span > 0, span, 1.0)  # between knots that are one it is 0
        one, other = over[:-1], over[1:]
        value = (inside - t[: -degree - 1]) * one + (t[degree + 1 :] - inside) * other
    return np.stack([value.T, DEGREE * (one - other).T])
