"""Harmonics of strong lines as a noise of the lines that they fall on.

A receiver or a structure that is not quite linear adds, at n times the frequency of a line, a part
h_n of its velocity, in a phase and pattern of its own. To the lines there that is a disturbance of
variance

    s^2(w) = sum_n h_n^2 P(w / n)

in each part, P being half the mean square of the measured velocity. Its ratios h_n, one for each
order, are the most likely ones for what a first fit leaves over line by line, whose squares are
taken as those of independent normal numbers of the variance 1 + s^2, the noise's being 1. Lines
then count by the inverse of that: few are lost, none need be named, and bounds hold what is added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.modes.compression import PrincipalResponses
from sldvexp.modes.responses import Responses
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array, IndexArray

#: Orders that are looked for.
ORDERS = (2, 3, 4, 5)
#: Level of the tests of the misfit that asks for harmonics, and of what each order gains.
LEVEL = 1e-3
#: How far a line may be from the multiple of another, relatively.
SAME = 1e-6
#: Ratios between which the most likely one is looked for.
RATIO = (1e-7, 1.0)


@dataclass(frozen=True, eq=False)
class LineHarmonics:
    """Harmonics that were found.

    Parameters
    ----------
    order : ndarray of int, shape (harmonic,)
        Two for the second harmonic; empty if there are none.
    ratio : ndarray, shape (harmonic,)
        Amplitude over that of the line it belongs to.
    source : ndarray of int, shape (harmonic, line)
        Place among the images' lines of the line that it belongs to, -1 where there is none.
    """

    order: IndexArray
    ratio: Array
    source: IndexArray

    @classmethod
    def none(cls, lines: int) -> LineHarmonics:
        """Make that of lines without harmonics."""
        return cls(np.zeros(0, int), np.zeros(0), np.zeros((0, lines), int))

    def variance(self, power: Array) -> Array:
        """Compute what they add to the variance of each part of lines.

        Parameters
        ----------
        power : ndarray, shape (..., line of the images)
            Variance of each part of their velocities.

        Returns
        -------
        ndarray, shape (..., line)
        """
        added = np.zeros((*power.shape[:-1], self.source.shape[1]))
        for ratio, source in zip(self.ratio, self.source, strict=True):
            added += ratio**2 * _of_sources(source, power)
        return added


def find_harmonics(
    responses: Responses, principal: PrincipalResponses, misfit_by_line: Array
) -> LineHarmonics:
    """Find the ratios of harmonics that explain what a fit leaves over, if it leaves too much.

    Parameters
    ----------
    responses : Responses
    principal : PrincipalResponses
        Their responses as they were fitted.
    misfit_by_line : ndarray, shape (line,)
        Variance of what is left over, over that of the noise.
    """
    found, dof = LineHarmonics.none(len(misfit_by_line)), 2 * len(principal.values)
    total = dof * len(misfit_by_line)
    if chi_square_p_value(float(dof * misfit_by_line.sum()), total) > LEVEL:
        return found
    power = principal_power(responses, principal)
    every = _sources(responses, principal.frequency)
    unit = np.stack([_of_sources(source, power) for source in every]) * principal.weight**2
    kept = np.flatnonzero(unit.any(axis=1))
    ratio = _most_likely(unit[kept], misfit_by_line)
    best = _surprise(unit[kept], misfit_by_line, ratio)
    needed = []
    for k in range(len(kept)):
        rest = np.delete(unit[kept], k, axis=0)
        without = _surprise(rest, misfit_by_line, _most_likely(rest, misfit_by_line))
        needed.append(bool(scipy.special.chdtrc(1, max(dof * (without - best), 0.0)) < LEVEL))
    kept = kept[needed]
    ratio = _most_likely(unit[kept], misfit_by_line)
    return LineHarmonics(np.array(ORDERS)[kept], ratio, every[kept])


def weigh(
    principal: PrincipalResponses, responses: Responses, harmonics: LineHarmonics
) -> PrincipalResponses:
    """Give lines the weights that noise and harmonics together ask for."""
    power = principal_power(responses, principal)
    added = harmonics.variance(power) * principal.weight**2
    less = 1 / np.sqrt(1 + added)
    return replace(principal, values=principal.values * less, weight=principal.weight * less)


def principal_power(responses: Responses, principal: PrincipalResponses) -> Array:
    """Compute the mean square of a part of the principal responses, (line of the images,).

    All pixels' squares are those of the responses, which share them; harmonics have patterns of
    their own, and are taken to be shared alike.
    """
    scale = max(1.0, principal.noise_ratio)
    return responses.power() * principal.pixels / len(principal.values) / scale**2


def _sources(responses: Responses, line: Array) -> IndexArray:
    """Find the line of the images whose harmonic of each order a line is, (order, line)."""
    known = responses.every_line
    found = []
    for order in ORDERS:
        nearest = np.abs(known[:, None] - line / order).argmin(axis=0)
        same = np.abs(known[nearest] * order - line) < SAME * line
        found.append(np.where(same, nearest, -1))
    return np.array(found)


def _of_sources(source: IndexArray, power: Array) -> Array:
    """Take the power of the lines that harmonics belong to, 0 where there is none."""
    return np.asarray(np.where(source >= 0, power[..., source], 0.0))


def _most_likely(unit: Array, misfit: Array) -> Array:
    """Find the ratios that make the misfits most likely."""
    if not len(unit):
        return np.zeros(0)
    low, high = 2 * np.log(RATIO)
    start = np.full(len(unit), np.clip(np.log(misfit.mean() / unit.max()), low, high))
    least = scipy.optimize.minimize(
        lambda x: _surprise(unit, misfit, np.exp(x / 2)),
        start,
        jac=lambda x: _slope(unit, misfit, np.exp(x / 2)),
        method="L-BFGS-B",
        bounds=[(low, high)] * len(unit),
    )
    return np.asarray(np.exp(least.x / 2))


def _surprise(unit: Array, misfit: Array, ratio: Array) -> float:
    """Compute minus twice the log likelihood for each degree of freedom of a line."""
    expected = 1 + ratio**2 @ unit
    return float((np.log(expected) + misfit / expected).sum())


def _slope(unit: Array, misfit: Array, ratio: Array) -> Array:
    """Differentiate it by the logarithms of the squared ratios."""
    expected = 1 + ratio**2 @ unit
    return np.asarray(ratio**2 * (unit @ (1 / expected - misfit / expected**2)))
