"""Forces that the motion of a plate asks for: the residual of its equation, patch by patch.

A thin plate of bending stiffness D and mass rho h per area obeys

    D lap lap w - rho h omega^2 w = p

where p is the pressure of all forces on it, damping among them. Both sides are averaged over a
window with a smooth weight phi that vanishes with three derivatives on its rim, so that all
derivatives are those of the weight:

    B = int w lap lap phi,    M = int w phi,    mean of p = D (B - kappa^4 M) / int phi,

with ``kappa^4 = rho h omega^2 / D``; all are functionals of the splines of w. Where nothing acts,
``B = gamma kappa^4 M`` with gamma = 1, or ``1 / (1 + i eta)`` with a loss factor eta; another real
part says that bending waves are shorter or longer than material and thickness make them.

Windows over the whole surface, times polynomials, have little noise: they tell gamma, and whether
one gamma is enough. Windows of patches tell where forces act: a patch that no common gamma explains
is one, the worst first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre, Polynomial

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
from sldvexp.shell.estimate import SurfaceField
from sldvexp.shell.surface_fit import SurfaceFit
from sldvexp.typing import Array, BoolArray, ComplexArray

#: Gauss points along each side of a patch, and of the whole surface.
POINTS, MANY_POINTS = 20, 48
#: Weight over a window, from -1 to 1: its first three derivatives vanish on the rim.
WEIGHT = Polynomial([1, 0, -1]) ** 4
#: Polynomials along each side that the weight of the whole surface is multiplied by.
ORDERS = 4
#: Angle, rad, by which normals of a flat surface may turn from one end to the other.
FLAT = 1e-6


@dataclass(frozen=True, eq=False)
class PatchForces:
    """Forces on patches at one frequency.

    Attributes
    ----------
    pressure : ndarray of complex, shape (patch,), Pa
        Mean pressure beside that of gamma.
    std : ndarray, shape (part, patch), Pa
    p_value : ndarray, shape (patch,)
        Probability of such a one where no force acts.
    acted : ndarray of bool, shape (patch,)
        Where forces act.
    gamma : complex
        Of the whole surface; where forces act, of the other patches.
    gamma_std : ndarray, shape (2,)
        Of its real and its imaginary part.
    p_whole : float
        Probability that one gamma explains the whole surface so badly, if no force acts.
    """

    pressure: ComplexArray
    std: Array
    p_value: Array
    acted: BoolArray
    gamma: complex
    gamma_std: Array
    p_whole: float


@dataclass(frozen=True, eq=False)
class Averages:
    """Averages of both sides of the equation over some windows.

    Attributes
    ----------
    y, x : ndarray of complex, shape (window,)
        ``B / kappa^4`` and M of the velocity, m/s.
    spread : ndarray, shape (part, window, window)
        Covariance of y - x.
    """

    y: ComplexArray
    x: ComplexArray
    spread: Array

    @classmethod
    def of(cls, fit: SurfaceFit, bent: Array, still: Array, kappa4: float, line: int) -> Averages:
        """Average, with rows of B and M."""
        count = len(bent)
        values, covariance = covariance_of(fit, np.concatenate([bent / kappa4, still]))
        turn = np.hstack([np.eye(count), -np.eye(count)])
        spread = turn @ covariance[:, line] @ turn.T
        return cls(values[:count, line], values[count:, line], spread)

    def common(self, used: BoolArray) -> tuple[complex, Array]:
        """Regress y on x with one complex factor; the covariance of its two parts."""
        information, score = np.zeros((2, 2)), np.zeros(2)
        for part, design in enumerate(self._columns):
            columns = design[used]
            weighted = np.linalg.solve(self.spread[part][np.ix_(used, used)], columns)
            information += columns.T @ weighted
            score += weighted.T @ (self.y.real, self.y.imag)[part][used]
        covariance = np.asarray(np.linalg.inv(information))
        real, imaginary = covariance @ score
        return complex(real, imaginary), covariance

    def p_value(self, gamma: complex) -> float:
        """Compute the probability of so large residuals of all windows, if only gamma is free."""
        left = self.y - gamma * self.x
        squares = sum(
            of @ np.linalg.solve(spread, of)
            for of, spread in zip((left.real, left.imag), self.spread, strict=True)
        )
        return float(scipy.special.chdtrc(2 * len(left) - 2, squares))

    def p_values(self, gamma: complex, covariance: Array, used: BoolArray) -> Array:
        """Compute the probability of each window's residual, of both parts together.

        That of a window which gamma was found of varies less by what gamma varies, any other's
        more.
        """
        left = self.y - gamma * self.x
        chi_square = np.zeros(len(left))
        for of, spread, columns in zip(
            (left.real, left.imag), self.spread, self._columns, strict=True
        ):
            own = spread.diagonal()
            of_gamma = np.einsum("pi,ij,pj->p", columns, covariance, columns)
            chi_square += of**2 / np.maximum(own + np.where(used, -1, 1) * of_gamma, own / 10)
        return np.asarray(scipy.special.chdtrc(2, chi_square))

    @property
    def _columns(self) -> tuple[Array, Array]:
        """Columns of gamma's two parts in the real and in the imaginary part of y."""
        real = np.stack([self.x.real, -self.x.imag], axis=1)
        return real, np.stack([self.x.imag, self.x.real], axis=1)


