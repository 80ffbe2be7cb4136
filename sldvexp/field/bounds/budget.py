"""Budget of a field's uncertainty: its variance by source, which add up to that of the bounds.

Noise, poses, pointing and calibration have variances of their own. What interpolation between
pixels and the elements leave out of a smooth field are no random errors but estimates b_i and b_e
of definite ones, which may cancel: interpolation flattens waves, elements raise them. They are not
subtracted; their sum's square, averaged over the nodes around, is taken as a variance, as if the
place of the node on the wave were drawn. Between the two it is divided as their own squares are.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sldvexp.field.bounds.element_error import SurfaceMean
from sldvexp.typing import Array, ComplexArray

#: All sources that are known of, in the order of the budget, and how tables call them.
SOURCES = {
    "noise": "noise of the velocities",
    "pose": "poses",
    "pointing": "pointing of the mirrors at pixels",
    "calibration": "calibration of the mirrors",
    "interpolation": "interpolation between pixels",
    "elements": "size of the elements",
}
#: What shows in no residual of one session, and is in no budget.
NEVER_INCLUDED = ("drift", "hysteresis of the mirrors")
#: What such lines have besides that were measured together.
OF_SEVERAL_LINES = "harmonics of a line that fall on others"

#: How often squares of estimated errors are averaged over the nodes around.
AVERAGED = 2
#: Part of the noise's standard error that smoothed estimates of the elements' error have of their
#: own, found by trial: 0.18 to 0.20 from 60 to 900 nodes of a surface.
OF_NOISE = 0.18


def model_variances(
    mean: SurfaceMean, noise: Array, elements: ComplexArray, interpolation: ComplexArray | None
) -> dict[str, Array]:
    """Turn the errors of a field's model into variances, shape (part, node, component, frequency).

    Parameters
    ----------
    noise : ndarray, shape (node, component, frequency), m2/s2
        Variance of a part's nodal values from the noise, of which estimates have something.
    elements : ndarray of complex, shape (node, component, frequency), m/s
        Estimated error of the elements; see `element_error`. Where it is NaN nothing is added.
    interpolation : ndarray of complex, shape (node, component, frequency), m/s, optional
        That of the interpolation, where it could be estimated.
    """
    own = {"elements": smoothed(mean, elements)}
    if interpolation is not None:
        own["interpolation"] = smoothed(mean, interpolation)
    square = {name: _mean_square(mean, error) for name, error in own.items()}
    both = _mean_square(mean, np.sum(list(own.values()), axis=0))
    total = np.sum(list(square.values()), axis=0)
    both = np.maximum(both - OF_NOISE**2 * np.nan_to_num(noise), 0.0)
    ratio = np.divide(both, total, out=np.zeros_like(both), where=total > 0)
    return {name: square[name] * ratio for name in SOURCES if name in square}


def smoothed(mean: SurfaceMean, error: ComplexArray) -> ComplexArray:
    """Keep the smooth part of an error, which a mean m(e) changes by ``e - m(e)`` only; 0 for NaN.

    ``m(2 e - m(e))`` keeps a wave but for the fourth power of its wave number.
    """
    return np.nan_to_num(mean.of(2 * error - mean.of(error)))


def _mean_square(mean: SurfaceMean, error: ComplexArray) -> Array:
    """Average squares of real and imaginary part over the nodes around, (part, *error.shape)."""
    squares = np.stack([error.real**2, error.imag**2])
    for _ in range(AVERAGED):
        squares = np.stack([mean.of(part) for part in squares])
    return squares


def not_included(variance: Mapping[str, Array]) -> list[str]:
    """Name the sources that are in no bound: nothing tells them, or no residual can show them."""
    if not variance:
        return []
    untold = [text for name, text in SOURCES.items() if name not in variance]
    several = any(each.shape[-1] > 1 for each in variance.values())
    return [*untold, *NEVER_INCLUDED, *([OF_SEVERAL_LINES] if several else [])]


def by_source(variance: Mapping[str, Array]) -> tuple[list[str], Array]:
    """List the sources and their variances in the part whose sum is larger.

    Parameters
    ----------
    variance : mapping of str to ndarray, shape (part or 1, node, component, frequency), m2/s2

    Returns
    -------
    sources : list of str
    variances : ndarray, shape (source, node, component, frequency), m2/s2
    """
    names = [name for name in SOURCES if name in variance]
    shape = np.broadcast_shapes((2, 1, 1, 1), *(variance[n].shape for n in names))
    each = np.stack([np.broadcast_to(variance[n], shape) for n in names])
    larger = np.nan_to_num(each.sum(axis=0)).argmax(axis=0)
    return names, np.take_along_axis(each, larger[None, None], axis=1)[:, 0]
