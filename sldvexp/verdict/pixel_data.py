"""Velocities of the pixels that views are compared on: whitened, and of few frequencies.

Noise that differs by pixel and by frequency is taken as a product of both, so that after division
every real number has the variance 1 and all frequencies share one design. The frequencies are then
turned into their principal modes by a real orthogonal matrix, which leaves the noise white; a
factor or a conjugate of a view stays one. Modes below the noise tell nothing and are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.field import View
from sldvexp.lazy import scipy
from sldvexp.typing import Array, ComplexArray, IndexArray
from sldvexp.verdict.beams import MeasuredSurface, PixelBeams

#: Pixels of a view that are compared; of more, evenly chosen ones.
MOST_PIXELS = 2500
#: Modes of the frequencies that are compared.
MOST_MODES = 12
#: Pixels whose standard errors are averaged.
AROUND = 25
#: Standard error of a pixel, over the largest velocity, below which it is taken as unknown.
EXACT = 1e-9


@dataclass(frozen=True, eq=False)
class PixelData:
    """Pixels of one view whose beams meet the surface.

    Attributes
    ----------
    view : View
    pixel : ndarray of int, shape (pixel,)
        Of the view's image.
    velocity : ndarray of complex, shape (pixel, mode)
        Whitened: real and imaginary part have the variance 1 each.
    weight : ndarray, shape (pixel,)
        What the design's rows are multiplied by.
    std : ndarray, shape (pixel,), m/s
        What a whitened number is multiplied by to be a velocity, at a frequency of mean noise.
    beams : PixelBeams
        Of those of the pixels that meet the surface from where the view is stated to stand.
    """

    view: View
    pixel: IndexArray
    velocity: ComplexArray
    weight: Array
    std: Array
    beams: PixelBeams


def pixel_data(views: Sequence[View], beams: Sequence[PixelBeams]) -> tuple[list[PixelData], bool]:
    """Collect the pixels of all views that see the surface.

    Parameters
    ----------
    beams : sequence of PixelBeams
        Of the pixels of each view that are compared, see `compared_beams`.

    Returns
    -------
    list of PixelData
    bool
        True if the views state their noise; otherwise it is taken as even.
    """
    pixels = [of.pixel for of in beams]
    noise = [local_std(view, of) for view, of in zip(views, pixels, strict=True)]
    size = max((np.abs(v.velocity[p]).max(initial=0.0) for v, p in _pairs(views, pixels)))
    stated = all(n.size == 0 or n.min() > EXACT * size for n in noise)
    if not stated:
        noise = [np.full_like(n, size or 1.0) for n in noise]
    by_frequency = np.sqrt(np.mean(np.concatenate(noise) ** 2, axis=0))
    by_pixel = [np.sqrt(np.mean((n / by_frequency) ** 2, axis=1)) for n in noise]
    white = [
        v.velocity[p] / by_frequency / a[:, None]
        for (v, p), a in zip(_pairs(views, pixels), by_pixel, strict=True)
    ]
    modes = _modes(np.concatenate(white))
    scale = np.sqrt(np.mean(by_frequency**2))  # a number only: all rows alike
    return [
        PixelData(view, of.pixel, values @ modes, scale / a, scale * a, of)
        for view, of, values, a in zip(views, beams, white, by_pixel, strict=True)
    ], stated


def _pairs(views: Sequence[View], pixels: Sequence[IndexArray]) -> list[tuple[View, IndexArray]]:
    return list(zip(views, pixels, strict=True))


def compared_beams(view: View, surface: MeasuredSurface) -> PixelBeams:
    """Trace usable pixels and choose, of those that meet the surface, evenly if they are many."""
    met = PixelBeams.trace(view, surface, np.flatnonzero(view.usable))
    step = max(1, int(np.ceil(len(met.pixel) / MOST_PIXELS)))
    return met.take(np.arange(0, len(met.pixel), step))


def local_std(view: View, pixels: IndexArray) -> Array:
    """Average the standard errors around some pixels, shape (pixel, frequency).

    Those of single pixels are often estimates themselves, and dividing by an estimate from few
    samples makes residuals larger than they are.
    """
    square = np.square(view.std).reshape(len(view.std), -1)[pixels]
    if len(pixels) > AROUND and np.ptp(square) > 0:
        _, near = scipy.spatial.cKDTree(view.dac[pixels]).query(view.dac[pixels], AROUND)
        # One neighbour at a time in memory.
        square = sum(square.take(neighbour, axis=0) for neighbour in near.T.copy()) / AROUND
    return np.broadcast_to(np.sqrt(square), view.velocity[pixels].shape)


def _modes(white: ComplexArray) -> Array:
    """Find the modes of the frequencies that rise above the noise, shape (frequency, mode)."""
    both = np.concatenate([white.real, white.imag])
    energy, vectors = np.linalg.eigh(both.T @ both)
    # The largest eigenvalue that noise alone would have, by Marchenko and Pastur.
    noise = (np.sqrt(len(both)) + np.sqrt(both.shape[1])) ** 2
    kept = np.flatnonzero(energy > noise)[-MOST_MODES:]
    return vectors[:, kept if len(kept) else [-1]]
