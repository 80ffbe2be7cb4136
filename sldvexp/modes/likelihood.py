"""Most likely poles with their covariance, by variable projection.

Residues and what lies beyond the band are linear; ``ln w_r`` and ``ln zeta_r`` are the unknowns of
`sldvexp.modes.variable_projection`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.modes.compression import PrincipalResponses
from sldvexp.modes.model import BEYOND, basis, basis_derivatives, poles_of, split
from sldvexp.modes.variable_projection import (
    LEVEL,
    STEP,
    Change,
    FitQuality,
    VariableProjection,
    may_be_one,
    most_likely_unknowns,
    require_lines,
    search_range,
    starts_beside,
)
from sldvexp.typing import Array, ComplexArray, IndexArray


@dataclass(frozen=True, eq=False)
class PoleFit(FitQuality):
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


def most_likely(responses: PrincipalResponses, starts: ComplexArray) -> PoleFit:
    """Find the most likely poles near some starts, with as many beside the band as lines ask for.

    Raises
    ------
    UserError
        If there are not enough lines for so many poles.
    """
    best = _without_doubles(responses, _fitted(responses, starts, np.zeros(0, complex)))
    for added in starts_beside(responses.omega):
        other = np.append(best.beyond, added)
        if not _enough(responses, len(best.pole) + len(other)):
            break
        tried = _fitted(responses, best.pole, other)
        if tried.gains_on(best):
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


def _without_doubles(responses: PrincipalResponses, fit: PoleFit) -> PoleFit:
    """Join modes that lie within one resonance, unless lines need them both."""
    k = 0
    while k + 1 < len(fit.pole):
        if not may_be_one(*fit.pole[k : k + 2]):
            k += 1
            continue
        fewer = [np.delete(np.arange(len(fit.pole)), j) for j in (k, k + 1)]
        tried = [_fitted(responses, fit.pole[left], fit.beyond) for left in fewer]
        best = int(tried[1].chi_square < tried[0].chi_square)
        if len(tried[best].pole) < len(fit.pole) - 1 or fit.gains_on(tried[best]):
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
    whole = np.concatenate([starts, beside])
    count = len(whole)
    require_lines(_enough(responses, count), len(responses.frequency), count)
    found = most_likely_unknowns(
        lambda unknowns: _projection(responses, _poles_at(unknowns)),
        _unknowns_of(whole),
        search_range(responses.omega, len(starts), beside),
        np.repeat(STEP, count),
    )
    return _evaluated(responses, _poles_at(found), len(starts))


def at_poles(responses: PrincipalResponses, poles: ComplexArray) -> PoleFit:
    """Judge given poles as `most_likely` does its own; they have no covariance."""
    fit = _evaluated(responses, _poles_at(_unknowns_of(poles)), len(poles))
    return replace(fit, covariance=np.full_like(fit.covariance, np.nan))


def _evaluated(responses: PrincipalResponses, poles: ComplexArray, starts: int) -> PoleFit:
    """Tell poles within the band, the first of which are no others, and how well they fit."""
    omega, last = responses.omega, _projection(responses, poles)
    count, lines, columns = len(poles), len(omega), last.residual.shape[1]
    covariance = responses.covariance(last.jacobian(whole=False))
    size = np.abs(poles)
    inside = np.flatnonzero((size >= omega[0]) & (size <= omega[-1]) & (np.arange(count) < starts))
    inside = inside[np.argsort(size[inside], kind="stable")]
    own = np.concatenate([inside, count + inside])
    dof = float((2 * lines - 2 * count - BEYOND) * columns - 2 * count)
    return PoleFit(
        poles[inside],
        np.delete(poles, inside),
        inside,
        covariance[np.ix_(own, own)],
        last.chi_square,
        dof,
        last.by_line(lines),
    )


def _unknowns_of(poles: ComplexArray) -> Array:
    """List ln w_r, then ln zeta_r, of poles."""
    size = np.abs(poles)
    return np.log([*size, *(-poles.real / size)])


def _poles_at(unknowns: Array) -> ComplexArray:
    """Make poles of ln w_r and ln zeta_r."""
    return poles_of(*np.exp(unknowns).reshape(2, -1))


def _projection(responses: PrincipalResponses, poles: ComplexArray) -> VariableProjection:
    """Project the responses at given poles."""
    count, omega = len(poles), responses.omega

    def changes() -> Iterator[Change]:
        each = basis_derivatives(poles, omega).reshape(2 * count, -1, 2)
        for k, change in enumerate(each):
            mode = k % count
            yield [mode, count + mode], responses.weighted(change)

    rows = responses.weighted(basis(poles, omega))
    return VariableProjection(rows, split(responses.values.T), changes)
