"""Blocks of pixels that several scan lines share; each pixel has its own random numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sldvexp.instrument import InstrumentError
from sldvexp.typing import Array, IntArray
from sldvexp.virtual_lab.electronics import UNIFORMS, PixelNoise
from sldvexp.virtual_lab.pointing import MirrorPath

#: Pixels computed at once, filled up if they are fewer: arithmetic in arrays of one shape gives a
#: pixel the same last bits wherever it stands in a list. Half as many take a fifth longer in all.
BLOCK = 128
#: Blocks that short scan lines fill together, if it is known that they come.
AHEAD = 4


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


Counts = NDArray[np.int16]
Statuses = NDArray[np.uint8]


class AnnouncedLines:
    """Lines that are going to be scanned; short ones are computed together.

    Parameters
    ----------
    checked : callable
        Checks the steps of a line.
    way : callable
        Gives the mirrors' way along the line of a number.
    block : callable
        Computes counts and status of at most `BLOCK` pixels, by their stretches and ways.
    """

    def __init__(
        self,
        checked: Callable[[NDArray[Any]], IntArray],
        way: Callable[[int], MirrorPath],
        block: Callable[[IntArray, list[Stretch], list[MirrorPath]], tuple[Counts, Statuses]],
    ) -> None:
        self._checked, self._way, self._block = checked, way, block
        self._expected: Sequence[tuple[IntArray, int]] = ()
        self._known: dict[int, tuple[IntArray, Counts, Statuses, MirrorPath]] = {}

    def expect(self, lines: Sequence[tuple[IntArray, int]]) -> None:
        """Hear of lines, pixels and numbers."""
        if lines is not self._expected:
            self._expected, self._known = lines, {}

    def forget(self) -> None:
        """Forget what was computed, as it would come out otherwise now."""
        self._known = {}

    def line(self, steps: IntArray, stream: int) -> tuple[Counts, Statuses, MirrorPath] | None:
        """Give counts, status and the mirrors' way of a short line; None of others."""
        if not 0 < len(steps) < BLOCK:
            return None
        if stream not in self._known:
            self._known = self._computed(stream)
        found = self._known.pop(stream, None)
        return found[1:] if found and np.array_equal(found[0], steps) else None

    def _computed(self, stream: int) -> dict[int, tuple[IntArray, Counts, Statuses, MirrorPath]]:
        """Compute lines from one on, as long as they are short and fill blocks together."""
        told = [number for _, number in self._expected]
        taken: list[tuple[IntArray, int]] = []
        for dac, number in self._expected[told.index(stream) :] if stream in told else ():
            pixels = sum(len(d) for d, _ in taken) + len(dac)
            if not len(dac) < BLOCK or pixels > AHEAD * BLOCK:
                break
            try:
                taken.append((self._checked(np.asarray(dac)), number))
            except InstrumentError:  # which is told when its turn has come
                break
        if len(taken) < 2:
            return {}
        steps = np.concatenate([dac for dac, _ in taken])
        owner = np.repeat(np.arange(len(taken)), [len(dac) for dac, _ in taken])
        numbers = [number for _, number in taken]
        ways = [self._way(number) for number in numbers]
        blocks = []
        for some, found, stretches in stretches_of(owner, numbers, BLOCK):
            blocks.append(self._block(steps[some], stretches, [ways[k] for k in found]))
        counts, status = (np.concatenate(each) for each in zip(*blocks, strict=True))
        ends = np.cumsum([len(dac) for dac, _ in taken]).tolist()
        own = [slice(end - len(dac), end) for end, (dac, _) in zip(ends, taken, strict=True)]
        return {
            number: (dac, counts[own[k]], status[own[k]], ways[k])
            for k, (dac, number) in enumerate(taken)
        }


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
    ends = np.cumsum([stretch.pixels for stretch in stretches]).tolist()
    uniform = np.empty((ends[-1], UNIFORMS))
    normal = np.empty((ends[-1], 2, samples), np.float32)
    for stretch, end in zip(stretches, ends, strict=True):
        own = slice(end - stretch.pixels, end)
        noise.fill(stretch.stream, stretch.first, uniform[own], normal[own])
    return uniform, normal
