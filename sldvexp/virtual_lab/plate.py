"""`scene=plate`: a vibrating plate or cylindrical panel, what the beam sees of it, and its truth.

The plate's motion is a sum of damped modes in closed form (`sldvexp.virtual_lab.modes`), so that
velocity and strain are known exactly at every point of the measured surface. That surface is flat
or a part of a cylinder: a `PlateSurface` tells where it is, how it is turned and where beams meet
it. Other plates extend `AnyPlate`, other scenes of them `VibratingScene`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.geometry import rotation_from_euler
from sldvexp.lazy import xarray as xr
from sldvexp.targets import Circles, Target
from sldvexp.typing import Array, BoolArray, ComplexArray
from sldvexp.units import LengthUnit
from sldvexp.virtual_lab.attached import TERMS, LoadedModes, LoadedPlate, PointMass, Rib
from sldvexp.virtual_lab.beam import Beams, SceneObject
from sldvexp.virtual_lab.calibration_scene import CalibrationScene
from sldvexp.virtual_lab.modes import (
    KAPPA,
    Coupling,
    Direction,
    EdgeSupport,
    Mode,
    RectangularPlate,
)
from sldvexp.virtual_lab.motion import DampedModes, Sheet
from sldvexp.virtual_lab.surface import (
    CylinderSurface,
    FlatSurface,
    LitSurface,
    PlateSurface,
)


@dataclass
class Hole:
    """A rectangular hole in a plate; behind it something rests, or nothing if no backdrop is there.

    Parameters
    ----------
    center : list of 2 float, the plate's unit
        From the plate's center along its own x (the arc, if it is curved) and y.
    size : list of 2 float, the plate's unit
    """

    center: list[float] = field(default_factory=lambda: [0.0, 0.0])
    size: list[float] = field(default_factory=lambda: [0.04, 0.04])

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no hole can be."""
        for key in ("center", "size"):
            values = getattr(self, key)
            message = f"must be 2 numbers, not {len(values)}"
            checks.require(len(values) == 2, f"{name}.{key}", message)
            checks.finite(f"{name}.{key}", *values)
        for side in self.size:
            checks.positive(f"{name}.size", side)


