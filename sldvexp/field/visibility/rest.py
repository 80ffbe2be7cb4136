"""What all lines of an image tell of pixels at rest, as sums over the lines.

A streamed run has these sums of all its lines, and of the lines themselves few combinations, which
leave noise out: rest cannot be told by those.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray

#: Probability that a pixel at rest moves more than this by its noise.
AT_REST = 1e-4
#: Pixels of a row that tell how it goes on, and how much more than what they miss of one another a
#: pixel must be off that.
CONTINUED, BREAK = 6, 2.0


@dataclass(frozen=True, eq=False)
class RestSums:
    """Sums over the lines of one view.

    Attributes
    ----------
    size : ndarray, shape (pixel,)
        ``sum_f |v_f|^2 / std_f^2``; infinite where a velocity is not known, NaN where a standard
        error is zero.
    limit : float
        What a pixel at rest exceeds at `AT_REST`.
    breaks_off : ndarray of bool, shape (pixel,)
        Pixels at the border of a lattice that do not go on as the image does.
    """

    size: Array
    limit: float
    breaks_off: BoolArray


def sizes(velocity: NDArray[np.complexfloating], std: Array, usable: BoolArray) -> Array:
    """Sum squares over variances, see `RestSums.size`.

    Parameters
    ----------
    velocity : ndarray, shape (pixel, frequency)
    std : ndarray, shape (pixel,) or (pixel, frequency)
    usable : ndarray of bool, shape (pixel,)
    """
    square = np.square(std).reshape(len(std), -1)
    found = np.full(len(velocity), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        found[usable] = np.sum(np.abs(velocity[usable]) ** 2 / square[usable], axis=1)
    found[usable & ~(square > 0).all(axis=1)] = np.nan
    return found


def limit_of(lines: int, has_phase: bool) -> float:
    """Give the sum of squares over variances that a pixel at rest exceeds at `AT_REST`.

    Parameters
    ----------
    has_phase : bool
        Velocities have a real and an imaginary part; otherwise none has an imaginary one.
    """
    return float(scipy.special.chdtri((2 if has_phase else 1) * lines, AT_REST))


#: Sums of the four borders of a lattice, shape (3, pixel of the border): see `border_sums`.
BorderSums = list[Array]


def border_sums(
    velocity: NDArray[np.complexfloating], std: Array, usable: BoolArray, shape: tuple[int, int]
) -> BorderSums:
    """Sum how the pixels at each border of a lattice go on, over some lines.

    The four pixels before one at the border go on as ``4 v_1 - 6 v_2 + 4 v_3 - v_4``, at a nodal
    line along the border to rest. That misses the fourth power of the pixels' distance, as it does
    one pixel further inside.

    Returns
    -------
    list of ndarray, shape (3, pixel of the border)
        Of each side in turn: squares over variances of what the pixel is off, squares of that, and
        of what the next one is off. No pixel of a side across which are too few.
    """
    image = np.where(usable[:, None], velocity, 0.0).reshape(*shape, -1)
    square = np.square(std).reshape(len(std), -1)
    square = np.broadcast_to(square, velocity.shape).reshape(image.shape)
    found = []
    for turn in range(4):
        v, s2 = (np.rot90(of, turn) for of in (image, square))  # views
        if len(v) < CONTINUED:
            found.append(np.zeros((3, 0)))
            continue
        off = v[0] - (4 * v[1] - 6 * v[2] + 4 * v[3] - v[4])
        missed = v[1] - (4 * v[2] - 6 * v[3] + 4 * v[4] - v[5])
        noise = s2[0] + 16 * s2[1] + 36 * s2[2] + 16 * s2[3] + s2[4]
        white = np.abs(off) ** 2 / np.where(noise > 0, noise, np.inf)
        each = white, np.abs(off) ** 2, np.abs(missed) ** 2
        found.append(np.array([of.sum(axis=1) for of in each]))
    return found


def breaks_off(
    sums: BorderSums, limit: float, usable: BoolArray, shape: tuple[int, int]
) -> BoolArray:
    """Find pixels at the border of a lattice that do not go on as the image does, (pixel,).

    Where one of the pixels that tell it has no velocity nothing is told.
    """
    found = np.zeros(shape, bool)
    for turn, (white, off, missed) in enumerate(sums):
        known, border = (np.rot90(of, turn) for of in (usable.reshape(shape), found))
        if len(known) >= CONTINUED:
            far = off > BREAK**2 * missed
            border[0] |= (white > limit) & far & known[:CONTINUED].all(axis=0)
    return found.ravel()


def is_lattice(shape: tuple[int, int] | None) -> TypeGuard[tuple[int, int]]:
    """Tell whether pixels are in rows and columns, two at least."""
    return shape is not None and min(shape) >= 2


def rest_sums(
    velocity: NDArray[np.complexfloating],
    std: Array,
    usable: BoolArray,
    shape: tuple[int, int] | None,
) -> RestSums:
    """Sum over lines that are all in memory, shape (pixel, frequency)."""
    limit = limit_of(velocity.shape[1], bool(np.imag(velocity[usable]).any()))
    off = np.zeros(len(velocity), bool)
    if is_lattice(shape):
        off = breaks_off(border_sums(velocity, std, usable, shape), limit, usable, shape)
    return RestSums(sizes(velocity, std, usable), limit, off)
