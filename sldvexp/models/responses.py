"""Criteria by place and by line: the model's response against what was measured.

The model responds as the sum of its paired modes, each with the measured scale alpha and damping
zeta but the model's own frequency and shape,

    v_p(f) = sum alpha_r P_pr  2i zeta r / (1 - r^2 + 2i zeta r),   r = f / f_r.

FRAC compares it with the measured lines of a pixel, CSAC with the pixels of a line, CoMAC the modes
of a pixel without frequencies.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp.models.assurance import Assurance, assurance
from sldvexp.models.shape_agreement import ShapeTest
from sldvexp.typing import Array, ComplexArray


def respond(shape: ComplexArray, natural: Array, damping: Array, frequency: Array) -> ComplexArray:
    """Compute velocities at lines from modal velocities at resonance, shape (pixel, line).

    Parameters
    ----------
    shape : ndarray of complex, shape (pixel, mode), m/s
    natural : ndarray, shape (mode,), Hz
    damping : ndarray, shape (mode,)
    frequency : ndarray, shape (line,), Hz

    Examples
    --------
    >>> one = np.array([1.0])
    >>> respond(2 * one[:, None], 100 * one, 0.01 * one, 100 * one).round(9).tolist()
    [[(2+0j)]]
    """
    r = frequency / natural[:, None]
    turning = 2j * damping[:, None] * r
    return np.asarray(shape @ (turning / (1 - r**2 + turning)))


def comac(measured: ComplexArray, predicted: ComplexArray, std: Array) -> Assurance:
    """Compute CoMAC of every pixel, each mode by its own size, arrays of shape (pixel, mode).

    Examples
    --------
    >>> a = np.array([[1.0, 2.0], [1.0, -1.0]])
    >>> comac(a, a, np.zeros((2, 2))).value.round(9).tolist()
    [1.0, 1.0]
    """
    size = np.sqrt(np.mean(np.abs(predicted) ** 2, axis=0))
    return assurance(measured / size, predicted / size, 2 * (std / size) ** 2)


def scaled(shape: Array, tests: Sequence[ShapeTest]) -> ComplexArray:
    """Scale the model's shapes to the measured modes, (pixel, model_mode) to (pixel, test)."""
    return np.stack([t.scale * shape[:, t.model_mode] for t in tests], axis=-1)
