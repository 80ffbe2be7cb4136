"""One pass over the samples: projections on the model's columns and sums of squares.

Everything else follows from these few numbers a pixel, since ``SSE = |V|^2 - |Q^T V|^2``. That
difference loses as many digits as the signal's power exceeds the noise's: in double precision the
noise is right to 3e-10 of itself under a signal 1000 times larger, to 3e-6 under one 100,000 times
larger.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.errors import UserError
from sldvexp.typing import Array, BoolArray

#: Samples of one channel that a thread holds in double precision at a time: 1 MB, near the cache.
CHUNK_SAMPLES = 2**17

#: Products of one matrix multiplication: few enough for BLAS not to start threads of its own.
CHUNK_PRODUCTS = 2**19

#: Chunks are whole multiples of this, the rows that BLAS takes at a time.
ROWS = 8

#: Samples of an image from which threads are worth their beginning and memory of their own: 16 MB.
MANY = 2**23

#: Pieces of the image for each thread, so that none waits long for the other.
PIECES_PER_THREAD = 4


@dataclass(frozen=True)
class Projection:
    """Projections and sums of squares that the fits need of the samples.

    Attributes
    ----------
    coefficients : ndarray, shape (channel, column, pixel)
        c = Q^T V, in the samples' unit.
    square : ndarray, shape (channel, pixel)
        |V|^2. Not finite where a sample is not.
    at_limit : ndarray of bool, shape (channel, pixel)
        True where a sample lies at or beyond a limit.
    """

    coefficients: Array
    square: Array
    at_limit: BoolArray


def project(
    samples: NDArray[np.generic],
    columns: Array,
    limits: ArrayLike | None = None,
    threads: int | None = None,
) -> Projection:
    """Project every record on the columns, and sum its squares.

    A chunk has the same size whatever the image, filled up with whatever was there before. So BLAS
    treats every record alike, and its numbers do not depend on which others come with it.

    Parameters
    ----------
    samples : ndarray, shape (channel, pixel, sample)
        Integers or floats, in any memory order; never copied as a whole.
    columns : ndarray, shape (sample, column)
    limits : array_like, shape (2,) or (channel, 2), optional
        Smallest and largest sample of the converter. Not given: nothing is at a limit.
    threads : int, optional
        Unless given all processors that this process may use, for large images.

    Raises
    ------
    UserError
        If the samples are not real numbers or their number differs from the columns'.
    """
    _check(samples, columns)
    channels, pixels, n = samples.shape
    result = Projection(
        np.empty((channels, columns.shape[1], pixels)),
        np.empty((channels, pixels)),
        np.zeros((channels, pixels), bool),
    )
    bounds = None if limits is None else np.broadcast_to(np.asarray(limits, float), (channels, 2))
    chunk = min(CHUNK_SAMPLES, CHUNK_PRODUCTS // columns.shape[1]) // n
    chunk = max(ROWS, chunk // ROWS * ROWS)
    threads = threads or (_processors() if samples.size >= MANY else 1)
    pieces = 1 if threads == 1 else max(1, min(PIECES_PER_THREAD * threads, pixels // chunk))
    edges = np.linspace(0, pixels, pieces + 1).astype(int)

    def work(piece: int) -> None:
        held = _memory(samples, chunk)
        for first in range(edges[piece], edges[piece + 1], chunk):
            part = slice(first, min(first + chunk, edges[piece + 1]))
            _project_chunk(samples[:, part], columns, bounds, held, result, part)

    if pieces == 1:
        work(0)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, range(pieces)))
    return result


def _processors() -> int:
    """Count processors that this process may use, where the system tells."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _project_chunk(
    samples: NDArray[np.generic],
    columns: Array,
    bounds: Array | None,
    held: Array,
    result: Projection,
    part: slice,
) -> None:
    """Project some pixels; `held` is memory for their samples in double precision."""
    v = held[:, : samples.shape[1]]
    np.copyto(v, samples)
    # Infinite and missing samples end in `square`, where they are found and flagged.
    with np.errstate(invalid="ignore", over="ignore"):
        c = np.matmul(held, columns)[:, : samples.shape[1]]
        result.coefficients[:, :, part] = c.swapaxes(1, 2)
        np.vecdot(v, v, out=result.square[:, part])
    if bounds is None:
        return
    # Most chunks are free of limits. NaN, which hides its neighbours, makes the comparison fail.
    if not (samples.min() > bounds[:, 0].max() and samples.max() < bounds[:, 1].min()):
        low, high = bounds.T[:, :, None, None]
        result.at_limit[:, part] = ((samples <= low) | (samples >= high)).any(axis=-1)


def _memory(samples: NDArray[np.generic], chunk: int) -> Array:
    """Reserve memory for a chunk, (channel, pixel, sample), in the samples' memory order."""
    channels, _, n = samples.shape
    if samples.strides[0] < samples.strides[1]:
        return np.zeros((chunk, channels, n)).swapaxes(0, 1)
    return np.zeros((channels, chunk, n))


def _check(samples: NDArray[np.generic], columns: Array) -> None:
    """Refuse samples that are not (channel, pixel, sample) of real numbers."""
    if samples.ndim != 3 or samples.dtype.kind not in "iuf":
        raise UserError(
            "signal: the samples must be real numbers with a channel, a pixel and a sample "
            f"dimension, not {samples.dtype} of shape {samples.shape}"
        )
    if samples.shape[2] != len(columns):
        raise UserError(
            f"signal: each record has {samples.shape[2]} samples, but {len(columns)} sample "
            "times are given"
        )
