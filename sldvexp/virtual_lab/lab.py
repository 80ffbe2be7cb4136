"""Virtual lab: an instrument in front of a scene, and the truth about both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.config.registry import register
from sldvexp.errors import UserError, nearest
from sldvexp.instrument import Acquisition, Instrument, InstrumentError, RawSamples, ScanningPlugin
from sldvexp.instrument.person import Mark, Place, Steps
from sldvexp.laser import MIRRORS, TwoMirror, project
from sldvexp.signal import ExcitationKind
from sldvexp.targets import Target
from sldvexp.typing import Array, BoolArray, ComplexArray, IntArray
from sldvexp.virtual_lab import camera
from sldvexp.virtual_lab.ahead import BLOCK, AnnouncedLines, Stretch, drawn
from sldvexp.virtual_lab.beam import Beams, SceneObject, beams
from sldvexp.virtual_lab.calibration_scene import CalibrationObject
from sldvexp.virtual_lab.electronics import Electronics, PixelNoise
from sldvexp.virtual_lab.plate import VibratingPlate
from sldvexp.virtual_lab.pointing import MirrorPath, errors_along
from sldvexp.virtual_lab.scene import Scene
from sldvexp.virtual_lab.transients import DIFFERENT, Transients, long_period


class VirtualLab:
    """A scanning vibrometer in a scene; an `Instrument` that runs in this process.

    Parameters
    ----------
    scene : Scene
    laser : TwoMirror
        The mirrors as the experiment knows them; the scene says how the true ones differ.
    target : Target, optional
        The calibration object as the experiment knows it.
    seed : int or sequence of int
        Of everything random: two labs of one seed are the same.

    Raises
    ------
    UserError
        If the scene does not fit the target.
    """

    def __init__(
        self,
        scene: Scene,
        laser: TwoMirror,
        target: Target | None = None,
        seed: int | Sequence[int] = 0,
    ) -> None:
        if not scene.views:
            raise UserError(
                "scene.views: give at least one view, where the instrument stands; sldvexp-lab "
                "takes rough poses of the scan too, as scan.poses of scan=session"
            )
        self.scene = scene
        self.mirrors = scene.mirrors.applied(laser)
        self._pointing = scene.pointing_terms
        self.position = (0, 0)
        self.shutter_open = scene.shutter_open
        self._seed = [seed] if isinstance(seed, int) else list(seed)
        rng = np.random.default_rng(np.random.SeedSequence([*self._seed, len(self._seed)]))
        self.objects = scene.objects(target, rng)
        self._acquisition: Acquisition | None = None
        self._moved: tuple[object, Transients] | None = None
        self._announced = AnnouncedLines(self._checked, self._way, self._block)
        self.start_stream(0)
        self.use_view(next(iter(scene.views)))

    def __enter__(self) -> VirtualLab:
        return self

    def __exit__(self, *exception: object) -> None:
        self.home()

    def use_view(self, name: str) -> None:
        """Stand where a view says; UserError if the scene has no such view."""
        rotation, origin = self.true_pose(name)
        self.view = name
        self._announced.forget()
        self._rotation, self._origin = rotation, origin
        self._pictured: NDArray[np.uint8] | None = None
        self._noise = PixelNoise(self._seed, name)
        self._jitter = PixelNoise(self._seed, f"{name}\0jitter")
        self._speckle = PixelNoise(self._seed, f"{name}\0speckle")
        self._trigger = PixelNoise(self._seed, f"{name}\0trigger")
        self._mistakes = self.scene.mistakes.get(name)

    def start_stream(self, stream: int) -> None:
        """Let the pixels that follow be those of a scan line, counted from 0.

        A pixel's noise depends on the seed, the view, the number of samples, `stream` and the
        pixel's place in it, and on nothing else: a line that is measured again under its own
        number comes out the same to the bit, another number gives new noise.

        Parameters
        ----------
        stream : int
            From 0 to 2^64 - 1.
        """
        self._stream, self._pixel = stream, 0
        self._path = self._way(stream)

    def _way(self, stream: int) -> MirrorPath:
        return MirrorPath(self._pointing, self.mirrors, stream)

    def configure(self, acquisition: Acquisition) -> None:
        """Set sampling and generator for all pixels that follow."""
        a = acquisition
        numbers = [a.rate, a.amplitude, *a.excitation]
        if not (a.rate > 0 and a.samples > 0 and np.isfinite(numbers).all()):
            raise InstrumentError(f"configure: rate and samples must be positive numbers, not {a}")
        if a.amplitude < 0 or any(f <= 0 for f in a.excitation):
            raise InstrumentError(
                f"configure: frequencies must be positive and the amplitude not negative, not {a}"
            )
        self._announced.forget()
        a = self._acquisition = replace(a, amplitude=a.amplitude * self.scene.generator_gain)
        self._frequency = np.array(a.excitation, float) * (1.0 + self.scene.generator_error)
        scene = self.scene
        self._electronics = Electronics(
            scene.noisy_vibrometer, scene.noisy_digitizer, a, self._frequency
        )

    def home(self) -> None:
        """Send the mirrors to step 0 and switch the generator off."""
        self.position = (0, 0)
        if self._acquisition is not None:
            self.configure(Acquisition(self._acquisition.rate, self._acquisition.samples, ()))

    def move(self, dac: Sequence[int]) -> None:
        """Point the beam at (up_down, left_right) in DAC steps."""
        steps = self._checked(np.reshape(dac, (1, -1)))
        self.position = (int(steps[0, 0]), int(steps[0, 1]))

    def acquire(self) -> RawSamples:
        """Sample one pixel where the beam stands."""
        return self.scan(np.array([self.position]))

    def scan(self, dac: ArrayLike, stream: int | None = None) -> RawSamples:
        """Move to and sample a list of pixels.

        Parameters
        ----------
        dac : array_like of int, shape (pixel, 2)
        stream : int, optional
            Number of the scan line that this list begins, see `start_stream`; without it the
            pixels go on where the last ones ended.

        Raises
        ------
        InstrumentError
            If nothing was configured, or the board has no such steps.
        """
        if self._acquisition is None:
            raise InstrumentError("scan: the instrument was not configured; call configure first")
        steps = self._checked(np.asarray(dac))
        if stream is not None:
            self.start_stream(stream)
        records = self._acquisition.records
        counts = np.empty((len(steps) * records, 2, self._acquisition.samples), np.int16)
        status = np.empty(len(steps) * records, np.uint8)
        moving = self._acquisition.drive is not None
        usual = self.shutter_open and records == 1 and not moving
        known = self._announced.line(steps, stream) if usual and stream is not None else None
        if known is not None:
            counts, status, self._path, self._pixel = *known, len(steps)
        visits = steps if moving else np.repeat(steps, records, axis=0)
        block, each = (self._moving_block, records) if moving else (self._here, 1)
        for begin in range(0, len(visits) if known is None else 0, BLOCK):
            end = min(begin + BLOCK, len(visits))
            counts[begin * each : end * each], status[begin * each : end * each] = block(
                visits[begin:end]
            )
        if len(steps):
            self.position = (int(steps[-1, 0]), int(steps[-1, 1]))
        scales = self._electronics.volts_per_count
        return RawSamples(counts, scales, self._acquisition.rate, status, records)

    def expect(self, lines: Sequence[tuple[IntArray, int]]) -> None:
        """Hear of lines that are going to be scanned; they come out the same, to the bit."""
        self._announced.expect(lines)

    def true_pose(self, view: str) -> tuple[Array, Array]:
        """Return rotation (3, 3), world to laser, and origin (3,), m, of a view."""
        if view not in self.scene.views:
            raise UserError(f"the scene has no view {view}; {nearest(view, self.scene.views)}")
        pose = self.scene.views[view]
        return pose.rotation, pose.place

    def true_dac(self, points: ArrayLike) -> Array:
        """Find DAC steps, not rounded, that point the beam at points of the world from this view.

        Parameters
        ----------
        points : array_like, shape (..., 3), m

        Returns
        -------
        ndarray, shape (..., 2), steps
            For the true mirrors and wiring.
        """
        in_laser = (np.asarray(points, float) - self._origin) @ self._rotation.T
        dac = self.mirrors.dac_from_angle(project(in_laser, self.mirrors.mirror_offset))
        return dac[..., ::-1] if self.scene.mirrors.swapped else dac

    def true_edge(self, circle: int, azimuth: ArrayLike) -> Array:
        """Find where the edge of a circle lies in this view, machining errors included.

        Parameters
        ----------
        circle : int
            Its number.
        azimuth : array_like, shape (...), rad
            Angles from the x axis of the circle's plane.

        Returns
        -------
        ndarray, shape (..., 2), steps
            Not rounded.
        """
        return self.true_dac(self.calibration_object.edge(circle, np.asarray(azimuth)))

    def true_velocity(self, dac: ArrayLike, frequency: Array) -> ComplexArray:
        """Compute what moves along the beams of DAC steps from this view, without any mistake.

        Parameters
        ----------
        dac : array_like, shape (pixel, 2), steps
        frequency : ndarray, shape (tone,), Hz

        Returns
        -------
        ndarray of complex, shape (pixel, tone), m/s per V of excitation
        """
        light = self.light(dac)
        seen = [thing.seen(light, frequency) for thing in self.objects]
        distance = np.stack([d for d, _ in seen])
        velocity = np.stack([v for _, v in seen])[
            distance.argmin(axis=0), np.arange(len(light.origin))
        ]
        hit = np.isfinite(distance.min(axis=0))[:, None]
        return np.where(hit, velocity, -light.direction[:, 2:] * self.scene.residual)

    def light(self, dac: ArrayLike) -> Beams:
        """Send the beams of DAC steps, whole or not, shape (beam, 2), from this view."""
        return self._beams(np.asarray(dac), (self._rotation, self._origin))

    def spot(self) -> Array:
        """Find where the beam falls now, shape (3,), m; UserError if on no object."""
        light = self.light([self.position])
        distance = min(float(o.seen(light, np.zeros(0))[0][0]) for o in self.objects)
        if not np.isfinite(distance):
            up_down, left_right = self.position
            raise UserError(
                f"in the view {self.view} the beam at ({up_down}, {left_right}) falls on nothing "
                "that the virtual lab has; send it elsewhere"
            )
        return light.origin[0] + distance * light.direction[0]

    def read_position(self) -> tuple[int, int]:
        """See `sldvexp.instrument.bench.TellsAtBench`."""
        return self.position

    def light_level(self) -> float:
        """See `sldvexp.instrument.bench.TellsAtBench`; less where the laser is noisier."""
        steps = np.array([self.position])
        light = self.light(steps)
        distance = np.min([o.seen(light, np.zeros(0))[0] for o in self.objects], axis=0)
        if not self.shutter_open or not (np.isfinite(distance[0]) or self.scene.backdrop):
            return 0.0
        noisier = self._noisier(steps)
        return 1.0 if noisier is None else 1.0 / float(noisier[0])

    def picture(self) -> NDArray[np.uint8]:
        """See `sldvexp.instrument.bench.TellsAtBench`: a camera that looks along the laser."""
        rotation, origin = self._rotation, self._origin
        if self._pictured is None:
            self._pictured = camera.photograph(self.objects, rotation, origin)
        if not self.shutter_open:
            return self._pictured
        light = self.light(np.array([self.position]))
        distance = np.min([o.seen(light, np.zeros(0))[0] for o in self.objects], axis=0)
        away = np.where(np.isfinite(distance), distance, camera.BACKDROP)[:, None]
        (spot,) = light.origin + away * light.direction
        return camera.with_spot(self._pictured, (spot - origin) @ rotation.T)

    def generator(self, what: str) -> np.random.Generator:
        """Make a generator of random numbers that belong to a name, whatever was drawn before."""
        entropy = [len(self._seed), *self._seed, *what.encode()]
        return np.random.default_rng(np.random.SeedSequence(entropy))

    @property
    def person(self) -> SimulatedPerson:
        """Who points the beam by eye and holds the digitizer."""
        return SimulatedPerson(self)

    @property
    def calibration_object(self) -> CalibrationObject:
        """True calibration object; UserError if there is none."""
        found = [o for o in self.objects if isinstance(o, CalibrationObject)]
        if not found:
            raise UserError("the virtual lab has no calibration object; choose a target of circles")
        return found[0]

    @property
    def plate(self) -> VibratingPlate:
        """True plate with its `velocity` and `strain`; UserError if there is none."""
        found = [o for o in self.objects if isinstance(o, VibratingPlate)]
        if not found:
            raise UserError("the virtual lab has no plate; choose scene=plate")
        return found[0]

    def _checked(self, dac: IntArray) -> IntArray:
        """Check the steps, if the board has them."""
        if dac.ndim != 2 or dac.shape[1] != len(MIRRORS) or dac.dtype.kind not in "iu":
            raise InstrumentError(
                f"move: needs pairs of whole DAC steps (up_down, left_right), not an array of "
                f"{dac.dtype} and shape {dac.shape}"
            )
        low, high = self.mirrors.board.value
        if dac.size and (dac.min() < low or dac.max() > high):
            pixel, mirror = np.argwhere((dac < low) | (dac > high))[0]
            raise InstrumentError(
                f"move: pixel {pixel} asks for {MIRRORS[mirror]} step {dac[pixel, mirror]}, but "
                f"the board has {low} to {high}"
            )
        return dac

    def _wired(self, dac: NDArray[Any]) -> NDArray[Any]:
        """Give the steps as the mirrors get them."""
        return dac[:, ::-1] if self.scene.mirrors.swapped else dac

    def _beams(
        self, dac: NDArray[Any], pose: tuple[Array, Array], error: Array | None = None
    ) -> Beams:
        return beams(self.mirrors, self._wired(dac), *pose, self.scene.spot, error)

    def _here(self, dac: IntArray) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
        """Acquire counts and status of at most BLOCK pixels, the next of the line."""
        stretch = Stretch(self._stream, self._pixel, len(dac))
        self._pixel += len(dac)
        return self._block(dac, [stretch], [self._path])

    def _block(
        self, dac: IntArray, stretches: Sequence[Stretch], paths: Sequence[MirrorPath]
    ) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
        """Acquire counts and status of at most BLOCK pixels, of one line or of several."""
        assert self._acquisition is not None
        n, samples = len(dac), self._acquisition.samples
        filled = dac[np.minimum(np.arange(BLOCK), n - 1)]
        noisier = self._noisier(filled)
        error = self._pointing_error(filled, noisier, stretches, paths)
        velocity, lit = self._look(filled, error)
        uniform, normal = drawn(self._noise, stretches, samples)
        velocity *= self._acquisition.amplitude
        self._spoil_by_speckle(velocity[:n], stretches)
        own = None if noisier is None else noisier[:n]
        return self._electronics.record(velocity, lit, uniform, normal, own)

    def _moving_block(self, dac: IntArray) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
        """Acquire all records of at most BLOCK pixels that move in any way."""
        a, n = self._acquisition, len(dac)
        assert a is not None
        assert a.drive is not None
        filled = dac[np.minimum(np.arange(BLOCK), n - 1)]
        noisier = self._noisier(filled)
        stretch = Stretch(self._stream, self._pixel, n)
        error = self._pointing_error(filled, noisier, [stretch], [self._path])
        coefficient, lit = self._terms(filled, error)
        self._spoil_terms(coefficient[:n])
        motion = self._motion()
        power = motion.power(coefficient)
        found = []
        for pixel in range(n):
            first = (self._pixel + pixel) * a.records
            uniform, normal = self._noise.draw(self._stream, first, a.records, a.samples)
            begins = self._starts(first, float(uniform[0, 0]), len(motion.played))
            rows = [motion.record(coefficient[pixel], begin, a.samples) for begin in begins]
            velocity, played = (np.stack(each) for each in zip(*rows, strict=True))
            own = None if noisier is None else np.full(a.records, noisier[pixel])
            seen = np.full(a.records, lit[pixel])
            how = (float(power[pixel]), seen, (uniform, normal), own)
            found.append(self._electronics.record_motion(velocity, played, *how))
        self._pixel += n
        counts, status = zip(*found, strict=True)
        return np.concatenate(counts), np.concatenate(status)

    def _starts(self, first: int, chance: float, length: int) -> IntArray:
        """Choose where in the long period a pixel's records start, by a number in [0, 1)."""
        a = self._acquisition
        assert a is not None
        assert a.drive is not None
        begin = a.samples * int(chance * (length // a.samples))
        found = (begin if a.triggered else int(chance * length)) + a.samples * np.arange(a.records)
        if a.drive.excitation.kind is ExcitationKind.hammer:
            found = np.zeros(a.records, np.int64)  # each blow is one of its own
        missed = self.scene.digitizer.missed_trigger
        if a.triggered and missed:
            uniform, _ = self._trigger.draw(self._stream, first, a.records, 1)
            anywhere = (uniform[:, 1] * length).astype(np.int64)
            found = np.where(uniform[:, 0] < missed, anywhere, found)
        return found

    def _motion(self) -> Transients:
        """Compute, once a view and acquisition, how all terms move; the last is flat: the rest."""
        a = self._acquisition
        assert a is not None
        assert a.drive is not None
        key = (self.view, a.drive, -(-a.records // DIFFERENT))
        if self._moved is None or self._moved[0] != key:
            played = self.scene.generator_gain * long_period(a.drive, a.records)
            self._moved = key, Transients.computed(played, a.rate, self._spectra)
        return self._moved[1]

    def _spectra(self, frequency: Array) -> ComplexArray:
        """Compute the spectra of the terms of all objects, and of what rests, (term, line)."""
        mistakes, rows = self._mistakes, []
        for thing in self.objects:
            if mistakes is None or thing.calibrates:
                rows.append(thing.spectra(frequency))
            else:
                spoilt = thing.in_modes(mistakes.modes)
                rows.append(spoilt.spectra(mistakes.frequency * frequency))
        rows.append(np.ones((1, len(frequency)), complex))
        every = np.concatenate(rows)
        return every if mistakes is None else mistakes.recorded(every, frequency)

    def _terms(self, dac: IntArray, error: Array | None) -> tuple[Array, BoolArray]:
        """Look along the beams: coefficients (pixel, term), and whether light comes back."""
        light = self._beams(dac, (self._rotation, self._origin), error)
        seen = []
        for thing in self.objects:
            mistakes = self._mistakes
            if mistakes is None or thing.calibrates:
                seen.append(thing.terms(light))
            else:
                pose = mistakes.knocked(*self.true_pose(mistakes.seen_from or self.view))
                seen.append(thing.terms(self._beams(dac, pose, error)))
        distance = np.stack([d for d, _ in seen])
        first, hit = distance.argmin(axis=0), np.isfinite(distance.min(axis=0))
        own = [c * (hit & (first == k))[:, None] for k, (_, c) in enumerate(seen)]
        resting = np.where(hit, 0.0, -light.direction[:, 2] * self.scene.residual)
        coefficient = np.concatenate([*own, resting[:, None]], axis=1)
        return coefficient, (hit | self.scene.backdrop) & self.shutter_open

    def _spoil_terms(self, coefficient: Array) -> None:
        """Let some pixels, (pixel, term), follow the excitation in a random size instead."""
        v = self.scene.vibrometer
        if not v.unflagged:
            return
        uniform, normal = self._speckle.draw(self._stream, self._pixel, len(coefficient), 1)
        wrong = uniform[:, 0] < v.unflagged
        coefficient[wrong] = 0.0
        coefficient[wrong, -1] = normal[wrong, 0, 0] * v.unflagged_velocity

    def _noisier(self, dac: IntArray) -> Array | None:
        """Compute the factor of noise by the distance of what the beams hit, shape (pixel,)."""
        if self._pointing.worst == 1:
            return None
        light = self.light(dac)
        distance = np.min([o.seen(light, np.zeros(0))[0] for o in self.objects], axis=0)
        return self.scene.vibrometer.distance.factor(distance, self._pointing.worst)

    def _pointing_error(
        self,
        dac: IntArray,
        noisier: Array | None,
        stretches: Sequence[Stretch],
        paths: Sequence[MirrorPath],
    ) -> Array | None:
        """Find how far the angles are off at the pixels of stretches, the rest as the last."""
        if not self._pointing.moves:
            return None
        normal = drawn(self._jitter, stretches, 1)[1].astype(float)
        n = len(normal)
        jitter = normal[:, :, 0] * (1.0 if noisier is None else noisier[:n, None])
        pixels = [stretch.pixels for stretch in stretches]
        error = errors_along(paths, self._wired(dac[:n]), jitter, pixels)
        return error[np.minimum(np.arange(len(dac)), n - 1)]

    def _spoil_by_speckle(self, velocity: ComplexArray, stretches: Sequence[Stretch]) -> None:
        """Replace the velocities (pixel, tone) of some pixels by random ones."""
        v = self.scene.vibrometer
        if not v.unflagged:
            return
        uniform, normal = drawn(self._speckle, stretches, velocity.shape[1])
        wrong = uniform[:, 0] < v.unflagged
        random = (normal[:, 0] + 1j * normal[:, 1]) * v.unflagged_velocity / math.sqrt(2.0)
        velocity[wrong] = random[wrong]

    def _look(self, dac: IntArray, error: Array | None) -> tuple[ComplexArray, BoolArray]:
        """Look along the beams: velocity (pixel, tone), m/s per V, and whether light comes back."""
        light = self._beams(dac, (self._rotation, self._origin), error)
        seen = [self._seen(o, light, dac, error) for o in self.objects]
        distance = np.stack([d for d, _ in seen])
        first = distance.argmin(axis=0)
        hit = np.isfinite(distance.min(axis=0))
        resting = -light.direction[:, 2] * self.scene.residual
        velocity = np.stack([v for _, v in seen])[first, np.arange(len(dac))]
        velocity = np.where(hit[:, None], velocity, resting[:, None])
        if self._mistakes is not None:
            velocity = self._mistakes.recorded(velocity, self._frequency)
        return velocity, (hit | self.scene.backdrop) & self.shutter_open

    def _seen(
        self, thing: SceneObject, light: Beams, dac: IntArray, error: Array | None
    ) -> tuple[Array, ComplexArray]:
        """Compute distance and velocity of one object; mistakes are made with the structure."""
        mistakes = self._mistakes
        if mistakes is None or thing.calibrates:
            return thing.seen(light, self._frequency)
        pose = mistakes.knocked(*self.true_pose(mistakes.seen_from or self.view))
        light = self._beams(dac, pose, error)
        return thing.in_modes(mistakes.modes).seen(light, mistakes.frequency * self._frequency)


@register("instrument", "simulated")
@dataclass
class Simulated(ScanningPlugin):
    """A scene's virtual lab, without a socket."""

    real = False

    def open(
        self,
        scene: Any,
        laser: TwoMirror,
        target: Target | None = None,
        seed: int = 0,
        view: str = "",
    ) -> AbstractContextManager[Instrument]:
        """See `ScanningPlugin`.

        Raises
        ------
        UserError
            If there is no scene, or it has no such view or does not fit the target.
        """
        if scene is None:
            raise UserError("instrument=simulated needs a scene; choose scene=calibration or plate")
        lab = VirtualLab(scene, laser, target, seed)
        if view:
            lab.use_view(view)
        return lab


class SimulatedPerson:
    """A `Person` who knows the truth but for the errors that the scene states.

    Errors belong to the seed, the view and the mark or spot: who points again points the same.

    Parameters
    ----------
    lab : VirtualLab
    """

    def __init__(self, lab: VirtualLab) -> None:
        self.lab = lab

    def true_position(self, mark: Mark) -> np.ndarray:
        """Find where a mark truly stands, shape (3,), m.

        Within its accuracy, from anywhere the same.
        """
        if not self.lab.scene.operator.mark_error:
            return mark.position
        bound = math.sqrt(3.0) * mark.std
        return mark.position + bound * self.lab.generator(f"mark {mark.number}").uniform(-1, 1, 3)

    def aim(self, mark: Mark, start: Steps) -> Steps:
        """See `Person`; all marks can be seen from everywhere."""
        lab = self.lab
        true = self.true_position(mark)
        light = lab.light(lab.true_dac(true)[None])
        radius = light.radius(np.linalg.norm(true - light.origin, axis=1))
        rng = lab.generator(f"aim at {mark.number} in {lab.view}")
        # The part of it along the beam moves nothing.
        off = lab.scene.operator.pointing * radius * rng.standard_normal(3)
        up_down, left_right = np.rint(lab.true_dac(true + off)).astype(int).tolist()
        lab.move((up_down, left_right))
        return up_down, left_right

    def digitise(self, spot: int, samples: int) -> list[Place]:
        """See `Person`."""
        rng = self.lab.generator(f"digitise {spot} in {self.lab.view}")
        error = self.lab.scene.operator.digitizer * rng.standard_normal((samples, 3))
        return [(x, y, z) for x, y, z in (self.lab.spot() + error).tolist()]
