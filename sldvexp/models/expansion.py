"""Measured modes expanded to all nodes of a model (SEREP), with bounds.

A measured mode is taken for a sum of the model's shapes, ``a = P q``, q by generalised least
squares with the pixels' noise and the poses' errors; at the nodes it is ``s q`` with the
covariance ``s C_q s'``. It is exact for every sum of the model's shapes and for nothing else: a
model whose shapes are rejected is not expanded.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp.models.shape_agreement import ShapeTest
from sldvexp.typing import Array, ComplexArray


def expand(motion: Array, tests: Sequence[ShapeTest]) -> tuple[ComplexArray, Array]:
    """Expand measured modes to the nodes of a model.

    Parameters
    ----------
    motion : ndarray, shape (node, 3, model_mode)
        Of the surface seen.
    tests : sequence of ShapeTest
        Of the measured modes.

    Returns
    -------
    velocity : ndarray of complex, shape (node, 3, test), m/s
    std : ndarray, shape (node, 3, test), m/s
        Of the part with the larger error.

    Examples
    --------
    >>> from sldvexp.models.shape_agreement import StackedPixels, examine_shape
    >>> shape = np.eye(4)[:, :2]
    >>> exact = (np.zeros((4, 2, 1)), np.zeros((4, 2)), np.zeros((2, 1, 1)))
    >>> both = shape @ np.array([[2.0], [0.5]])
    >>> seen = StackedPixels(both + 0j, np.full((4, 1), 0.1), shape, *exact)
    >>> velocity, std = expand(np.ones((1, 3, 2)), [examine_shape(seen, 0, 0)])
    >>> velocity[0, 0].round(6).tolist(), std[0, 0].round(6).tolist()
    ([(2.5+0j)], [0.141421])
    """
    velocity = np.stack([motion @ t.all.coefficient for t in tests], axis=-1)
    variance = [np.einsum("ncr,rs,ncs->nc", motion, t.all.covariance, motion) for t in tests]
    return velocity, np.sqrt(np.stack(variance, axis=-1))
