"""`scene=plate`: a vibrating plate or cylindrical panel, what the beam sees of it, and its truth.

The plate's motion is a sum of damped modes in closed form (`sldvexp.virtual_lab.modes`), so that
velocity and strain are known exactly at every point of the measured surface. That surface is flat
or a part of a cylinder: a `PlateSurface` tells where it is, how it is turned and where beams meet
it.
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
from sldvexp.virtual_lab.beam import Beams, SceneObject
from sldvexp.virtual_lab.calibration_scene import CalibrationScene
from sldvexp.virtual_lab.modes import EdgeSupport, Mode, Modes


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
class Plate:
    """A rectangular thin plate, flat or bent to a cylinder about its own y axis.

    The plate's own axes stand at the center of its middle surface, z along its normal.

    Parameters
    ----------
    unit : LengthUnit
        Unit of all lengths below.
    center : list of 3 float
        Where the center stands in the world.
    euler : list of 3 float, rad
        phi1, phi2, phi3 in the x-convention, world to plate.
    size : list of 2 float
        Sides along its own x (the arc, if it is curved) and y.
    thickness : float
        The beam sees the surface half of this above the middle surface.
    radius : float, optional
        Of the middle surface's curvature; positive if the normal points away from the axis of
        the cylinder, negative towards it. Without it the plate is flat.
    edges : EdgeSupport
        How they are held; decides the shapes of bending.
    modes : dict of str to Mode
    holes : dict of str to Hole
        Cut out of the whole plate, whose modes they do not change.
    """

    unit: LengthUnit = LengthUnit.m
    center: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    euler: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    size: list[float] = field(default_factory=lambda: [0.3, 0.25])
    thickness: float = 0.003
    radius: float | None = None
    edges: EdgeSupport = EdgeSupport.supported
    modes: dict[str, Mode] = field(default_factory=dict)
    holes: dict[str, Hole] = field(default_factory=dict)

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no plate can be."""
        known = len(checks.problems)
        for key, count in (("center", 3), ("euler", 3), ("size", 2)):
            values = getattr(self, key)
            message = f"must be {count} numbers, not {len(values)}"
            checks.require(len(values) == count, f"{name}.{key}", message)
            checks.finite(f"{name}.{key}", *values)
        for side in self.size:
            checks.positive(f"{name}.size", side)
        checks.non_negative(f"{name}.thickness", self.thickness)
        checks.require(bool(self.modes), f"{name}.modes", "give at least one mode")
        for mode_name, mode in self.modes.items():
            mode.check(checks, f"{name}.modes.{mode_name}", self.edges)
        for hole_name, hole in self.holes.items():
            hole.check(checks, f"{name}.holes.{hole_name}")
        if self.radius is not None and len(checks.problems) == known:
            self._check_radius(checks, f"{name}.radius", self.radius)

    def _check_radius(self, checks: Checks, name: str, radius: float) -> None:
        least = max(self.thickness / 2, self.size[0] / (2 * math.pi))
        checks.require(
            math.isfinite(radius) and abs(radius) > least,
            name,
            f"must be finite and beyond +-{least:.6g} {self.unit.name}, where the panel would "
            f"close to a tube or its surface vanish, not {radius}",
        )


