"""Scan lines of velocities and the edge points found on them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray

#: Pixels of a straight scan line are beside it by the rounding to whole steps at most.
STRAIGHT = 1.0
#: Least number of pixels on a line: a gradient with a maximum inside needs five.
LEAST_PIXELS = 5


class Reason(Enum):
    """Why a candidate is no edge."""

    flagged = "with flagged pixels at the edge"
    contrast = "with too little contrast"
    end = "with the edge at the end of the line"
    order = "on which the velocity falls before it rises"
    profile = "that no edge profile fits"


def is_edge(reason: NDArray[np.object_]) -> BoolArray:
    """Tell which candidates have no reason against them, shape (n,)."""
    return np.array([r is None for r in reason], bool)


@dataclass(frozen=True, eq=False)
class ScanLines:
    """Velocity magnitudes along straight scan lines.

    A magnitude of complex noise is not zero on average: it lifts the resting side and makes every
    circle smaller by about ``noise / contrast`` times twice the spot's width. `of_velocity` takes
    the component in phase with the motion instead, which noise leaves unbiased.

    Parameters
    ----------
    magnitude : ndarray, shape (line, pixel), m/s or any unit
    std : ndarray, shape (line, pixel), the same unit
        Standard error of each magnitude.
    position : ndarray, shape (line, pixel, 2), steps
        DAC steps (up_down, left_right), in the order of scanning.
    flag : ndarray of bool, shape (line, pixel)
        True where the magnitude is not to be trusted; it may then be NaN.
    name : str
        What is scanned, for messages.
    phase : ndarray, shape (line,), rad, optional
        Of each line's motion, relative to the reference channel.

    Raises
    ------
    UserError
        If the shapes differ, a line is too short, not straight or turns back, or a pixel that is
        not flagged has no finite magnitude or no positive standard error.
    """

    magnitude: Array
    std: Array
    position: Array
    flag: BoolArray
    name: str = "the circle"
    phase: Array | None = None

    def __post_init__(self) -> None:
        shape = self.magnitude.shape
        shapes = self.std.shape, self.flag.shape, self.position.shape[:-1]
        if len(shape) != 2 or any(s != shape for s in shapes) or self.position.shape[-1:] != (2,):
            raise UserError(
                f"{self.name}: magnitudes, standard errors and flags must be (line, pixel) and "
                f"positions (line, pixel, 2), not {shape}, {shapes[0]}, {shapes[1]} and "
                f"{self.position.shape}"
            )
        if shape[1] < LEAST_PIXELS:
            raise UserError(
                f"{self.name}: a scan line needs {LEAST_PIXELS} pixels or more, not {shape[1]}"
            )
        finite = np.isfinite(self.magnitude) & np.isfinite(self.std) & (self.std > 0)
        unknown = np.logical_not(finite | self.flag)
        self._refuse(unknown, "has no finite magnitude with a positive standard error")
        self._refuse(~np.isfinite(self.position.sum(axis=-1)), "has no finite position")
        along, beside = self._frame
        aside = np.abs(beside)
        farthest = aside == aside.max(axis=1, keepdims=True)
        crooked = (aside > STRAIGHT) & farthest
        self._refuse(crooked, "stands beside its line, which must be straight")
        self._refuse(np.diff(along, append=np.inf) < 0, "is followed by one that turns back")
        self._refuse(along[:, -1:] <= along[:, :1], "stands where the whole line does")

    @classmethod
    def of_velocity(
        cls,
        velocity: ComplexArray,
        std: Array,
        position: Array,
        flag: BoolArray,
        name: str = "the circle",
    ) -> ScanLines:
        """Scan lines of the velocity's component in phase with the lines' common motion.

        Parameters
        ----------
        velocity : ndarray of complex, shape (line, pixel)
            Relative to the reference channel, so that all pixels of one speaker share a phase.
        std : ndarray, shape (line, pixel)
            Standard error of the real and of the imaginary part.
        position, flag, name
            As in the class.
        """
        good = np.where(flag, 0.0, velocity)
        # a square has no sign, and noise that is alike in both parts cancels in the sum of squares
        axis = np.exp(0.5j * np.angle(np.sum(good**2)))
        in_phase = (velocity * axis.conj()).real
        turned = np.sum(np.where(flag, 0.0, in_phase)) < 0
        phase = np.angle(good.sum(axis=1))
        return cls(-in_phase if turned else in_phase, std, position, flag, name, phase)

    @property
    def origin(self) -> Array:
        """Mean position of each line, shape (line, 2), steps."""
        return self.position.mean(axis=1)

    @property
    def direction(self) -> Array:
        """Unit vector along each line in the order of scanning, shape (line, 2)."""
        pixels = self.position.shape[1]
        way = np.einsum("p,lpi->li", np.arange(pixels) - (pixels - 1) / 2, self.position)
        length = np.linalg.norm(way, axis=-1, keepdims=True)
        return np.divide(way, length, out=np.zeros_like(way), where=length > 0)

    @property
    def along(self) -> Array:
        """Distance of each pixel along its line from `origin`, shape (line, pixel), steps."""
        return self._frame[0]

    @property
    def pitch(self) -> Array:
        """Mean distance between neighbouring pixels of each line, shape (line,), steps."""
        return (self.along[:, -1] - self.along[:, 0]) / (self.along.shape[1] - 1)

    def place(self, line: IndexArray, edge: Array, width: Array) -> Array:
        """Place edges on their lines, shape (n, 2), steps.

        On an oblique line whole steps lie beside it. A pixel beside it by q shifts an edge that is
        not square to the line in proportion to q and to the pixel's weight in the fit of a profile,
        the square of its slope; an edge is placed beside the line by the mean q of that weight.
        """
        along, beside = (values[line] for values in self._frame)
        reach = np.maximum(width, self.pitch[line] / 2)[:, None]
        exponent = ((along - edge[:, None]) / reach) ** 2
        weight = np.exp(exponent.min(axis=1, keepdims=True) - exponent)
        aside = (weight * beside).sum(axis=1) / weight.sum(axis=1)
        ahead = self.direction[line]
        left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        return self.origin[line] + edge[:, None] * ahead + aside[:, None] * left

    def filled(self) -> Array:
        """Fill flagged pixels by interpolation along their line (zero on a flagged line)."""
        values = np.where(self.flag, 0.0, self.magnitude)
        for k in np.flatnonzero(self.flag.any(axis=1) & ~self.flag.all(axis=1)):
            good, t = ~self.flag[k], self.along[k]
            values[k] = np.interp(t, t[good], values[k, good])
        return values

    @cached_property
    def _frame(self) -> tuple[Array, Array]:
        """Coordinates of the pixels along and across their line, which every edge asks for."""
        away = self.position - self.origin[:, None]
        x, y = np.moveaxis(self.direction[:, None], -1, 0)
        return away[..., 0] * x + away[..., 1] * y, away[..., 1] * x - away[..., 0] * y

    def _refuse(self, bad: BoolArray, what: str) -> None:
        if bad.any():
            line, pixel = np.argwhere(bad)[0]
            raise UserError(f"{self.name}: pixel {pixel} of scan line {line} {what}")


@dataclass(frozen=True, eq=False)
class ScanLineEdges:
    """Edge points on scan lines, and what was rejected.

    Parameters
    ----------
    position : ndarray, shape (n, 2), steps
    std : ndarray, shape (n,), steps
        Standard error along the scan line.
    direction : ndarray, shape (n, 2)
        Unit vector of the scan line.
    width : ndarray, shape (n,), steps
        Width of the edge's profile along the scan line (`sldvexp.image.edge_profile`).
    line : ndarray of int, shape (n,)
    rising : ndarray of bool, shape (n,)
        Whether the magnitude grows along the line.
    phase : ndarray, shape (n,), rad
        Of the motion on the line; NaN if it is not known.
    rejected : tuple of (int, Reason)
        Line and reason of every candidate that is no edge.
    lines : int
        How many lines were looked at.
    name : str
    reach : ndarray, shape (n, 2), steps, optional
        How far the pixels that place an edge go, from it back along the line and on.
    growth_std : ndarray, shape (n, 2), steps, optional
        How far two independent errors of the motion's growth over the circle move the edges along
        the scan lines, all together, one standard deviation each (`sldvexp.image.uneven_motion`).
    gain : ndarray, shape (n, pixel), steps over the magnitude's unit, optional
        How far each pixel of the edge's line moves it along the line.
    """

    position: Array
    std: Array
    direction: Array
    width: Array
    line: IndexArray
    rising: BoolArray
    phase: Array
    rejected: tuple[tuple[int, Reason], ...]
    lines: int
    name: str
    reach: Array | None = None
    growth_std: Array | None = None
    gain: Array | None = None

    def counts(self) -> dict[Reason, int]:
        """Count how many candidates were rejected for each reason."""
        return dict(Counter(reason for _, reason in self.rejected))

    def summary(self) -> str:
        """Summarise what was seen, in one phrase."""
        seen = f"{len(self.std)} edges on {self.lines} scan lines"
        lost = [f"{n} {reason.value}" for reason, n in self.counts().items()]
        return f"{seen}; rejected {', '.join(lost)}" if lost else seen
