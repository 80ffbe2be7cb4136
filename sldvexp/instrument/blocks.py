"""Blocks of samples: bytes to counts as a profile says, and whether it says so rightly.

The reference channel follows the generator, a sum of sines of known frequencies. Read with the
wrong byte order, kind of number or order of channels it is noise, while the right reading is

    r(t) = c + sum_k a_k cos(w_k t) + b_k sin(w_k t),

so that the share of its sum of squares that this explains tells the readings apart.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.instrument.connection import DisturbanceError
from sldvexp.instrument.profile import ByteOrder, ChannelOrder, Data, SampleType
from sldvexp.instrument.protocol import CHANNELS, RawSamples, Status
from sldvexp.typing import Array

#: Counts on each side of zero.
HALF_COUNTS = 2**15


def block_size(data: Data, pixels: int, samples: int) -> int:
    """Count bytes of a block of samples."""
    return pixels * len(CHANNELS) * samples * np.dtype(data.type.value).itemsize


def decoded(
    data: Data,
    block: bytes,
    status: bytes,
    shape: tuple[int, int],
    volts_per_count: Sequence[float],
    rate: float,
) -> RawSamples:
    """Decode samples of a block.

    Parameters
    ----------
    data : Data
        How the block is written.
    status : bytes
        One a pixel; empty if there is none.
    shape : tuple of int
        Pixels, and samples a pixel and channel.
    volts_per_count : sequence of float
        In the order of `CHANNELS`.
    rate : float, Hz

    Raises
    ------
    DisturbanceError
        If a sample is not a number.
    """
    ordered = _numbers(data, block, shape)
    flags = np.frombuffer(status, np.uint8) if status else np.zeros(shape[0], np.uint8)
    scale = np.array(volts_per_count, float)
    if data.type is SampleType.float32:
        counts, over = _rounded(ordered, scale)
        flags = flags | over
    else:
        counts = ordered.astype(np.int16, copy=False)
    return RawSamples(counts, scale, rate, flags)


#: Share of the reference that the generator's sines explain at least in a right reading, and at
#: most in a wrong one: counts from the wrong end make a square wave, whose first sine has 0.81.
RIGHT, WRONG = 0.99, 0.9
#: Samples of the reference a sine at least, so that not anything looks like it.
SAMPLES_A_SINE = 16
#: Pixels of a block whose reference is looked at.
LOOKED_AT = 4


def better_reading(
    data: Data, block: bytes, shape: tuple[int, int], tones: Sequence[float], rate: float
) -> str:
    """Name the settings of a profile's `data` that explain a block as its own do not.

    Parameters
    ----------
    data : Data
    block : bytes
    shape : tuple of int
        Pixels, and samples a pixel and channel.
    tones : sequence of float, Hz
        What the generator plays.
    rate : float, Hz

    Returns
    -------
    str
        As in ``data.order: big``; empty if the block is read well, or nothing else is better.
    """
    if not tones or shape[1] < SAMPLES_A_SINE * len(tones):
        return ""
    time = np.arange(shape[1]) / rate
    phases = 2 * np.pi * np.outer(time, tones)
    sines = np.hstack([np.ones((shape[1], 1)), np.cos(phases), np.sin(phases)])
    basis = np.linalg.qr(sines)[0]
    if _explained(data, block, shape, basis) >= WRONG:
        return ""
    integers = (SampleType.int16, SampleType.uint16)
    kinds = integers if data.type in integers else (data.type,)
    readings = [
        replace(data, type=kind, order=order, layout=layout)
        for kind, order, layout in itertools.product(kinds, ByteOrder, ChannelOrder)
    ]
    best = max(readings, key=lambda reading: _explained(reading, block, shape, basis))
    if _explained(best, block, shape, basis) < RIGHT:
        return ""
    keys = [key for key in ("type", "order", "layout") if getattr(best, key) != getattr(data, key)]
    return ", ".join(f"data.{key}: {getattr(best, key).name}" for key in keys)


def _explained(data: Data, block: bytes, shape: tuple[int, int], basis: Array) -> float:
    """Share of the references' sums of squares about their means that an orthonormal basis has."""
    with np.errstate(all="ignore"):
        reference = _numbers(data, block, shape)[:LOOKED_AT, CHANNELS.index("reference")]
        varying = reference.astype(float)
        varying = varying - varying.mean(axis=1, keepdims=True)
        total = np.sum(varying**2)
        share = np.sum((varying @ basis) ** 2) / total
    return float(share) if np.isfinite(share) else 0.0


def _numbers(data: Data, block: bytes, shape: tuple[int, int]) -> NDArray[Any]:
    """Numbers of a block about zero, shape (pixel, channel, sample)."""
    pixels, samples = shape
    raw = np.frombuffer(block, np.dtype(data.order.value + data.type.value))
    if data.layout is ChannelOrder.interleaved:
        by_channel = raw.reshape(pixels, samples, len(CHANNELS)).transpose(0, 2, 1)
    else:
        by_channel = raw.reshape(pixels, len(CHANNELS), samples)
    ordered = by_channel[:, [data.channels.index(c) for c in CHANNELS]]
    if data.type is SampleType.uint16:
        return (ordered.astype(np.int32) - HALF_COUNTS).astype(np.int16)
    return ordered


def _rounded(
    volts: NDArray[np.floating], scale: Array
) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
    """Round volts to counts, with the status of pixels whose volts are beyond them."""
    if not np.isfinite(volts).all():
        pixel = int(np.argwhere(~np.isfinite(volts))[0, 0])
        raise DisturbanceError(f"pixel {pixel} has a sample that is not a finite number of volts")
    counts = np.rint(volts / scale[:, None])
    clipped = np.clip(counts, -HALF_COUNTS, HALF_COUNTS - 1)
    beyond = (counts != clipped).any(axis=(1, 2))
    flags = np.where(beyond, Status.over_range, Status.good).astype(np.uint8)
    return clipped.astype(np.int16), flags
