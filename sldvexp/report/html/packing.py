"""Numbers of nodes for a script: exact where there is room, else rounded below what they mean.

A complex velocity is rounded to a share of its own bound, or of its frequency's largest where
that is more: ``V = q max(share b, m / 32000)`` with whole ``q``. So what the rounding takes is far
below the bound, and what is left are small whole numbers, whose differences from node to node are
deflated. Bounds are rounded in equal steps of their logarithm.
"""

from __future__ import annotations

import base64
import zlib

import numpy as np
from numpy.typing import NDArray

#: Of a velocity's bound, to which the velocity is rounded.
SHARE = 1 / 16
#: Step of the logarithm of bounds.
RATIO = 0.01
#: Largest whole number, so many steps a colour's largest value has, and the number of no value.
MOST, SHADES, NONE = 32_000, 1_000, -32_768


def floats(values: NDArray) -> str:
    """Write numbers exactly enough for anything: base64 of little-endian float32.

    Examples
    --------
    >>> floats(np.array([1.0]))
    'AACAPw=='
    """
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()


def velocities(velocity: NDArray, bound: NDArray) -> dict[str, object]:
    """Write velocities and bounds, shape (frequency, component, node), rounded.

    Returns
    -------
    dict
        ``real``, ``imaginary`` and ``bound`` of whole numbers, and what they are multiplied by.
    """
    known = bound[np.isfinite(bound) & (bound > 0)]
    least = float(known.min()) if known.size else 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        code = np.clip(np.round(np.log(bound / least) / RATIO), 1 - MOST, MOST)
    step = steps(velocity, least * np.exp(RATIO * code))
    return {
        "real": whole(velocity.real / step),
        "imaginary": whole(velocity.imag / step),
        "bound": whole(code),
        "least": least,
        "ratio": RATIO,
        "share": SHARE,
        "finest": [float(f) for f in _finest(velocity)],
    }


def steps(velocity: NDArray, bound: NDArray) -> NDArray:
    """Choose steps of velocities, all of them greater than zero."""
    return np.fmax(SHARE * bound, _finest(velocity)[:, None, None])


def whole(values: NDArray) -> str:
    """Write numbers as whole ones: differences from node to node, by bytes, deflated.

    Parameters
    ----------
    values : (..., node) array
        NaN is kept.
    """
    numbers = np.where(np.isnan(values), NONE, np.clip(np.round(values), -MOST - 1, MOST + 1))
    differences = np.diff(numbers.astype(np.int64), axis=-1, prepend=0).astype("<i2")
    planes = differences.ravel().view(np.uint8).reshape(-1, 2).T
    # Numbers that scatter repeat little: what looks for long repeats finds none, and takes minutes.
    deflate = zlib.compressobj(6, zlib.DEFLATED, zlib.MAX_WBITS, 9, zlib.Z_FILTERED)
    return base64.b64encode(deflate.compress(planes.tobytes()) + deflate.flush()).decode()


def shades(values: NDArray) -> NDArray:
    """Choose a step at each frequency for values that are only colours."""
    return _steps(values, SHADES)


def _finest(velocity: NDArray) -> NDArray:
    return _steps(velocity.reshape(len(velocity), -1), MOST)


def _steps(values: NDArray, most: int) -> NDArray:
    """Find the step at each frequency of which the largest value has so many."""
    largest = np.nanmax(np.abs(values), axis=1, initial=0.0) / most
    return np.where(largest > 0, largest, 1.0)