@dataclass(frozen=True, eq=False)
class PlateSurface(ABC):
    """Upper surface of a plate in the plate's own axes, by coordinates of its middle surface.

    Parameters
    ----------
    size : ndarray, shape (2,), m
        Coordinates (s, t) run from 0 to these.
    height : float, m
        Of the upper surface above the middle one, along the normal.
    holes : ndarray, shape (hole, 2, 2), m
        Lowest and highest coordinates of each.
    """

    size: Array
    height: float
    holes: Array

    @property
    @abstractmethod
    def curvature(self) -> float:
        """Of the middle surface along s, 1/m; positive if the normal points away from the axis."""

    @abstractmethod
    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Find where each beam first meets the upper surface.

        Parameters
        ----------
        origin, direction : ndarray, shape (beam, 3)

        Returns
        -------
        distance : ndarray, shape (beam,), m
            Infinite where the beam misses.
        coordinates : ndarray, shape (beam, 2), m
            0 where the beam misses.
        """

    @abstractmethod
    def coordinates(self, points: Array) -> Array:
        """Find the nearest places, shape (..., 2), m; beyond `size` for points beside."""

    @abstractmethod
    def frame(self, coordinates: Array) -> Array:
        """Compute unit rows along s, along t and along the normal, shape (..., 3, 3)."""

    @abstractmethod
    def position(self, coordinates: Array) -> Array:
        """Compute places on the upper surface, shape (..., 3), m."""

    def inside(self, coordinates: Array) -> BoolArray:
        """Tell whether coordinates are on the plate, shape (...)."""
        on_it = np.all((coordinates >= 0) & (coordinates <= self.size), axis=-1)
        for low, high in self.holes:
            on_it &= ~np.all((coordinates > low) & (coordinates < high), axis=-1)
        return on_it


@dataclass(frozen=True, eq=False)
class VibratingPlate(SceneObject):
    """A surface that vibrates in modes. The spot is small against their waves: it sees a point.

    Parameters
    ----------
    surface : PlateSurface
    modes : Modes
    mode_names : tuple of str
    rotation : ndarray, shape (3, 3)
        World to the plate's own axes.
    center : ndarray, shape (3,), m
    """

    surface: PlateSurface
    modes: Modes
    mode_names: tuple[str, ...]
    rotation: Array
    center: Array

    @classmethod
    def built(cls, plate: Plate) -> VibratingPlate:
        """Make the plate of a configuration."""
        unit = plate.unit.value
        size, height = unit * np.array(plate.size), unit * plate.thickness / 2
        middles = [np.array(hole.center) for hole in plate.holes.values()]
        halves = [np.array(hole.size) / 2 for hole in plate.holes.values()]
        limits = [[m - h, m + h] for m, h in zip(middles, halves, strict=True)]
        holes = unit * np.array(limits).reshape(-1, 2, 2) + size / 2
        surface: PlateSurface = FlatSurface(size, height, holes)
        if plate.radius is not None:
            surface = CylinderSurface(size, height, holes, unit * plate.radius)
        return cls(
            surface=surface,
            modes=Modes.built(plate.modes.values(), size, plate.edges),
            mode_names=tuple(plate.modes),
            rotation=rotation_from_euler(plate.euler),
            center=unit * np.array(plate.center),
        )

    def seen(self, beams: Beams, frequency: Array) -> tuple[Array, ComplexArray]:
        """Compute the distance to the surface and the velocity at the beam's axis.

        See `SceneObject`.
        """
        direction = beams.direction @ self.rotation.T
        origin = (beams.origin - self.center) @ self.rotation.T
        distance, place = self.surface.meet(origin, direction)
        to_instrument = np.einsum("bij,bj->bi", self.surface.frame(place), -direction)
        along_sight = np.einsum("bmi,bi->bm", self._motion(place), to_instrument)
        response = self.modes.response(frequency)
        return distance, np.einsum("bm,mf->bf", along_sight, response)

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
        local = np.einsum("pmi,m->pi", self._motion(place), self._response(frequency))
        return np.einsum("pij,pi->pj", self.surface.frame(place) @ self.rotation, local)

    def strain(self, points: ArrayLike, frequency: float) -> ComplexArray:
        """Compute true strain of the measured surface at the places nearest to points of the world.

        Parameters
        ----------
        points : array_like, shape (point, 3), m
        frequency : float, Hz

        Returns
        -------
        ndarray of complex, shape (point, 3), per V of excitation
            e_11, e_22 and e_12 (tensor component) along the first two rows of `axes`; NaN beside
            the plate.
        """
        shape = self.modes.strain(self._place(points), self.surface.height, self.surface.curvature)
        displacement = self._response(frequency) / (2j * np.pi * frequency)
        return np.einsum("pmi,m->pi", shape, displacement)

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


class FlatSurface(PlateSurface):
    """A plane at z = height in the plate's axes."""

    @property
    def curvature(self) -> float:
        """None."""
        return 0.0

    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """See `PlateSurface`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (self.height - origin[:, 2]) / direction[:, 2]
            coordinates = self.coordinates(origin + distance[:, None] * direction)
            hits = self.inside(coordinates) & (distance > 0)
        return np.where(hits, distance, np.inf), np.where(hits[:, None], coordinates, 0.0)

    def coordinates(self, points: Array) -> Array:
        """See `PlateSurface`."""
        return points[..., :2] + self.size / 2

    def frame(self, coordinates: Array) -> Array:
        """See `PlateSurface`."""
        return np.broadcast_to(np.eye(3), (*coordinates.shape[:-1], 3, 3))

    def position(self, coordinates: Array) -> Array:
        """See `PlateSurface`."""
        xy = coordinates - self.size / 2
        return np.concatenate([xy, np.full_like(xy[..., :1], self.height)], axis=-1)


@dataclass(frozen=True, eq=False)
class CylinderSurface(PlateSurface):
    """A cylinder about the line x = 0, z = -radius; s is the middle surface's arc.

    Parameters
    ----------
    radius : float, m
        Of the middle surface; negative where the normal points towards the axis.
    """

    radius: float

    @property
    def curvature(self) -> float:
        """1 / radius."""
        return 1.0 / self.radius

    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Find where each beam first meets the upper surface."""
        ox, oz = origin[:, 0], origin[:, 2] + self.radius
        dx, dz = direction[:, 0], direction[:, 2]
        a, b = dx**2 + dz**2, ox * dx + oz * dz
        c = ox**2 + oz**2 - (self.radius + self.height) ** 2
        distance = np.full(len(origin), np.inf)
        coordinates = np.zeros((len(origin), 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(b**2 - a * c)
            for crossing in ((-b + root) / a, (-b - root) / a):  # the nearer one last: it stays
                place = self.coordinates(origin + crossing[:, None] * direction)
                hits = self.inside(place) & (crossing > 0)
                distance = np.where(hits, crossing, distance)
                coordinates = np.where(hits[:, None], place, coordinates)
        return distance, coordinates

    def coordinates(self, points: Array) -> Array:
        """See `PlateSurface`."""
        reach = self.radius + self.height
        angle = np.arctan2(points[..., 0] / reach, (points[..., 2] + self.radius) / reach)
        return np.stack([self.radius * angle, points[..., 1]], axis=-1) + self.size / 2

    def frame(self, coordinates: Array) -> Array:
        """See `PlateSurface`."""
        sine, cosine = self._turn(coordinates)
        zero, one = np.zeros_like(sine), np.ones_like(sine)
        rows = [[cosine, zero, -sine], [zero, one, zero], [sine, zero, cosine]]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def position(self, coordinates: Array) -> Array:
        """See `PlateSurface`."""
        sine, cosine = self._turn(coordinates)
        reach = self.radius + self.height
        y = coordinates[..., 1] - self.size[1] / 2
        return np.stack([reach * sine, y, reach * cosine - self.radius], axis=-1)

    def _turn(self, coordinates: Array) -> tuple[Array, Array]:
        """Compute sine and cosine of the angle from the panel's center."""
        angle = (coordinates[..., 0] - self.size[0] / 2) / self.radius
        return np.sin(angle), np.cos(angle)


@register("scene", "plate")
@dataclass
class PlateScene(CalibrationScene):
    """A vibrating plate; beside it the calibration object, if `target` has circles.

    Parameters
    ----------
    plate : Plate
    """

    plate: Plate = field(default_factory=Plate)

    def check(self, checks: Checks) -> None:
        """Note what is wrong with the plate, the speakers and washers."""
        super().check(checks)
        self.plate.check(checks, "plate")

    @property
    def mode_names(self) -> list[str]:
        """Names of the plate's modes."""
        return list(self.plate.modes)

    def objects(self, target: Target | None, rng: np.random.Generator) -> list[SceneObject]:
        """List the plate, and the calibration object if there is one."""
        objects = super().objects(target, rng) if isinstance(target, Circles) else []
        return [*objects, VibratingPlate.built(self.plate)]


def truth_to_dataset(
    scene: PlateScene,
    points: Array,
    frequency: ArrayLike,
    amplitude: float,
    places: Array | None = None,
) -> xr.Dataset:
    """Make the group ``truth``: true velocity of the plate near points, and its strain.

    Parameters
    ----------
    points : ndarray, shape (node, 3), m
        In the world.
    frequency : array_like, shape (frequency,), Hz
    amplitude : float, V
        Of the excitation at each frequency.
    places : ndarray, shape (place, 3), m, optional
        Where the strain is wanted.

    Returns
    -------
    xarray.Dataset
        ``velocity`` of the measured surface at the place nearest to each point, NaN beside the
        plate, and the point's ``height`` above that surface; ``strain`` of that surface.
    """
    plate = VibratingPlate.built(scene.plate)
    hertz = np.atleast_1d(np.asarray(frequency, float))
    velocity = np.stack([amplitude * plate.velocity(points, f) for f in hertz], axis=-1)
    strain = None
    if places is not None:
        strain = np.stack([amplitude * plate.strain(places, f) for f in hertz], axis=-1)
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