def require_plate(found: SurfaceField, check: str) -> None:
    """Refuse surfaces that bend, whose middle resists bending too (`UserError`)."""
    outline = found.fit.outline
    bent = np.abs(outline.chart.forms(outline.corners).curvature).max()
    if bent * np.ptp(outline.corners, axis=0).max() > FLAT:
        raise UserError(
            f"check={check} needs a flat plate: the middle of a curved one resists bending too"
        )


def patch_places(fit: SurfaceFit, patches: tuple[int, int]) -> tuple[Array, Array]:
    """Find the middles of all patches that lie on the structure as a whole, and their sides.

    Returns
    -------
    places : ndarray, shape (patch, 2), m
    sides : ndarray, shape (2,), m
    """
    low, high = fit.outline.low, fit.outline.high
    sides = (high - low) / patches
    corner = np.stack(np.meshgrid(*(np.arange(n) for n in patches), indexing="ij"), axis=-1)
    places = low + (corner.reshape(-1, 2) + 0.5) * sides
    tried = np.linspace(-0.5, 0.5, 9) * (1 - 1e-6)
    around = np.stack(np.meshgrid(tried, tried), axis=-1).reshape(-1, 2) * sides
    on_it = [fit.outline.holds(place + around).all() for place in places]
    return places[np.array(on_it, bool)], sides


def window_rows(
    fit: SurfaceFit, place: Array, sides: Array, orders: int, points: int
) -> tuple[Array, Array]:
    """Make the rows of B and of M over one window, times polynomials; over the weight's integral.

    Returns
    -------
    tuple of ndarray, shape (orders^2, coefficient) each, 1/m^4 and 1
    """
    node, weight = np.polynomial.legendre.leggauss(points)
    at = np.stack(np.meshgrid(node, node, indexing="ij"), axis=-1).reshape(-1, 2)
    share = np.outer(weight, weight).ravel() / (WEIGHT.integ()(1) - WEIGHT.integ()(-1)) ** 2
    w = share[:, None] * fit.shell.bending(place + at * sides / 2)
    shapes = [WEIGHT * Legendre.basis(n).convert(kind=Polynomial) for n in range(orders)]

    def along(i: int) -> list[Array]:
        """Evaluate the shapes' i-th derivatives, in units of half a side."""
        return [(shape.deriv(i) if i else shape)(node) for shape in shapes]

    value, second, fourth = along(0), along(2), along(4)
    (s2, t2), (s4, t4) = (2 / sides) ** 2, (2 / sides) ** 4
    bent, still = [], []
    for a in range(orders):
        for b in range(orders):
            of = s4 * np.outer(fourth[a], value[b]) + t4 * np.outer(value[a], fourth[b])
            of += 2 * s2 * t2 * np.outer(second[a], second[b])
            bent.append(of.ravel() @ w)
            still.append(np.outer(value[a], value[b]).ravel() @ w)
    none = np.zeros((orders**2, 2 * fit.shell.membrane.count))
    return np.hstack([none, bent]), np.hstack([none, still])


