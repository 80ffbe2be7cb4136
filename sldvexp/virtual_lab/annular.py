"""Modes of an annular plate in closed form: a disc with a round hole in its middle (Kirchhoff).

With n nodal diameters, in polar coordinates,

    w = W(r) cos(n theta - phi),    W = A J_n(k r) + B Y_n(k r) + C I_n(k r) + D K_n(k r).

Two conditions hold at each edge, of W, its slope, the moment ``M = W'' + nu (W'/r - n^2 W/r^2)``
and the edge force ``V = (lap W)' - (1 - nu) n^2 / r^2 (W' - W/r)``; k makes their determinant zero.
The functions are divided by their own size at the edge where they are largest, I and K with their
exponentials taken out, so that no k overflows. The natural frequency is
``k^2 sqrt(D / rho h) / 2 pi``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from functools import cache, lru_cache

import numpy as np

from sldvexp.errors import Checks
from sldvexp.lazy import scipy
from sldvexp.typing import Array
from sldvexp.virtual_lab.motion import DampedModes, Derivative, Sheet

#: Steps of k, over pi / (ring's width), in which roots of the determinant are looked for.
STEP = 0.02
#: Least k times the outer radius that counts as vibration: below are rigid motions.
RIGID = 0.3
#: Places on the radius among which the largest motion is looked for.
FINE = 2001
#: Shapes that are remembered: every lab of one plate asks for the same ones.
REMEMBERED = 256


class EdgeCondition(Enum):
    """How a round edge is held."""

    free = "free"
    supported = "supported"
    clamped = "clamped"


@dataclass
class AnnularMode:
    """One damped mode of an annular plate.

    Parameters
    ----------
    diameters : int
        Nodal diameters n.
    circles : int
        Which root of the determinant, from 0: about as many nodal circles.
    angle : float, deg
        Where it moves most, from the plate's own x towards y.
    frequency : float, Hz, optional
        Of the undamped mode; without it the natural one of the plate's sheet.
    damping : float
        Over critical.
    velocity : float, m/s per V of excitation
        Peak where it moves most, at resonance, where it is in phase with the excitation there.
    """

    diameters: int = 0
    circles: int = 0
    angle: float = 0.0
    frequency: float | None = None
    damping: float = 0.01
    velocity: float = 0.02

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no mode can be."""
        for key in ("diameters", "circles"):
            value = getattr(self, key)
            checks.require(
                0 <= value <= 40, f"{name}.{key}", f"must be a number from 0 to 40, not {value}"
            )
        checks.finite(f"{name}.angle", self.angle)
        if self.frequency is not None:
            checks.positive(f"{name}.frequency", self.frequency)
        checks.positive(f"{name}.damping", self.damping)
        checks.finite(f"{name}.velocity", self.velocity)


@dataclass(frozen=True)
class Annulus:
    """Geometry and edges that decide the shapes.

    Parameters
    ----------
    radius, hole : float, m
        Of the outer edge and of the hole.
    nu : float
    edge, hole_edge : EdgeCondition
    """

    radius: float
    hole: float
    nu: float
    edge: EdgeCondition
    hole_edge: EdgeCondition = EdgeCondition.free

    @lru_cache(maxsize=REMEMBERED)  # noqa: B019 - of few small plates, which keep nothing alive
    def shape(self, diameters: int, circles: int) -> RadialShape:
        """Find the shape of a mode, its largest motion 1.

        Examples
        --------
        A plate clamped outside, free at a hole of half its radius:

        >>> plate = Annulus(1.0, 0.5, 1 / 3, EdgeCondition.clamped)
        >>> round(plate.shape(0, 0).k ** 2, 2)
        17.64
        """
        k = self._root(diameters, circles)
        # The last right singular vector solves the four conditions.
        unscaled = np.linalg.svd(self._conditions(diameters, k))[2][-1]
        found = RadialShape(diameters, k, self.radius, self.hole, unscaled)
        r = np.linspace(self.hole, self.radius, FINE)
        w = found.derivative(r, 0)
        return RadialShape(diameters, k, self.radius, self.hole, unscaled / w[np.abs(w).argmax()])

    def _root(self, n: int, nth: int) -> float:
        """Find the nth k > 0 that makes the determinant zero, 1/m."""

        def determinant(k: float) -> float:
            return float(np.linalg.det(self._conditions(n, k)))

        step = STEP * math.pi / (self.radius - self.hole)
        low, value = RIGID / self.radius, determinant(RIGID / self.radius)
        while True:
            high = low + step
            ahead = determinant(high)
            if value * ahead <= 0:
                if nth == 0:
                    return float(scipy.optimize.brentq(determinant, low, high, xtol=1e-14 * high))
                nth -= 1
            low, value = high, ahead

    def _conditions(self, n: int, k: float) -> Array:
        """Make the rows of the four conditions, of functions and lengths of size 1."""
        shape = RadialShape(n, k, self.radius, self.hole, np.eye(4))
        rows = []
        for r, edge in ((self.radius, self.edge), (self.hole, self.hole_edge)):
            w, slope, *_ = shape.derivatives(r)
            moment = shape.moment(r, self.nu) / k**2
            force = shape.edge_force(r, self.nu) / k**3
            rows += {
                EdgeCondition.clamped: [w, slope / k],
                EdgeCondition.supported: [w, moment],
                EdgeCondition.free: [moment, force],
            }[edge]
        return np.stack(rows)


