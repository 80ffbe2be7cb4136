"""`laser=two_mirror`: galvanometer mirrors with offset, orthogonal axes, and their D/A board.

A calibration is a polynomial in u, the DAC step over the board's largest step, for each mirror:
``angle = zero + gain u + sum_k polynomial[k] u**(k + 2)``. `TwoMirror` makes sure that it is
monotonic over the board's range, so that angles have one DAC step each. The last dimension is
(up_down, left_right) throughout.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.typing import Array, BoolArray, IntArray
from sldvexp.units import AngleUnit

MIRRORS = ("up_down", "left_right")

#: Steps of u at which a calibration's slope is looked at.
MONOTONIC_GRID = 1000
#: Of the range: lets a limit pass that a conversion of units has rounded.
ROUNDING = 1e-12

#: Bisection alone needs 53 halvings; Newton's steps from inside the bracket need five.
ITERATIONS = 100


class Board(Enum):
    """D/A converters by their range of steps."""

    bits_12_sign = (-4096, 4096)
    bits_16 = (-32768, 32767)


@dataclass
class Mirror:
    """One mirror's calibration, ``angle = zero + gain u + sum_k polynomial[k] u**(k + 2)``.

    `u` is the DAC step over the board's largest step, so that a calibration holds for any board.

    Parameters
    ----------
    gain : float
        Angle at full scale (u = 1). Negative for a mirror wired the other way round. By default one
        of 4096 steps is 0.0061 deg: Figure 4.29 prints s as 0.0055 deg and as 0.9039 steps.
    zero : float
        Angle at step 0.
    polynomial : list of float
        Coefficients of u^2, u^3 and so on.
    gain_std, zero_std : float
        Standard deviations of what is known of both; 0 where that is nothing or they are exact.
    polynomial_std : list of float
        Those of the coefficients; as many as there are, or none.
    unit : AngleUnit
        Unit of the numbers above.
    """

    gain: float = 25.0
    zero: float = 0.0
    polynomial: list[float] = field(default_factory=list)
    unit: AngleUnit = AngleUnit.deg
    gain_std: float = 0.0
    zero_std: float = 0.0
    polynomial_std: list[float] = field(default_factory=list)

    @property
    def coefficients(self) -> list[float]:
        """Polynomial coefficients in rad, ascending powers of u."""
        scale = self.unit.value
        return [scale * c for c in (self.zero, self.gain, *self.polynomial)]

    def deviations(self, straight: bool) -> Iterator[tuple[Mirror, Mirror]]:
        """Give mirrors one standard deviation to both sides, by each stated error.

        Parameters
        ----------
        straight : bool
            By gain and zero as well.
        """
        for name in ("gain", "zero") if straight else ():
            value, std = getattr(self, name), getattr(self, f"{name}_std")
            if std:
                yield replace(self, **{name: value + std}), replace(self, **{name: value - std})
        for k, std in enumerate(self.polynomial_std):
            if std:
                more, less = list(self.polynomial), list(self.polynomial)
                more[k], less[k] = more[k] + std, less[k] - std
                yield replace(self, polynomial=more), replace(self, polynomial=less)

    def check(self, checks: Checks, name: str, board: Board) -> None:
        """Note under `name` what makes this calibration useless on a board."""
        known = len(checks.problems)
        checks.non_negative(f"{name}.gain_std", self.gain_std)
        checks.non_negative(f"{name}.zero_std", self.zero_std)
        for k, std in enumerate(self.polynomial_std):
            checks.non_negative(f"{name}.polynomial_std[{k}]", std)
        stated, given = len(self.polynomial_std), len(self.polynomial)
        message = f"must have as many numbers as polynomial, {given}, or none, not {stated}"
        checks.require(stated in (0, given), f"{name}.polynomial_std", message)
        checks.finite(f"{name}.gain", self.gain)
        checks.finite(f"{name}.zero", self.zero)
        checks.finite(f"{name}.polynomial", *self.polynomial)
        checks.require(
            self.gain != 0, f"{name}.gain", "must not be zero: the mirror would not move"
        )
        if len(checks.problems) > known:
            return
        lowest = board.value[0] / board.value[1]
        last = MONOTONIC_GRID if self.polynomial else 0  # a straight line has one slope
        grid = [lowest + (1.0 - lowest) * i / MONOTONIC_GRID for i in range(last + 1)]
        turns = next((u for u in grid if self._slope(u) * self.gain <= 0), None)
        checks.require(
            turns is None,
            f"{name}.polynomial",
            f"the angle must grow or shrink over the whole range of the board, but turns "
            f"back at step {(turns or 0.0) * board.value[1]:.0f}",
        )
        reach = max(abs(self._angle(lowest)), abs(self._angle(1.0)))
        checks.require(
            reach < math.pi / 2,
            f"{name}.gain",
            f"full scale reaches {math.degrees(reach):.6g} deg; a mirror stays below 90 deg "
            f"(unit is {self.unit.name})",
        )

    def _angle(self, u: float) -> float:
        return sum(c * u**k for k, c in enumerate(self.coefficients))

    def _slope(self, u: float) -> float:
        return sum(k * c * u ** (k - 1) for k, c in enumerate(self.coefficients) if k)


@register("laser", "two_mirror")
@dataclass
class TwoMirror:
    """Scanner with an up-down and a left-right mirror whose axes stand `mirror_offset` apart.

    Parameters
    ----------
    mirror_offset : float, m
        Distance between the two axes (Eq 4.3). It is your instrument's own. The dissertation does
        not print it, and the points of Figure 4.28 barely determine it: their best fit is 0.000533
        deg^2 at 0 m, 0.000564 at 0.020 m, 0.000745 at 0.040 m.
    board : Board
        D/A converter that drives both mirrors.
    up_down, left_right : Mirror
        Calibration of each mirror.
    mirror_offset_std : float, m
        Standard deviation of what is known of the offset; 0 where that is nothing or it is exact.
        Bounds of fields contain this and those of the mirrors.
    pointing_std : float, DAC steps
        Standard deviation of where each mirror comes to rest beside where it is sent, anew each
        time, as a repeatability test shows it (Section 4.5); 0 where it is not known. Bounds of
        fields contain it.
    """

    mirror_offset: float = 0.0
    board: Board = Board.bits_12_sign
    up_down: Mirror = field(default_factory=Mirror)
    left_right: Mirror = field(default_factory=Mirror)
    mirror_offset_std: float = 0.0
    pointing_std: float = 0.0

    def __post_init__(self) -> None:
        checks = Checks()
        checks.non_negative("mirror_offset", self.mirror_offset)
        checks.non_negative("mirror_offset_std", self.mirror_offset_std)
        checks.non_negative("pointing_std", self.pointing_std)
        for name in MIRRORS:
            getattr(self, name).check(checks, name, self.board)
        checks.done()

    @property
    def step(self) -> Array:
        """Angle of one DAC step at step 0, shape (mirror,), rad; always positive."""
        largest = self.board.value[1]
        return np.array([abs(getattr(self, m).coefficients[1]) / largest for m in MIRRORS])

    @property
    def ways(self) -> IntArray:
        """Signs of steps that go up and to the left, as seen from the instrument, shape (mirror,).

        The laser frame's y is up and its x to the left for who looks along z.

        Examples
        --------
        >>> TwoMirror(up_down=Mirror(gain=-25.0)).ways.tolist()
        [-1, 1]
        """
        return np.array([1 if getattr(self, m).gain > 0 else -1 for m in MIRRORS])

    @property
    def reach(self) -> tuple[Array, Array]:
        """Smallest and largest angle of each mirror, shape (mirror,), rad."""
        u = np.array(self.board.value) / self.board.value[1]
        ends = np.stack([self._angle(name, u) for name in MIRRORS], axis=1)
        return ends.min(axis=0), ends.max(axis=0)

    def reaches(self, angle: Array, share: Array | float = 1.0) -> BoolArray:
        """Tell which angles the mirrors can be sent to, shape (...).

        The ends of the board belong to it, since a beam can be sent there, and so does what lies
        beyond them by the rounding of a conversion: `dac_from_angle` has a step for all of these
        and for no others.

        Parameters
        ----------
        angle : ndarray, shape (..., 2), rad
            NaN, as of a point behind the instrument, is not reached.
        share : float or ndarray, broadcastable to (..., 1)
            Part of the range around its middle that counts.

        Examples
        --------
        >>> laser = TwoMirror()
        >>> laser.reaches(laser.angle_from_dac([[4096, -4096], [0, 0]])).tolist()
        [True, True]
        >>> laser.reaches(np.radians([[25.1, 0], [20, 0], [np.nan, 0]]), share=0.9).tolist()
        [False, True, False]
        """
        low, high = self.reach
        slack = ROUNDING * (high - low) + (share - 1) * (high - low) / 2
        within = (angle >= low - slack) & (angle <= high + slack)
        return np.asarray(within[..., 0] & within[..., 1])

    def steps_beyond(self, angle: Array) -> Array:
        """Give how many steps angles are beyond the ends of the board, shape (..., 2); 0 within it.

        Negative beyond the smallest angle of a mirror, positive beyond its largest; steps of the
        size that they have at step 0.

        Examples
        --------
        >>> TwoMirror().steps_beyond(np.radians([26.0, -1.0])).round().tolist()
        [164.0, 0.0]
        """
        low, high = self.reach
        return np.asarray((angle - np.clip(angle, low, high)) / self.step)

    def angle_from_dac(self, dac: ArrayLike, labels: ArrayLike | None = None) -> Array:
        """Give the mirror angles of DAC steps.

        Parameters
        ----------
        dac : array_like, shape (..., 2), steps
        labels : array_like, broadcastable to (...), optional
            Names of the points in messages; their indices without it.

        Returns
        -------
        ndarray, shape (..., 2), rad

        Raises
        ------
        UserError
            If a step is beyond the board's range (or not a number); names the point and the mirror.

        Examples
        --------
        >>> TwoMirror().angle_from_dac([4096, -2048]).round(4)
        array([ 0.4363, -0.2182])
        """
        steps = np.asarray(dac, float)
        low, high = self.board.value
        angles = np.empty(steps.shape)
        for i, name in enumerate(MIRRORS):
            _require_within(steps[..., i], low, high, labels, f"{name} DAC step", 1.0, "")
            angles[..., i] = self._angle(name, steps[..., i] / high)
        return angles

    def dac_from_angle(self, angle: ArrayLike, labels: ArrayLike | None = None) -> Array:
        """Give the DAC steps, not rounded, of mirror angles: the inverse of `angle_from_dac`.

        Parameters
        ----------
        angle : array_like, shape (..., 2), rad
        labels : array_like, broadcastable to (...), optional
            Names of the points in messages; their indices without it.

        Returns
        -------
        ndarray, shape (..., 2), steps
            Within 1e-12 of the largest step.

        Raises
        ------
        UserError
            If an angle is beyond the mirror's range (or not a number); names the point and the
            mirror.

        Examples
        --------
        >>> TwoMirror().dac_from_angle([0.2, -0.1]).round(1)
        array([1877.5, -938.7])
        """
        angles = np.asarray(angle, float)
        lowest, largest = self.board.value
        steps = np.empty(angles.shape)
        for i, name in enumerate(MIRRORS):
            reach = self._angle(name, np.array([lowest / largest, 1.0]))
            low, high = float(reach.min()), float(reach.max())
            what = f"{name} angle of"
            _require_within(angles[..., i], low, high, labels, what, 180.0 / np.pi, " deg")
            steps[..., i] = largest * self._solve(name, angles[..., i])
        return steps

    def steps_within(self, angle: Array, reach: tuple[Array, Array]) -> Array:
        """Give the DAC steps, not rounded, of angles that are reached; NaN of all others.

        As `dac_from_angle` and `reaches` tell them, of many angles block by block.

        Parameters
        ----------
        angle : ndarray, shape (point, 2), rad
        reach : pair of ndarray, shape (mirror,), rad
            As of `reach`, found once for all blocks.

        Returns
        -------
        ndarray, shape (point, 2), steps
            An entry of all points is contiguous.

        Examples
        --------
        >>> laser = TwoMirror()
        >>> laser.steps_within(np.array([[0.2, -0.1], [0.0, 0.5]]), laser.reach).round(1).tolist()
        [[1877.5, -938.7], [nan, nan]]
        """
        steps, reached = np.empty(angle.T.shape), np.ones(len(angle), bool)
        for name, of_mirror, low, high, found in zip(MIRRORS, angle.T, *reach, steps, strict=True):
            slack = ROUNDING * (high - low)
            reached &= (of_mirror >= low - slack) & (of_mirror <= high + slack)
            np.multiply(
                self.board.value[1], self._solve(name, np.clip(of_mirror, low, high)), out=found
            )
        if not reached.all():
            steps[:, ~reached] = np.nan
        return steps.T

    def _angle(self, name: str, u: Array) -> Array:
        return np.asarray(polynomial.polyval(u, getattr(self, name).coefficients))

    def _solve(self, name: str, angle: Array) -> Array:
        """Solve for the u of each angle, by Newton's method inside a bracket that holds the root.

        Of a straight line it is known at once. The polynomial is monotonic, so that the sign of the
        excess says which side to keep; a step out of the bracket is replaced by a halving of it.
        """
        coefficients = getattr(self, name).coefficients
        lowest = self.board.value[0] / self.board.value[1]
        u = np.clip((angle - coefficients[0]) / coefficients[1], lowest, 1.0)
        if len(coefficients) == 2:  # a straight line
            return u
        slopes = polynomial.polyder(coefficients)
        sign = np.sign(coefficients[1])
        below, above = np.full(angle.shape, lowest), np.ones(angle.shape)
        for _ in range(ITERATIONS):
            excess = sign * (self._angle(name, u) - angle)
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
