"""Linear model of one record, ``V = sum_k A_k cos(w_k t) + B_k sin(w_k t) + C`` (Eq 3.2).

Its columns are made orthonormal, ``S = Q R``, with the intercept last. Then the coefficients
``c = Q^T V`` are independent, each with the variance of a sample, and to drop the intercept is to
set its coefficient to zero: the other coefficients and the rest of R stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.typing import Array, ComplexArray

#: Beyond this condition number of S two columns are the same for a record of that length.
LARGEST_CONDITION = 100.0

#: Frequencies that differ by less than this share are one frequency.
SAME_FREQUENCY = 1e-9


@dataclass(frozen=True, repr=False)
class SineModel:
    """Orthonormal columns of the fit, shared by all pixels and both channels.

    Attributes
    ----------
    times : ndarray, shape (sample,), s
    frequencies : ndarray, shape (frequency,), Hz
        Those that the pixels are wanted at.
    nuisance : ndarray, shape (other,), Hz
        Harmonics and hum, fitted so that they do not disturb, then discarded.
    columns : ndarray, shape (sample, column)
        Q: cos and sin of each frequency, of each nuisance, then the intercept.
    triangle : ndarray, shape (column, column)
        R.
    """

    times: Array
    frequencies: Array
    nuisance: Array
    columns: Array
    triangle: Array

    def __repr__(self) -> str:
        samples, columns = self.columns.shape
        hertz = ", ".join(f"{f:g}" for f in self.frequencies)
        return f"model of {hertz} Hz: {samples} samples, {columns} columns"

    @property
    def dof(self) -> int:
        """Degrees of freedom that the full model leaves, n - p."""
        return self.columns.shape[0] - self.columns.shape[1]

    @property
    def phasor_map(self) -> ComplexArray:
        """Matrix M, shape (column, frequency), of ``A - i B = c M``.

        ``A cos(wt) + B sin(wt)`` is the real part of ``(A - i B) exp(+i w t)``. The dissertation
        stores its conjugate A + i B (Eqs 3.9 and 3.17).
        """
        solve = np.linalg.inv(self.triangle)
        wanted = 2 * len(self.frequencies)
        phasor = solve[0:wanted:2] - 1j * solve[1:wanted:2]
        return np.ascontiguousarray(phasor.T)


def sine_model(
    times: ArrayLike, frequencies: ArrayLike, harmonics: int = 0, hum: ArrayLike = ()
) -> SineModel:
    """Make the model of records that were sampled at `times` (Eqs 3.3 and 3.4).

    Parameters
    ----------
    times : array_like, shape (sample,), s
        Increasing, evenly spaced or not, common to all pixels. Where zero lies does not matter:
        the phase of a pixel is relative to the reference.
    frequencies : array_like, shape (frequency,), Hz
    harmonics : int
        How many harmonics of each frequency are fitted besides: 2 adds 2 f and 3 f.
    hum : array_like, Hz
        Further disturbing frequencies, as 50.

    Raises
    ------
    UserError
        If the samples are too few, out of order, or cannot tell the frequencies apart.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.signal import sine_model
    >>> sine_model(np.arange(64) / 640.0, [50.0]).columns.shape  # cosine, sine, constant
    (64, 3)
    """
    t = np.asarray(times, float)
    wanted = np.atleast_1d(np.asarray(frequencies, float))
    others = _nuisance(wanted, harmonics, np.atleast_1d(np.asarray(hum, float)))
    _check(t, wanted, others)
    q, r = np.linalg.qr(design_matrix(t, np.concatenate([wanted, others])))
    _check_condition(t, [*wanted, *others], r)
    return SineModel(t, wanted, others, q, r)


def design_matrix(times: Array, frequencies: Array) -> Array:
    """Build the matrix S of Eq 3.4, shape (sample, column): cosines, sines, then ones."""
    angle = 2 * np.pi * np.outer(times, frequencies)
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(len(times), -1)
    return np.column_stack([waves, np.ones(len(times))])


def _nuisance(wanted: Array, harmonics: int, hum: Array) -> Array:
    """Choose harmonics and hum, without those that are wanted or already there."""
    known = list(wanted)
    for f in [m * f for m in range(2, harmonics + 2) for f in wanted] + list(hum):
        if all(abs(f - k) > SAME_FREQUENCY * k for k in known):
            known.append(f)
    return np.array(known[len(wanted) :], float)


def _check(t: Array, wanted: Array, others: Array) -> None:
    """Refuse samples and frequencies that make no model."""
    if t.ndim != 1 or not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0):
        raise UserError("signal: the sample times must be one increasing row of finite seconds")
    every = np.concatenate([wanted, others])
    if wanted.size == 0 or not np.all(np.isfinite(every) & (every > 0)):
        bad = next((f for f in every if not (np.isfinite(f) and f > 0)), "none")
        raise UserError(f"signal: a frequency must be a positive number of Hz, not {bad}")
    needed = 2 * every.size + 2
    if t.size < needed:
        raise UserError(
            f"signal: {t.size} samples cannot determine {2 * every.size + 1} coefficients and "
            f"their standard errors; take at least {needed} samples or fit fewer frequencies"
        )
    step = np.diff(t)
    even = np.ptp(step) < 1e-6 * step.mean()
    if even and wanted.max() >= 0.5 / step.mean():
        raise UserError(
            f"signal: {wanted.max():.6g} Hz cannot be sampled at {1 / step.mean():.6g} Hz; sample "
            f"above {2 * wanted.max():.6g} Hz"
        )


def _check_condition(t: Array, frequencies: Sequence[float], triangle: Array) -> None:
    """Refuse frequencies that look alike in these samples, and name them."""
    norms = np.linalg.norm(triangle, axis=0)  # of the columns of S
    _, sizes, directions = np.linalg.svd(triangle / np.where(norms > 0, norms, 1.0))
    if sizes[-1] * LARGEST_CONDITION > sizes[0]:
        return
    weight = directions[-1, :-1].reshape(-1, 2)
    shares = [*np.hypot(weight[:, 0], weight[:, 1]), abs(directions[-1, -1])]
    names = [*(f"{f:.6g} Hz" for f in frequencies), "the offset"]
    first, second = (names[i] for i in sorted(np.argsort(shares)[-2:]))
    raise UserError(
        f"signal: {t.size} samples over {np.ptp(t):.4g} s cannot tell {first} from {second}; "
        "record longer, sample otherwise or leave one of them out"
    )
