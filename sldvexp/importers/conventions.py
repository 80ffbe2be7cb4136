"""Conventions of measured values: how the numbers of a file become peak velocities.

A file may hold displacements, velocities or accelerations in any unit of length, as peak, r.m.s.
or half-peak amplitudes of either sign and either time dependence. With ``x = X exp(i omega t)``
each derivative is a factor ``i omega``, so that one factor, one power of ``i omega`` and perhaps a
conjugation make every one of them the velocity ``V exp(+i omega t)`` towards the instrument.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from sldvexp.dataset import Severity
from sldvexp.importers.reference import ReferenceUnit
from sldvexp.typing import Array, ComplexArray
from sldvexp.unit_labels import Amplitude as Amplitude


class Directions(Enum):
    """Sources of the lines of sight.

    Attributes
    ----------
    dof
        The response direction of each function, as +Z, in its node's coordinate system.
    view
        `origin` or `direction` of each view.
    pose
        The run's poses, and the laser's mirrors.
    """

    dof = "dof"
    view = "view"
    pose = "pose"


class Positive(Enum):
    """Sense of a positive velocity of the file, seen from the surface."""

    towards = 1
    away = -1


class Quantity(Enum):
    """Quantity of a motion; the value is how often it must be differentiated for a velocity."""

    displacement = 1
    velocity = 0
    acceleration = -1


class MotionUnit(Enum):
    """Unit of length in the values' unit, as mm of mm/s, in m; g is one of acceleration."""

    m = 1.0
    cm = 0.01
    mm = 1e-3
    um = 1e-6
    nm = 1e-9
    inch = 0.0254
    mil = 2.54e-5
    ft = 0.3048
    g = 9.80665


class Phase(Enum):
    """Sign in the exponent of the time dependence that complex values belong to."""

    exp_plus = 1
    exp_minus = -1


class Zeros(Enum):
    """Meaning of a function whose values are all zero."""

    refuse = "refuse"
    missing = "missing"
    measured = "measured"


@dataclass(frozen=True)
class Conventions:
    """Rule that turns a file's values to peak velocities towards the instrument, exp(+i omega t).

    Parameters
    ----------
    factor : float
        Of units, amplitude, reference and sign together.
    conjugate : bool
        Whether the file's time dependence is exp(-i omega t).
    told : dict of str to str
        What was decided and by what, for the record.
    odd : tuple of (str, Severity)
        What else the file says that was not heeded, a sentence each with the file, and how much
        that weighs.
    reference : ReferenceUnit or None
        None if values have no reference.
    amplitude : float or None
        Of the reference, in its unit; None likewise.

    Examples
    --------
    >>> rule = Conventions(Quantity.displacement, 1e-6, False, {})
    >>> rule.velocity(np.array([1.0]), np.array([100.0])).round(6).tolist()
    [0.000628j]
    """

    quantity: Quantity
    factor: float
    conjugate: bool
    told: dict[str, str]
    odd: tuple[tuple[str, Severity], ...] = ()
    reference: ReferenceUnit | None = None
    amplitude: float | None = None

    def velocity(self, values: NDArray, frequency: Array) -> ComplexArray:
        """Turn values of any shape that ends with frequency to velocities, m/s."""
        omega = 2j * np.pi * frequency
        values = np.conj(values) if self.conjugate else values
        return np.asarray(self.factor * values * omega**self.quantity.value, complex)
