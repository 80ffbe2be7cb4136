"""Pixels beyond the given surface that do not belong to the structure, though they should.

Where the structure goes on beyond its given surface (`Volume.margin`), pixels there make the rim
surer. No comparison of views judges them, since it knows the surface alone; something that stands
in a beam, or a structure that ends earlier, would bend the rim. A good pixel leaves

    d2 = sum_f |v - fit|^2 / (std_p scale_f)^2,

a chi-square with two degrees of freedom a frequency, or the multiple of it that the median has. The
farthest are left out and the splines fitted again, until none is far: a bad pixel draws the splines
to itself and away from its neighbours, so that these must not be judged together with it.

Where the structure ends before the margin does, pixels of all views are at rest there, and splines
that nothing else holds bend to them without any residual. So those are looked for first: on a side
of the surface beyond a distance all pixels of two views or more are at rest within their noise,
while the splines without them say that they should move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.shell.measured import blocks
from sldvexp.shell.pixels import ViewPixels
from sldvexp.shell.surface_fit import SurfaceFit
from sldvexp.typing import Array, BoolArray, IndexArray

#: Probability of leaving out any good pixel.
ANY = 1e-4
#: Part of the largest d2 from which pixels are left out together with the farthest.
AMONG_THE_FARTHEST = 0.25
#: Probability that noise alone moves a pixel at rest as much, or a prediction is as wrong.
BY_CHANCE = 1e-4
#: Part of the resting pixels that may lie where little motion is predicted, as near nodal lines.
PREDICTED = 0.75
#: Fewest resting pixels, and views that have them, from which a side of the structure has ended.
FEWEST_AT_REST, FEWEST_VIEWS = 4, 2


@dataclass(frozen=True, eq=False)
class RestingSide:
    """Pixels beyond one side of the surface that are at rest in all views.

    Attributes
    ----------
    pixels : list of ndarray of int
        Of each view's image.
    ends : float, m
        Distance beyond the surface at which the structure is still known to move.
    middle : ndarray, shape (2,), m
        Coordinates of their middle.
    """

    pixels: list[IndexArray]
    ends: float
    middle: Array


def resting_sides(found: SurfaceFit) -> list[RestingSide]:
    """Find the sides of the surface beyond which all pixels are at rest from some distance on."""
    outline, inner = found.outline, replace(found.outline, margin=0.0)
    if outline.closed or outline.margin == 0:
        return []
    low, high = inner.corners.min(axis=0), inner.corners.max(axis=0)
    place = np.concatenate([p.coordinates for p in found.pixels])
    view = np.repeat(np.arange(len(found.pixels)), [len(p.pixel) for p in found.pixels])
    pixel = np.concatenate([p.pixel for p in found.pixels])
    beyond = np.concatenate([low - place, place - high], axis=1)  # of the four sides
    side, far = beyond.argmax(axis=1), beyond.max(axis=1)
    measured, size = found.measured, np.empty(len(pixel))
    for k, some, block in blocks(found.pixels):
        size[some] = measured.over_noise(measured.velocity(k, block), some)
    rests = size < _usual_ratio(found) * scipy.special.chdtri(2 * len(measured.scale), BY_CHANCE)
    sides = []
    for k in range(beyond.shape[1]):
        own = (side == k) & (far > 0)
        ends = float(far[own & ~rests].max(initial=0.0))
        chosen = own & (far > ends)
        if chosen.sum() >= FEWEST_AT_REST and len(np.unique(view[chosen])) >= FEWEST_VIEWS:
            each = [pixel[chosen & (view == v)] for v in range(len(found.pixels))]
            sides.append(RestingSide(each, ends, place[chosen].mean(axis=0)))
    return sides


def should_move(without: SurfaceFit, side: RestingSide, before: Sequence[ViewPixels]) -> bool:
    """Tell whether splines that are fitted without a side's pixels say that these should move.

    Parameters
    ----------
    without : SurfaceFit
    before : sequence of ViewPixels
        Of all views, with the side's pixels.
    """
    beside = []
    for k, (pixels, chosen) in enumerate(zip(before, side.pixels, strict=True)):
        some = np.flatnonzero(np.isin(pixels.pixel, chosen))
        if not len(some):
            continue
        own = replace(
            pixels,
            pixel=pixels.pixel[some],
            coordinates=pixels.coordinates[some],
            cosine=pixels.cosine[some],
        )
        rows = own.design(without.shell, without.face)
        predicted, of_noise, others = without.evaluate(rows)
        left = without.measured.velocity(k, own) - predicted
        noise = float(np.median(without.measured.pixel_std)) * without.measured.scale
        variance = of_noise + others + np.square(noise)
        parts = np.stack([left.real, left.imag])
        beside.append(np.sum(parts**2 / variance, axis=(0, 2)))
    lines = len(without.measured.scale)
    apart = np.quantile(np.concatenate(beside), PREDICTED)
    return bool(apart > _usual_ratio(without) * scipy.special.chdtri(2 * lines, BY_CHANCE))


def strangers(found: SurfaceFit) -> list[IndexArray]:
    """Find pixels beyond the surface that the splines do not fit, the worst of all views.

    Returns
    -------
    list of ndarray of int
        Of the views' images.
    """
    beyond = [_beyond(found, pixels) for pixels in found.pixels]
    count = sum(int(here.sum()) for here in beyond)
    if not count:
        return [np.zeros(0, np.intp) for _ in beyond]
    apart, lines = found.distances, len(found.measured.scale)
    limit = _usual_ratio(found) * scipy.special.chdtri(2 * lines, ANY / count)
    own = np.concatenate(beyond) & (apart > limit)
    far = own & (apart >= AMONG_THE_FARTHEST * np.max(apart, where=own, initial=0.0))
    parts = np.split(far, np.cumsum([len(here) for here in beyond])[:-1])
    return [p.pixel[part] for p, part in zip(found.pixels, parts, strict=True)]


def _beyond(found: SurfaceFit, pixels: ViewPixels) -> BoolArray:
    """Mark pixels whose beams meet the structure beyond the given surface."""
    if found.outline.closed or found.outline.margin == 0:
        return np.zeros(len(pixels.pixel), bool)
    return ~replace(found.outline, margin=0.0).holds(pixels.coordinates)


def _usual_ratio(found: SurfaceFit) -> float:
    """Divide the median d2 by that of noise as it is stated, 1 at least."""
    usual = scipy.special.chdtri(2 * len(found.measured.scale), 0.5)
    return max(1.0, float(np.median(found.distances)) / float(usual))
