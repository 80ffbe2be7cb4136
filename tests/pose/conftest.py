"""Edges of the virtual lab's true circles with known noise, without the work of scanning them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from sldvexp.geometry import KnownPose, euler_from_rotation, vector_from_rotation
from sldvexp.image import ScanLineEdges
from sldvexp.laser import TwoMirror
from sldvexp.pose import EdgePoints, EdgePoses, solve_edges
from sldvexp.pose.circle_images import CircleImages
from sldvexp.pose.misfit import edge_points
from sldvexp.session.circles import edges_to_dataset
from sldvexp.targets import Circle, Circles, Plane, std_of_bound
from sldvexp.units import LengthUnit
from sldvexp.virtual_lab import VirtualLab
from sldvexp.virtual_lab.calibration_scene import CalibrationScene
from sldvexp.virtual_lab.scene import MirrorErrors

#: Figure 4.29, and four places from which the same object is seen; all look at its middle.
FIGURE_4_29 = KnownPose([-1.153, 2.547, 1.913], [0.862, 0.508, 1.553])
PLACES = [[-0.6, 0.3, 1.6], [0.2, -0.7, 1.7], [0.1, 0.9, 1.4], [-0.3, -0.5, 1.2]]
LINES = 44


def looking(origin: Sequence[float]) -> KnownPose:
    """The pose of an instrument that looks at the object's middle, upright."""
    z = np.array([0.14, 0.14, 0.0]) - origin
    z /= np.linalg.norm(z)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return KnownPose(euler_from_rotation(np.stack([x, np.cross(z, x), z])).tolist(), list(origin))


VIEWS = dict(zip("abcde", [FIGURE_4_29, *map(looking, PLACES)], strict=True))


def circles(accuracy: float = 0.00005, planes: int = 1) -> Circles:
    """The object of Table 4.1, or with the second plane of ``target=two_planes``; inch."""
    front = [(2.2574, 2.8216, 0.8090), (7.4654, 1.6073, 0.8161),
             (9.4997, 9.7075, 0.8206), (1.5810, 9.5402, 0.8014)]  # fmt: skip
    found = {n: Circle(*numbers) for n, numbers in enumerate(front, 1)}
    stand = {"front": Plane()}
    if planes == 2:
        stand["raised"] = Plane([5.5, 5.5, 3.0], [0.0, 0.2, 1.0])
        corners = [(-1.5, -1.5), (1.5, -1.5), (1.5, 1.5), (-1.5, 1.5)]
        found |= {n: Circle(x, y, 0.8, "raised") for n, (x, y) in enumerate(corners, 5)}
    return Circles(unit=LengthUnit.inch, accuracy=accuracy, circles=found, planes=stand)


