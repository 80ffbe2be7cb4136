"""Mistakes in one view of a session, of which the program behind the instrument knows nothing.

What is recorded of a velocity v at the frequency f is

    (sign) gain exp(i (phase - 2 pi f delay)) v,

divided by sqrt(2) if effective values were written, of conj(v) if the phase was counted the other
way. This is true of everything the view measures. A wrong place, frequency or motion is that of
the structure alone: the calibration object was scanned before.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sldvexp.errors import Checks
from sldvexp.geometry import rotation_from_vector
from sldvexp.typing import Array, ComplexArray


@dataclass
class ViewMistakes:
    """Mistakes in one view.

    Parameters
    ----------
    gain : float
        Recorded velocity over the true one: a wrong range of the vibrometer.
    sign : int
        -1 if velocities away from the instrument were taken for positive.
    conjugate : bool
        Whether a phase lag was taken for a lead.
    rms : bool
        Whether effective values were written for peak values.
    phase : float, rad
        Added to the phase at every frequency.
    delay : float, s
        Of the velocity channel: takes 2 pi f delay from the phase.
    frequency : float
        Frequency at which the structure truly moved over the one that the view is said to have.
    modes : dict of str to float
        Factors of the velocities of single modes: another field, as of a shaker that was moved.
    seen_from : str
        Another view, from whose place the structure was seen in truth; two views that name each
        other are exchanged.
    turned : list of 3 float, rad
        Rotation vector in the laser frame by which the tripod was knocked between the calibration
        object and the structure.
    moved : list of 3 float, m
        Shift of the origin in the world by which it was knocked.
    """

    gain: float = 1.0
    sign: int = 1
    conjugate: bool = False
    rms: bool = False
    phase: float = 0.0
    delay: float = 0.0
    frequency: float = 1.0
    modes: dict[str, float] = field(default_factory=dict)
    seen_from: str = ""
    turned: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    moved: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what nobody can do wrong."""
        checks.positive(f"{name}.gain", self.gain)
        checks.require(self.sign in (1, -1), f"{name}.sign", f"must be 1 or -1, not {self.sign}")
        checks.positive(f"{name}.frequency", self.frequency)
        for key in ("phase", "delay"):
            checks.finite(f"{name}.{key}", getattr(self, key))
        for mode, factor in self.modes.items():
            checks.finite(f"{name}.modes.{mode}", factor)
        for key in ("turned", "moved"):
            values = getattr(self, key)
            message = f"must be three numbers, not {len(values)}"
            checks.require(len(values) == 3, f"{name}.{key}", message)
            checks.finite(f"{name}.{key}", *values)

    def recorded(self, velocity: ComplexArray, frequency: Array) -> ComplexArray:
        """Give what is recorded of velocities (pixel, tone) at frequencies (tone,) in Hz."""
        size = self.sign * self.gain * (np.sqrt(0.5) if self.rms else 1.0)
        turn = np.exp(1j * (self.phase - 2 * np.pi * frequency * self.delay))
        return size * turn * (velocity.conj() if self.conjugate else velocity)

    def knocked(self, rotation: Array, origin: Array) -> tuple[Array, Array]:
        """Give the pose after the knock: rotation (3, 3), world to laser, and origin (3,), m."""
        return rotation_from_vector(np.array(self.turned)) @ rotation, origin + self.moved
