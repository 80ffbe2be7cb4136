"""A mirror's calibration: DAC steps to angles and back, and the limits of the board.

The last dimension is (up_down, left_right). A calibration is a polynomial in u, the DAC step over
the board's largest step; `TwoMirror` has made sure that it is monotonic over the board's range.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.laser.two_mirror import MIRRORS
from sldvexp.typing import Array

if TYPE_CHECKING:
    from sldvexp.laser.two_mirror import TwoMirror


#: Of the range: lets a limit pass that a conversion of units has rounded.
ROUNDING = 1e-12

#: Bisection alone needs 53 halvings; Newton's steps from inside the bracket need five.
ITERATIONS = 100


def angle_from_dac(laser: TwoMirror, dac: ArrayLike, labels: ArrayLike | None = None) -> Array:
    """Mirror angles of DAC steps, ``angle = zero + gain u + sum_k polynomial[k] u**(k + 2)``.

    Parameters
    ----------
    laser : TwoMirror
    dac : array_like, shape (..., 2), steps
    labels : array_like, broadcastable to (...), optional
        What the points are called in messages; their indices without it.

    Returns
    -------
    ndarray, shape (..., 2), rad

    Raises
    ------
    UserError
        If a step is beyond the board's range (or not a number); names the point and the mirror.
    """
    steps = np.asarray(dac, float)
    low, high = laser.board.value
    angles = np.empty(steps.shape)
    for i, name in enumerate(MIRRORS):
        _require_within(steps[..., i], low, high, labels, f"{name} DAC step", 1.0, "")
        angles[..., i] = _angle(laser, name, steps[..., i] / high)
    return angles


def dac_from_angle(laser: TwoMirror, angle: ArrayLike, labels: ArrayLike | None = None) -> Array:
    """DAC steps, not rounded, of mirror angles: the inverse of `angle_from_dac`.

    Parameters
    ----------
    laser : TwoMirror
    angle : array_like, shape (..., 2), rad
    labels : array_like, broadcastable to (...), optional
        What the points are called in messages; their indices without it.

    Returns
    -------
    ndarray, shape (..., 2), steps
        Within 1e-12 of the largest step.

    Raises
    ------
    UserError
        If an angle is beyond the mirror's range (or not a number); names the point and the mirror.
    """
    angles = np.asarray(angle, float)
    largest = laser.board.value[1]
    steps = np.empty(angles.shape)
    for i, name in enumerate(MIRRORS):
        reach = _reach(laser, name)
        low, high = float(reach.min()), float(reach.max())
        what = f"{name} angle of"
        _require_within(angles[..., i], low, high, labels, what, 180.0 / np.pi, " deg")
        steps[..., i] = largest * _solve(laser, name, angles[..., i])
    return steps


def _reach(laser: TwoMirror, name: str) -> Array:
    """Angles of one mirror at the lowest and the highest step, rad."""
    low, high = laser.board.value
    return _angle(laser, name, np.array([low / high, 1.0]))


def _angle(laser: TwoMirror, name: str, u: Array) -> Array:
    return np.asarray(polynomial.polyval(u, getattr(laser, name).coefficients))


def _solve(laser: TwoMirror, name: str, angle: Array) -> Array:
    """The u of each angle, by Newton's method inside a bracket that always holds the root."""
    coefficients = getattr(laser, name).coefficients
    slopes = polynomial.polyder(coefficients)
    sign = np.sign(coefficients[1])
    below = np.full(angle.shape, laser.board.value[0] / laser.board.value[1])
    above = np.ones(angle.shape)
    u = np.clip((angle - coefficients[0]) / coefficients[1], below, above)
    for _ in range(ITERATIONS):
        excess = sign * (_angle(laser, name, u) - angle)
        below = np.where(excess < 0, u, below)
        above = np.where(excess > 0, u, above)
        newton = u - excess / (sign * polynomial.polyval(u, slopes))
        outside = (newton < below) | (newton > above)
        new = np.where(excess == 0, u, np.where(outside, (below + above) / 2, newton))
        done = np.all(np.abs(new - u) <= np.finfo(float).eps)
        u = new
        if done:
            break
    return u


def _require_within(
    values: Array,
    low: float,
    high: float,
    labels: ArrayLike | None,
    what: str,
    scale: float,
    unit: str,
) -> None:
    """Complain about the first value outside the range, in `unit` after multiplying by `scale`."""
    slack = ROUNDING * (high - low)
    outside = ~((values >= low - slack) & (values <= high + slack))
    if outside.any():
        first = np.argwhere(outside)[0]
        label = _label(values.shape, tuple(first), labels)
        raise UserError(
            f"point {label}: the {what} {scale * values[tuple(first)]:.9g}{unit} is not within "
            f"the mirror's range of {scale * low:.9g} to {scale * high:.9g}{unit}; "
            "move the instrument or check the calibration of the laser"
        )


def _label(shape: tuple[int, ...], index: tuple[int, ...], labels: ArrayLike | None) -> str:
    if labels is None:
        return ", ".join(str(i) for i in index)
    return str(np.broadcast_to(np.asarray(labels), shape)[index])