@dataclass(frozen=True, eq=False)
class RadialShape:
    """The radial function W of one mode.

    Parameters
    ----------
    diameters : int
    k : float, 1/m
    radius, hole : float, m
    coefficients : ndarray, shape (..., 4)
        Of J, Y, I and K, each over its own size.
    """

    diameters: int
    k: float
    radius: float
    hole: float
    coefficients: Array

    def derivative(self, r: Array | float, order: int) -> Array:
        """Compute W (order 0) or its first, second or third derivative by r, shape (..., r)."""
        return self.derivatives(r)[order]

    def derivatives(self, r: Array | float) -> tuple[Array, Array, Array, Array]:
        """Compute W and its first, second and third derivative by r, each of shape (..., r).

        From ``W'' = -W'/r + (n^2/r^2 -+ k^2) W``, minus for J and Y, plus for I and K.
        """
        r = np.asarray(r, float)
        n, sign = self.diameters, np.array([-1.0, -1.0, 1.0, 1.0])
        w, slope = self._functions(r)
        bowl = n**2 / r**2 + np.multiply.outer(sign, np.full(r.shape, self.k**2))
        second = -slope / r + bowl * w
        third = -second / r + slope / r**2 + bowl * slope - 2 * n**2 / r**3 * w
        whole = (w, slope, second, third)
        zeroth, first, second, third = (np.tensordot(self.coefficients, of, 1) for of in whole)
        return zeroth, first, second, third

    def laplacian_slope(self, r: Array | float) -> Array:
        """Compute ``(lap W)'``: lap W is -k^2 W of J and Y, k^2 W of I and K."""
        sign = np.array([-1.0, -1.0, 1.0, 1.0]) * self.k**2
        slope = self._functions(np.asarray(r, float))[1]
        return np.asarray(np.tensordot(self.coefficients * sign, slope, 1))

    def moment(self, r: Array | float, nu: float) -> Array:
        """Compute the radial moment over -D."""
        w, slope, second, _ = self.derivatives(r)
        return np.asarray(second + nu * (slope / r - self.diameters**2 * w / np.square(r)))

    def edge_force(self, r: Array | float, nu: float) -> Array:
        """Compute Kirchhoff's edge force over -D."""
        w, slope, *_ = self.derivatives(r)
        twist = (1 - nu) * self.diameters**2 / np.square(r) * (slope - w / r)
        return np.asarray(self.laplacian_slope(r) - twist)

    def _functions(self, r: Array) -> tuple[Array, Array]:
        """Compute J, Y, I, K over their sizes, and their derivatives by r, shape (4, r) each."""
        n, k, special = self.diameters, self.k, scipy.special
        x, outer, inner = k * r, k * self.radius, k * self.hole
        y_size = float(np.hypot(special.jv(n, inner), special.yv(n, inner)))
        j_size = float(np.hypot(special.jv(n, outer), min(abs(special.yv(n, outer)), 1.0)))
        grown = np.exp(x - outer) / special.ive(n, outer)
        fallen = np.exp(inner - x) / special.kve(n, inner)
        w = [
            special.jv(n, x) / j_size,
            special.yv(n, x) / y_size,
            special.ive(n, x) * grown,
            special.kve(n, x) * fallen,
        ]
        slope = [
            k * special.jvp(n, x) / j_size,
            k * special.yvp(n, x) / y_size,
            k * (special.ive(n + 1, x) + n / x * special.ive(n, x)) * grown,
            k * (-special.kve(n + 1, x) + n / x * special.kve(n, x)) * fallen,
        ]
        return np.stack(w), np.stack(slope)


