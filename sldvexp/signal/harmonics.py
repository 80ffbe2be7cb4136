"""Harmonics of a record, fitted one after the other while they are significant (Section 6.2).

The models M_0, M_1, .. M_H have no harmonic, the second, the second and the third, and so on; hum
and the intercept are in each. A harmonic is tested against the model without it,

    F_h = (SSE_(h-1) - SSE_h) / q / (SSE_h / dof_h),

q being its columns, and the first that is not significant ends the search: a record with 3 f but
no 2 f has no harmonic. A record without harmonics is given one with probability alpha.

One pass over the samples serves all models. What the columns Q_h span, those of the largest model
span too, ``Q_h = Q_H Q_H' Q_h``, so that ``c_h = (Q_h' Q_H) c_H``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sldvexp.signal.channel import ChannelFit, HarmonicTests, fit_channel, residual_squares
from sldvexp.signal.pixel_quality import Intercept
from sldvexp.signal.sine_model import SineModel
from sldvexp.statistics import nested_f_test
from sldvexp.typing import Array, BoolArray, IntArray


def fit_while_significant(
    coefficients: Array,
    square: Array,
    models: Sequence[SineModel],
    intercept: Intercept = Intercept.test,
    confidence: float = 0.95,
    scale: float = 1.0,
    quantum: float = 0.0,
) -> ChannelFit:
    """Fit every pixel by the model before the first harmonic that is not significant.

    Parameters
    ----------
    coefficients : ndarray, shape (column, pixel)
        c = Q^T V of the last model.
    square : ndarray, shape (pixel,)
        |V|^2.
    models : sequence of SineModel
        Each with one harmonic more.
    intercept, confidence, scale, quantum
        As of `sldvexp.signal.channel.fit_channel`; the confidence is that of the harmonics too.
    """
    own = [_rotate(coefficients, models[-1].columns.T @ m.columns) for m in models]
    fits = [
        fit_channel(c, square, m, intercept, confidence, scale, quantum)
        for c, m in zip(own, models, strict=True)
    ]
    p_value, needed = _tests(own, square, models, intercept, confidence)
    used = np.cumprod(needed, axis=1).sum(axis=1)
    return ChannelFit(
        phasor=_chosen([f.phasor for f in fits], used),
        sample_variance=_chosen([f.sample_variance for f in fits], used),
        f_intercept=_chosen([f.f_intercept for f in fits], used),
        intercept=_chosen([f.intercept for f in fits], used),
        full_dof=np.array([m.dof for m in models])[used],
        unit_variance=_chosen([f.unit_variance for f in fits], used),
        unit_pseudo_variance=_chosen([f.unit_pseudo_variance for f in fits], used),
        harmonics=HarmonicTests(used, p_value),
    )


def _tests(
    own: Sequence[Array],
    square: Array,
    models: Sequence[SineModel],
    intercept: Intercept,
    confidence: float,
) -> tuple[Array, BoolArray]:
    """Test each harmonic: p-values, and True where it is needed or wanted anyway."""
    last = -1 if intercept is Intercept.never else None
    left = [residual_squares(c[:last], square) for c in own]
    p_value = np.full((len(square), len(models) - 1), np.nan)
    needed = np.ones(p_value.shape, bool)
    for h in range(1, len(models)):
        added = models[h - 1].dof - models[h].dof
        if not added:
            continue
        dof = models[h].dof + (intercept is Intercept.never)
        with np.errstate(invalid="ignore", divide="ignore"):
            test = nested_f_test(left[h - 1], left[h], added, dof, confidence)
            p_value[:, h - 1] = test.p_value
            needed[:, h - 1] = test.p_value < 1 - confidence
    return p_value, needed


def _rotate(coefficients: Array, matrix: Array) -> Array:
    """Compute ``matrix' c``, (column, pixel), each pixel by the same operations in one order."""
    return np.stack(
        [sum(w * c for w, c in zip(row, coefficients, strict=True)) for row in matrix.T]
    )


def _chosen(each: Sequence[NDArray], used: IntArray) -> NDArray:
    """Take of each pixel what the model with that many harmonics has."""
    return np.stack(each)[used, np.arange(len(used))]
