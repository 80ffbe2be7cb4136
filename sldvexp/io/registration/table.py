"""Registration data of one view: object points and the mirror positions that reach them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.laser import MIRRORS, TwoMirror
from sldvexp.typing import Array, BoolArray, IntArray
from sldvexp.units import LengthUnit


@dataclass(frozen=True, eq=False)
class RegistrationTable:
    """Matched object and image points of one view, in SI units.

    Parameters
    ----------
    name : str
        Of the view.
    number : ndarray of int, shape (N,)
        Of the points; no number twice.
    object_point : ndarray, shape (N, 3), m
    angle : ndarray, shape (N, 2), rad, optional
        (up_down, left_right) of the beam through each point.
    dac : ndarray, shape (N, 2), steps, optional
        The same as DAC steps. One of `angle` and `dac` must be there.
    object_std : ndarray, shape (N, 3), m, optional
        Standard deviation of each object point's coordinates, if it is known.
    distance_guess : float, m, optional
        From the instrument to the object, as a file stated it; no method here needs it.
    unit : LengthUnit
        In which text files state the lengths of this table. The arrays are in m all the same.
    source : str
        Where the data came from, for messages.

    Raises
    ------
    UserError
        If shapes disagree, a number is not finite, a point number stands twice, or an angle is
        90 degrees or more.

    Examples
    --------
    >>> RegistrationTable("front", np.array([7, 9]), np.eye(3)[:2], angle=np.zeros((2, 2)))
    <RegistrationTable of view front: 2 points with angles>
    """

    name: str
    number: IntArray
    object_point: Array
    angle: Array | None = None
    dac: Array | None = None
    distance_guess: float | None = None
    unit: LengthUnit = LengthUnit.m
    source: str = ""
    object_std: Array | None = None

    def __repr__(self) -> str:
        has = [n for n, a in (("angles", self.angle), ("DAC steps", self.dac)) if a is not None]
        points = f"{len(self.number)} point{'s' if len(self.number) > 1 else ''}"
        return f"<RegistrationTable of view {self.name}: {points} with {' and '.join(has)}>"

    def __post_init__(self) -> None:
        where = f"{self.source or 'registration data'}, view {self.name}"
        n = len(self.number)
        if n == 0:
            raise UserError(f"{where}: has no points")
        if self.angle is None and self.dac is None:
            raise UserError(f"{where}: has neither mirror angles nor DAC steps")
        for what, values, width in (
            ("object_point", self.object_point, 3),
            ("object_std", self.object_std, 3),
            ("angle", self.angle, 2),
            ("dac", self.dac, 2),
        ):
            if values is None:
                continue
            if np.shape(values) != (n, width):
                raise UserError(
                    f"{where}: {what} has the shape {np.shape(values)} where {n} points "
                    f"need {(n, width)}"
                )
            bad = ~np.isfinite(values).all(axis=1)
            if bad.any():
                raise UserError(
                    f"{where}: {what} of point {self.number[bad][0]} is not a finite number"
                )
        unique, count = np.unique(self.number, return_counts=True)
        if (count > 1).any():
            raise UserError(f"{where}: point number {unique[count > 1][0]} stands twice")
        self._require_forward(where)

    def part(self, chosen: BoolArray) -> RegistrationTable:
        """Take the points that a mask, shape (N,), chooses."""
        arrays = ("number", "object_point", "angle", "dac", "object_std")
        there = {name: getattr(self, name) for name in arrays}
        return replace(self, **{n: a[chosen] for n, a in there.items() if a is not None})

    @property
    def labels(self) -> list[str]:
        """Names of the points in messages."""
        return [f"{n} of view {self.name}" for n in self.number]

    def angle_through(self, laser: TwoMirror) -> Array:
        """Give mirror angles, shape (N, 2), rad: the measured ones, or those of the DAC steps.

        Raises
        ------
        UserError
            If a DAC step is beyond the range of the laser's board.
        """
        if self.angle is not None:
            return self.angle
        assert self.dac is not None  # one of the two is there, see __post_init__
        return laser.angle_from_dac(self.dac, self.labels)

    def _require_forward(self, where: str) -> None:
        """Refuse angles no mirror has: most often DAC steps, or degrees taken for radians."""
        if self.angle is None:
            return
        beyond = np.argwhere(np.abs(self.angle) >= np.pi / 2)
        if len(beyond):
            point, mirror = beyond[0]
            raise UserError(
                f"{where}: the {MIRRORS[mirror]} angle of point {self.number[point]} is "
                f"{np.degrees(self.angle[point, mirror]):.6g} deg, but a beam towards the object "
                "stays below 90 deg (are these DAC steps?)"
            )