@dataclass
class AnyPlate(ABC):
    """A thin plate or panel of any outline, held somewhere in the world.

    The plate's own axes stand at the center of its middle surface, z along its normal.

    Parameters
    ----------
    unit : LengthUnit
        Unit of all lengths below.
    center : list of 3 float
        Where the center stands in the world.
    euler : list of 3 float, rad
        phi1, phi2, phi3 in the x-convention, world to plate.
    thickness : float
        The beam sees the surface half of this above the middle surface, and from behind that as
        far below.
    E : float, Pa
        Natural frequencies need it and the next two.
    nu : float
    rho : float, kg/m^3
    """

    unit: LengthUnit = LengthUnit.m
    center: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    euler: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    thickness: float = 0.003
    E: float = 70.0e9
    nu: float = 0.33
    rho: float = 2700.0

    @property
    def sheet(self) -> Sheet:
        """What it is made of, in SI units."""
        return Sheet(self.E, self.nu, self.rho, self.unit.value * self.thickness)

    @property
    def place(self) -> Array:
        """Where the middle of its surface's coordinates stands in the world, m."""
        return self.unit.value * np.array(self.center)

    @property
    @abstractmethod
    def mode_names(self) -> tuple[str, ...]:
        """Names of its modes."""

    @abstractmethod
    def surface(self) -> PlateSurface:
        """Make the measured surface."""

    @abstractmethod
    def vibration(self) -> DampedModes:
        """Make the modes, on the coordinates of the surface."""

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no plate can be."""
        for key in ("center", "euler"):
            values = getattr(self, key)
            checks.require(
                len(values) == 3, f"{name}.{key}", f"must be 3 numbers, not {len(values)}"
            )
            checks.finite(f"{name}.{key}", *values)
        checks.non_negative(f"{name}.thickness", self.thickness)
        for key in ("E", "rho"):
            checks.positive(f"{name}.{key}", getattr(self, key))
        message = f"must lie between -1 and 0.5, not {self.nu}"
        checks.require(-1 < self.nu < 0.5, f"{name}.nu", message)


@dataclass
class Plate(AnyPlate):
    """A rectangular thin plate, flat or bent to a cylinder about its own y axis.

    Parameters
    ----------
    size : list of 2 float
        Sides along its own x (the arc, if it is curved) and y.
    radius : float, optional
        Of the middle surface's curvature; positive if the normal points away from the axis of
        the cylinder, negative towards it. Without it the plate is flat.
    edges : EdgeSupport
        How they are held; decides the shapes of bending.
    coupling : Coupling
        How the middle surface of a curved panel moves along itself while it bends.
    shear : bool
        Whether normals turn by less than the slope in bending (Mindlin): by the part
        ``1 / (1 + D k^2 / (5/6 G h))`` of it, k the mode's wave number.
    shear_share : float, optional
        Instead: the part of the slope that shear takes of the mode of one half wave along each
        side.
    modes : dict of str to Mode
    holes : dict of str to Hole
        Cut out of the whole plate, whose modes they do not change.
    masses : dict of str to PointMass
        On a flat, supported plate. A mode's half waves then tell its place in the order of natural
        frequencies, that which it had without the masses and ribs.
    ribs : dict of str to Rib
        On the same.
    spot_edges : bool
        Whether a spot on an edge of a flat plate or its holes sees a mean of the plate's velocity
        and of what rests behind, as a real one does. Else it sees what its axis meets.
    """

    size: list[float] = field(default_factory=lambda: [0.3, 0.25])
    radius: float | None = None
    edges: EdgeSupport = EdgeSupport.supported
    coupling: Coupling = Coupling.none
    shear: bool = False
    shear_share: float | None = None
    modes: dict[str, Mode] = field(default_factory=dict)
    holes: dict[str, Hole] = field(default_factory=dict)
    masses: dict[str, PointMass] = field(default_factory=dict)
    ribs: dict[str, Rib] = field(default_factory=dict)
    spot_edges: bool = False

    @property
    def mode_names(self) -> tuple[str, ...]:
        """See `AnyPlate`."""
        return tuple(self.modes)

    def surface(self) -> PlateSurface:
        """See `AnyPlate`."""
        unit = self.unit.value
        size, height = unit * np.array(self.size), unit * self.thickness / 2
        middles = [np.array(hole.center) for hole in self.holes.values()]
        halves = [np.array(hole.size) / 2 for hole in self.holes.values()]
        limits = [[m - h, m + h] for m, h in zip(middles, halves, strict=True)]
        holes = unit * np.array(limits).reshape(-1, 2, 2) + size / 2
        if self.radius is None:
            kind = LitSurface if self.spot_edges else FlatSurface
            return kind(size, height, holes)
        return CylinderSurface(size, height, holes, unit * self.radius)

    def vibration(self) -> DampedModes:
        """See `AnyPlate`."""
        unit, sheet = self.unit.value, self.sheet
        a, b = unit * np.array(self.size)
        shear = sheet.bending / (KAPPA * sheet.shearing) if self.shear else 0.0
        if self.shear and self.shear_share is not None:
            shear = self.shear_share / (1 - self.shear_share) / (math.pi**2 * (a**-2 + b**-2))
        curvature = 0.0 if self.radius is None else 1 / (unit * self.radius)
        whole = RectangularPlate((a, b), self.edges, sheet, curvature, self.coupling, shear)
        bare = whole.modes(self.modes.values())
        if not (self.masses or self.ribs):
            return bare
        return LoadedModes.built(list(self.modes.values()), bare, self._loaded((a, b)))

    def _loaded(self, size: tuple[float, float]) -> LoadedPlate:
        """Describe what is attached, in SI units and coordinates from one corner."""
        unit = self.unit.value
        masses = []
        for m in self.masses.values():
            x, y = (unit * c + side / 2 for c, side in zip(m.center, size, strict=True))
            masses.append((x, y, m.mass))
        ribs = []
        for rib in self.ribs.values():
            across = unit * rib.offset + size[1 - rib.along.value] / 2
            width, height, plate = (unit * x for x in (rib.width, rib.height, self.thickness))
            bending = self.E * width * (height**3 - plate**3) / 12
            ribs.append((rib.along.value, across, bending, self.rho * width * (height - plate)))
        return LoadedPlate(size, self.sheet, tuple(masses), tuple(ribs))

    def check(self, checks: Checks, name: str) -> None:
        """See `AnyPlate`."""
        known = len(checks.problems)
        super().check(checks, name)
        message = f"must be 2 numbers, not {len(self.size)}"
        checks.require(len(self.size) == 2, f"{name}.size", message)
        checks.finite(f"{name}.size", *self.size)
        for side in self.size:
            checks.positive(f"{name}.size", side)
        checks.require(bool(self.modes), f"{name}.modes", "give at least one mode")
        for mode_name, mode in self.modes.items():
            mode.check(checks, f"{name}.modes.{mode_name}", self.edges)
        for hole_name, hole in self.holes.items():
            hole.check(checks, f"{name}.holes.{hole_name}")
        flat = self.radius is None or not self.spot_edges
        checks.require(flat, f"{name}.spot_edges", "needs a flat plate, without radius")
        if self.radius is not None and len(checks.problems) == known:
            self._check_radius(checks, f"{name}.radius", self.radius)
        self._check_coupling(checks, f"{name}.coupling")
        self._check_shear(checks, name)
        if self.masses or self.ribs:
            self._check_attached(checks, name)
        self._check_natural(checks, name)

    def _check_radius(self, checks: Checks, name: str, radius: float) -> None:
        least = max(self.thickness / 2, self.size[0] / (2 * math.pi))
        checks.require(
            math.isfinite(radius) and abs(radius) > least,
            name,
            f"must be finite and beyond +-{least:.6g} {self.unit.name}, where the panel would "
            f"close to a tube or its surface vanish, not {radius}",
        )

    def _check_coupling(self, checks: Checks, name: str) -> None:
        """Refuse coupling where nothing couples, or where no closed form is known."""
        if self.coupling is Coupling.none:
            return
        message = f"{self.coupling.name} needs a curved panel: give radius, or choose none"
        checks.require(self.radius is not None, name, message)
        message = f"{self.coupling.name} is exact on supported edges alone, not on free ones"
        checks.require(self.edges is EdgeSupport.supported, name, message)

    def _check_shear(self, checks: Checks, name: str) -> None:
        if self.shear_share is None:
            return
        message = f"must be from 0 to below 1, as 0.02, not {self.shear_share}"
        checks.require(0 <= self.shear_share < 1, f"{name}.shear_share", message)
        checks.require(self.shear, f"{name}.shear_share", "needs shear: true")

    def _check_attached(self, checks: Checks, name: str) -> None:
        """Refuse masses and ribs on what the sum of sines does not describe."""
        key = "masses" if self.masses else "ribs"
        plain = self.radius is None and self.edges is EdgeSupport.supported and not self.shear
        message = "need a flat plate on supported edges without shear"
        checks.require(plain, f"{name}.{key}", message)
        checks.require(self.thickness > 0, f"{name}.{key}", "need a plate with a thickness")
        for mass_name, mass in self.masses.items():
            mass.check(checks, f"{name}.masses.{mass_name}", self.size)
        for rib_name, rib in self.ribs.items():
            rib.check(checks, f"{name}.ribs.{rib_name}", self.size, self.thickness)
        for mode_name, mode in self.modes.items():
            where = f"{name}.modes.{mode_name}"
            message = f"must have at most {TERMS // 4} half waves along each side beside {key}"
            few = mode.direction is not Direction.normal or max(mode.x, mode.y) <= TERMS // 4
            checks.require(few, where, message)
            checks.require(not mode.membrane, f"{where}.membrane", f"does not go with {key}")

    def _check_natural(self, checks: Checks, name: str) -> None:
        """Refuse natural frequencies of what has no stiffness, or whose stiffness is not known."""
        unknown = [key for key, mode in self.modes.items() if mode.frequency is None]
        if not unknown:
            return
        where = f"{name}.modes.{unknown[0]}.frequency"
        message = "must be given, because a plate of no thickness has no natural frequency"
        checks.require(self.thickness > 0, where, message)
        stiff = self.radius is None or self.coupling is Coupling.donnell
        message = "must be given for a curved panel, or coupling: donnell, which knows it"
        checks.require(stiff, where, message)


@dataclass(frozen=True, eq=False)
class VibratingPlate(SceneObject):
    """A surface that vibrates in modes. The spot is small against their waves: it sees a point.

    Parameters
    ----------
    surface : PlateSurface
    modes : DampedModes
    mode_names : tuple of str
    rotation : ndarray, shape (3, 3)
        World to the plate's own axes.
    center : ndarray, shape (3,), m
    """

    surface: PlateSurface
    modes: DampedModes
    mode_names: tuple[str, ...]
    rotation: Array
    center: Array

    @classmethod
    def built(cls, plate: AnyPlate) -> VibratingPlate:
        """Make the plate of a configuration."""
        return cls(
            surface=plate.surface(),
            modes=plate.vibration(),
            mode_names=plate.mode_names,
            rotation=rotation_from_euler(plate.euler),
            center=plate.place,
        )

    def terms(self, beams: Beams) -> tuple[Array, Array]:
        """See `SceneObject`: the modes' motion at the beam's axis, along the line of sight."""
        direction = beams.direction @ self.rotation.T
        origin = (beams.origin - self.center) @ self.rotation.T
        distance, along_sight, behind = self._seen_of_side(origin, direction)
        if behind.any():
            back = replace(self, surface=self.surface.back)
            own = back._seen_of_side(origin[behind], direction[behind])
            distance[behind], along_sight[behind] = own[:2]
        if isinstance(self.surface, LitSurface):
            met = np.isfinite(distance)
            points = origin[met] + distance[met, None] * direction[met]
            light = self.surface.light(points, direction[met], beams.radius(distance[met]))
            along_sight[met] *= light[:, None]
        return distance, along_sight

    def spectra(self, frequency: Array) -> ComplexArray:
        """See `SceneObject`: the modes' responses."""
        return self.modes.response(frequency)

    def _seen_of_side(self, origin: Array, direction: Array) -> tuple[Array, Array, BoolArray]:
        """Compute distances, velocities of modes along beams, and which beams come from behind."""
        distance, place = self.surface.meet(origin, direction)
        if not np.isfinite(distance).any():  # as of whole blocks that look elsewhere
            nothing = np.zeros((len(distance), len(self.modes.frequency)))
            return distance, nothing, np.zeros(len(distance), bool)
        to_instrument = np.einsum("bij,bj->bi", self.surface.frame(place), -direction)
        along_sight = np.einsum("bmi,bi->bm", self._motion(place), to_instrument)
        return distance, along_sight, np.isfinite(distance) & (to_instrument[:, 2] < 0)

    def in_modes(self, factors: Mapping[str, float]) -> VibratingPlate:
        """See `SceneObject`."""
        factor = np.array([factors.get(name, 1.0) for name in self.mode_names])
        return replace(self, modes=replace(self.modes, velocity=factor * self.modes.velocity))

    def velocity(self, points: ArrayLike, frequency: float) -> ComplexArray:
        """Compute the measured surface's true velocity, nearest to points of the world.

        Parameters
        ----------
        points : array_like, shape (point, 3), m
        frequency : float, Hz

        Returns
        -------
        ndarray of complex, shape (point, 3), m/s per V of excitation
            Along the world's axes; NaN beside the plate and over its holes.
        """
        place = self._place(points)
        return self._along_world(place, self._motion(place), frequency)

    def middle_velocity(self, points: ArrayLike, frequency: float) -> ComplexArray:
        """Compute the same of the middle surface."""
        place = self._place(points)
        moved = self.modes.motion(place, 0.0, self.surface.curvature)
        return self._along_world(place, moved, frequency)

    def _along_world(self, place: Array, motion: Array, frequency: float) -> ComplexArray:
        local = np.einsum("pmi,m->pi", motion, self._response(frequency))
        return np.einsum("pij,pi->pj", self.surface.frame(place) @ self.rotation, local)

    def modal_velocity(self, points: ArrayLike) -> Array:
        """Compute each mode's own velocity at its resonance, nearest to points of the world.

        Parameters
        ----------
        points : array_like, shape (point, 3), m

        Returns
        -------
        ndarray, shape (point, 3, mode), m/s per V of excitation
            Along the world's axes; NaN beside the plate and over its holes.
        """
        place = self._place(points)
        local = self._motion(place) * self.modes.velocity[:, None]
        return np.einsum("pij,pmi->pjm", self.surface.frame(place) @ self.rotation, local)

    def strain(
        self, points: ArrayLike, frequency: float, axes: Array | None = None
    ) -> ComplexArray:
        """Compute true strain of the measured surface at the places nearest to points of the world.

        Parameters
        ----------
        points : array_like, shape (point, 3), m
        frequency : float, Hz
        axes : ndarray, shape (point, 3, 3), optional
            Unit rows, two tangents first; without them those of the method `axes`.

        Returns
        -------
        ndarray of complex, shape (point, 3), per V of excitation
            e_11, e_22 and e_12 (tensor component) along the two tangents; NaN beside the plate.
        """
        shape = self.modes.strain(self._place(points), self.surface.height, self.surface.curvature)
        displacement = self._response(frequency) / (2j * np.pi * frequency)
        own = np.einsum("pmi,m->pi", shape, displacement)
        if axes is None:
            return own
        tensor = own[:, [0, 2, 2, 1]].reshape(-1, 2, 2)
        turn = np.einsum("pai,pbi->pab", axes[:, :2], self.axes(points)[:, :2])
        (ss, st), (_, tt) = np.moveaxis(turn @ tensor @ np.swapaxes(turn, 1, 2), 0, -1)
        return np.stack([ss, tt, st], axis=-1)

    def height(self, points: ArrayLike) -> Array:
        """Compute height of points above the measured surface, shape (point,), m.

        NaN beside the plate.
        """
        place = self._place(points)
        own = (np.atleast_2d(np.asarray(points, float)) - self.center) @ self.rotation.T
        normal = self.surface.frame(place)[:, 2]
        return np.einsum("pi,pi->p", own - self.surface.position(place), normal)

    def axes(self, points: ArrayLike) -> Array:
        """Compute two tangents and the normal of the surface, unit rows, shape (point, 3, 3)."""
        return self.surface.frame(self._place(points)) @ self.rotation

    def position(self, coordinates: ArrayLike) -> Array:
        """Compute points of the measured surface in the world.

        Parameters
        ----------
        coordinates : array_like, shape (point, 2), m
            Along the plate's sides, from one corner of the middle surface.

        Returns
        -------
        ndarray, shape (point, 3), m
        """
        return self.surface.position(np.asarray(coordinates, float)) @ self.rotation + self.center

    def _place(self, points: ArrayLike) -> Array:
        """Find the nearest places of points, shape (point, 2), m; NaN beside the plate."""
        own = (np.atleast_2d(np.asarray(points, float)) - self.center) @ self.rotation.T
        place = self.surface.coordinates(own)
        rounding = 1e-9 * self.surface.size
        clipped = np.clip(place, 0.0, self.surface.size)
        beside = (np.abs(place - clipped) > rounding).any(axis=-1, keepdims=True)
        beside |= ~self.surface.inside(clipped)[..., None]
        return np.where(beside, np.nan, clipped)

    def _motion(self, place: Array) -> Array:
        return self.modes.motion(place, self.surface.height, self.surface.curvature)

    def _response(self, frequency: float) -> ComplexArray:
        return self.modes.response(np.array([frequency]))[:, 0]


