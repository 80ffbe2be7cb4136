"""A person beside the instrument, who does what it cannot: see marks, hold a digitizer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from sldvexp.typing import Array

Steps = tuple[int, int]
Place = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Mark:
    """A fiducial mark.

    Parameters
    ----------
    number : int
    position : ndarray, shape (3,), m
        As measured.
    std : ndarray, shape (3,), m
        Standard deviation of that.
    """

    number: int
    position: Array
    std: Array


class Person(Protocol):
    """Who points the beam and measures where it falls."""

    def aim(self, mark: Mark, start: Steps) -> Steps | None:
        """Bring the beam onto a mark.

        Parameters
        ----------
        mark : Mark
        start : (up_down, left_right), steps
            Where the beam may begin.

        Returns
        -------
        (up_down, left_right), steps, or None if the mark cannot be seen from here.
        """

    def digitise(self, spot: int, samples: int) -> list[Place]:
        """Measure several times where the beam falls as it stands, in m.

        Parameters
        ----------
        spot : int
            Which spot of the view this is, from 1.
        samples : int
            How often.
        """


@runtime_checkable
class Attended(Protocol):
    """An instrument that brings a person along, as a simulated one does."""

    @property
    def person(self) -> Person:
        """Who is there."""
