"""Most likely poles of several references, by variable projection, and how many modes each has.

Poles of the linear fits have one shape each at first. A pole gets one more where its residues ask
for it, and is parted into poles of their own where these do. Each step is kept if what it gains is
no chance, so that two modes of one pole stay two modes of one pole; how far they may be apart
without being told is in its bounds.

A pole of m modes is parted along ``phi D L'`` of the next term, ``i w phi D L' / (i w - l)^2``:
the eigenvalues of D are how far its modes are apart, and its eigenvectors what their shapes are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
from sldvexp.modes.compression import PrincipalResponses
from sldvexp.modes.likelihood import BESIDE, BESIDE_DAMPING, DAMPING, LEVEL, NEAR, STEP
from sldvexp.modes.model import BEYOND, basis, poles_of, split
from sldvexp.modes.participation import Participation, SharedPole
from sldvexp.typing import Array, ComplexArray

#: Typical uncertainty of a share of a start.
SHARE_STEP = 0.1


#: Chance of a gain at the start of a richer model, above which it is not fitted.
PROMISE = 0.1


@dataclass(frozen=True, eq=False)
class SharedFit:
    """Most likely poles and shares.

    Parameters
    ----------
    found : Participation
        Poles in rising order.
    covariance : ndarray, shape (unknown, unknown)
        Of its unknowns, for unit noise.
    chi_square, dof : float
        Squares of what is left over of the principal responses, and their expectation.
    by_line : ndarray, shape (line,)
        Ratio of the two by line, of all references.
    """

    found: Participation
    covariance: Array
    chi_square: float
    dof: float
    by_line: Array

    @property
    def misfit(self) -> float:
        """Variance of what is left over, over that of the noise."""
        return self.chi_square / self.dof


#: Another fit with more or fewer modes at one of the poles; None if lines do not need it.
Step = Callable[["JointLines", SharedFit, int], "SharedFit | None"]


@dataclass(frozen=True, eq=False)
class JointLines:
    """Principal responses of several references.

    Parameters
    ----------
    principal : PrincipalResponses
        Their values and weights are those of all references side by side.
    references : int
    """

    principal: PrincipalResponses
    references: int

    @property
    def omega(self) -> Array:
        """Lines of one reference, rad/s."""
        return self.principal.omega

    @property
    def lines(self) -> int:
        """How many lines each reference has."""
        return len(self.principal.frequency)

    @property
    def stacked(self) -> PrincipalResponses:
        """Responses of all references as rows of one weight, for the linear fits."""
        weight = self.principal.weight.reshape(self.references, -1)
        one = np.exp(np.log(weight).mean(axis=0))
        values = self.principal.values.reshape(-1, self.references, self.lines) * (one / weight)
        return replace(
            self.principal,
            values=values.reshape(-1, self.lines),
            weight=one,
        )

    def residues(self, poles: ComplexArray, squared: ComplexArray | None = None) -> ComplexArray:
        """Fit residues of any rank at given poles, and of double poles beside them.

        Returns
        -------
        ndarray of complex, shape (pole, response, reference)
        """
        columns = basis(poles, self.omega)
        if squared is not None:
            iw = 1j * self.omega[:, None]
            one = iw / (iw - squared) ** 2, iw / (iw - squared.conj()) ** 2
            more = split(np.concatenate([one[0] + one[1], 1j * (one[0] - one[1])], axis=1))
            columns = np.concatenate([more, columns], axis=1)
        count, found = len(poles) if squared is None else len(squared), []
        weights = self.principal.weight.reshape(self.references, -1)
        values = self.principal.values.reshape(-1, self.references, self.lines)
        for k, weight in enumerate(weights):
            rows = np.tile(weight, 2)[:, None] * columns
            own = np.linalg.lstsq(rows, split(values[:, k].T), rcond=None)[0]
            found.append(own[:count] + 1j * own[count : 2 * count])
        return np.stack(found, axis=-1)


def most_likely_jointly(lines: JointLines, starts: ComplexArray) -> SharedFit:
    """Find the most likely poles near some starts, and how many modes each has.

    Raises
    ------
    UserError
        If there are not enough lines for so many poles.
    """
    best = _fitted(lines, Participation(_of_rank(lines, starts, [1] * len(starts)), starts[:0]))
    best = _without_doubles(lines, _within_the_band(lines, best))
    for step in (_with_more_modes, _with_fewer_modes, _parted):
        while (tried := _first_step(step, lines, best)) is not None:
            best = tried
    return _with_distances(lines, _with_others(lines, best))


def _first_step(step: Step, lines: JointLines, fit: SharedFit) -> SharedFit | None:
    """Take the first step that is one, from the pole whose residues ask most for one more mode."""
    values, strength = _values(fit), []
    for pole, residue in zip(fit.found.poles, lines.residues(values), strict=True):
        size = np.append(np.linalg.svd(residue, compute_uv=False), 0.0)[pole.modes]
        strength.append(size**2 * abs(pole.value) / -pole.value.real)
    tried = (step(lines, fit, int(k)) for k in np.argsort(strength)[::-1])
    return next((one for one in tried if one is not None), None)


def _of_rank(lines: JointLines, poles: ComplexArray, modes: list[int]) -> tuple[SharedPole, ...]:
    """Give poles the shares that their residues have, of so many modes each."""
    found = []
    for pole, residue, count in zip(poles, lines.residues(poles), modes, strict=True):
        rows = np.linalg.svd(residue, full_matrices=False)[2][:count]
        found.append(SharedPole.from_rows(complex(pole), rows))
    return tuple(found)


def _better(richer: SharedFit, poorer: SharedFit) -> bool:
    """Tell whether what more unknowns gain is no chance."""
    gain = (poorer.chi_square - richer.chi_square) / max(1.0, richer.misfit)
    return bool(scipy.special.chdtrc(poorer.dof - richer.dof, max(gain, 0.0)) < LEVEL)


def _values(fit: SharedFit) -> ComplexArray:
    return np.array([pole.value for pole in fit.found.poles], complex)


def _within_the_band(lines: JointLines, fit: SharedFit) -> SharedFit:
    """Take poles that left the band for others beside it."""
    omega, values = lines.omega, _values(fit)
    inside = (abs(values) >= omega[0]) & (abs(values) <= omega[-1])
    if inside.all() or not inside.any():
        return fit
    poles = tuple(fit.found.poles[k] for k in np.flatnonzero(inside))
    return _fitted(lines, Participation(poles, np.append(fit.found.beyond, values[~inside])))


def _without_doubles(lines: JointLines, fit: SharedFit) -> SharedFit:
    """Join poles that lie within one resonance, unless lines need both, with one mode or two."""
    k = 0
    while k + 1 < len(fit.found.poles):
        first, second = _values(fit)[k : k + 2]
        if abs(second.imag - first.imag) > -NEAR * (first.real + second.real):
            k += 1
            continue
        poles = fit.found.poles
        values = np.delete(_values(fit), k + 1)
        values[k] = (first + second) / 2
        tried = []
        for modes in (1, 2):
            count = [modes if j == k else 1 for j in range(len(values))]
            joined = (*poles[:k], _of_rank(lines, values, count)[k], *poles[k + 2 :])
            tried.append(_fitted(lines, replace(fit.found, poles=joined)))
        simpler = next((one for one in tried if not _better(fit, one)), None)
        fit, k = (fit, k + 1) if simpler is None else (simpler, max(k - 1, 0))
    return fit


def _with_more_modes(lines: JointLines, fit: SharedFit, at: int) -> SharedFit | None:
    """Give a pole one more mode, if lines need it."""
    pole = fit.found.poles[at]
    if pole.modes == lines.references:
        return None
    modes = [p.modes + (k == at) for k, p in enumerate(fit.found.poles)]
    model = _with(fit, at, _of_rank(lines, _values(fit), modes)[at])
    if not _enough(lines, model) or not _promises(lines, fit, model):
        return None
    tried = _fitted(lines, model)
    return tried if _better(tried, fit) else None


def _promises(lines: JointLines, fit: SharedFit, richer: Participation) -> bool:
    """Tell whether a model gains enough at its start for a fit to be worth while."""
    left = float((_SharedProjection(lines, richer).residual ** 2).sum())
    gain = (fit.chi_square - left) / max(1.0, fit.misfit)
    more = len(richer.unknowns) - len(fit.found.unknowns) + fit.dof - _freedom(lines, richer)
    return bool(scipy.special.chdtrc(more, max(gain, 0.0)) < PROMISE)


def _with_fewer_modes(lines: JointLines, fit: SharedFit, at: int) -> SharedFit | None:
    """Take a mode from a pole, if lines do not need it."""
    modes = [p.modes - (k == at) for k, p in enumerate(fit.found.poles)]
    if not modes[at]:
        return None  # poles that are none were left out before
    fewer = _of_rank(lines, _values(fit), modes)[at]
    tried = _fitted(lines, _with(fit, at, fewer))
    return None if _better(fit, tried) else tried


def _parted(lines: JointLines, fit: SharedFit, at: int) -> SharedFit | None:
    """Part a pole of several modes into poles of one mode each, if lines need that."""
    pole = fit.found.poles[at]
    if pole.modes == 1:
        return None
    distance, turned = _distances(lines, fit, at)
    rows = np.linalg.solve(turned, pole.share.T)
    moved = pole.value + distance
    if not np.isfinite(moved).all() or (moved.real >= 0).any() or (moved.imag <= 0).any():
        return None
    own = [SharedPole.from_rows(complex(m), r[None]) for m, r in zip(moved, rows, strict=True)]
    tried = _fitted(lines, _with(fit, at, *own))
    return tried if _better(tried, fit) else None


def _distances(lines: JointLines, fit: SharedFit, at: int) -> tuple[ComplexArray, ComplexArray]:
    """Estimate how far the modes of a pole are from it, rad/s, and how shapes mix in them."""
    values, pole = _values(fit), fit.found.poles[at]
    next_term = lines.residues(values, values[at : at + 1])[0]
    shapes = lines.residues(values)[at][:, pole.pivots]
    apart = np.linalg.pinv(shapes) @ next_term @ np.linalg.pinv(pole.share.T)
    distance, turned = np.linalg.eig(apart)
    return distance, turned


def _with_distances(lines: JointLines, fit: SharedFit) -> SharedFit:
    """Put into the covariance of poles of several modes how far these may be apart."""
    covariance, count = fit.covariance.copy(), len(fit.found.poles) + len(fit.found.beyond)
    for k, pole in enumerate(fit.found.poles):
        if pole.modes > 1:
            distance = _distances(lines, fit, k)[0]
            covariance[k, k] += np.mean(distance.imag**2) / abs(pole.value) ** 2
            covariance[count + k, count + k] += np.mean((distance.real / pole.value.real) ** 2)
    return replace(fit, covariance=covariance)


def _with(fit: SharedFit, at: int, *others: SharedPole) -> Participation:
    """Put other poles in the place of one."""
    poles = fit.found.poles
    return replace(fit.found, poles=(*poles[:at], *others, *poles[at + 1 :]))


def _with_others(lines: JointLines, best: SharedFit) -> SharedFit:
    """Add poles beside the band, as lines ask for them."""
    omega = lines.omega
    for side, step in ((omega[-1], 1), (omega[0], -1)):
        near = abs(side + step * BESIDE * (omega[-1] - omega[0]))
        added = poles_of(np.array([near]), np.array([BESIDE_DAMPING]))
        other = replace(best.found, beyond=np.append(best.found.beyond, added))
        if not _enough(lines, other):
            break
        tried = _fitted(lines, other)
        if _better(tried, best):
            best = tried
    return best


def _freedom(lines: JointLines, model: Participation) -> float:
    """Count the real degrees of freedom that a model leaves over."""
    linear = 2 * len(model.pole) + lines.references * (BEYOND + 2 * len(model.beyond))
    rows, columns = 2 * lines.references * lines.lines, len(lines.principal.values)
    return float((rows - linear) * columns - len(model.unknowns))


def _enough(lines: JointLines, model: Participation) -> bool:
    """Tell whether lines leave something over."""
    return _freedom(lines, model) > 0


def _bounds(model: Participation, omega: Array) -> tuple[Array, Array]:
    """Say between which values unknowns are looked for; poles beside the band stay there."""
    own, count = len(model.poles), len(model.poles) + len(model.beyond)
    free = len(model.unknowns) - 2 * count
    low = np.array([*np.log([omega[0] / 10, DAMPING[0]]).repeat(count), *np.full(free, -np.inf)])
    high = np.array([*np.log([omega[-1] * 10, DAMPING[1]]).repeat(count), *np.full(free, np.inf)])
    for k, pole in enumerate(model.beyond, own):
        above = abs(pole) > omega[-1]
        low[k], high[k] = (np.log(omega[-1]), high[k]) if above else (low[k], np.log(omega[0]))
    return low, high


def _fitted(lines: JointLines, start: Participation) -> SharedFit:
    """Fit all unknowns near a start."""
    if not _enough(lines, start):
        raise UserError(
            f"{lines.lines} lines are too few for {len(start.pole)} modes: measure more lines, or "
            "choose a narrower band"
        )
    count = len(start.poles) + len(start.beyond)
    low, high = _bounds(start, lines.omega)
    steps = np.repeat([*STEP, SHARE_STEP], [count, count, len(low) - 2 * count])

    def left_over(unknowns: Array) -> Array:
        return _SharedProjection(lines, start.at(unknowns)).residual.ravel()

    def jacobian(unknowns: Array) -> Array:
        return _SharedProjection(lines, start.at(unknowns)).jacobian(whole=True)

    solution = scipy.optimize.least_squares(
        left_over,
        np.clip(start.unknowns, low + 1e-9, high - 1e-9),
        jacobian,
        bounds=(low, high),
        x_scale=steps,
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    return _evaluated(lines, start.at(solution.x))


def _evaluated(lines: JointLines, model: Participation) -> SharedFit:
    """Put poles in rising order, and tell how well they fit."""
    order = np.argsort([abs(pole.value) for pole in model.poles], kind="stable")
    model = replace(model, poles=tuple(model.poles[k] for k in order))
    last = _SharedProjection(lines, model)
    slope = last.jacobian(whole=False)
    covariance = lines.principal.covariance(slope)
    columns = last.residual.shape[1]
    squares = (last.residual**2).sum(axis=1).reshape(-1, lines.lines).sum(axis=0)
    free = (1 - (last.unitary**2).sum(axis=1)) * columns
    by_line = np.asarray(squares / free.reshape(-1, lines.lines).sum(axis=0))
    return SharedFit(model, covariance, float(squares.sum()), _freedom(lines, model), by_line)


class _SharedProjection:
    """Least squares of the linear coefficients at given poles and shares."""

    def __init__(self, lines: JointLines, model: Participation):
        self.lines, self.model = lines, model
        values = split(lines.principal.values.T)
        self.unitary, triangle = np.linalg.qr(self._weighted(model.columns(lines.omega)))
        self.inverse = scipy.linalg.solve_triangular(triangle, self.unitary.T)
        self.coefficients = self.inverse @ values
        self.residual = values - self.unitary @ (self.unitary.T @ values)

    def _weighted(self, rows: Array) -> Array:
        return self.lines.principal.weighted(rows)

    def jacobian(self, whole: bool) -> Array:
        """Differentiate the residual, all of it or as if nothing were left over."""
        columns = []
        for own, change in self.model.changes(self.lines.omega):
            weighted = self._weighted(change)
            moved = weighted @ self.coefficients[own]
            column = -(moved - self.unitary @ (self.unitary.T @ moved))
            if whole:
                column -= self.inverse[own].T @ (weighted.T @ self.residual)
            columns.append(column.ravel())
        return np.stack(columns, axis=1)
