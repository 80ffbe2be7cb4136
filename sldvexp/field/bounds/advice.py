"""Advice on finer elements, cubic interpolation or more pixels, given only where it helps.

A change lessens some parts of the budget and raises others: elements of half the size leave out a
quarter of what they do, and have up to twice the noise's variance (1.0 to 1.7 times was found, as
elements share the pixels); cubic interpolation leaves out nearly nothing, and has half as much
variance again from the noise; with twice as many pixels each way interpolation leaves out a
quarter, and the noise where elements are finer than pixels stays. What elements and interpolation
leave out may cancel, so that less of one can be more of both. The total after each change is
computed, and only a change that lessens the bound of a component by a fifth or more is advised.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sldvexp.field.bounds.budget import OF_NOISE, smoothed
from sldvexp.field.bounds.element_error import SurfaceMean
from sldvexp.typing import Array, ComplexArray


@dataclass(frozen=True)
class Change:
    """A change of the experiment, and by what it multiplies parts of the budget.

    Parameters
    ----------
    noise : float
        Of the variance.
    elements, interpolation : float
        Of the estimated errors.
    """

    text: str
    noise: float
    elements: float
    interpolation: float


HALVED = Change("elements of half the size", 2.0, 0.25, 1.0)
CUBIC = Change("volume.sight.interpolation=cubic", 1.5, 1.0, 0.0)
PIXELS = Change("twice as many pixels in each direction", 1.0, 1.0, 0.25)

#: Part of a component's variance from elements and interpolation above which advice is sought.
WORTH_ADVICE = 0.25
#: Standard error after a change, over that before, from which the change is advised.
WORTH_DOING = 0.8


def mean_squares(
    mean: SurfaceMean,
    variance: Mapping[str, Array],
    elements: ComplexArray,
    interpolation: ComplexArray | None,
) -> Array:
    """Average the parts that changes act upon over nodes, parts and frequencies.

    Returns
    -------
    ndarray, shape (5, component), m2/s2
        The noise's variance; that of poses, pointing and calibration; the squares of the elements'
        error, its product with that of the interpolation, and the squares of this.
    """
    known = np.isfinite(variance["noise"][0])

    def average(values: Array) -> Array:
        total = np.where(known, values, 0.0).sum(axis=(0, 2))
        return np.asarray(total / np.maximum(known.sum(axis=(0, 2)), 1))

    noise = average(variance["noise"][0])
    own = ("noise", "elements", "interpolation")
    others = [average(v.mean(axis=0)) for name, v in variance.items() if name not in own]
    e = smoothed(mean, elements)
    i = np.zeros_like(e) if interpolation is None else smoothed(mean, interpolation)
    products = [average((a * b.conj()).real / 2) for a, b in ((e, e), (e, i), (i, i))]
    products[0] = np.maximum(products[0] - OF_NOISE**2 * noise, 0.0)
    return np.stack([noise, np.sum(others, axis=0) + 0 * noise, *products])


def advice(squares: Array, components: tuple[str, ...], cubic: bool) -> list[str]:
    """Say which change would help most, if one would.

    Parameters
    ----------
    squares : ndarray, shape (5, component), m2/s2
        See `mean_squares`.
    cubic : bool
        Whether interpolation is cubic already.
    """
    before = _total(squares, Change("", 1.0, 1.0, 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        of_model = 1 - (squares[0] + squares[1]) / before
    if not np.any(of_model > WORTH_ADVICE):
        return []
    worst = int(np.nanargmax(of_model))
    changes = [HALVED, PIXELS] if cubic else [HALVED, CUBIC, PIXELS]
    after = {change: float(_total(squares, change)[worst]) for change in changes}
    best = min(after, key=lambda change: after[change])
    ratio = np.sqrt(after[best] / before[worst])
    if not ratio < WORTH_DOING:
        return []
    return [
        f"what elements and interpolation leave out is {of_model[worst]:.0%} of the variance of "
        f"{components[worst]}, and in its bounds; {best.text} would make these smaller, by the "
        f"budget {ratio:.0%} of what they are"
    ]


def _total(squares: Array, change: Change) -> Array:
    """Compute the variance of every component after a change."""
    noise, others, ee, ei, ii = squares
    a, b = change.elements, change.interpolation
    return np.asarray(change.noise * noise + others + a * a * ee + 2 * a * b * ei + b * b * ii)
