"""Most likely poles of several references, by variable projection, and how many modes each has.

Poles of the linear fits have one shape each at first. A pole gets one more where its residues ask
for it, and is parted into poles of their own where these do. Each step is kept if what it gains is
no chance, so that two modes of one pole stay two modes of one pole; how far they may be apart
without being told is in its bounds.

A pole of m modes is parted along ``phi D L'`` of the next term, ``i w phi D L' / (i w - l)^2``:
the eigenvalues of D are how far its modes are apart, and its eigenvectors what their shapes are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.modes.compression import PrincipalResponses
from sldvexp.modes.model import BEYOND, basis, split
from sldvexp.modes.participation import Participation, SharedPole
from sldvexp.modes.variable_projection import (
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
from sldvexp.typing import Array, ComplexArray

#: Typical uncertainty of a share of a start.
SHARE_STEP = 0.1


#: Chance of a gain at the start of a richer model, above which it is not fitted.
PROMISE = 0.1


@dataclass(frozen=True, eq=False)
class SharedFit(FitQuality):
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
        if not may_be_one(first, second):
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
        simpler = next((one for one in tried if not fit.gains_on(one)), None)
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
    return tried if tried.gains_on(fit) else None


def _promises(lines: JointLines, fit: SharedFit, richer: Participation) -> bool:
    """Tell whether a model gains enough at its start for a fit to be worth while."""
    left = _projection(lines, richer).chi_square
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
    return None if fit.gains_on(tried) else tried


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
    return tried if tried.gains_on(fit) else None


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
    for added in starts_beside(lines.omega):
        other = replace(best.found, beyond=np.append(best.found.beyond, added))
        if not _enough(lines, other):
            break
        tried = _fitted(lines, other)
        if tried.gains_on(best):
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


def _fitted(lines: JointLines, start: Participation) -> SharedFit:
    """Fit all unknowns near a start."""
    require_lines(_enough(lines, start), lines.lines, len(start.pole))
    poles, count = len(start.poles), len(start.poles) + len(start.beyond)
    others = len(start.unknowns) - 2 * count
    found = most_likely_unknowns(
        lambda unknowns: _projection(lines, start.at(unknowns)),
        start.unknowns,
        search_range(lines.omega, poles, start.beyond, others),
        np.repeat([*STEP, SHARE_STEP], [count, count, others]),
    )
    return _evaluated(lines, start.at(found))


def _evaluated(lines: JointLines, model: Participation) -> SharedFit:
    """Put poles in rising order, and tell how well they fit."""
    order = np.argsort([abs(pole.value) for pole in model.poles], kind="stable")
    model = replace(model, poles=tuple(model.poles[k] for k in order))
    last = _projection(lines, model)
    covariance = lines.principal.covariance(last.jacobian(whole=False))
    dof = _freedom(lines, model)
    return SharedFit(model, covariance, last.chi_square, dof, last.by_line(lines.lines))


def _projection(lines: JointLines, model: Participation) -> VariableProjection:
    """Project the responses of all references at given poles and shares."""
    weighted = lines.principal.weighted
    rows, values = weighted(model.columns(lines.omega)), split(lines.principal.values.T)

    def changes() -> Iterator[Change]:
        return ((own, weighted(change)) for own, change in model.changes(lines.omega))

    return VariableProjection(rows, values, changes)
