"""Where the mirrors really stand: pointing noise, hysteresis, drift.

At every pixel a mirror's angle is that of its calibration plus

    e = jitter n - direction hysteresis / 2 + drift line / 100,

n normal of unit variance, drawn for each pixel and mirror; direction +1 where the angle grew to get
here and -1 where it shrank; line counted from the view's beginning. A mirror that the pixel before
did not ask to move keeps its last direction. Every scan line begins at step 0: so a line that is
measured again comes out the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.laser import MIRRORS, TwoMirror
from sldvexp.typing import Array

#: Scan lines after which a mirror has gone by the whole of `PointingTerms.drift`.
LINES = 100


@dataclass(frozen=True)
class PointingTerms:
    """Sizes of the errors of a scanner that depend on where it is sent, when, and how far it sees.

    Parameters
    ----------
    jitter : float, rad
        Standard deviation of each mirror's angle, new at every pixel.
    hysteresis : float, rad
        By how much the angles differ that a mirror takes at one step from the two sides.
    drift : float, rad
        Of both mirrors' angles in a hundred scan lines of a view.
    worst : float
        Factor of the jitter and of the laser's noise at the worst optical distance.
    """

    jitter: float = 0.0
    hysteresis: float = 0.0
    drift: float = 0.0
    worst: float = 1.0

    @property
    def moves(self) -> bool:
        """True if any of them moves the beam."""
        return bool(self.jitter or self.hysteresis or self.drift)


class Scanner(Enum):
    """How well the scanner points.

    Attributes
    ----------
    ideal
        Every mirror stands where its calibration says.
    modern
        Pointing noise of 10 microrad and 5 microrad of hysteresis.
    chapter_4
        The dissertation's instrument: bitangent points repeat within 0.2 to 0.5 DAC step, those of
        a circle at a poor optical distance worse (Figure 4.27), and s of a pose is about 0.4 step.
    """

    ideal = PointingTerms()
    modern = PointingTerms(jitter=10e-6, hysteresis=5e-6)
    chapter_4 = PointingTerms(jitter=50e-6, worst=3.0)


class MirrorPath:
    """Way of the mirrors along one scan line, and how far off their angles are.

    Parameters
    ----------
    terms : PointingTerms
    mirrors : TwoMirror
        The true ones.
    line : int
        Number of the line in its view.
    """

    def __init__(self, terms: PointingTerms, mirrors: TwoMirror, line: int) -> None:
        self._terms = terms
        self._ways = mirrors.ways
        self._drift = terms.drift * line / LINES
        self._dac = np.zeros(len(MIRRORS))
        self._direction = np.zeros(len(MIRRORS))

    def error(self, dac: ArrayLike, normal: Array) -> Array:
        """Compute the errors of both angles at successive pixels; the way goes on from there.

        Parameters
        ----------
        dac : array_like, shape (pixel, 2), steps
            As the mirrors get them.
        normal : ndarray, shape (pixel, 2)
            Random numbers that multiply the jitter.

        Returns
        -------
        ndarray, shape (pixel, 2), rad
        """
        return errors_along([self], dac, normal, [len(normal)])


def errors_along(
    paths: Sequence[MirrorPath], dac: ArrayLike, normal: Array, pixels: Sequence[int]
) -> Array:
    """Compute the errors along several ways of the same mirrors, one after the other.

    Parameters
    ----------
    dac, normal : shape (pixel, 2)
        As of `MirrorPath.error`, of all ways.
    pixels : sequence of int
        How many each way has of them.

    Returns
    -------
    ndarray, shape (pixel, 2), rad
    """
    count = np.asarray(pixels)
    # Where each way was before, and which way it turned, stands ahead of its pixels.
    before = np.cumsum(count + 1) - count - 1
    there = np.ones(len(normal) + len(count), bool)
    there[before] = False
    steps = np.empty((len(there), len(MIRRORS)))
    steps[there], steps[before] = dac, [path._dac for path in paths]
    turned = np.empty_like(steps)
    # Angles follow the steps one way over the whole range.
    turned[1:] = np.sign(steps[1:] - steps[:-1]) * paths[0]._ways
    turned[before] = [path._direction for path in paths]
    # Where nothing turned, the last pixel of the way that did tells the direction.
    last = np.where(turned != 0, np.arange(len(turned))[:, None], 0)
    last[before] = before[:, None]
    direction = np.take_along_axis(turned, np.maximum.accumulate(last), axis=0)
    for path, end in zip(paths, before + count, strict=True):
        path._dac, path._direction = steps[end], direction[end]
    t, drift = paths[0]._terms, np.repeat([path._drift for path in paths], count)
    return np.asarray(
        t.jitter * normal - direction[there] * t.hysteresis / 2 + drift[:, None], float
    )