@dataclass(frozen=True, eq=False)
class AnnularModes(DampedModes):
    """Bending of an annular plate; its middle surface has no motion along itself.

    Parameters
    ----------
    shapes : tuple of RadialShape
    angle : ndarray, shape (mode,), rad
    center : ndarray, shape (2,), m
        Of the plate in the coordinates of its surface.
    """

    shapes: tuple[RadialShape, ...]
    angle: Array
    center: Array

    @classmethod
    def built(
        cls, modes: Iterable[AnnularMode], plate: Annulus, sheet: Sheet, center: Array
    ) -> AnnularModes:
        """Make the modes of a configuration."""
        modes = list(modes)
        shapes = tuple(plate.shape(m.diameters, m.circles) for m in modes)
        speed = math.sqrt(sheet.bending / sheet.mass)
        natural = [
            s.k**2 * speed / (2 * math.pi) if m.frequency is None else m.frequency
            for m, s in zip(modes, shapes, strict=True)
        ]
        return cls(
            frequency=np.array(natural),
            damping=np.array([m.damping for m in modes]),
            velocity=np.array([m.velocity for m in modes]),
            turning=np.ones(len(modes)),
            shapes=shapes,
            angle=np.radians([m.angle for m in modes]),
            center=np.asarray(center, float),
        )

    def derivatives(self, coordinates: Array) -> tuple[Derivative, Derivative, Derivative]:
        """See `DampedModes`."""
        x, y = (coordinates - self.center).T
        # Beside the plate no motion is defined; inside of the hole K and Y would be infinite.
        r = np.clip(np.hypot(x, y), self.shapes[0].hole, None)
        polar = r, np.arctan2(y, x)

        def none(i: int, j: int) -> Array:
            return np.zeros((len(coordinates), len(self.shapes)))

        @cache
        def radial(mode: int) -> tuple[Array, ...]:
            return self.shapes[mode].derivatives(r)

        def bending(i: int, j: int) -> Array:
            modes = enumerate(zip(self.shapes, self.angle, strict=True))
            of = [_cartesian(f.diameters, radial(k), a, polar, i, j) for k, (f, a) in modes]
            return np.stack(of, axis=1)

        return none, none, bending


def _cartesian(
    n: int,
    radial: tuple[Array, ...],
    angle: float,
    polar: tuple[Array, Array],
    i: int,
    j: int,
) -> Array:
    """Differentiate ``W(r) cos(n (theta - angle))`` i times by x and j times by y, i + j <= 2.

    Parameters
    ----------
    radial : tuple of ndarray
        W and its derivatives at r.
    polar : tuple of ndarray
        r and theta of every point.
    """
    (w, slope, second, _), (r, theta) = radial, polar
    even, odd = np.cos(n * (theta - angle)), -n * np.sin(n * (theta - angle))
    if i + j == 0:
        return np.asarray(w * even)
    c, s = np.cos(theta), np.sin(theta)
    by_r, by_theta = slope * even, w * odd / r
    if i + j == 1:
        return np.asarray(c * by_r - s * by_theta if i else s * by_r + c * by_theta)
    # Components of the Hessian along r and theta.
    rr = second * even
    tt = (slope / r - n**2 * w / r**2) * even
    rt = (slope / r - w / r**2) * odd
    along = {(2, 0): (c * c, s * s, -2 * c * s), (0, 2): (s * s, c * c, 2 * c * s)}
    of_rr, of_tt, of_rt = along.get((i, j), (c * s, -c * s, c * c - s * s))
    return np.asarray(of_rr * rr + of_tt * tt + of_rt * rt)
