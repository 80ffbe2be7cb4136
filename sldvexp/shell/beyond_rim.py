"""Pixels beyond the given surface that do not belong to the structure, though they should.

Where the structure goes on beyond its given surface (`Volume.margin`), pixels there make the rim
surer. No comparison of views judges them, since it knows the surface alone; something that stands
in a beam, or a structure that ends earlier, would bend the rim. A good pixel leaves

    d2 = sum_f |v - fit|^2 / (std_p scale_f)^2,

a chi-square with two degrees of freedom a frequency, or the multiple of it that the median has. The
farthest are left out and the splines fitted again, until none is far: a bad pixel draws the splines
to itself and away from its neighbours, so that these must not be judged together with it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.shell.pixels import ViewPixels
from sldvexp.shell.surface_fit import SurfaceFit
from sldvexp.typing import Array, BoolArray, IndexArray

#: Probability of leaving out any good pixel.
ANY = 1e-4
#: Part of the largest d2 from which pixels are left out together with the farthest.
AMONG_THE_FARTHEST = 0.25


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
    apart, lines = _distances(found), len(found.measured.scale)
    usual = scipy.special.chdtri(2 * lines, 0.5)
    limit = max(1.0, float(np.median(apart)) / usual) * scipy.special.chdtri(2 * lines, ANY / count)
    own = np.concatenate(beyond) & (apart > limit)
    far = own & (apart >= AMONG_THE_FARTHEST * np.max(apart, where=own, initial=0.0))
    parts = np.split(far, np.cumsum([len(here) for here in beyond])[:-1])
    return [p.pixel[part] for p, part in zip(found.pixels, parts, strict=True)]


def _beyond(found: SurfaceFit, pixels: ViewPixels) -> BoolArray:
    """Mark pixels whose beams meet the structure beyond the given surface."""
    if found.outline.closed or found.outline.margin == 0:
        return np.zeros(len(pixels.pixel), bool)
    return ~replace(found.outline, margin=0.0).holds(pixels.coordinates)


def _distances(found: SurfaceFit) -> Array:
    """Compute d2 of every pixel."""
    std = found.measured.pixel_std[:, None] * found.measured.scale
    return np.asarray(np.sum(np.abs(found.residual / std) ** 2, axis=1))
