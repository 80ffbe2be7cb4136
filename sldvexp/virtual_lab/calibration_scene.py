"""`scene=calibration`: the calibration object, its speakers moving behind resting washers.

The calibration object: speakers that move behind resting washers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sldvexp.config.registry import name_of, register
from sldvexp.errors import Checks, UserError, nearest
from sldvexp.targets import Circles, Target
from sldvexp.typing import Array, ComplexArray, IntArray
from sldvexp.virtual_lab.beam import Beams, SceneObject, part_inside
from sldvexp.virtual_lab.scene import Scene


@dataclass
class Speaker:
    """A speaker, moving as a piston along the normal of its washer's plane.

    Parameters
    ----------
    velocity : float, m/s per V of excitation
        Peak; 0 is a dead speaker.
    phase : float, rad
        Of the velocity towards the viewer, relative to the excitation.
    """

    velocity: float = 0.01
    phase: float = 0.0

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no speaker can be."""
        checks.non_negative(f"{name}.velocity", self.velocity)
        checks.finite(f"{name}.phase", self.phase)


@dataclass
class CircleError:
    """True circle minus the one that the target describes.

    Parameters
    ----------
    x, y, height : float, m
        Of its center, along its plane's own axes.
    diameter : float, m
    """

    x: float = 0.0
    y: float = 0.0
    height: float = 0.0
    diameter: float = 0.0

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is no number."""
        for key in ("x", "y", "height", "diameter"):
            checks.finite(f"{name}.{key}", getattr(self, key))


@register("scene", "calibration")
@dataclass
class CalibrationScene(Scene):
    """Calibration object of Section 4.4 in front of the instrument.

    Parameters
    ----------
    speaker : Speaker
        Behind every circle that `speakers` does not list.
    speakers : dict of int to Speaker
        Other speakers, by the circle's number.
    washer : float, m
        Width of the resting rim around every circle; it hides what is behind.
    machine_error : bool
        Whether the true circles differ from the configured ones by as much as the machine that
        measured them may err: every coordinate, diameter and height, uniformly within +-accuracy.
    circle_errors : dict of int to CircleError
        By how much more single circles differ from the configured ones, by their numbers.
    scale : float
        True size of the object over that of ``target``, about the origin of the world.
    mirrored : bool
        The true object is the mirror image of ``target``, left and right of its middle.
    """

    speaker: Speaker = field(default_factory=Speaker)
    speakers: dict[int, Speaker] = field(default_factory=dict)
    washer: float = 0.01
    machine_error: bool = True
    circle_errors: dict[int, CircleError] = field(default_factory=dict)
    scale: float = 1.0
    mirrored: bool = False

    def check(self, checks: Checks) -> None:
        """Note what is wrong with the speakers and washers."""
        self.speaker.check(checks, "speaker")
        for number, speaker in self.speakers.items():
            speaker.check(checks, f"speakers.{number}")
        for number, error in self.circle_errors.items():
            error.check(checks, f"circle_errors.{number}")
        checks.non_negative("washer", self.washer)
        checks.positive("scale", self.scale)

    def objects(self, target: Target | None, rng: np.random.Generator) -> list[SceneObject]:
        """Make the calibration object."""
        if not isinstance(target, Circles):
            found = (name_of(type(target)) or "target/null").partition("/")[2]
            raise UserError(
                f"the virtual lab's calibration object needs circles, but target is {found}; "
                "choose target=dissertation or another target of circles"
            )
        for key in ("speakers", "circle_errors"):
            for number in getattr(self, key):
                if number not in target.circles:
                    numbers = (str(n) for n in target.circles)
                    raise UserError(
                        f"scene.{key}.{number}: the calibration object has no circle {number}; "
                        f"{nearest(str(number), numbers)}"
                    )
        speakers = {n: self.speakers.get(n, self.speaker) for n in target.circles}
        errors = rng if self.machine_error else None
        built = CalibrationObject.built(target, speakers, self.washer, self.residual, errors)
        if self.circle_errors:
            built = built.with_errors(self.circle_errors)
        if self.scale != 1:
            built = replace(
                built, center=self.scale * built.center, radius=self.scale * built.radius
            )
        return [built.mirror_image() if self.mirrored else built]


@dataclass(frozen=True, eq=False)
class CalibrationObject(SceneObject):
    """Washers with speakers behind their holes, all infinitely thin.

    Parameters
    ----------
    number : ndarray of int, shape (circle,)
    center : ndarray, shape (circle, 3), m
    axes : ndarray, shape (circle, 3, 3)
        x, y and normal of each circle's plane as unit rows.
    radius : ndarray, shape (circle,), m
        Of the holes.
    velocity : ndarray of complex, shape (circle,), m/s per V
        Of the speakers along the normal.
    washer : float, m
        Width of the rims.
    residual : float, m/s per V
        Of the rims, along the world's z.
    """

    calibrates = True

    number: IntArray
    center: Array
    axes: Array
    radius: Array
    velocity: ComplexArray
    washer: float
    residual: float

    @classmethod
    def built(
        cls,
        circles: Circles,
        speakers: Mapping[int, Speaker],
        washer: float,
        residual: float,
        rng: np.random.Generator | None,
    ) -> CalibrationObject:
        """Make the object of a configuration; a `rng` draws the errors of its machining."""
        known = [circles.circles[n] for n in speakers]
        planes = [circles.planes[c.plane] for c in known]
        measured = np.array([[c.x, c.y, 0.0, c.diameter] for c in known])
        if rng is not None:
            measured += rng.uniform(-circles.accuracy, circles.accuracy, measured.shape)
        axes = np.stack([plane.axes() for plane in planes])
        origin = np.array([plane.origin for plane in planes])
        center = origin + np.einsum("ck,ckj->cj", measured[:, :3], axes)
        unit = circles.unit.value
        velocity = [s.velocity * np.exp(1j * s.phase) for s in speakers.values()]
        return cls(
            number=np.array(list(speakers)),
            center=unit * center,
            axes=axes,
            radius=unit * measured[:, 3] / 2,
            velocity=np.array(velocity),
            washer=washer,
            residual=residual,
        )

    def terms(self, beams: Beams) -> tuple[Array, Array]:
        """See `SceneObject`: parts in phase and in quadrature of the mean velocity under the spot.

        The distance is that to the nearest washer.
        """
        distance, circle = self._nearest(beams)
        if not np.isfinite(distance).any():  # as of whole blocks that look elsewhere
            return distance, np.zeros((len(distance), 2))
        hit = np.where(np.isfinite(distance), distance, 0.0)
        normal, speaker = self.axes[circle, 2], self.velocity[circle]
        away = beams.origin + hit[:, None] * beams.direction - self.center[circle]
        from_center = np.linalg.norm(away, axis=-1)
        outward = away / np.maximum(from_center, np.finfo(float).tiny)[:, None]
        radius = self.radius[circle]
        moving = part_inside(
            from_center, outward, normal, radius, beams.direction, beams.radius(hit)
        )
        to_instrument = -beams.direction
        piston = speaker * (normal * to_instrument).sum(-1)
        resting = self.residual * to_instrument[:, 2]
        mean = moving * piston + (1.0 - moving) * resting
        return distance, np.stack([mean.real, mean.imag], axis=1)

    def spectra(self, frequency: Array) -> ComplexArray:
        """See `SceneObject`: speakers follow every frequency alike."""
        return np.repeat([[1.0], [1j]], len(frequency), axis=1)

    def with_errors(self, errors: Mapping[int, CircleError]) -> CalibrationObject:
        """Move and widen single circles, by their numbers."""
        off = [errors.get(int(n), CircleError()) for n in self.number]
        moved = np.array([[e.x, e.y, e.height] for e in off])
        wider = np.array([e.diameter for e in off]) / 2
        center = self.center + np.einsum("ck,ckj->cj", moved, self.axes)
        return replace(self, center=center, radius=self.radius + wider)

    def mirror_image(self) -> CalibrationObject:
        """Exchange left and right of the object about the middle of its circles."""
        middle = self.center[:, 0].mean()
        flip = np.array([-1.0, 1.0, 1.0])
        center = self.center * flip + [2 * middle, 0.0, 0.0]
        return replace(self, center=center, axes=self.axes * flip)

    def edge(self, number: int, azimuth: Array) -> Array:
        """Compute points on a circle's edge, at angles from its plane's x axis, (..., 3), m."""
        i = self.number.tolist().index(number)
        x, y, _ = self.axes[i]
        angle = np.asarray(azimuth, float)[..., None]
        return self.center[i] + self.radius[i] * (np.cos(angle) * x + np.sin(angle) * y)

    def _nearest(self, beams: Beams) -> tuple[Array, IntArray]:
        """Find the distance to the nearest washer that each beam hits, and which one it is."""
        normal = self.axes[:, 2]
        height = np.einsum("bcj,cj->bc", self.center - beams.origin[:, None], normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = height / (beams.direction @ normal.T)
            hit = beams.origin[:, None] + distance[..., None] * beams.direction[:, None]
            from_center = np.linalg.norm(hit - self.center, axis=-1)
            misses = ~((from_center <= self.radius + self.washer) & (distance > 0))
        distance = np.where(misses, np.inf, distance)
        circle = distance.argmin(axis=1)
        return np.take_along_axis(distance, circle[:, None], axis=1)[:, 0], circle
