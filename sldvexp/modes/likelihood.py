"""Most likely poles with their covariance, by variable projection.

Residues and what lies beyond the band are linear: for given poles they are those of least squares,
and what is left over is ``r = (I - P P^+) y``. Gauss-Newton steps in ``ln w_r`` and ``ln zeta_r``
make its squares least (Golub and Pereyra); with unit noise the covariance is ``(J' J)^-1`` of

    J = -(I - P P^+) dP P^+ y - (P^+)' dP' (I - P P^+) y.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
from sldvexp.modes.compression import PrincipalResponses
from sldvexp.modes.model import BEYOND, basis, basis_derivatives, poles_of, split
from sldvexp.typing import Array, ComplexArray, IndexArray

#: Typical uncertainties of ln w and ln zeta of a start.
STEP = (1e-3, 1e-1)
#: Damping ratios between which poles are looked for.
DAMPING = (1e-7, 0.9)
#: Where modes beyond the band are looked for first, in parts of the band, and their damping.
BESIDE, BESIDE_DAMPING = 0.15, 0.02
#: Modes nearer than so many widths of their resonances are asked whether they are one.
NEAR = 2.0
#: Chance of such an improvement by a mode that is none.
LEVEL = 1e-6


@dataclass(frozen=True, eq=False)
class PoleFit:
    """Most likely poles.

    Parameters
    ----------
    pole : ndarray of complex, shape (mode,), rad/s
        Of modes within the band, in rising order.
    beyond : ndarray of complex, shape (other,), rad/s
        Of modes beside the band, which the lines show but do not tell well.
    start : ndarray of int, shape (mode,)
        Which of the starts each mode came from.
    covariance : ndarray, shape (2 mode, 2 mode)
        Of ``ln w_r`` of the modes within the band, then of ``ln zeta_r``, for unit noise.
    chi_square : float
        Squares of what is left over of the principal responses.
    dof : float
    by_line : ndarray, shape (line,)
        The same by line, over its expectation.
    """

    pole: ComplexArray
    beyond: ComplexArray
    start: IndexArray
    covariance: Array
    chi_square: float
    dof: float
    by_line: Array

    @property
    def misfit(self) -> float:
        """Variance of what is left over, over that of the noise."""
        return self.chi_square / self.dof


def most_likely(responses: PrincipalResponses, starts: ComplexArray) -> PoleFit:
    """Find the most likely poles near some starts, with as many beside the band as lines ask for.

    Raises
    ------
    UserError
        If there are not enough lines for so many poles.
    """
    best = _without_doubles(responses, _fitted(responses, starts, np.zeros(0, complex)))
    omega = responses.omega
    for side, step in ((omega[-1], 1), (omega[0], -1)):
        near = abs(side + step * BESIDE * (omega[-1] - omega[0]))
        added = poles_of(np.array([near]), np.array([BESIDE_DAMPING]))
        other = np.append(best.beyond, added)
        if not _enough(responses, len(best.pole) + len(other)):
            break
        tried = _fitted(responses, best.pole, other)
        if _better(tried, best):
            best = replace(tried, start=best.start[tried.start])
    return best


def without_noise(responses: PrincipalResponses, fit: PoleFit) -> PoleFit:
    """Leave out modes whose residues are no more than noise that neighbouring lines share.

    Such noise looks like a mode where the window makes it decay. Of each mode the squares of its
    residues, over their covariance, are those of chi-square if it is none.
    """
    while responses.correlation is not None and len(fit.pole):
        whole = np.append(fit.pole, fit.beyond)
        inverse = np.linalg.pinv(responses.weighted(basis(whole, responses.omega)))
        found = inverse @ split(responses.values.T)
        spread = inverse @ responses.correlation @ inverse.T
        chance = []
        for k in range(len(fit.pole)):
            own = [k, len(whole) + k]
            squares = np.sum(found[own] * np.linalg.solve(spread[np.ix_(own, own)], found[own]))
            squares /= max(1.0, fit.misfit)
            chance.append(float(scipy.special.chdtrc(found[own].size, squares)))
        worst = int(np.argmax(chance))
        if chance[worst] < LEVEL:
            break
        left = np.delete(np.arange(len(fit.pole)), worst)
        if not len(left):
            return replace(fit, pole=fit.pole[:0], start=fit.start[:0])
        again = _fitted(responses, fit.pole[left], fit.beyond)
        fit = replace(again, start=fit.start[left][again.start])
    return fit


def _better(richer: PoleFit, poorer: PoleFit) -> bool:
    """Tell whether what one more pole gains is no chance."""
    gain = (poorer.chi_square - richer.chi_square) / max(1.0, richer.misfit)
    return bool(scipy.special.chdtrc(poorer.dof - richer.dof, max(gain, 0.0)) < LEVEL)


def _without_doubles(responses: PrincipalResponses, fit: PoleFit) -> PoleFit:
    """Join modes that lie within one resonance, unless lines need them both."""
    k = 0
    while k + 1 < len(fit.pole):
        first, second = fit.pole[k : k + 2]
        if abs(second.imag - first.imag) > -NEAR * (first.real + second.real):
            k += 1
            continue
        fewer = [np.delete(np.arange(len(fit.pole)), j) for j in (k, k + 1)]
        tried = [_fitted(responses, fit.pole[left], fit.beyond) for left in fewer]
        best = int(tried[1].chi_square < tried[0].chi_square)
        if len(tried[best].pole) < len(fit.pole) - 1 or _better(fit, tried[best]):
            k += 1
            continue
        start = fit.start[fewer[best]][tried[best].start]
        fit, k = replace(tried[best], start=start), max(k - 1, 0)
    return fit


def _enough(responses: PrincipalResponses, count: int) -> bool:
    """Tell whether lines leave something over of so many poles."""
    rows, columns = 2 * len(responses.frequency), len(responses.values)
    return (rows - 2 * count - BEYOND) * columns > 2 * count


def _fitted(responses: PrincipalResponses, starts: ComplexArray, beside: ComplexArray) -> PoleFit:
    """Fit poles near starts, and others that stay beside the band."""
    values, omega = split(responses.values.T), responses.omega
    whole = np.concatenate([starts, beside])
    count, lines = len(whole), len(omega)
    if not _enough(responses, count):
        raise UserError(
            f"{lines} lines are too few for {count} modes: measure more lines, or choose a "
            "narrower band"
        )
    low = np.log([*np.full(count, omega[0] / 10), *np.full(count, DAMPING[0])])
    high = np.log([*np.full(count, omega[-1] * 10), *np.full(count, DAMPING[1])])
    for k, pole in enumerate(beside, len(starts)):
        above = abs(pole) > omega[-1]
        low[k], high[k] = (np.log(omega[-1]), high[k]) if above else (low[k], np.log(omega[0]))

    def left_over(unknowns: Array) -> Array:
        return _Projection(responses, values, unknowns).residual.ravel()

    def jacobian(unknowns: Array) -> Array:
        return _Projection(responses, values, unknowns).jacobian(whole=True)

    start = np.log([*np.abs(whole), *(-whole.real / np.abs(whole))])
    solution = scipy.optimize.least_squares(
        left_over,
        np.clip(start, low + 1e-9, high - 1e-9),
        jacobian,
        bounds=(low, high),
        x_scale=np.repeat(STEP, count),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    return _evaluated(responses, _Projection(responses, values, solution.x), len(starts))


def at_poles(responses: PrincipalResponses, poles: ComplexArray) -> PoleFit:
    """Judge given poles as `most_likely` does its own; they have no covariance."""
    unknowns = np.log([*np.abs(poles), *(-poles.real / np.abs(poles))])
    found = _Projection(responses, split(responses.values.T), unknowns)
    fit = _evaluated(responses, found, len(poles))
    return replace(fit, covariance=np.full_like(fit.covariance, np.nan))


def _evaluated(responses: PrincipalResponses, last: _Projection, starts: int) -> PoleFit:
    """Tell poles within the band, the first of which are no others, and how well they fit."""
    omega, values = responses.omega, last.residual
    count, lines = len(last.poles), len(omega)
    slope = last.jacobian(whole=False)
    covariance = responses.covariance(slope)
    squares = (last.residual**2).sum(axis=1)
    free = (1 - (last.unitary**2).sum(axis=1)) * values.shape[1]
    by_line = np.asarray(squares.reshape(2, lines).sum(axis=0) / free.reshape(2, lines).sum(axis=0))
    size = np.abs(last.poles)
    inside = np.flatnonzero((size >= omega[0]) & (size <= omega[-1]) & (np.arange(count) < starts))
    inside = inside[np.argsort(size[inside], kind="stable")]
    own = np.concatenate([inside, count + inside])
    dof = float((2 * lines - 2 * count - BEYOND) * values.shape[1] - 2 * count)
    return PoleFit(
        last.poles[inside],
        np.delete(last.poles, inside),
        inside,
        covariance[np.ix_(own, own)],
        float(squares.sum()),
        dof,
        by_line,
    )


class _Projection:
    """Least squares of the linear coefficients at given poles."""

    def __init__(self, responses: PrincipalResponses, values: Array, unknowns: Array):
        count = len(unknowns) // 2
        self.responses = responses
        self.poles = poles_of(np.exp(unknowns[:count]), np.exp(unknowns[count:]))
        rows = responses.weighted(basis(self.poles, responses.omega))
        self.unitary, triangle = np.linalg.qr(rows)
        self.inverse = scipy.linalg.solve_triangular(triangle, self.unitary.T)
        self.coefficients = self.inverse @ values
        self.residual = values - self.unitary @ (self.unitary.T @ values)

    def jacobian(self, whole: bool) -> Array:
        """Differentiate the residual, all of it or as if nothing were left over."""
        count = len(self.poles)
        changes = basis_derivatives(self.poles, self.responses.omega)
        columns: list[Array] = []
        for change in changes.reshape(2 * count, -1, 2):
            mode = len(columns) % count
            own = [mode, count + mode]
            weighted = self.responses.weighted(change)
            moved = weighted @ self.coefficients[own]
            column = -(moved - self.unitary @ (self.unitary.T @ moved))
            if whole:
                column -= self.inverse[own].T @ (weighted.T @ self.residual)
            columns.append(column.ravel())
        return np.stack(columns, axis=1)
