"""Blocks of bytes to samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sldvexp.instrument.connection import DisturbanceError
from sldvexp.instrument.profile import Data, Layout, SampleType
from sldvexp.instrument.protocol import CHANNELS, Samples, Status
from sldvexp.typing import Array

#: Counts on each side of zero.
HALF_COUNTS = 2**15


def block_size(data: Data, pixels: int, samples: int) -> int:
    """Bytes of a block of samples."""
    return pixels * len(CHANNELS) * samples * np.dtype(data.type.value).itemsize


def decoded(
    data: Data,
    block: bytes,
    status: bytes,
    shape: tuple[int, int],
    volts_per_count: Sequence[float],
    rate: float,
) -> Samples:
    """Samples of a block.

    Parameters
    ----------
    data : Data
        How the block is written.
    block : bytes
    status : bytes
        One a pixel; empty if there is none.
    shape : tuple of int
        Pixels, and samples a pixel and channel.
    volts_per_count : sequence of float
        In the order of `CHANNELS`.
    rate : float, Hz

    Returns
    -------
    Samples

    Raises
    ------
    DisturbanceError
        If a sample is not a number.
    """
    pixels, samples = shape
    raw = np.frombuffer(block, np.dtype(data.order.value + data.type.value))
    if data.layout is Layout.interleaved:
        by_channel = raw.reshape(pixels, samples, len(CHANNELS)).transpose(0, 2, 1)
    else:
        by_channel = raw.reshape(pixels, len(CHANNELS), samples)
    ordered = by_channel[:, [data.channels.index(c) for c in CHANNELS]]
    flags = np.frombuffer(status, np.uint8) if status else np.zeros(pixels, np.uint8)
    scale = np.array(volts_per_count, float)
    if data.type is SampleType.float32:
        counts, over = _rounded(ordered, scale)
        flags = flags | over
    elif data.type is SampleType.uint16:
        counts = (ordered.astype(np.int32) - HALF_COUNTS).astype(np.int16)
    else:
        counts = ordered.astype(np.int16, copy=False)
    return Samples(counts, scale, rate, flags)


def _rounded(
    volts: NDArray[np.floating], scale: Array
) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
    """Volts as counts, and the status of pixels whose volts are beyond them."""
    if not np.isfinite(volts).all():
        pixel = int(np.argwhere(~np.isfinite(volts))[0, 0])
        raise DisturbanceError(f"pixel {pixel} has a sample that is not a finite number of volts")
    counts = np.rint(volts / scale[:, None])
    clipped = np.clip(counts, -HALF_COUNTS, HALF_COUNTS - 1)
    beyond = (counts != clipped).any(axis=(1, 2))
    flags = np.where(beyond, Status.over_range, Status.good).astype(np.uint8)
    return clipped.astype(np.int16), flags