class VibratingScene(CalibrationScene):
    """A vibrating plate; beside it the calibration object, if `target` has circles.

    Scenes that extend it say what the plate is.
    """

    plate: AnyPlate

    def check(self, checks: Checks) -> None:
        """Note what is wrong with the plate, the speakers and washers."""
        super().check(checks)
        self.plate.check(checks, "plate")

    @property
    def mode_names(self) -> list[str]:
        """Names of the plate's modes."""
        return list(self.plate.mode_names)

    def objects(self, target: Target | None, rng: np.random.Generator) -> list[SceneObject]:
        """List the plate, and the calibration object if there is one."""
        objects = super().objects(target, rng) if isinstance(target, Circles) else []
        return [*objects, VibratingPlate.built(self.plate)]


@register("scene", "plate")
@dataclass
class PlateScene(VibratingScene):
    """A vibrating rectangular plate; beside it the calibration object, if `target` has circles.

    Parameters
    ----------
    plate : Plate
    """

    plate: Plate = field(default_factory=Plate)


def truth_to_dataset(
    scene: VibratingScene,
    points: Array,
    frequency: ArrayLike,
    amplitude: ArrayLike,
    places: Array | None = None,
    frames: Array | None = None,
) -> xr.Dataset:
    """Make the group ``truth``: true velocity of the plate near points, and its strain.

    Parameters
    ----------
    points : ndarray, shape (node, 3), m
        In the world.
    frequency : array_like, shape (frequency,), Hz
    amplitude : array_like, shape () or (frequency,), V
        Of the excitation at each frequency.
    places : ndarray, shape (place, 3), m, optional
        Where the strain is wanted.
    frames : ndarray, shape (place, 3, 3), optional
        Unit rows there, two tangents first, along which it is wanted.

    Returns
    -------
    xarray.Dataset
        ``velocity`` of the measured surface at the place nearest to each point, NaN beside the
        plate, and the point's ``height`` above that surface; ``strain`` of that surface.
    """
    plate = VibratingPlate.built(scene.plate)
    hertz = np.atleast_1d(np.asarray(frequency, float))
    volts = np.asarray(amplitude, float)
    velocity = volts * np.stack([plate.velocity(points, f) for f in hertz], axis=-1)
    strain = None
    if places is not None:
        strain = volts * np.stack([plate.strain(places, f, frames) for f in hertz], axis=-1)
    coords = {"node": np.arange(len(points)), "frequency": hertz}
    if places is not None:
        coords["strain_component"] = np.array(["ss", "tt", "st"])
    return dataset.group(
        "truth",
        coords,
        strain=strain,
        velocity=velocity,
        height=plate.height(points),
        position=points,
    )
