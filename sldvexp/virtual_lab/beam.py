"""True beam in the world, and how a spot of finite size lies across an edge."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import Checks
from sldvexp.geometry.blurred_disc import part_of_disc
from sldvexp.laser import TwoMirror, rays
from sldvexp.typing import Array, ComplexArray


@dataclass
class Spot:
    """Laser spot: a Gaussian beam focused at some distance.

    Its radius (intensity 1/e^2 of the axis) at distance d is
    ``waist sqrt(1 + ((d - focus) / rayleigh)**2)``.

    Parameters
    ----------
    waist : float, m
        Radius where it is smallest; 0 makes the beam a line.
    focus : float, m
        Distance of the waist from the scanning mirror.
    rayleigh : float, m
        Distance from the waist at which the spot's area has doubled; a diffraction-limited beam
        has pi waist^2 / wavelength.
    """

    waist: float = 0.0003
    focus: float = 1.7
    rayleigh: float = 0.45

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no beam can be."""
        checks.non_negative(f"{name}.waist", self.waist)
        checks.non_negative(f"{name}.focus", self.focus)
        checks.positive(f"{name}.rayleigh", self.rayleigh)


@dataclass(frozen=True, eq=False)
class Beams:
    """Laser beams in the world.

    Parameters
    ----------
    origin, direction : ndarray, shape (beam, 3), m and unit vectors
        From the instrument outwards; D of v = V . D is the opposite direction.
    spot : Spot
    """

    origin: Array
    direction: Array
    spot: Spot

    def radius(self, distance: Array) -> Array:
        """Compute spot radius (1/e^2 of the intensity) across the beam at each distance, m."""
        return self.spot.waist * np.hypot(1.0, (distance - self.spot.focus) / self.spot.rayleigh)


def beams(
    mirrors: TwoMirror,
    dac: ArrayLike,
    rotation: ArrayLike,
    origin: ArrayLike,
    spot: Spot,
    error: Array | None = None,
) -> Beams:
    """Send the beams of DAC steps, by the true mirrors and the true pose.

    Parameters
    ----------
    dac : array_like, shape (beam, 2), steps
    rotation : array_like, shape (3, 3)
        World to laser.
    origin : array_like, shape (3,), m
        Of the laser frame, in the world.
    error : ndarray, shape (beam, 2), rad, optional
        Of the mirrors' angles.
    """
    angle = mirrors.angle_from_dac(dac)
    start, along = rays(angle if error is None else angle + error, mirrors.mirror_offset)
    r = np.asarray(rotation, float)
    return Beams(np.asarray(origin, float) + start @ r, along @ r, spot)


def part_inside(
    away: Array, outward: Array, normal: Array, edge: Array, direction: Array, radius: Array
) -> Array:
    """Compute the part of the spot's light that falls inside a circular edge.

    On a plane with unit normal n the light of a Gaussian beam of radius w along d has the
    covariance ``C(a, b) = w^2/4 (a.b + (a.d)(b.d) / (n.d)^2)`` of in-plane unit vectors a and b.
    What of it falls into the circle is exact (`sldvexp.geometry.blurred_disc`): at an edge of 10 mm
    radius a spot of 0.3 mm radius has its halfway value 1.1 um inside of it. Left out is the beam's
    divergence across the spot.

    Parameters
    ----------
    away : ndarray, shape (beam,), m
        Of the beam's axis from the circle's center, on the plane.
    outward, normal : ndarray, shape (beam, 3)
        Unit vectors in the plane away from the circle's center, and across the plane.
    edge : ndarray, shape (beam,), m
        Radius of the circle.
    direction : ndarray, shape (beam, 3)
        Of the beam.
    radius : ndarray, shape (beam,), m
        Of the beam (1/e^2); 0 makes the edge a step.

    Returns
    -------
    ndarray, shape (beam,)
    """
    along = np.cross(normal, outward)
    slant = np.stack([(direction * v).sum(-1) for v in (outward, along)], axis=-1)
    slant /= (direction * normal).sum(-1, keepdims=True)
    round_ = np.eye(2) + slant[:, :, None] * slant[:, None, :]
    covariance = (radius / edge / 2.0)[:, None, None] ** 2 * round_
    middle = np.stack([away / edge, np.zeros_like(away)], axis=-1)
    return part_of_disc(middle, covariance)


class SceneObject(ABC):
    """Something that the beam can hit. A new object implements two hooks, `terms` and `spectra`.

    What moves is a sum of shapes, ``v(t) = sum_m c_m q_m(t)``: the beam decides the coefficients
    c_m, the excitation the responses q_m, whatever it plays.

    Attributes
    ----------
    calibrates : bool
        Whether it tells where the instrument stands; mistakes of a view spoil the other objects.
    """

    calibrates: ClassVar[bool] = False

    def in_modes(self, factors: Mapping[str, float]) -> SceneObject:
        """Give this object with the velocities of its modes multiplied, by the modes' names."""
        return self

    def seen(self, beams: Beams, frequency: Array) -> tuple[Array, ComplexArray]:
        """Compute distance and velocity of this object, as the instrument sees them.

        Parameters
        ----------
        frequency : ndarray, shape (tone,), Hz

        Returns
        -------
        distance : ndarray, shape (beam,), m
            From the beam's origin; infinite where it misses the object.
        velocity : ndarray of complex, shape (beam, tone), m/s per V of excitation
            Along the line of sight, positive towards the instrument (v = V . D), averaged over
            the spot; finite, but without meaning, where the beam misses.
        """
        distance, coefficient = self.terms(beams)
        return distance, np.einsum("bm,mf->bf", coefficient, self.spectra(frequency))

    @abstractmethod
    def terms(self, beams: Beams) -> tuple[Array, Array]:
        """Compute the distance of `seen`, and the coefficients c_m, shape (beam, term)."""

    @abstractmethod
    def spectra(self, frequency: Array) -> ComplexArray:
        """Compute what each term does at frequencies, shape (term, tone), m/s per V."""
