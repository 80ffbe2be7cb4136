"""Blocks of pixels that several scan lines share; each pixel has its own random numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sldvexp.typing import Array, IntArray
from sldvexp.virtual_lab.electronics import PixelNoise
from sldvexp.virtual_lab.pointing import MirrorPath


class Stretch(NamedTuple):
    """Successive pixels of a block that are of one scan line.

    Parameters
    ----------
    stream : int
        Number of the line, see `VirtualLab.start_stream`.
    first : int
        Place of the first of them in it.
    pixels : int
    """

    stream: int
    first: int
    pixels: int


class ScannedLine(NamedTuple):
    """A line that was computed before it is scanned: what comes of it, and the mirrors' way."""

    dac: IntArray
    counts: NDArray[np.int16]
    status: NDArray[np.uint8]
    path: MirrorPath


def stretches_of(
    owner: IntArray, numbers: Sequence[int], block: int
) -> Iterator[tuple[slice, IntArray, list[Stretch]]]:
    """Divide the pixels of lines that follow one another into blocks.

    Parameters
    ----------
    owner : ndarray of int, shape (pixel,)
        Line of each pixel, counted from 0.
    numbers : sequence of int
        Of the lines, see `VirtualLab.start_stream`.
    block : int
        Pixels of a block; the last may have fewer.

    Yields
    ------
    slice, ndarray of int and list of Stretch
        Pixels of a block, its lines as they are counted, and what it has of each.
    """
    begins = np.searchsorted(owner, np.arange(len(numbers)))
    for start in range(0, len(owner), block):
        lines, first, pixels = np.unique(
            owner[start : start + block], return_index=True, return_counts=True
        )
        whole = zip(lines, start + first - begins[lines], pixels, strict=True)
        stretches = [Stretch(numbers[k], int(at), int(n)) for k, at, n in whole]
        yield slice(start, start + block), lines, stretches


def drawn(
    noise: PixelNoise, stretches: Sequence[Stretch], samples: int
) -> tuple[Array, NDArray[np.float32]]:
    """Draw the random numbers of pixels, each its own; see `PixelNoise.draw`."""
    found = [noise.draw(*stretch, samples) for stretch in stretches]
    uniform, normal = zip(*found, strict=True)
    return np.concatenate(uniform), np.concatenate(normal)
