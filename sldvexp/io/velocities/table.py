"""Line-of-sight velocities of points seen from several views, checked once.

All formats end in one `LineOfSight`. What a file of others calls its arrays and dimensions, and in
which order they are, is a `FileLayout`.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.errors import UserError, nearest
from sldvexp.io.questions import OpenQuestionError
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, BoolArray, ComplexArray, IntArray
from sldvexp.unit_labels import Amplitude
from sldvexp.units import LengthUnit, VelocityUnit

#: How values that are not there become known to be so.
REMEDY = (
    "leave points without a velocity out with instrument.incomplete=drop, or keep them marked with "
    "instrument.incomplete=mark"
)
FINITE = f"must be finite; {REMEDY}"
#: Unit vectors may be printed with three digits.
LARGEST_LENGTH_ERROR = 5e-3


@dataclass(frozen=True)
class LineOfSight:
    """Velocities along known directions.

    Parameters
    ----------
    source : str
        File or instrument, for messages.
    point : list of str or None
        Labels of the points; None for a single point without a name.
    frequency : ndarray or None, shape (frequency,), Hz
        None for a single frequency that is not stated.
    direction_cosines : ndarray, shape (view, point, 3)
        Unit vectors from the surface to the instrument.
    velocity : ndarray, shape (view, point, frequency), m/s
        Real or complex.
    std : ndarray or None, shape of `velocity`, m/s
        Standard error of a velocity, per real and imaginary part.
    missing : ndarray of bool or None, shape of `velocity`
        Where there is no velocity, which is NaN; None if all are there.
    position : ndarray or None, shape (point, 3), m
    triangle, line : ndarray of int or None, shapes (triangle, 3) and (line, 2)
        Places of points that a surface or a line joins.
    amplitude : Amplitude or None
        Measure of a sine that the file says its velocities are; None if it says nothing.
    odd : tuple of str
        Sentences on text of the file that settings win over.
    ignored : tuple of str
        Names of columns or arrays that were left out as the settings say.

    Raises
    ------
    UserError
        If a number is not finite, a direction is not a unit vector, a standard error is not
        positive, a frequency is negative or repeated, or positions do not fit the points.

    Examples
    --------
    >>> cosines = np.array([[[0.0, 0.0, 1.0]], [[0.6, 0.0, 0.8]]])
    >>> LineOfSight("memory", ["front", "left"], None, None, cosines, np.ones((2, 1, 1)))
    <LineOfSight of 2 views, 1 points, 1 frequencies from memory>
    """

    source: str
    view: list[str]
    point: list[str] | None
    frequency: Array | None
    direction_cosines: Array
    velocity: Array | ComplexArray
    std: Array | None = None
    missing: BoolArray | None = None
    position: Array | None = None
    triangle: IntArray | None = None
    line: IntArray | None = None
    amplitude: Amplitude | None = None
    odd: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()

    def __repr__(self) -> str:
        names = ("views", "points", "frequencies")
        shape = ", ".join(f"{n} {name}" for n, name in zip(self.velocity.shape, names, strict=True))
        return f"<LineOfSight of {shape} from {self.source}>"

    def __post_init__(self) -> None:
        cosines, velocity, std = self.direction_cosines, self.velocity, self.std
        gap = np.zeros(velocity.shape, bool) if self.missing is None else self.missing
        no_line = np.asarray(gap.all(axis=2) & np.isnan(cosines).all(axis=2))
        known = np.isfinite(cosines) | no_line[..., None]
        self._check("direction cosine", cosines, known, "must be finite")
        self._check("velocity", velocity, np.isfinite(velocity) | gap, FINITE)
        if std is not None:
            good = (np.isfinite(std) & (std > 0)) | gap
            self._check("standard error", std, good, "must be positive")
        with np.errstate(over="ignore"):
            length = np.linalg.norm(cosines, axis=-1)
        unit = (abs(length - 1) <= LARGEST_LENGTH_ERROR) | no_line
        right = "must be 1: directions are unit vectors from the surface to the instrument"
        self._check("length of the direction", length, unit, right)
        for name, labels in (("view", self.view), ("point", self.point or [])):
            if len(set(labels)) != len(labels):
                raise UserError(f"{self.source}: a {name} is named twice in {', '.join(labels)}")
            if not ACTING.search("\n".join(labels)):
                continue
            if acting := [label for label in labels if ACTING.search(label)]:
                raise UserError(
                    f"{self.source}: the {name} {acting[0]!a} has characters in its name that "
                    "would act on a terminal; take them out"
                )
        if self.frequency is not None:
            self._check_frequencies(self.frequency)
        self._check_places()

    def _check_places(self) -> None:
        """Complain unless every point has a place, and what is joined are points."""
        points = self.velocity.shape[1]
        place = self.position
        if place is not None and (place.shape != (points, 3) or not np.isfinite(place).all()):
            raise UserError(
                f"{self.source}: the positions have the shape {place.shape}; they must be finite "
                f"and of the shape {(points, 3)}, x, y and z of every point"
            )
        for name, joined, corners in (("triangle", self.triangle, 3), ("line", self.line, 2)):
            if joined is None:
                continue
            fits = joined.ndim == 2 and joined.shape[1] == corners
            if not fits or (joined < 0).any() or (joined >= points).any():
                raise UserError(
                    f"{self.source}: each {name} must have {corners} of the {points} points"
                )

    def complete(self) -> LineOfSight:
        """Leave out points that lack a velocity; of a single point, frequencies.

        Raises
        ------
        UserError
            If nothing is left.
        """
        if self.missing is None:
            return self
        kept = np.asarray(~self.missing.any(axis=0))
        points, lines = np.ones(kept.shape[0], bool), np.ones(kept.shape[1], bool)
        if self.point is not None:
            points = np.asarray(kept.all(axis=1))
        else:
            lines = kept[0]
        if not points.any() or not lines.any():
            raise UserError(f"{self.source}: in all of it some view has no velocity")

        def part(array: NDArray | None) -> NDArray | None:
            return None if array is None else array[:, points][..., lines]

        place = np.cumsum(points) - 1

        def joined(corners: IntArray | None) -> IntArray | None:
            return None if corners is None else place[corners[points[corners].all(axis=1)]]

        return replace(
            self,
            point=self.point and [p for p, keep in zip(self.point, points, strict=True) if keep],
            frequency=None if self.frequency is None else self.frequency[lines],
            direction_cosines=self.direction_cosines[:, points],
            velocity=self.velocity[:, points][..., lines],
            std=part(self.std),
            missing=None,
            position=None if self.position is None else self.position[points],
            triangle=joined(self.triangle),
            line=joined(self.line),
        )

    def _check(self, what: str, values: NDArray, good: BoolArray, right: str) -> None:
        """Complain about the first bad entry of an array that starts with (view, point)."""
        if good.all():
            return
        index = tuple(np.argwhere(~good)[0])
        at = [f"view {self.view[index[0]]}"]
        if self.point is not None:
            at.append(f"point {self.point[index[1]]}")
        if self.frequency is not None and what in ("velocity", "standard error"):
            at.append(f"{self.frequency[index[2]]:g} Hz")
        shown = f"the {what} of {', '.join(at)} is {values[index]:.6g}"
        kind = OpenQuestionError if right == FINITE and np.isnan(values[index]) else UserError
        raise kind(f"{self.source}: {shown}, but {right}")

    def _check_frequencies(self, frequency: Array) -> None:
        """Complain unless frequencies are finite, not negative, and differ."""
        bad = frequency[~(np.isfinite(frequency) & (frequency >= 0))]
        if bad.size:
            raise UserError(f"{self.source}: {bad[0]:g} is not a frequency in Hz")
        if len(np.unique(frequency)) != len(frequency):
            raise UserError(f"{self.source}: a frequency is given twice")

    def to_dataset(self) -> xr.Dataset:
        """Make the run's group ``line_of_sight``, without unnamed single points and frequencies."""
        coords: dict[str, list[str] | Array] = {"view": self.view}
        sight = self.direction_cosines
        there: dict[str, NDArray] = {"velocity": self.velocity}
        if self.std is not None:
            there["velocity_std"] = self.std
        if self.missing is not None:
            there["flags"] = self.missing.astype(np.int8)
        if self.point is None:
            sight = sight[:, 0]
            there = {name: array[:, 0] for name, array in there.items()}
        else:
            coords["point"] = self.point
        if self.frequency is None:
            there = {name: array[..., 0] for name, array in there.items()}
        else:
            coords["frequency"] = self.frequency
        if self.point is not None:
            places = {"position": self.position, "triangle": self.triangle, "line": self.line}
            there |= {name: array for name, array in places.items() if array is not None}
        made = dataset.group("line_of_sight", coords, direction_cosines=sight, **there)
        made.attrs["source"] = Path(self.source).name
        return made


