"""What instruments that measured point by point have in common: views, conventions, directions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from omegaconf import MISSING

from sldvexp.errors import Checks
from sldvexp.units import LengthUnit

if TYPE_CHECKING:
    import xarray as xr

    from sldvexp.importers.measured import Measured
    from sldvexp.laser.two_mirror import TwoMirror


class Directions(Enum):
    """Where the lines of sight come from.

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
    """What a positive velocity of the file is."""

    towards = 1
    away = -1


class Quantity(Enum):
    """What moves; the value is how often it must be differentiated to be a velocity."""

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
    ft = 0.3048
    g = 9.80665


class Amplitude(Enum):
    """What a spectrum gives of a sine; the value turns it to the peak."""

    peak = 1.0
    rms = 2**0.5
    half = 2.0


class Phase(Enum):
    """Sign in the exponent of the time dependence that complex values belong to."""

    exp_plus = 1
    exp_minus = -1


class Zeros(Enum):
    """What a function is whose values are all zero."""

    refuse = "refuse"
    missing = "missing"
    measured = "measured"


@dataclass
class PointView:
    """One view.

    Parameters
    ----------
    path : str
        Its file; several views may have the same one.
    dof : str
        Which of a universal file's response directions are read, as ``+Z``; empty for all.
    origin : list of 3 float, m
        Where the instrument stood, in the world of the points.
    direction : list of 3 float
        From the surface to an instrument that is far away, or moved along; any length.
    """

    path: str = MISSING
    dof: str = ""
    origin: list[float] = field(default_factory=list)
    direction: list[float] = field(default_factory=list)


@dataclass
class Pointwise(ABC):
    """Velocities that were measured point by point. A strategy implements the hook `measured`.

    What a file does not say, and a setting does not either, is asked for.

    Parameters
    ----------
    views : dict of str to PointView
        Each with its file; with directions=view also with an origin or a direction.
    directions : Directions
        Where the lines of sight come from: the files' dof, each view, or the run's pose.
    positive : Positive, optional
        Which way a positive velocity points; a dof tells it itself.
    frequency : list of float, Hz
        Lines that are read, empty for all; of a table that states none, its frequency.
    quantity : Quantity, optional
        What moves. It wins over what the file says.
    unit : MotionUnit, optional
        Unit of length in the values' unit. It wins over what the file says.
    length_unit : LengthUnit, optional
        Of coordinates. It wins over what the file says.
    amplitude : Amplitude, optional
        Of spectra. It wins over what the file says.
    phase : Phase, optional
        Sign of i omega t in the analyser's Fourier series, which no file says; a cross spectrum of
        the response and the conjugate reference is exp_plus.
    reference : float, optional
        Peak amplitude of the reference in its unit of the file, which response functions are
        multiplied with; 1 gives velocities per unit.
    std : float, optional, m/s
        Standard error of every velocity, of real and imaginary part each.
    zeros : Zeros
        What a function is whose values are all zero: refused, missing, or measured.
    incomplete : bool
        Leave out points that not all views have; otherwise they are refused.
    """

    views: dict[str, PointView] = field(default_factory=dict)
    directions: Directions = Directions.dof
    positive: Positive | None = None
    frequency: list[float] = field(default_factory=list)
    quantity: Quantity | None = None
    unit: MotionUnit | None = None
    length_unit: LengthUnit | None = None
    amplitude: Amplitude | None = None
    phase: Phase | None = None
    reference: float | None = None
    std: float | None = None
    zeros: Zeros = Zeros.refuse
    incomplete: bool = False

    def __post_init__(self) -> None:
        checks = Checks()
        message = "must name at least one view, as {front: {path: front.uff}}"
        checks.require(bool(self.views), "views", message)
        for name, view in self.views.items():
            self._check_view(checks, f"views.{name}", view)
        for i, frequency in enumerate(self.frequency):
            checks.non_negative(f"frequency[{i}]", frequency)
        for name in ("std", "reference"):
            if (value := getattr(self, name)) is not None:
                checks.positive(name, value)
        self.check(checks)
        checks.done()

    def check(self, checks: Checks) -> None:  # noqa: B027  not all have more to check
        """Note what is wrong with the strategy's own settings."""

    @abstractmethod
    def measured(self) -> Iterator[Measured]:
        """What the views say, one after the other."""

    def _check_view(self, checks: Checks, key: str, view: PointView) -> None:
        for name in ("origin", "direction"):
            values = getattr(view, name)
            message = f"must be three numbers, not {len(values)}"
            checks.require(len(values) in (0, 3), f"{key}.{name}", message)
            checks.finite(f"{key}.{name}", *values)
        zero = bool(view.direction) and not any(view.direction)
        checks.require(not zero, f"{key}.direction", "must be a direction, not zero")
        given = bool(view.origin) + bool(view.direction)
        if self.directions is Directions.view:
            message = "give either origin or direction, because directions=view"
            checks.require(given == 1, key, message)
        else:
            message = f"origin and direction need directions=view, not {self.directions.name}"
            checks.require(given == 0, key, message)
        dofs = [sign + axis for axis in "XYZ" for sign in "+-"]
        message = f"must be one of {', '.join(dofs)}, not {view.dof}"
        checks.require(not view.dof or view.dof in dofs, f"{key}.dof", message)

    def inputs(self) -> list[str]:
        """The views' files."""
        return [view.path for view in self.views.values()]

    def read(
        self, tree: Mapping[str, xr.Dataset] | None = None, laser: TwoMirror | None = None
    ) -> xr.Dataset:
        """The group ``line_of_sight``, with the points' positions if the files have them.

        Parameters
        ----------
        tree : mapping of str to Dataset, optional
            With the group ``pose``, for directions from it.
        laser : TwoMirror, optional
            Likewise.

        Raises
        ------
        UserError
            If a file is missing or broken, or says too little or contradicts itself.
        """
        from sldvexp.importers.to_line_of_sight import read_points

        return read_points(self, tree or {}, laser)

    def images_of_points(
        self, tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
    ) -> dict[str, xr.Dataset]:
        """The groups ``image/<view>``: a pixel for each point, where the mirrors send the beam.

        Parameters
        ----------
        tree : mapping of str to Dataset
            With the group ``pose``.
        laser : TwoMirror

        Raises
        ------
        UserError
            As `read`, or if there is no pose or standard error.
        """
        from sldvexp.importers.to_images import read_images

        return read_images(self, tree, laser)
