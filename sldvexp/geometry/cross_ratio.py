"""Cross-ratios of four collinear points and of the pencil of lines that joins them to a centre.

All functions take A, B, C, D along the dimension of four; leading dimensions are carried through.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.typing import Array


def from_coordinates(coordinates: ArrayLike) -> Array:
    """Give the cross-ratio of four points by their coordinates along their line (Eq 4.10).

    Parameters
    ----------
    coordinates : array_like, shape (..., 4)
        x of A, B, C and D; any unit.

    Returns
    -------
    ndarray, shape (...)
        ``(x_C - x_A)(x_D - x_B) / ((x_C - x_B)(x_D - x_A))``.

    Raises
    ------
    UserError
        If B and C or A and D coincide, where it is infinite or undetermined, or if a number is
        not finite.

    Examples
    --------
    >>> from_coordinates([0.0, 1.0, 2.0, 3.0]).round(4)
    np.float64(1.3333)
    """
    a, b, c, d = _elements(coordinates)
    return _ratio((c - a) * (d - b), (c - b) * (d - a))


def from_points(points: ArrayLike, tolerance: float = 1e-9) -> Array:
    """Give the cross-ratio of four collinear points in any number of dimensions (Eq 4.9).

    Parameters
    ----------
    points : array_like, shape (..., 4, dimensions)
        A, B, C and D; any unit.
    tolerance : float
        Largest distance from the common line, as a fraction of the points' extent.

    Returns
    -------
    ndarray, shape (...)
        ``AC BD / (AD BC)`` of directed distances.

    Raises
    ------
    UserError
        If the points are not on one line, or B and C or A and D coincide.

    Examples
    --------
    >>> from_points([[0.0, 0.0], [1.0, 2.0], [2.0, 4.0], [3.0, 6.0]]).round(4)
    np.float64(1.3333)
    """
    p = np.asarray(points, float)
    _require(bool(np.isfinite(p).all()))
    from_mean = p - p.mean(axis=-2, keepdims=True)
    _, _, axes = np.linalg.svd(from_mean)
    direction = axes[..., 0, :]
    along = np.einsum("...ij,...j->...i", from_mean, direction)
    beside = from_mean - along[..., None] * direction[..., None, :]
    distance = np.linalg.norm(beside, axis=-1).max(axis=-1)
    extent = np.ptp(along, axis=-1)
    if not np.all(distance <= tolerance * extent):
        raise UserError(
            f"the four points of a cross-ratio must lie on one line: they stand up to "
            f"{np.max(distance):.3g} beside it over a length of {np.max(extent):.3g}"
        )
    return from_coordinates(along)


def from_slopes(slopes: ArrayLike) -> Array:
    """Give the cross-ratio of four lines through one centre by their slopes (Eq 4.11).

    Parameters
    ----------
    slopes : array_like, shape (..., 4)
        Of the lines OA, OB, OC and OD: tangents of their angles.

    Returns
    -------
    ndarray, shape (...)

    Raises
    ------
    UserError
        If the lines OB and OC or OA and OD coincide.

    Examples
    --------
    >>> from_slopes([0.0, 1.0, 2.0, 3.0]).round(4)
    np.float64(1.3333)
    """
    return from_coordinates(slopes)


def from_angles(angles: ArrayLike) -> Array:
    """Give the cross-ratio of lines or planes through one centre or axis by angles (Eq 4.12).

    Parameters
    ----------
    angles : array_like, shape (..., 4), rad
        Of the lines OA, OB, OC and OD from any common direction: mirror angles, for the planes in
        which a mirror swings the beam (Sections 4.4.3.8 and 4.4.3.9).

    Returns
    -------
    ndarray, shape (...)
        ``sin(AOC) sin(BOD) / (sin(BOC) sin(AOD))``.

    Raises
    ------
    UserError
        If the lines OB and OC or OA and OD coincide.

    Examples
    --------
    >>> from_angles(np.arctan([0.0, 1.0, 2.0, 3.0])).round(4)
    np.float64(1.3333)
    """
    a, b, c, d = _elements(angles)
    return _ratio(np.sin(c - a) * np.sin(d - b), np.sin(c - b) * np.sin(d - a))


def _elements(values: ArrayLike) -> Array:
    """Move A, B, C and D to the first dimension."""
    elements = np.moveaxis(np.asarray(values, float), -1, 0)
    _require(bool(np.isfinite(elements).all()))
    return elements


def _ratio(numerator: Array, denominator: Array) -> Array:
    _require(bool((denominator != 0).all()))
    return np.asarray(numerator / denominator)


def _require(determined: bool) -> None:
    if not determined:
        raise UserError(
            "a cross-ratio needs four finite elements A, B, C and D, "
            "of which neither B and C nor A and D coincide"
        )