def covariance_of(fit: SurfaceFit, rows: Array) -> tuple[ComplexArray, Array]:
    """Compute functionals and how their errors go together.

    Returns
    -------
    values : ndarray of complex, shape (functional, frequency)
    covariance : ndarray, shape (part, frequency, functional, functional)
    """
    count = len(rows)
    size = np.linalg.norm(rows, axis=1)
    rows = rows / size[:, None]
    first, second = np.triu_indices(count, 1)
    values, own, others = fit.evaluate(np.concatenate([rows, rows[first] + rows[second]]))
    variance = np.moveaxis(own + others, 1, 2)
    found = np.zeros((*variance.shape[:2], count, count))
    diagonal = variance[..., :count]
    found[..., range(count), range(count)] = diagonal
    # var(a + b) = var(a) + var(b) + 2 cov(a, b)
    sums = variance[..., count:] - diagonal[..., first] - diagonal[..., second]
    found[..., first, second] = found[..., second, first] = sums / 2
    return values[:count] * size[:, None], found * size[:, None] * size


def patch_forces(
    found: SurfaceField, places: Array, sides: Array, line: int, level: float
) -> PatchForces:
    """Find forces on patches at one frequency.

    Parameters
    ----------
    places, sides : ndarray
        See `patch_places`.
    line : int
        Which of the field's frequencies.
    level : float
        Probability of taking any patch for one where a force acts, if there is none.
    """
    sheet, fit = found.material, found.fit
    assert sheet is not None
    assert found.frequency is not None
    omega = 2 * np.pi * found.frequency[line]
    kappa4 = sheet.mass * omega**2 / sheet.bending_stiffness
    each = [window_rows(fit, place, sides, 1, POINTS) for place in places]
    bent, still = (np.concatenate(rows) for rows in zip(*each, strict=True))
    patches = Averages.of(fit, bent, still, kappa4, line)
    acted = np.zeros(len(places), bool)
    while True:
        gamma, covariance = patches.common(~acted)
        p_value = patches.p_values(gamma, covariance, ~acted)
        worst = int(np.argmin(np.where(acted, np.inf, p_value)))
        if acted.sum() >= len(places) // 2 or p_value[worst] >= level / len(places):
            break
        acted[worst] = True
    whole = patches
    if len(patch_places(fit, (1, 1))[0]):
        middle, size = (fit.outline.low + fit.outline.high) / 2, fit.outline.high - fit.outline.low
        rows = window_rows(fit, middle, size, ORDERS, MANY_POINTS)
        whole = Averages.of(fit, *rows, kappa4, line)
    of_whole, its_covariance = whole.common(np.ones(len(whole.x), bool))
    p_whole = whole.p_value(of_whole)
    if p_whole >= level and not acted.any():
        gamma, covariance = of_whole, its_covariance
    # p = D kappa^4 (y - gamma x) / (i omega): real and imaginary part change places.
    factor = sheet.bending_stiffness * kappa4 / omega
    std = np.sqrt(np.diagonal(patches.spread, axis1=1, axis2=2))[::-1]
    return PatchForces(
        factor * (patches.y - gamma * patches.x) / 1j,
        factor * std,
        p_value,
        acted,
        gamma,
        np.sqrt(np.diag(covariance)),
        p_whole,
    )
