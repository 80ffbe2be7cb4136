"""Least-squares sine of every pixel of one channel (Eqs 3.5 to 3.8), with its noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.signal.pixel_quality import Intercept
from sldvexp.signal.sine_model import SineModel
from sldvexp.statistics import FTest, f_test
from sldvexp.typing import Array, BoolArray, ComplexArray, IntArray

#: Share of |V|^2 below which a residual sum of squares is rounding of double precision.
RESOLUTION = 1e-15


@dataclass(frozen=True)
class HarmonicTests:
    """Harmonics of one channel, each tested against the model without it.

    Attributes
    ----------
    used : ndarray of int, shape (pixel,)
        How many are in the fit: those before the first that is not significant.
    p_value : ndarray, shape (pixel, harmonic)
        Probability of such an F without that harmonic; NaN for one that is wanted anyway.
    """

    used: IntArray
    p_value: Array


@dataclass(frozen=True)
class ChannelFit:
    """Sines of one channel.

    Attributes
    ----------
    phasor : ndarray of complex, shape (pixel, frequency)
        A - i B, peak amplitude.
    sample_variance : ndarray, shape (pixel,)
        Noise of one sample, SSE / dof.
    f_intercept : ndarray, shape (pixel,)
        F statistic of the intercept against the `full_dof` of the full model.
    intercept : ndarray of bool, shape (pixel,)
        True where the fit has the intercept.
    full_dof : int, or ndarray of int of shape (pixel,) if pixels have different models
    unit_variance : ndarray, shape (pixel, frequency)
        ``E |e|^2`` of the phasor's error e for a sample of unit variance.
    unit_pseudo_variance : ndarray of complex, shape (pixel, frequency)
        ``E e^2`` for such a sample.
    harmonics : HarmonicTests, optional
        If harmonics were fitted only while significant.
    """

    phasor: ComplexArray
    sample_variance: Array
    f_intercept: Array
    intercept: BoolArray
    full_dof: int | IntArray
    unit_variance: Array
    unit_pseudo_variance: ComplexArray
    harmonics: HarmonicTests | None = None

    @property
    def noise(self) -> Array:
        """Standard deviation of one sample, shape (pixel,)."""
        return np.sqrt(self.sample_variance)

    @property
    def dof(self) -> IntArray:
        """Degrees of freedom of each pixel's residuals, shape (pixel,)."""
        return self.full_dof + ~self.intercept

    @property
    def variance(self) -> Array:
        """``E |e|^2`` of the phasor's error e, shape (pixel, frequency)."""
        return self.sample_variance[:, None] * self.unit_variance

    @property
    def pseudo_variance(self) -> ComplexArray:
        """``E e^2``, shape (pixel, frequency); zero for independent, equal errors of both parts."""
        return self.sample_variance[:, None] * self.unit_pseudo_variance

    def intercept_test(self, confidence: float) -> FTest:
        """Test every pixel's intercept by F, with its p-value (recommendation of Section 6.2)."""
        return f_test(self.f_intercept, 1, self.full_dof, confidence)


def fit_channel(
    coefficients: Array,
    square: Array,
    model: SineModel,
    intercept: Intercept = Intercept.test,
    confidence: float = 0.95,
    scale: float = 1.0,
    quantum: float = 0.0,
) -> ChannelFit:
    """Fit the model with and without its intercept, and keep what the F-test says.

    Parameters
    ----------
    coefficients : ndarray, shape (column, pixel)
        c = Q^T V, with the intercept's last.
    square : ndarray, shape (pixel,)
        |V|^2.
    confidence : float
        1 - alpha of the F-test.
    scale : float
        Unit of the result for one unit of the samples.
    quantum : float
        Step of the converter in units of the samples. Rounding alone gives a sample the variance
        quantum^2 / 12, and the noise is never taken to be less.
    """
    phasor_map = model.phasor_map
    # An all-zero channel makes F = 0/0, a missing sample makes everything NaN; both get flagged.
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        drop = coefficients[-1] ** 2
        sse_full = residual_squares(coefficients, square)
        f = drop * model.dof / sse_full
        keep = ~(f <= _critical(model, intercept, confidence))
        sse = sse_full + np.where(keep, 0.0, drop)
        s2 = np.maximum(sse / (model.dof + ~keep), quantum**2 / 12)
        used = [*coefficients[:-1], coefficients[-1] * keep]
        phasor = _combine(used, scale * phasor_map)
    spread = _over_columns(squared(phasor_map), keep)
    pseudo_spread = _over_columns(phasor_map**2, keep)
    return ChannelFit(phasor, scale**2 * s2, f, keep, model.dof, spread, pseudo_spread)


def residual_squares(coefficients: Array, square: Array) -> Array:
    """Compute ``SSE = |V|^2 - |c|^2``, shape (pixel,), not below what double precision resolves."""
    return np.maximum(square - (coefficients**2).sum(axis=0), RESOLUTION * square)


def squared(z: ComplexArray) -> Array:
    """Square ``|z|^2``, without the square root of `abs`."""
    return z.real**2 + z.imag**2


def _over_columns(terms: NDArray, intercept: BoolArray) -> NDArray:
    """Sum over the columns, (pixel, frequency), the intercept's only where the fit has it."""
    return np.where(intercept[:, None], terms.sum(axis=0), terms[:-1].sum(axis=0))


def _combine(coefficients: list[Array], matrix: ComplexArray) -> ComplexArray:
    """Compute ``c M``, (pixel, frequency), each pixel by the same operations in the same order."""
    result = np.zeros((len(coefficients[0]), matrix.shape[1]), complex)
    for c, row in zip(coefficients, matrix, strict=True):
        result.real += np.multiply.outer(c, row.real)
        result.imag += np.multiply.outer(c, row.imag)
    return result


def _critical(model: SineModel, intercept: Intercept, confidence: float) -> float:
    """Compute value that F must exceed for the intercept to stay."""
    if intercept is Intercept.always:
        return -np.inf
    if intercept is Intercept.never:
        return np.inf
    return float(f_test(0.0, 1, model.dof, confidence).critical)
