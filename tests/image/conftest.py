"""Images of calibration objects through the two-mirror model, and scans of blurred edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.special import ndtr

from sldvexp.geometry import conic, rotation_from_vector
from sldvexp.image import ScanLines
from sldvexp.laser import TwoMirror, project
from sldvexp.targets import Circle, Circles, Plane
from sldvexp.units import LengthUnit

#: Figure 4.1, inches.
FRONT = {
    1: Circle(2.2574, 2.8216, 0.8090),
    2: Circle(7.4654, 1.6073, 0.8161),
    3: Circle(9.4997, 9.7075, 0.8206),
    4: Circle(1.5810, 9.5402, 0.8014),
}
#: A square of equal circles, which alone looks the same from four sides.
SQUARE = {5: (-1.5, -1.5), 6: (1.5, -1.5), 7: (1.5, 1.5), 8: (-1.5, 1.5)}


@pytest.fixture
def figure_4_1() -> Circles:
    return Circles(unit=LengthUnit.inch, circles=dict(FRONT))


@pytest.fixture
def two_planes() -> Circles:
    raised = {n: Circle(x, y, 0.8, "raised") for n, (x, y) in SQUARE.items()}
    planes = {"front": Plane(), "raised": Plane([5.5, 5.5, 3.0], [0.0, 0.2, 1.0])}
    return Circles(unit=LengthUnit.inch, circles=FRONT | raised, planes=planes)


@dataclass
class View:
    """Where an instrument stands before an object whose normal faces it.

    Parameters
    ----------
    laser : TwoMirror
    range : float, m
    tilt : pair of float, rad
        About the axes across the line of sight.
    roll : float, rad
    aside : pair of float, m
        Of the object's middle from the instrument's axis.
    """

    laser: TwoMirror
    range: float = 1.7
    tilt: tuple[float, float] = (0.2, -0.15)
    roll: float = 0.3
    aside: tuple[float, float] = (0.05, -0.1)

    def dac(self, points: np.ndarray) -> np.ndarray:
        """DAC steps of points on the object, shape (..., 2)."""
        facing = np.diag([1.0, -1.0, -1.0])
        tilted = rotation_from_vector(np.array([*self.tilt, 0.0])) @ facing
        rotation = rotation_from_vector(np.array([0.0, 0.0, self.roll])) @ tilted
        middle = np.array([5.5, 5.5, 0.0]) * LengthUnit.inch.value
        in_laser = (points - middle) @ rotation.T + np.array([*self.aside, self.range])
        return self.laser.dac_from_angle(project(in_laser, self.laser.mirror_offset))

    def edge(self, target: Circles, number: int, n: int = 48) -> np.ndarray:
        """Points of a circle's edge in DAC steps, shape (n, 2)."""
        circle = target.circles[number]
        plane = target.planes[circle.plane]
        turn = 2 * np.pi * np.arange(n) / n
        around = circle.diameter / 2 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        flat = np.array([circle.x, circle.y]) + around
        return self.dac(target.unit.value * (np.array(plane.origin) + flat @ plane.axes()[:2]))


@pytest.fixture
def view() -> Callable[..., View]:
    """Make a view; the mirror offset is given in m."""

    def make(mirror_offset: float = 0.045, **where: object) -> View:
        return View(TwoMirror(mirror_offset=mirror_offset), **where)  # type: ignore[arg-type]

    return make


@dataclass
class Spot:
    """A Gaussian spot that scans an ellipse which moves as one, before a resting surface.

    Parameters
    ----------
    ellipse : ndarray, shape (5,)
    width : float, steps
        Standard deviation of the spot's intensity.
    noise : float
        Of a pixel, relative to the motion.
    rng : numpy.random.Generator
    """

    ellipse: np.ndarray
    width: float
    noise: float
    rng: np.random.Generator

    def motion(self, position: np.ndarray) -> np.ndarray:
        """Part of the spot that is inside: exact across the ellipse, by quadrature along it."""
        node, weight = np.polynomial.hermite_e.hermegauss(30)
        m = np.linalg.inv(conic.shape_matrix(self.ellipse))
        x, y = np.moveaxis(position - self.ellipse[:2], -1, 0)
        total = np.zeros_like(x)
        for z, w in zip(node, weight / weight.sum(), strict=True):
            row = y + self.width * z
            middle = -m[0, 1] * row / m[0, 0]
            square = 1.0 - np.linalg.det(m) / m[0, 0] * row**2
            half = np.sqrt(np.maximum(square, 0.0) / m[0, 0])
            ends = [ndtr((middle + s * half - x) / self.width) for s in (1.0, -1.0)]
            total += w * (ends[0] - ends[1])
        return total

    def scan(self, position: np.ndarray, name: str = "circle 1") -> ScanLines:
        """Scan lines at these positions, shape (line, pixel, 2)."""
        velocity = self.motion(position) + self.noise * self.rng.normal(size=position.shape[:2])
        std = np.full(velocity.shape, self.noise)
        return ScanLines(velocity, std, position, np.zeros(velocity.shape, bool), name)

    def across(self, offsets: tuple[float, ...] = (-25.0, 0.0, 25.0)) -> np.ndarray:
        """Three horizontal lines of 300 pixels across the whole ellipse."""
        x, y = np.round(self.ellipse[:2])
        along = np.arange(300) - 150 + x
        lines = [np.stack([along, np.full(300, y + o)], axis=1) for o in offsets]
        return np.stack(lines)

    def fine(self, lines: int = 44) -> np.ndarray:
        """Lines of 25 whole steps across the edge, along its normals."""
        points, normals = conic.boundary(self.ellipse, 2 * np.pi * np.arange(lines) / lines)
        steps = np.arange(25)[:, None] - 12.0
        return np.round(points[:, None] + steps * normals[:, None])


@pytest.fixture
def spot() -> Callable[..., Spot]:
    """Make a spot before an ellipse of about 67 by 56 steps."""
    ellipse = np.array([-900.3, 1100.6, 65.0**2, 58.0**2, 300.0])

    def make(width: float = 1.5, noise: float = 0.01, seed: int = 0) -> Spot:
        return Spot(ellipse, width, noise, np.random.default_rng(seed))

    return make
