"""Most likely poles with their covariance, by variable projection.

Residues and what lies beyond the band are linear: for given poles they are those of least squares,
and what is left over is ``r = (I - P P^+) y``. Gauss-Newton steps in ``ln w_r`` and ``ln zeta_r``
make its squares least (Golub and Pereyra); with unit noise the covariance is ``(J' J)^-1`` of

    J = -(I - P P^+) dP P^+ y - (P^+)' dP' (I - P P^+) y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
from sldvexp.modes.compression import PrincipalResponses
from sldvexp.modes.model import BEYOND, basis, basis_derivatives, poles_of, split
from sldvexp.typing import Array, ComplexArray

#: Typical uncertainties of ln w and ln zeta of a start.
STEP = (1e-3, 1e-1)


@dataclass(frozen=True, eq=False)
class PoleFit:
    """Most likely poles.

    Parameters
    ----------
    pole : ndarray of complex, shape (mode,), rad/s
    covariance : ndarray, shape (2 mode, 2 mode)
        Of ``ln w_r`` of all modes, then of ``ln zeta_r``, for unit noise.
    chi_square : float
        Squares of what is left over of the principal responses.
    dof : float
    by_line : ndarray, shape (line,)
        The same by line, over its expectation.
    """

    pole: ComplexArray
    covariance: Array
    chi_square: float
    dof: float
    by_line: Array

    @property
    def misfit(self) -> float:
        """Variance of what is left over, over that of the noise."""
        return self.chi_square / self.dof


def most_likely(responses: PrincipalResponses, starts: ComplexArray) -> PoleFit:
    """Find the most likely poles near some starts.

    Raises
    ------
    UserError
        If there are not enough lines for so many poles.
    """
    values, omega = split(responses.values.T), responses.omega
    count, unknown = len(starts), 2 * len(starts) + BEYOND
    dof = values.size - values.shape[1] * unknown - 2 * count
    if len(values) <= unknown or dof <= 0:
        raise UserError(
            f"{len(omega)} lines are too few for {count} modes, which need more than "
            f"{unknown // 2} lines: measure more lines, or choose a narrower band"
        )

    def left_over(unknowns: Array) -> Array:
        return _Projection(responses, values, unknowns).residual.ravel()

    def jacobian(unknowns: Array) -> Array:
        return _Projection(responses, values, unknowns).jacobian(whole=True)

    start = np.log([*np.abs(starts), *(-starts.real / np.abs(starts))])
    solution = scipy.optimize.least_squares(
        left_over,
        start,
        jacobian,
        x_scale=np.repeat(STEP, count),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    last = _Projection(responses, values, solution.x)
    slope = last.jacobian(whole=False)
    covariance = np.asarray(np.linalg.inv(slope.T @ slope), float)
    squares = (last.residual**2).sum(axis=1)
    free = (1 - (last.unitary**2).sum(axis=1)) * values.shape[1]
    lines = len(omega)
    by_line = np.asarray(squares.reshape(2, lines).sum(axis=0) / free.reshape(2, lines).sum(axis=0))
    return PoleFit(last.poles, covariance, float(squares.sum()), float(dof), by_line)


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
