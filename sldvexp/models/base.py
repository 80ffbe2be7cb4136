"""Contract of the group `model`: a finite element model, its place, and how well it is known.

A source gives nodes, surface elements and shapes in axes of its own. Everything else is alike for
all: where these axes stand in the world, how thick the shell is, which parameters its frequencies
hang on and how well those are known, and which of them are adjusted.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sldvexp.errors import Checks, UserError, nearest
from sldvexp.geometry import rigid_transform, rotation_from_euler
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.models.modal_mass import DrivePoint
from sldvexp.typing import Array
from sldvexp.units import LengthUnit

#: Sensitivities d ln f / d ln theta that all modes of a thin plate or shell in bending have.
BENDING = {"E": 0.5, "rho": -0.5, "thickness": 1.0}
#: Least relative change of a parameter from one file to another.
LEAST_CHANGE = 1e-3
#: By how much matched points may stay apart, of their extent.
MATCHED = 0.02


@dataclass
class MatchedPoint:
    """A point known in the model's axes and in the world.

    Parameters
    ----------
    model : list of 3 float, the model's unit
    world : list of 3 float, m
    """

    model: list[float] = field(default_factory=list)
    world: list[float] = field(default_factory=list)


@dataclass
class ModelFrame:
    """Place of the model's axes in the world.

    Parameters
    ----------
    origin : list of 3 float, m
        Where the model's origin stands.
    euler : list of 3 float, rad
        phi1, phi2, phi3 in the x-convention, world to model.
    points : dict of str to MatchedPoint
        Instead: three points or more, not on a line, whose best fit is taken.
    """

    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    euler: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    points: dict[str, MatchedPoint] = field(default_factory=dict)

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no place can be."""
        lists = {f"{name}.{key}": getattr(self, key) for key in ("origin", "euler")}
        for label, point in self.points.items():
            lists[f"{name}.points.{label}.model"] = point.model
            lists[f"{name}.points.{label}.world"] = point.world
        for where, values in lists.items():
            checks.require(len(values) == 3, where, f"must be 3 numbers, not {len(values)}")
            checks.finite(where, *values)
        few = 0 < len(self.points) < 3
        checks.require(not few, f"{name}.points", "give three points or more, or none")

    def placed(self, model: FiniteElementModel, unit: float) -> FiniteElementModel:
        """Put a model that is in its own axes, in m, into the world."""
        if not self.points:
            rotation = rotation_from_euler(self.euler).T
            return model.moved(rotation, np.array(self.origin, float))
        own = unit * np.array([p.model for p in self.points.values()], float)
        world = np.array([p.world for p in self.points.values()], float)
        rotation, shift = rigid_transform(own, world)
        left = np.linalg.norm(own @ rotation.T + shift - world, axis=1)
        extent = float(np.linalg.norm(np.ptp(world, axis=0)))
        worst = list(self.points)[int(np.argmax(left))]
        if left.max() > MATCHED * extent:
            raise UserError(
                f"frame.points.{worst}: stays {1e3 * left.max():.3g} mm apart from its place in "
                f"the world when all points fit best; over {1e3 * extent:.3g} mm that is too much: "
                "are the model's points in model.unit, and the world's in m?"
            )
        if np.linalg.svd(world - world.mean(axis=0))[1][1] < 1e-3 * extent:
            raise UserError("frame.points: lie on a line; give one beside it")
        return model.moved(rotation, shift)


@dataclass
class VariedModel:
    """A model that is the same but for one parameter.

    Parameters
    ----------
    path : str
        Universal file or mesh with as many modes.
    value : float
        Of the parameter there.
    """

    path: str = ""
    value: float = 0.0


@dataclass
class ModelParameter:
    """A property that the model was made with.

    Parameters
    ----------
    value : float
        That of the model, in any unit.
    tolerance : float
        Its standard uncertainty, in the same unit.
    sensitivity : list of float
        Relative change of the frequencies by a relative change of it, d ln f / d ln value: one
        number for all modes, or one a mode of the model. E, rho and thickness need none: 0.5, -0.5
        and, of bending of thin structures, 1.
    varied : VariedModel, optional
        Instead: a file with another value of it, whose frequencies tell the sensitivity.
    """

    value: float = 1.0
    tolerance: float = 0.0
    sensitivity: list[float] = field(default_factory=list)
    varied: VariedModel | None = None


