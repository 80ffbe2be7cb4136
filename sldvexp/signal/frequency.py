"""Excitation's true frequency, from the reference records of all pixels together.

Every record has its own phase and amplitude but the same frequencies. A search of the pooled
periodogram comes within reach of the least sum of squares, and Gauss-Newton steps with all linear
coefficients eliminated (variable projection) go there. Harmonics are eliminated like hum: what
they say about the frequency is not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.errors import UserError
from sldvexp.signal.projection import project
from sldvexp.signal.sine_model import SineModel, design_matrix, sine_model
from sldvexp.typing import Array

#: Trial frequencies for each resolution cell 1/T of a record, and how many are tried at a time.
TRIALS_PER_CELL = 8
TRIALS_AT_ONCE = 64

#: Records that the search looks at, spread over the image; the refinement uses all.
SEARCH_RECORDS = 200

#: Steps below this share of a resolution cell, or of the standard error, end the refinement.
CONVERGED_CELL = 1e-9
CONVERGED_STD = 1e-3
MOST_STEPS = 20


@dataclass(frozen=True)
class Refined:
    """Frequencies with their uncertainty.

    Attributes
    ----------
    frequencies : ndarray, shape (frequency,), Hz
    std : ndarray, shape (frequency,), Hz
        Standard error from the residuals of all records.
    """

    frequencies: Array
    std: Array


def refine_frequencies(
    reference: NDArray[np.generic],
    times: ArrayLike,
    frequencies: ArrayLike,
    harmonics: int = 0,
    hum: ArrayLike = (),
    search: float = 0.0,
) -> Refined:
    """Find the least-squares frequencies of many records with phases of their own.

    Parameters
    ----------
    reference : ndarray, shape (pixel, sample)
        Good records only; the caller leaves out those that are clipped or not finite.
    times, frequencies, harmonics, hum
        As of `sldvexp.signal.sine_model.sine_model`. Without a search the frequencies must be right
        to half a resolution cell, 0.5 / T.
    search : float, Hz
        Half-width of the interval around each frequency that is searched first; 0 for none.

    Raises
    ------
    UserError
        If the records have no clear frequency within reach, or do not fit the times.
    """
    t = np.asarray(times, float)
    start = np.atleast_1d(np.asarray(frequencies, float))
    if len(reference) == 0:
        raise UserError("signal: no good reference record is left to find the frequency from")
    sine_model(t, start, harmonics, hum)  # refuses what cannot be fitted, before the search
    if search > 0:
        some = np.linspace(0, len(reference) - 1, min(len(reference), SEARCH_RECORDS)).astype(int)
        start = np.array([_search(reference[some], t, f, search) for f in start])
    cell = 1.0 / np.ptp(t)
    now = start
    for _ in range(MOST_STEPS):
        step, std = _gauss_newton(reference, sine_model(t, now, harmonics, hum))
        now = now + step
        if not np.all(np.abs(now - start) < cell):
            break
        if np.all(np.abs(step) < np.maximum(CONVERGED_CELL * cell, CONVERGED_STD * std)):
            return Refined(now, std)
    raise _not_found(frequencies, search + cell)


def _not_found(frequencies: ArrayLike, reach: float) -> UserError:
    """Say what to say when the set frequencies lead nowhere."""
    hertz = ", ".join(f"{f:.6g}" for f in np.atleast_1d(frequencies))
    return UserError(
        f"signal: the reference has no clear frequency within {reach:.4g} Hz of {hertz} Hz; check "
        "the generator and the frequency that was set, or search a wider interval"
    )


def _search(records: NDArray[np.generic], t: Array, frequency: float, search: float) -> float:
    """Find maximum of the periodogram, summed over records, on a grid around a frequency."""
    x = records - records.mean(axis=1, keepdims=True)
    spacing = 1.0 / (TRIALS_PER_CELL * np.ptp(t))
    count = int(np.ceil(search / spacing))
    trials = frequency + spacing * np.arange(-count, count + 1)
    trials = trials[trials > spacing]
    blocks = np.array_split(trials, int(np.ceil(len(trials) / TRIALS_AT_ONCE)))
    power = [(np.abs(np.exp(-2j * np.pi * np.outer(b, t)) @ x.T) ** 2).sum(axis=1) for b in blocks]
    best = int(np.argmax(np.concatenate(power)))
    if best in (0, len(trials) - 1):
        raise _not_found(frequency, search)
    return float(trials[best])


def _gauss_newton(reference: NDArray[np.generic], model: SineModel) -> tuple[Array, Array]:
    """Take one step of the frequencies; their standard errors too, shape (frequency,), Hz.

    A record's change with its frequency k, ``2 pi t (B cos - A sin)``, counts as far as it is
    orthogonal to the model's columns. ``t cos`` and ``t sin`` are projected once for all records.
    """
    f = model.frequencies
    t = model.times - model.times.mean()
    slopes = t[:, None] * design_matrix(model.times, f)[:, :-1]
    slopes = slopes - model.columns @ (model.columns.T @ slopes)
    p = model.columns.shape[1]
    sums = project(reference[None], np.hstack([model.columns, slopes]))
    c, along = sums.coefficients[0, :p].T, sums.coefficients[0, p:].T
    sse = sums.square[0].sum() - (c**2).sum()
    phasor = c @ model.phasor_map  # A - i B
    weight = 2 * np.pi * np.stack([-phasor.imag, -phasor.real], axis=-1)  # B, -A
    gradient = (weight.reshape(len(c), -1) * along).reshape(len(c), -1, 2).sum(axis=(0, 2))
    moments = np.einsum("nka,nlb->kalb", weight, weight, optimize=True)
    gram = (slopes.T @ slopes).reshape(len(f), 2, len(f), 2)
    inverse = np.linalg.pinv((moments * gram).sum(axis=(1, 3)), hermitian=True)
    s2 = max(sse, 0.0) / (len(c) * model.dof - len(f))
    return inverse @ gradient, np.sqrt(s2 * np.diag(inverse))
