"""Random numbers that belong to a pixel, whatever was measured before it.

Every pixel owns a stretch of a counter-based generator (Philox), found by the seed and the view
(the key) and by the stream and the pixel's place in it (the counter). A scan line that is measured
again under its stream's number repeats its noise bit for bit, and how a list is split into calls
makes no difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sldvexp.lazy import scipy
from sldvexp.typing import Array

#: Uniform numbers a pixel; a multiple of what the generator makes at once.
UNIFORMS = 4

#: 64-bit words that Philox makes for one count.
BLOCK = 4

#: Equally probable levels of the normal numbers, so that one 16-bit number draws one.
LEVELS = 2**16


class PixelNoise:
    """The random numbers of one view.

    Parameters
    ----------
    seed : sequence of int
    view : str
    """

    def __init__(self, seed: Sequence[int], view: str) -> None:
        entropy = [len(seed), *seed, *view.encode()]
        self._key = np.random.SeedSequence(entropy).generate_state(2, np.uint64)

    def draw(
        self, stream: int, first: int, pixels: int, samples: int
    ) -> tuple[Array, NDArray[np.float32]]:
        """Random numbers of successive pixels.

        Parameters
        ----------
        stream : int
            From 0 to 2^64 - 1, for example a scan line's number.
        first : int
            Place of the first pixel in the stream.
        pixels : int
        samples : int
            Samples per channel; other numbers of samples are other streams.

        Returns
        -------
        uniform : ndarray, shape (pixel, UNIFORMS)
            In [0, 1).
        normal : ndarray of float32, shape (pixel, 2, sample)
            Of zero mean and unit variance on 65536 levels, the largest 4.3.
        """
        counts = -(-2 * samples // (4 * BLOCK))
        words = UNIFORMS + BLOCK * counts
        counter = np.array([first * words // BLOCK, samples, stream, 0], np.uint64)
        generator = np.random.Philox(key=self._key, counter=counter)
        raw = generator.random_raw(pixels * words).reshape(pixels, words)
        uniform = np.asarray((raw[:, :UNIFORMS] >> np.uint64(11)) * 2.0**-53, np.float64)
        level = raw[:, UNIFORMS:].view(np.uint16)[:, : 2 * samples]
        return uniform, _normal_levels()[level].reshape(pixels, 2, samples)


@cache
def _normal_levels() -> NDArray[np.float32]:
    """Middle quantiles of the normal distribution, scaled to unit variance."""
    levels = scipy.special.ndtri((np.arange(LEVELS) + 0.5) / LEVELS)
    return (levels / levels.std()).astype(np.float32)
