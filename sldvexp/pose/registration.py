"""`pose=registration`: pose of each view from points and the mirror angles that reach them.

A file gives the points, or a person who pointed at them or digitised them in this run. Points whose
uncertainty was measured stand in the place of a calibration object's (`MeasuredPoints`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks, ConfigError, Problem, UserError, nearest
from sldvexp.io.registration import RegistrationTable, from_dataset, read
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import PoseResult
from sldvexp.pose.from_points import FromPoints, MirrorName
from sldvexp.targets import Target, TargetPoints
from sldvexp.units import LengthUnit

NAME_A_FILE = "must name a registration file, or one for each view as {front: a.reg, left: b.reg}"


@dataclass
class RegistrationFiles:
    """Registration data that a pose method starts from: of files, or of this run.

    Parameters
    ----------
    path : str or dict of view name to str, optional
        Files of registration data: ``.reg`` (Figure 4.28), ``.csv`` or ``.nc``. Without one, what
        a person found in this run (``scan=by_hand`` or ``by_digitizer``).
    unit : str
        Unit of the object points, for a file that does not state it: m, cm, mm, inch or ft.
    inverted : list of MirrorName
        Mirrors whose recorded angles grow the other way than in Eqs 4.2 and 4.3.
    """

    path: Any = None
    unit: str = ""
    inverted: list[MirrorName] = field(default_factory=list)

    def check_files(self, checks: Checks) -> None:
        """Note what is wrong with the fields above."""
        paths = self.path.values() if isinstance(self.path, dict) else [self.path]
        named = bool(self.path) and all(isinstance(p, str) and p for p in paths)
        checks.require(named or self.path is None, "path", NAME_A_FILE)
        units = LengthUnit.__members__
        if self.unit:
            message = f"{self.unit!r} is not a unit of length; {nearest(self.unit, units)}"
            checks.require(self.unit in units, "unit", message)

    def files(self) -> dict[str, str]:
        """Give each file's path by the view it is said to hold; empty for as the file says."""
        if self.path is None:
            return {}
        return self.path if isinstance(self.path, dict) else {"": self.path}

    def inputs(self) -> list[str]:
        """List the registration files."""
        return list(self.files().values())

    def tables(self, tree: Mapping[str, xr.Dataset]) -> list[RegistrationTable]:
        """Read the registration data of all views of the files, or of this run."""
        if self.path is None:
            return _scanned(tree)
        unit = LengthUnit[self.unit] if self.unit else None
        tables: list[RegistrationTable] = []
        for view, path in self.files().items():
            found = read(locate(path), unit)
            if view and len(found) > 1:
                raise UserError(
                    f"{path}: holds {len(found)} views but is given as the view {view}; "
                    "give the path alone"
                )
            tables += [replace(t, name=view or t.name) for t in found]
        names = [t.name for t in tables]
        if doubled := {n for n in names if names.count(n) > 1}:
            raise UserError(f"the view {doubled.pop()} is given twice")
        return tables


@register("pose", "registration")
@dataclass
class Registration(RegistrationFiles, FromPoints):
    """Pose from a registration file (Section 4.6.2), without a starting guess.

    Points that do not agree with the others are left out and named, so are points that have each
    other's numbers, a mirrored object and a wrong unit (`sldvexp.pose.wrong_points`); a view whose
    pose is not found does not end the others.
    """

    judges_points: ClassVar[bool] = True

    def _check(self, checks: Checks) -> None:
        super()._check(checks)
        self.check_files(checks)

    def estimate(
        self, laser: TwoMirror | None, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> PoseResult:
        """Solve every view of the files, or those that a person found in this run."""
        tables = self.tables(tree)
        # Points found in this run have just been measured: no target knows them better.
        known = target if self.path is not None else None
        return self.solve(tables, laser, known or measured_points(tables), self.inverted)


def _scanned(tree: Mapping[str, xr.Dataset]) -> list[RegistrationTable]:
    """Take registration data of all views that a person pointed or digitised in this run."""
    if "registration" not in tree:
        told = f"{NAME_A_FILE}, unless scan=by_hand or scan=by_digitizer gives the points"
        raise ConfigError([Problem("pose.path", told)])
    return from_dataset(tree["registration"], "")


class MeasuredPoints(Target):
    """Points of some views' registration data, each under its number.

    Parameters
    ----------
    tables : sequence of RegistrationTable
        With the standard deviations of their object points.
    """

    def __init__(self, tables: Sequence[RegistrationTable]) -> None:
        number = np.concatenate([t.number for t in tables])
        self._number, first = np.unique(number, return_index=True)
        self._position = np.concatenate([t.object_point for t in tables])[first]
        stds = [t.object_std for t in tables if t.object_std is not None]
        self._std = np.concatenate(stds)[first]

    def points(self) -> TargetPoints:
        """Give every point once, as its first view has it."""
        label = tuple(f"point {n}" for n in self._number)
        return TargetPoints(self._number, self._position, self._std, label)


def measured_points(tables: Sequence[RegistrationTable]) -> MeasuredPoints | None:
    """Take the points of some views for a target; None unless the uncertainty of all is known."""
    if any(table.object_std is None for table in tables):
        return None
    return MeasuredPoints(tables)