#: Names that a name of a file may stand for.
KNOWN = (
    "view",
    "point",
    "frequency",
    "axis",
    "direction_cosines",
    "velocity",
    "velocity_std",
    "real",
    "imag",
    "std",
    "dx",
    "dy",
    "dz",
    "position",
    "x",
    "y",
    "z",
    "triangle",
    "line",
)
#: Characters that move the cursor, or begin what a terminal obeys.
ACTING = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
#: Name of what a file has that is of no use.
IGNORED = "ignore"
#: Units of files that state none, by nobody told; that of frequencies in Hz.
UNSTATED_VELOCITY, UNSTATED_LENGTH, UNSTATED_FREQUENCY = VelocityUnit.m_per_s, LengthUnit.m, 1.0
ORDER = ("view", "point", "frequency")
DIMENSIONS = (*ORDER, "axis")


@dataclass(frozen=True)
class FileLayout:
    """Names and order of a file that differ from the program's own.

    Parameters
    ----------
    mapping : mapping of str to str
        From the file's names of variables, dimensions or columns to the program's, or `IGNORED`.
    order : tuple of str
        Dimensions of the velocities where they have no names; all of `ORDER` that there are.
    group : str
        Of a netCDF file; empty for its root.
    length : LengthUnit or None
        Of positions, where the file does not say it; None for m.
    gaps : bool
        Whether velocities may be missing.
    amplitude : Amplitude or None
        Measure of a sine that velocities are said to be.
    senses : mapping of str to str
        Values of the settings `phase` and `positive`, which text of the file may contradict.
    """

    mapping: Mapping[str, str] = field(default_factory=dict)
    order: tuple[str, ...] = ()
    group: str = ""
    length: LengthUnit | None = None
    gaps: bool = False
    amplitude: Amplitude | None = None
    senses: Mapping[str, str] = field(default_factory=dict)

    @property
    def ignored(self) -> list[str]:
        """Names of the file that are left out."""
        return [theirs for theirs, own in self.mapping.items() if own == IGNORED]

    def require(self, names: Iterable[Hashable], path: Path) -> None:
        """Complain about names that the file does not have."""
        known = [str(name) for name in names]
        for theirs in self.mapping:
            if theirs not in known:
                raise UserError(
                    f"{path}: instrument.mapping names {theirs}, which the file has not; "
                    f"{nearest(theirs, known)}"
                )


OWN = FileLayout()
