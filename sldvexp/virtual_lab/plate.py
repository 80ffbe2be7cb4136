"""The vibrating plate: what the beam sees of it, and its true velocity and strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.geometry.rotation import rotation_from_euler
from sldvexp.typing import Array, ComplexArray
from sldvexp.virtual_lab.beam import Beams
from sldvexp.virtual_lab.cylinder_surface import CylinderSurface
from sldvexp.virtual_lab.flat_surface import FlatSurface
from sldvexp.virtual_lab.modes import Modes
from sldvexp.virtual_lab.plate_scene import Plate
from sldvexp.virtual_lab.scene_object import SceneObject
from sldvexp.virtual_lab.surface import Surface


@dataclass(frozen=True, eq=False)
class VibratingPlate(SceneObject):
    """A surface that vibrates in modes. The spot is small against their waves: it sees a point.

    Parameters
    ----------
    surface : Surface
    modes : Modes
    rotation : ndarray, shape (3, 3)
        World to the plate's own axes.
    center : ndarray, shape (3,), m
    """

    surface: Surface
    modes: Modes
    rotation: Array
    center: Array

    @classmethod
    def built(cls, plate: Plate) -> VibratingPlate:
        """The plate of a configuration."""
        unit = plate.unit.value
        size, height = unit * np.array(plate.size), unit * plate.thickness / 2
        surface: Surface = FlatSurface(size, height)
        if plate.radius is not None:
            surface = CylinderSurface(size, height, unit * plate.radius)
        return cls(
            surface=surface,
            modes=Modes.built(plate.modes.values(), size, plate.edges),
            rotation=rotation_from_euler(plate.euler),
            center=unit * np.array(plate.center),
        )

    def seen(self, beams: Beams, frequency: Array) -> tuple[Array, ComplexArray]:
        """Distance to the surface and the velocity at the beam's axis; see `SceneObject`."""
        direction = beams.direction @ self.rotation.T
        origin = (beams.origin - self.center) @ self.rotation.T
        distance, place = self.surface.meet(origin, direction)
        to_instrument = np.einsum("bij,bj->bi", self.surface.frame(place), -direction)
        along_sight = np.einsum("bmi,bi->bm", self._motion(place), to_instrument)
        response = self.modes.response(frequency)
        return distance, np.einsum("bm,mf->bf", along_sight, response)

    def velocity(self, points: ArrayLike, frequency: float) -> ComplexArray:
        """True velocity of the measured surface at the places nearest to points of the world.

        Parameters
        ----------
        points : array_like, shape (point, 3), m
        frequency : float, Hz

        Returns
        -------
        ndarray of complex, shape (point, 3), m/s per V of excitation
            Along the world's axes; NaN beside the plate.
        """
        place = self._place(points)
        local = np.einsum("pmi,m->pi", self._motion(place), self._response(frequency))
        return np.einsum("pij,pi->pj", self.surface.frame(place) @ self.rotation, local)

    def strain(self, points: ArrayLike, frequency: float) -> ComplexArray:
        """True strain of the measured surface at the places nearest to points of the world.

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
        """Height of points above the measured surface, shape (point,), m; NaN beside the plate."""
        place = self._place(points)
        own = (np.atleast_2d(np.asarray(points, float)) - self.center) @ self.rotation.T
        normal = self.surface.frame(place)[:, 2]
        return np.einsum("pi,pi->p", own - self.surface.position(place), normal)

    def axes(self, points: ArrayLike) -> Array:
        """Two tangents and the normal of the surface, unit rows, shape (point, 3, 3)."""
        return self.surface.frame(self._place(points)) @ self.rotation

    def position(self, coordinates: ArrayLike) -> Array:
        """Points of the measured surface in the world.

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
        """Coordinates on the plate, NaN beside it."""
        own = (np.atleast_2d(np.asarray(points, float)) - self.center) @ self.rotation.T
        place = self.surface.coordinates(own)
        rounding = 1e-9 * self.surface.size
        clipped = np.clip(place, 0.0, self.surface.size)
        beside = (np.abs(place - clipped) > rounding).any(axis=-1, keepdims=True)
        return np.where(beside, np.nan, clipped)

    def _motion(self, place: Array) -> Array:
        return self.modes.motion(place, self.surface.height, self.surface.curvature)

    def _response(self, frequency: float) -> ComplexArray:
        return self.modes.response(np.array([frequency]))[:, 0]
