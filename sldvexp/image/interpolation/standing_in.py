"""Values in place of single pixels that dropped out, from the pixels around them.

A pixel of a lattice without a value takes the four cells at it along: of one in ten pixels a third
of the cells. Where it stands alone, the quadratic through the 5 x 5 pixels around, weighted by one
over the square of their distance, stands in for it. That is linear in the pixels, so that its
noise, and what it shares with its neighbours, are known; of a wave of wave number k it misses about
``(k h)^4 / 6``, h the pixels' distance. Pixels that belong to a hole stay open: nothing is known
there.
"""

from __future__ import annotations

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray

#: Rows and columns to either side that stand in for a pixel.
AROUND = 2
#: Variance of what stands in, over that of a pixel, above which it is extrapolated rather.
NOISIEST = 1.0
#: Least ratio of the eigenvalues of a fit that determines all terms.
DETERMINED = 1e-6


def quadratic(place: Array) -> Array:
    """Evaluate the terms of a quadratic at places, shape (..., 2); shape (..., 6)."""
    x, y = np.moveaxis(place, -1, 0)
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def stand_ins(
    grid: Array, usable: BoolArray, dropped: BoolArray
) -> tuple[scipy.sparse.csr_array, BoolArray]:
    """Find weights of the usable pixels that stand in for others.

    Parameters
    ----------
    grid : ndarray, shape (rows, columns, 2), steps
    usable : ndarray of bool, shape (rows * columns,)
    dropped : ndarray of bool, shape (rows * columns,)
        Pixels that single values stand in for, if they stand alone.

    Returns
    -------
    csr_array, shape (rows * columns, rows * columns)
        Rows of usable pixels are their own.
    ndarray of bool, shape (rows * columns,)
        Pixels that have a value now.
    """
    wanted = np.flatnonzero(dropped & ~usable & ~_in_hole(usable.reshape(grid.shape[:2])).ravel())
    near, there = _around(wanted, grid.shape[:2])
    there &= usable[near]
    weight, good = _weights(grid.reshape(-1, 2)[near] - grid.reshape(-1, 2)[wanted, None], there)
    own, (pixel, place) = np.flatnonzero(usable), np.nonzero(there & good[:, None])
    row = np.concatenate([own, wanted[pixel]])
    column = np.concatenate([own, near[pixel, place]])
    value = np.concatenate([np.ones(len(own)), weight[pixel, place]])
    count, filled = len(usable), usable.copy()
    filled[wanted[good]] = True
    return scipy.sparse.csr_array((value, (row, column)), shape=(count, count)), filled


def _in_hole(usable: BoolArray) -> BoolArray:
    """Find pixels that hang together with a block of 3 x 3 without a value, shape (row, column)."""
    block = np.ones((3, 3), bool)
    label, _ = scipy.ndimage.label(~usable, block)
    whole = scipy.ndimage.binary_erosion(~usable, block)
    return np.asarray(np.isin(label, np.unique(label[whole])) & ~usable)


def _around(pixel: IndexArray, shape: tuple[int, ...]) -> tuple[IndexArray, BoolArray]:
    """List pixels around others, shape (pixel, around), and which of them are in the image."""
    step = np.arange(-AROUND, AROUND + 1)
    away = np.stack(np.meshgrid(step, step, indexing="ij"), axis=-1).reshape(-1, 2)
    away = away[np.any(away != 0, axis=1)]
    at = np.stack(np.divmod(pixel, shape[1]), axis=-1)[:, None] + away
    inside = np.all((at >= 0) & (at < np.array(shape)), axis=-1)
    at = np.clip(at, 0, np.array(shape) - 1)
    return at[..., 0] * shape[1] + at[..., 1], inside


def _weights(away: Array, there: BoolArray) -> tuple[Array, BoolArray]:
    """Compute weights of the pixels around, shape (pixel, around), and which pixels have them.

    Parameters
    ----------
    away : ndarray, shape (pixel, around, 2), steps
    there : ndarray of bool, shape (pixel, around)
    """
    square = np.where(there, np.square(away).sum(axis=2), np.inf)
    size = np.sqrt(np.min(square, axis=1, initial=np.inf, keepdims=True))
    design = quadratic(away / np.where(np.isfinite(size), size, 1.0)[..., None])
    weighted = design * np.where(there, size**2 / np.where(there, square, 1.0), 0.0)[..., None]
    normal = np.swapaxes(weighted, 1, 2) @ design
    value, vector = np.linalg.eigh(np.nan_to_num(normal))
    determined = value[:, 0] > DETERMINED * value[:, -1]
    inverse = (vector / np.where(determined[:, None], value, 1.0)[:, None]) @ vector.swapaxes(1, 2)
    weight = np.einsum("pm,pam->pa", inverse[:, 0], np.nan_to_num(weighted))
    return weight, determined & (np.sum(weight**2, axis=1) <= NOISIEST)