@dataclass
class ModelSource(ABC):
    """Base of what finite element models come from.

    Parameters
    ----------
    unit : LengthUnit
        Of the model's coordinates and displacements.
    frame : ModelFrame
    thickness : float, the model's unit
        Of a shell, whose elements stand at its middle; the beam sees the surface half of it beside
        them. 0 if the elements are the surface seen.
    parameters : dict of str to ModelParameter
        What the frequencies hang on and how well it is known; without any, frequencies are compared
        but not judged.
    adjust : dict of str to float
        Parameters that are adjusted to the measured frequencies, each with the relative standard
        uncertainty of what is known of it beforehand, 0 if that is nothing.
    discretisation : list of float
        Relative standard uncertainty of the frequencies from the mesh: one for all modes, or one a
        mode of the model.
    drive : DrivePoint, optional
        Force that drives the structure, from which modal masses follow.
    pair_above : float
        MAC from which a measured mode and one of the model are a pair.
    confidence : float
        Level of the tests.
    """

    unit: LengthUnit = LengthUnit.m
    frame: ModelFrame = field(default_factory=ModelFrame)
    thickness: float = 0.0
    parameters: dict[str, ModelParameter] = field(default_factory=dict)
    adjust: dict[str, float] = field(default_factory=dict)
    discretisation: list[float] = field(default_factory=list)
    drive: DrivePoint | None = None
    pair_above: float = 0.5
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        self.frame.check(checks, "frame")
        checks.probability("pair_above", self.pair_above)
        checks.probability("confidence", self.confidence)
        if self.drive is not None:
            self.drive.check(checks, "drive")
        for value in self.discretisation:
            checks.non_negative("discretisation", value)
        for name, parameter in self.parameters.items():
            self._check_parameter(checks, name, parameter)
        for name, prior in self.adjust.items():
            message = nearest(name, self.known_parameters)
            where = f"adjust.{name}"
            checks.require(name in self.known_parameters, where, f"no such parameter; {message}")
            checks.non_negative(where, prior)
        self.check(checks)
        checks.done()

    def _check_parameter(self, checks: Checks, name: str, parameter: ModelParameter) -> None:
        where = f"parameters.{name}"
        checks.positive(f"{where}.value", parameter.value)
        checks.non_negative(f"{where}.tolerance", parameter.tolerance)
        varied = parameter.varied
        known = bool(parameter.sensitivity) or name in BENDING or varied is not None
        message = "must be given, as in [0.5]: how the frequencies change with it"
        checks.require(known, f"{where}.sensitivity", message)
        if varied is None:
            return
        checks.positive(f"{where}.varied.value", varied.value)
        checks.require(bool(varied.path), f"{where}.varied.path", "must name a file")
        twice = bool(parameter.sensitivity)
        checks.require(not twice, f"{where}.sensitivity", "is told by varied; give one of them")
        if parameter.value > 0 and varied.value > 0:
            change = abs(varied.value / parameter.value - 1)
            told = (
                f"must differ from {parameter.value:g} by {LEAST_CHANGE:g} of it or more, so that "
                "digits of a file tell the change"
            )
            checks.require(change >= LEAST_CHANGE, f"{where}.varied.value", told)

    @property
    def known_parameters(self) -> list[str]:
        """Names of the parameters that can be adjusted."""
        return list(self.parameters)

    def check(self, checks: Checks) -> None:
        """Note what is wrong with the settings that are a source's own."""
        checks.non_negative("thickness", self.thickness)

    @abstractmethod
    def inputs(self) -> list[str]:
        """Name the files that it reads."""

    @abstractmethod
    def read(self) -> FiniteElementModel:
        """Give the model in its own axes, in m."""

    def model(self) -> FiniteElementModel:
        """Give the model in the world, with its thickness."""
        placed = self.frame.placed(self.read(), self.unit.value)
        return replace(placed, thickness=self.unit.value * self.thickness)

    def sensitivities(self, model: FiniteElementModel) -> dict[str, Array]:
        """Give d ln f / d ln theta of every parameter, shape (mode,)."""
        return {n: self.given_sensitivity(n, p, model) for n, p in self.parameters.items()}

    def given_sensitivity(
        self, name: str, parameter: ModelParameter, model: FiniteElementModel
    ) -> Array:
        """Give a parameter's d ln f / d ln theta as its settings say it, shape (mode,)."""
        own = parameter.sensitivity or [BENDING[name]]
        return self.by_mode(f"parameters.{name}.sensitivity", own, model.modes)

    def tolerances(self) -> dict[str, float]:
        """Give the relative standard uncertainty of every parameter."""
        return {name: p.tolerance / p.value for name, p in self.parameters.items()}

    def values(self) -> dict[str, float]:
        """Give the value of every parameter that the model was made with."""
        return {name: p.value for name, p in self.parameters.items()}

    def discretisation_of(self, model: FiniteElementModel) -> Array:
        """Give the relative standard uncertainty of each frequency from the mesh, (mode,)."""
        return self.by_mode("discretisation", self.discretisation or [0.0], model.modes)

    @staticmethod
    def by_mode(where: str, values: Sequence[float], modes: int) -> Array:
        """Spread one number over all modes, or take one a mode.

        Raises
        ------
        UserError
            If there are others.
        """
        if len(values) not in (1, modes):
            raise UserError(
                f"{where}: has {len(values)} numbers; give one, or one for each of the model's "
                f"{modes} modes"
            )
        return np.broadcast_to(np.array(values, float), (modes,))
