"""Line-of-sight velocities of points seen from several views, checked once.

All formats end in one `LineOfSight`. What a file of others calls its arrays and dimensions, and in
which order they are, is a `FileLayout`.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, BoolArray, ComplexArray

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

    Raises
    ------
    UserError
        If a number is not finite, a direction is not a unit vector, a standard error is not
        positive, or a frequency is negative or repeated.

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

    def __repr__(self) -> str:
        names = ("views", "points", "frequencies")
        shape = ", ".join(f"{n} {name}" for n, name in zip(self.velocity.shape, names, strict=True))
        return f"<LineOfSight of {shape} from {self.source}>"

    def __post_init__(self) -> None:
        cosines, velocity, std = self.direction_cosines, self.velocity, self.std
        gap = np.zeros(velocity.shape, bool) if self.missing is None else self.missing
        no_line = gap.all(axis=2) & np.isnan(cosines).all(axis=2)
        known = np.isfinite(cosines) | no_line[..., None]
        self._check("direction cosine", cosines, known, "must be finite")
        self._check("velocity", velocity, np.isfinite(velocity) | gap, "must be finite")
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
        if self.frequency is not None:
            self._check_frequencies(self.frequency)

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
        raise UserError(f"{self.source}: {shown}, but {right}")

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
        values = {"velocity": self.velocity, "velocity_std": self.std, "flags": self.missing}
        there = {name: array for name, array in values.items() if array is not None}
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
)
ORDER = ("view", "point", "frequency")


@dataclass(frozen=True)
class FileLayout:
    """Names and order of a file that differ from the program's own.

    Parameters
    ----------
    mapping : mapping of str to str
        From the file's names of variables, dimensions or columns to the program's.
    order : tuple of str
        Dimensions of the velocities where they have no names; all of `ORDER` that there are.
    group : str
        Of a netCDF file; empty for its root.
    """

    mapping: Mapping[str, str] = field(default_factory=dict)
    order: tuple[str, ...] = ()
    group: str = ""

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