@dataclass
class EdgeLab:
    """Several views of one object, whose edges are drawn instead of scanned.

    Parameters
    ----------
    views : int
        How many of `VIEWS`.
    target : Circles
    mirrors : MirrorErrors
        By which the true mirrors differ from the nominal ones.
    std : float, DAC steps
        Of the edges along their scan lines.
    nominal : float, m
        Mirror offset.
    uneven : float
        Largest over smallest standard error that edges state, about `std`.
    pointing : float or sequence of float, DAC steps
        Noise of the mirrors besides, of all circles or of each.
    """

    views: int = 1
    target: Circles = None
    mirrors: MirrorErrors = None
    std: float = 0.007
    nominal: float = 0.03
    uneven: float = 1.0
    pointing: float | Sequence[float] = 0.0

    def __post_init__(self):
        self.target = self.target or circles()
        self.laser = TwoMirror(mirror_offset=self.nominal)
        self.names = list(VIEWS)[: self.views]
        self.scene = CalibrationScene(
            views={n: VIEWS[n] for n in self.names}, mirrors=self.mirrors or MirrorErrors()
        )
        self.lab = VirtualLab(self.scene, self.laser, self.target, 0)
        self.exact = CalibrationScene(views=self.scene.views, machine_error=False)
        self.machine(None)
        self.direction = {n: self._directions(n) for n in self.names}
        shape = len(self.target.circles), LINES
        share = np.random.default_rng(0).uniform(-0.5, 0.5, shape)
        self.stated = self.std * self.uneven**share
        self.true_std = np.hypot(self.stated, np.broadcast_to(self.pointing, shape[:1])[:, None])

    def machine(self, rng):
        """Make the object, with new machining errors if there is a generator."""
        scene = self.exact if rng is None else self.scene
        self.lab.objects = scene.objects(self.target, rng)

    def truth(self, name):
        """Rotation and origin of a view."""
        return self.lab.true_pose(name)

    def edges(self, rng):
        """Of all views; exact without a generator. By view, then circle."""
        return {n: self._of_view(n, rng) for n in self.names}

    def points(self, rng) -> list[EdgePoints]:
        """Of all views, as the solver takes them."""
        return [
            edge_points(CircleImages(n, found, None, None, None), self.laser, self.target)
            for n, found in self.edges(rng).items()
        ]

    def tree(self, rng):
        """Groups ``edge/<view>``."""
        return {f"edge/{n}": edges_to_dataset(list(e.values())) for n, e in self.edges(rng).items()}

    def solve(self, points, adjusted=None, shared=None, aside=1e-3) -> EdgePoses:
        """From starts that are aside."""
        starts = [(r, o + aside) for r, o in map(self.truth, self.names)]
        std = self.target.unit.value * std_of_bound(self.target.accuracy)
        return solve_edges(
            points,
            mirror_offset=self.nominal,
            views=self.names,
            starts=starts,
            adjust=adjusted,
            shared=shared,
            circle_std=std,
            max_iterations=100,
        )

    def errors(self, found: EdgePoses):
        """Rotation vector and origin, estimated minus true, of all views in a row."""
        each = zip(self.names, found.poses, strict=True)
        return np.concatenate([self.error(n, p) for n, p in each])

    def error(self, name, pose):
        """The same of one view."""
        rotation, origin = self.truth(name)
        turned = vector_from_rotation(pose.rotation @ rotation.T)
        return np.concatenate([turned, pose.origin - origin])

    def _images(self, name, azimuth):
        """True edges of all circles, shape (circle, line, 2)."""
        self.lab.use_view(name)
        thing = self.lab.calibration_object
        return self.lab.true_dac(np.stack([thing.edge(n, azimuth) for n in thing.number]))

    def _directions(self, name):
        """Scan lines across the edges, outwards."""
        azimuth = 2 * np.pi * np.arange(LINES) / LINES
        along = self._images(name, azimuth + 1e-4) - self._images(name, azimuth - 1e-4)
        across = np.stack([along[..., 1], -along[..., 0]], axis=-1)
        return across / np.linalg.norm(across, axis=-1, keepdims=True)

    def _of_view(self, name, rng):
        azimuth, direction = 2 * np.pi * np.arange(LINES) / LINES, self.direction[name]
        position = self._images(name, azimuth)
        if rng is not None:
            position += (self.true_std * rng.standard_normal(self.stated.shape))[
                ..., None
            ] * direction
        numbers = self.lab.calibration_object.number
        each = zip(numbers, position, direction, self.stated, strict=True)
        return {n: self._edges(f"circle {n}", p, d, s) for n, p, d, s in each}

    def _edges(self, name, position, direction, std):
        """Of one circle, seen by a spot without extent."""
        return ScanLineEdges(
            position=position,
            std=std.copy(),
            direction=direction,
            width=np.zeros(LINES),
            line=np.arange(LINES),
            rising=np.zeros(LINES, bool),
            phase=np.full(LINES, np.nan),
            rejected=(),
            lines=LINES,
            name=name,
        )


@pytest.fixture(scope="session")
def edge_lab():
    """Makes an `EdgeLab`."""
    return EdgeLab


@pytest.fixture(scope="session")
def make_circles():
    """Makes the calibration object."""
    return circles
