"""What one view says, and how its values become velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.importers.pointwise import Quantity
from sldvexp.io.uff.geometry import Geometry
from sldvexp.typing import Array, BoolArray, ComplexArray, IntArray


@dataclass(frozen=True)
class Conventions:
    """How a file's values become peak velocities towards the instrument, exp(+i omega t).

    Parameters
    ----------
    quantity : Quantity
    factor : float
        Of units, amplitude, reference and sign together.
    conjugate : bool
    told : dict of str to str
        What was decided and by what, for the record.
    """

    quantity: Quantity
    factor: float
    conjugate: bool
    told: dict[str, str]

    def velocity(self, values: NDArray, frequency: Array) -> ComplexArray:
        """Velocities of the file's values, m/s, of any shape that ends with frequency."""
        omega = 2j * np.pi * frequency
        values = np.conj(values) if self.conjugate else values
        return np.asarray(self.factor * values * omega**self.quantity.value, complex)


@dataclass(frozen=True, eq=False)
class Measured:
    """What one view says.

    Parameters
    ----------
    name : str
    source : str
    node : ndarray of int, shape (point,)
        Ascending.
    direction : ndarray of int, shape (point,)
        Code of each function's response direction.
    frequency : ndarray, shape (frequency,), Hz
    velocity : ndarray of complex, shape (point, frequency), m/s
    std : ndarray or None, shape of `velocity`, m/s
    missing : ndarray of bool, shape (point,)
        Where zeros stand for what was not measured.
    geometry : Geometry or None
    length : float
        One of the geometry's units in m.
    told : dict of str to str
        Conventions, for the record.
    """

    name: str
    source: str
    node: IntArray
    direction: IntArray
    frequency: Array
    velocity: ComplexArray
    std: Array | None
    missing: BoolArray
    geometry: Geometry | None
    length: float
    told: dict[str, str]


def close(one: Array, two: Array) -> bool:
    """Whether two lists of frequencies are the same."""
    return one.shape == two.shape and bool(np.allclose(one, two, rtol=1e-9, atol=0.0))


def same_frequencies(view: Measured, first: Measured | None) -> None:
    """Complain unless a view has the frequencies of the first one."""
    if first is not None and not close(view.frequency, first.frequency):
        raise UserError(
            f"{view.source}: view {view.name} has other frequencies than view {first.name}; choose "
            "those that all views have with instrument.frequency"
        )
