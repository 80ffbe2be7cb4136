"""`pose=registration`: pose of each view from points and the mirror angles that reach them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

from sldvexp.config.registry import register
from sldvexp.errors import Checks, nearest
from sldvexp.pose.base import PoseMethod

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from numpy.typing import NDArray

    from sldvexp.io.registration.table import RegistrationTable
    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.pose.from_points import Judge
    from sldvexp.targets.base import Target, TargetPoints

#: What may be adjusted besides the pose.
ADJUSTABLE = (
    "mirror_offset",
    "gain_up_down",
    "zero_up_down",
    "gain_left_right",
    "zero_left_right",
)


class MirrorName(Enum):
    """The two mirrors."""

    up_down = 0
    left_right = 1


@dataclass
class FromPoints(PoseMethod):
    """What all methods share that solve for the pose from matched object and image points.

    Parameters
    ----------
    adjust : dict of str to float
        Intrinsics to adjust with the pose, with the standard deviation of what is known of them
        beforehand, as in ``{mirror_offset: 0.005}`` (``.inf`` for nothing): mirror_offset (m),
        gain_up_down and gain_left_right (relative to the calibration), zero_up_down and
        zero_left_right (rad). All others are fixed.
    shared : dict of str to float
        The same for intrinsics that have one value in all views, which are then solved together.
    confidence : float
        Level of the intervals.
    max_iterations : int
        Most steps of the non-linear solution.
    """

    adjust: dict[str, float] = field(default_factory=dict)
    shared: dict[str, float] = field(default_factory=dict)
    confidence: float = 0.95
    max_iterations: int = 200

    def __post_init__(self) -> None:
        checks = Checks()
        self._check(checks)
        checks.done()

    def _check(self, checks: Checks) -> None:
        """Collect what is wrong with the fields; methods add to it."""
        checks.probability("confidence", self.confidence)
        least = f"must be at least 1, not {self.max_iterations}"
        checks.require(self.max_iterations >= 1, "max_iterations", least)
        for group in ("adjust", "shared"):
            for name, std in getattr(self, group).items():
                wrong = f"cannot be adjusted; {nearest(name, ADJUSTABLE)}"
                checks.require(name in ADJUSTABLE, f"{group}.{name}", wrong)
                wrong = f"must be a positive standard deviation, infinite for a free one, not {std}"
                checks.require(std > 0, f"{group}.{name}", wrong)
        for name in set(self.adjust) & set(self.shared):
            wrong = "is in adjust too: it is either one value a view or one for all views"
            checks.require(False, f"shared.{name}", wrong)

    def angle_std(
        self,
        number: NDArray[np.int64],
        distance: NDArray[np.float64],
        step: NDArray[np.float64],
        points: TargetPoints | None,
    ) -> NDArray[np.float64] | None:
        """Standard deviation of each point's angles, DAC steps, if it is known beforehand.

        Parameters
        ----------
        number : ndarray, shape (N,)
            Of the points.
        distance : ndarray, shape (N,), m
            From the instrument.
        step : ndarray, shape (2,), rad
            Angle of one DAC step of each mirror.
        points : TargetPoints or None
            Of the calibration object.

        Returns
        -------
        ndarray or None
            None estimates it from the residuals, alike for all points.
        """
        return None

    def judge(
        self, tables: Sequence[RegistrationTable], laser: TwoMirror, target: Target | None
    ) -> Judge | None:
        """What gives solved poses the covariance that they deserve, if errors are not independent.

        Parameters
        ----------
        tables : sequence of RegistrationTable
            Of all views.
        laser : TwoMirror
        target : Target or None
        """
        return None


NAME_A_FILE = "must name a registration file, or one for each view as {front: a.reg, left: b.reg}"


@register("pose", "registration")
@dataclass
class Registration(FromPoints):
    """Pose from a registration file (Section 4.6.2), without a starting guess.

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

    def _check(self, checks: Checks) -> None:
        from sldvexp.units import LengthUnit

        super()._check(checks)
        paths = self.path.values() if isinstance(self.path, dict) else [self.path]
        named = bool(self.path) and all(isinstance(p, str) and p for p in paths)
        checks.require(named or self.path is None, "path", NAME_A_FILE)
        units = LengthUnit.__members__
        if self.unit:
            message = f"{self.unit!r} is not a unit of length; {nearest(self.unit, units)}"
            checks.require(self.unit in units, "unit", message)

    def files(self) -> dict[str, str]:
        """Path of each file, by the view it is said to hold; empty for as the file says."""
        if self.path is None:
            return {}
        return self.path if isinstance(self.path, dict) else {"": self.path}

    def inputs(self) -> list[str]:
        """The registration files."""
        return list(self.files().values())

    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """Groups ``registration`` and ``pose``."""
        from sldvexp.pose.from_points import estimate
        from sldvexp.pose.measured import measured_points

        if self.path is None:
            tables = _scanned(tree)
            return estimate(self, tables, laser, measured_points(tables), self.inverted)
        tables = self._tables()
        return estimate(self, tables, laser, target or measured_points(tables), self.inverted)

    def _tables(self) -> list[Any]:
        """Registration data of all views."""
        from dataclasses import replace

        from sldvexp.config.paths import locate
        from sldvexp.errors import UserError
        from sldvexp.io.registration import read
        from sldvexp.units import LengthUnit

        unit = LengthUnit[self.unit] if self.unit else None
        tables = []
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


def _scanned(tree: Mapping[str, xr.Dataset]) -> list[RegistrationTable]:
    """Registration data of all views that a person pointed or digitised in this run."""
    from sldvexp.errors import ConfigError, Problem
    from sldvexp.io.registration.netcdf import from_dataset

    if "registration" not in tree:
        told = f"{NAME_A_FILE}, unless scan=by_hand or scan=by_digitizer gives the points"
        raise ConfigError([Problem("pose.path", told)])
    return from_dataset(tree["registration"], "")
