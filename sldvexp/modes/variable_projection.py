"""Variable projection: most likely unknowns of a model whose other coefficients are linear.

For given unknowns the linear coefficients are those of least squares, and what is left over is
``r = (I - P P^+) y`` of the model's columns P. Gauss-Newton steps in the unknowns make its squares
least (Golub and Pereyra); with unit noise the covariance is ``(J' J)^-1`` of

    J = -(I - P P^+) dP P^+ y - (P^+)' dP' (I - P P^+) y.

Unknowns begin with ln w of all poles and ln zeta of all poles, of which those beside the band come
last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
from sldvexp.modes.model import poles_of
from sldvexp.typing import Array, ComplexArray

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

#: Numbers of columns, and their derivatives by an unknown.
Change = tuple[Sequence[int], Array]


class VariableProjection:
    """Least squares of the linear coefficients.

    Parameters
    ----------
    rows : ndarray, shape (row, coefficient)
        The columns P at the unknowns.
    values : ndarray, shape (row, response)
        The data y.
    changes : callable
        Derivatives of the columns by the unknowns one after the other.

    Attributes
    ----------
    unitary : ndarray, shape (row, coefficient)
        Orthonormal columns Q of the span of P.
    residual : ndarray, shape (row, response)
    """

    def __init__(self, rows: Array, values: Array, changes: Callable[[], Iterable[Change]]):
        self.changes = changes
        self.unitary, triangle = np.linalg.qr(rows)
        self.inverse = scipy.linalg.solve_triangular(triangle, self.unitary.T)
        self.coefficients = self.inverse @ values
        self.residual = values - self.unitary @ (self.unitary.T @ values)

    @property
    def chi_square(self) -> float:
        """Squares of what is left over."""
        return float((self.residual**2).sum(axis=1).sum())

    def by_line(self, lines: int) -> Array:
        """Compare squares of what is left over with their expectation, shape (line,)."""
        squares = (self.residual**2).sum(axis=1)
        free = (1 - (self.unitary**2).sum(axis=1)) * self.residual.shape[1]
        by_line = (each.reshape(-1, lines).sum(axis=0) for each in (squares, free))
        return np.asarray(np.divide(*by_line))

    def jacobian(self, whole: bool) -> Array:
        """Differentiate the residual, all of it or as if nothing were left over.

        Returns
        -------
        ndarray, shape (row * response, unknown)
        """
        columns = []
        for own, change in self.changes():
            moved = change @ self.coefficients[own]
            column = -(moved - self.unitary @ (self.unitary.T @ moved))
            if whole:
                column -= self.inverse[own].T @ (change.T @ self.residual)
            columns.append(column.ravel())
        return np.stack(columns, axis=1)


def most_likely_unknowns(
    project: Callable[[Array], VariableProjection],
    start: Array,
    bounds: tuple[Array, Array],
    steps: Array,
) -> Array:
    """Find the unknowns with the least squares left over, near a start.

    Parameters
    ----------
    bounds : pair of ndarray, shape (unknown,)
        See `search_range`.
    steps : ndarray, shape (unknown,)
        Typical uncertainties.
    """

    @lru_cache(maxsize=1)
    def projected(unknowns: bytes) -> VariableProjection:
        """Project once for the residual and, if the step is taken, for the Jacobian."""
        return project(np.frombuffer(unknowns))

    low, high = bounds
    solution = scipy.optimize.least_squares(
        lambda unknowns: projected(unknowns.tobytes()).residual.ravel(),
        np.clip(start, low + 1e-9, high - 1e-9),
        lambda unknowns: projected(unknowns.tobytes()).jacobian(whole=True),
        bounds=bounds,
        x_scale=steps,
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    return np.asarray(solution.x)


def search_range(
    omega: Array, poles: int, beside: ComplexArray, others: int = 0
) -> tuple[Array, Array]:
    """Say between which values unknowns are looked for.

    Parameters
    ----------
    omega : ndarray, shape (line,), rad/s
    poles : int
        How many there are within the band.
    beside : ndarray of complex, shape (other,), rad/s
        Poles that stay on their side of the band.
    others : int
        Further unknowns, which may be anything.
    """
    count, free = poles + len(beside), np.full(others, np.inf)
    low = np.concatenate([np.log([omega[0] / 10, DAMPING[0]]).repeat(count), -free])
    high = np.concatenate([np.log([omega[-1] * 10, DAMPING[1]]).repeat(count), free])
    for k, pole in enumerate(beside, poles):
        above = abs(pole) > omega[-1]
        low[k], high[k] = (np.log(omega[-1]), high[k]) if above else (low[k], np.log(omega[0]))
    return low, high


def starts_beside(omega: Array) -> Iterator[ComplexArray]:
    """Make a pole above the band, and one below, with which a search begins, shape (1,)."""
    for side, step in ((omega[-1], 1), (omega[0], -1)):
        near = abs(side + step * BESIDE * (omega[-1] - omega[0]))
        yield poles_of(np.array([near]), np.array([BESIDE_DAMPING]))


def require_lines(enough: bool, lines: int, modes: int) -> None:
    """Complain if lines leave nothing over of so many modes."""
    if not enough:
        raise UserError(
            f"{lines} lines are too few for {modes} modes: measure more lines, or choose a "
            "narrower band"
        )


def may_be_one(first: complex, second: complex) -> bool:
    """Tell whether two poles lie within one resonance, the first one lower."""
    return abs(second.imag - first.imag) <= -NEAR * (first.real + second.real)


class FitQuality:
    """What is left over of a fit, and what was expected."""

    chi_square: float
    dof: float

    @property
    def misfit(self) -> float:
        """Variance of what is left over, over that of the noise."""
        return self.chi_square / self.dof

    def gains_on(self, poorer: FitQuality) -> bool:
        """Tell whether what more unknowns gain on a fit with fewer is no chance."""
        gain = (poorer.chi_square - self.chi_square) / max(1.0, self.misfit)
        return bool(scipy.special.chdtrc(poorer.dof - self.dof, max(gain, 0.0)) < LEVEL)
