"""Scenes of the virtual lab: where the instrument stands and how it measures."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from itertools import zip_longest

import numpy as np

from sldvexp.errors import Checks, ConfigError, UserError, nearest
from sldvexp.geometry import KnownPose
from sldvexp.laser import MIRRORS, Mirror, TwoMirror
from sldvexp.targets import Target
from sldvexp.typing import Array
from sldvexp.units import AngleUnit
from sldvexp.virtual_lab.beam import SceneObject, Spot
from sldvexp.virtual_lab.mistakes import ViewMistakes
from sldvexp.virtual_lab.pointing import PointingTerms, Scanner


@dataclass
class MirrorError:
    """True calibration minus nominal one, of one mirror.

    Parameters
    ----------
    gain : float
        Relative, of the gain and of all powers; -2 is a mirror wired the other way round.
    zero : float, rad
    polynomial : list of float, rad
        Added to the coefficients of u^2, u^3 and so on, u the DAC step over the board's largest: a
        mirror that is not linear.
    """

    gain: float = 0.0
    zero: float = 0.0
    polynomial: list[float] = field(default_factory=list)

    def applied(self, nominal: Mirror) -> Mirror:
        """Apply the errors: the true mirror."""
        zero, gain, *powers = nominal.coefficients
        scale = 1.0 + self.gain
        polynomial = [
            scale * known + more
            for known, more in zip_longest(powers, self.polynomial, fillvalue=0.0)
        ]
        return Mirror(scale * gain, zero + self.zero, polynomial, AngleUnit.rad)


@dataclass
class MirrorErrors:
    """True mirrors minus nominal ones, and how they are off in a way that no calibration knows.

    Parameters
    ----------
    mirror_offset : float, m
        Added to the distance between the two axes.
    up_down, left_right : MirrorError
    swapped : bool
        The cables from the D/A board to the two mirrors are crossed.
    jitter : float, rad, optional
        Standard deviation of each mirror's angle, new at every pixel; by default as the scene's
        ``pointing`` says, as the next two.
    hysteresis : float, rad, optional
        By how much the angles differ that a mirror takes at one step from the two sides.
    drift : float, rad, optional
        Of both mirrors' angles in a hundred scan lines of a view.
    """

    mirror_offset: float = 0.0
    up_down: MirrorError = field(default_factory=MirrorError)
    left_right: MirrorError = field(default_factory=MirrorError)
    swapped: bool = False
    jitter: float | None = None
    hysteresis: float | None = None
    drift: float | None = None

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is no number."""
        checks.finite(f"{name}.mirror_offset", self.mirror_offset)
        checks.non_negative(f"{name}.jitter", self.jitter or 0.0)
        for key in ("hysteresis", "drift"):
            checks.finite(f"{name}.{key}", getattr(self, key) or 0.0)
        for mirror in MIRRORS:
            error = getattr(self, mirror)
            for key in ("gain", "zero"):
                checks.finite(f"{name}.{mirror}.{key}", getattr(error, key))
            checks.finite(f"{name}.{mirror}.polynomial", *error.polynomial)

    def applied(self, nominal: TwoMirror) -> TwoMirror:
        """Apply the errors: the true mirror."""
        try:
            return TwoMirror(
                mirror_offset=nominal.mirror_offset + self.mirror_offset,
                board=nominal.board,
                up_down=self.up_down.applied(nominal.up_down),
                left_right=self.left_right.applied(nominal.left_right),
            )
        except ConfigError as error:
            raise UserError(f"scene.mirrors makes true mirrors that cannot be: {error}") from None


@dataclass
class OpticalDistance:
    """Noise by the distance that the laser looks over.

    The modes of a laser tube come back in step only over certain distances, a tube's length apart.
    Between them fewer speckles send light back: the laser's noise and the pointing noise, as the
    place under the spot that is measured wanders, grow to
    ``worst ** sin(pi (distance - best) / period)**2`` times those at the best distances.

    Parameters
    ----------
    worst : float, optional
        That factor in the middle between two best distances; by default as the scene's ``pointing``
        says.
    best : float, m
        One of the best distances from the scanning mirror.
    period : float, m
        From one best distance to the next.
    """

    worst: float | None = None
    best: float = 1.79
    period: float = 0.2

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no laser can be."""
        worst = 1.0 if self.worst is None else self.worst
        message = f"must be 1 or more, not {worst}"
        checks.require(math.isfinite(worst) and worst >= 1, f"{name}.worst", message)
        checks.finite(f"{name}.best", self.best)
        checks.positive(f"{name}.period", self.period)

    def factor(self, distance: Array, worst: float) -> Array:
        """Compute the factor at each distance, m; 1 where the beam hits nothing."""
        away = np.where(np.isfinite(distance), distance - self.best, 0.0)
        return np.asarray(worst ** np.sin(np.pi * away / self.period) ** 2)


@dataclass
class Vibrometer:
    """From velocity to voltage, with what the instrument adds.

    Parameters
    ----------
    sensitivity : float, V per m/s
        100 mV per mm/s in the medium range (Section 3.1).
    full_scale : float, m/s
        Of that range: 10 V. Beyond it the output stays there and the status says so.
    noise : float
        Laser noise, root mean square over full scale: the 0.5 % of Section 2.3.
    bandwidth : float, Hz
        The noise is white up to here. Sampled more slowly than twice this, it folds and stays
        white with the same root mean square.
    drop_out : float
        Probability that a pixel loses its light to speckle for a random part of its samples; each
        record of a pixel that has several.
    burst : float
        Noise without light, root mean square over full scale.
    drop_out_reported : bool
        Whether the instrument says so in the pixel's status.
    unflagged : float
        Probability that speckle makes a pixel's velocity a wrong one, of a random size and phase at
        every frequency, and nothing in its samples shows it.
    unflagged_velocity : float, m/s
        Root mean square of the peak of such a velocity.
    distance : OpticalDistance
    harmonics : list of float
        Amplitudes of the second, third... harmonic over that of the fundamental; what is no sine
        gets what the same curved characteristic makes of it.
    hum : float, V
        Peak amplitude of the mains' 50 Hz in the velocity signal.
    """

    sensitivity: float = 100.0
    full_scale: float = 0.1
    noise: float = 0.005
    bandwidth: float = 20000.0
    drop_out: float = 0.0
    burst: float = 0.2
    drop_out_reported: bool = True
    unflagged: float = 0.0
    unflagged_velocity: float = 0.02
    distance: OpticalDistance = field(default_factory=OpticalDistance)
    harmonics: list[float] = field(default_factory=list)
    hum: float = 0.0

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no vibrometer can be."""
        for key in ("sensitivity", "full_scale", "bandwidth"):
            checks.positive(f"{name}.{key}", getattr(self, key))
        for key in ("noise", "burst", "hum", "unflagged_velocity"):
            checks.non_negative(f"{name}.{key}", getattr(self, key))
        told = f"is a part of full_scale, below 1, not {self.noise}: 0.005 is the usual 0.5 %"
        checks.require(not self.noise >= 1, f"{name}.noise", told)
        for i, value in enumerate(self.harmonics):
            checks.non_negative(f"{name}.harmonics[{i}]", value)
        for key in ("drop_out", "unflagged"):
            value = getattr(self, key)
            message = f"must be a probability from 0 to 1, not {value}"
            checks.require(0 <= value <= 1, f"{name}.{key}", message)
        self.distance.check(checks, f"{name}.distance")


@dataclass
class AnalogInput:
    """16-bit A/D converter of both channels.

    Parameters
    ----------
    velocity_range, reference_range : float, V
        Each channel converts -range to +range and stays at its last count beyond.
    reference_noise : float, V
        Root mean square of the reference channel's noise, white.
    reference_gain : float
        Reference signal over the excitation; 0 is a cable that is not plugged in.
    exchanged : bool
        The cables of the two channels are crossed.
    missed_trigger : float
        Probability that a record of a triggered excitation starts at any time instead.
    """

    velocity_range: float = 10.0
    reference_range: float = 5.0
    reference_noise: float = 0.001
    reference_gain: float = 1.0
    exchanged: bool = False
    missed_trigger: float = 0.0

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no converter can be."""
        checks.positive(f"{name}.velocity_range", self.velocity_range)
        checks.positive(f"{name}.reference_range", self.reference_range)
        checks.non_negative(f"{name}.reference_noise", self.reference_noise)
        checks.finite(f"{name}.reference_gain", self.reference_gain)
        missed = f"must be a probability from 0 to 1, not {self.missed_trigger}"
        checks.require(0 <= self.missed_trigger <= 1, f"{name}.missed_trigger", missed)


@dataclass
class SceneOperator:
    """Person at the instrument, and what was measured by hand.

    Parameters
    ----------
    pointing : float
        Standard deviation, in any direction across the beam, of the spot's center from the mark
        that it is pointed at, over the spot's radius (1/e^2). Whole DAC steps add to it. The eye
        cannot see a mark through the bright core of the spot, brighter than half its peak, out to
        0.59 radii; any place in that core looks right, which makes 0.59 / 2 along each axis.
    mark_error : bool
        Whether the true marks stand elsewhere than measured: every coordinate uniformly within its
        accuracy, and the same in all views.
    digitizer : float, m
        Standard deviation of each coordinate of one sample of the acoustic digitizer. Seven samples
        of three corners of the calibration object, 11 inches apart, then scatter the origin of
        Table 4.2 by 22, 22 and 6 mm (print: 24, 21 and 6).
    """

    pointing: float = 0.29
    mark_error: bool = True
    digitizer: float = 0.0026

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what nobody can be."""
        checks.non_negative(f"{name}.pointing", self.pointing)
        checks.non_negative(f"{name}.digitizer", self.digitizer)


@dataclass
class Scene(ABC):
    """Truth: everything that the program behind the instrument does not know.

    Parameters
    ----------
    views : dict of str to KnownPose
        Where the instrument truly stands in each view; world axes are the calibration object's.
    pointing : Scanner
        How well the scanner points; a term given in ``mirrors`` or ``vibrometer.distance`` takes
        the place of its own.
    mirrors : MirrorErrors
        How the true mirrors differ from those of the group ``laser``.
    spot : Spot
    vibrometer : Vibrometer
    digitizer : AnalogInput
    operator : SceneOperator
    mistakes : dict of str to ViewMistakes
        Mistakes in single views, by the view's name.
    noise : float
        Factor of the vibrometer's noise, with light and without, and of the reference channel's.
    generator_error : float
        By which part the generator's frequencies are too high.
    generator_gain : float
        Its true amplitude over the one that it was asked for; 0 is an output that stays off.
    shutter_open : bool
        Whether the laser's light leaves the instrument.
    residual : float, m/s per V of excitation
        Peak velocity along the world's z of everything that should rest.
    backdrop : bool
        Whether the beam beside all objects falls on something that rests, or is lost.
    """

    views: dict[str, KnownPose] = field(default_factory=dict)
    pointing: Scanner = Scanner.modern
    mirrors: MirrorErrors = field(default_factory=MirrorErrors)
    spot: Spot = field(default_factory=Spot)
    vibrometer: Vibrometer = field(default_factory=Vibrometer)
    digitizer: AnalogInput = field(default_factory=AnalogInput)
    operator: SceneOperator = field(default_factory=SceneOperator)
    mistakes: dict[str, ViewMistakes] = field(default_factory=dict)
    noise: float = 1.0
    generator_error: float = 0.0
    generator_gain: float = 1.0
    shutter_open: bool = True
    residual: float = 0.0
    backdrop: bool = True

    def __post_init__(self) -> None:
        checks = Checks()
        for name, view in self.views.items():
            _check_view(checks, f"views.{name}", view)
        self.mirrors.check(checks, "mirrors")
        self.spot.check(checks, "spot")
        self.vibrometer.check(checks, "vibrometer")
        self.digitizer.check(checks, "digitizer")
        self.operator.check(checks, "operator")
        self._check_mistakes(checks)
        slow = math.isfinite(self.generator_error) and self.generator_error > -1
        message = f"must be a finite number above -1, not {self.generator_error}"
        checks.require(slow, "generator_error", message)
        checks.non_negative("noise", self.noise)
        checks.non_negative("generator_gain", self.generator_gain)
        checks.finite("residual", self.residual)
        self.check(checks)
        checks.done()

    @property
    def pointing_terms(self) -> PointingTerms:
        """Terms of ``pointing``, those given one by one in their places."""
        own = {key: getattr(self.mirrors, key) for key in ("jitter", "hysteresis", "drift")}
        own["worst"] = self.vibrometer.distance.worst
        given = {key: value for key, value in own.items() if value is not None}
        return replace(self.pointing.value, **given)

    @property
    def mode_names(self) -> list[str]:
        """Names of the modes of what vibrates; none if it has no modes."""
        return []

    @property
    def noisy_vibrometer(self) -> Vibrometer:
        """Vibrometer with the scene's factor of noise."""
        v = self.vibrometer
        return replace(v, noise=self.noise * v.noise, burst=self.noise * v.burst)

    @property
    def noisy_digitizer(self) -> AnalogInput:
        """Converter with the scene's factor of noise."""
        d = self.digitizer
        return replace(d, reference_noise=self.noise * d.reference_noise)

    def check(self, checks: Checks) -> None:  # noqa: B027 (a scene need not have more to check)
        """Note what is wrong with the fields that a scene adds."""

    def _check_mistakes(self, checks: Checks) -> None:
        for view, mistakes in self.mistakes.items():
            name = f"mistakes.{view}"
            there = f"the scene has no view {view}; {nearest(view, self.views)}"
            checks.require(view in self.views, name, there)
            mistakes.check(checks, name)
            other = mistakes.seen_from
            there = f"the scene has no view {other}; {nearest(other, self.views)}"
            checks.require(not other or other in self.views, f"{name}.seen_from", there)
            for mode in mistakes.modes:
                there = f"the scene has no mode {mode}; {nearest(mode, self.mode_names)}"
                checks.require(mode in self.mode_names, f"{name}.modes", there)

    @abstractmethod
    def objects(self, target: Target | None, rng: np.random.Generator) -> list[SceneObject]:
        """List everything that the beam can hit.

        Parameters
        ----------
        target : Target or None
            The calibration object as the experiment knows it.
        rng : numpy.random.Generator
            For how the true objects differ from what is known of them.

        Raises
        ------
        UserError
            If the scene does not fit the target.
        """


def _check_view(checks: Checks, name: str, view: KnownPose) -> None:
    view.check(checks, name)
    uncertain = bool(view.euler_std or view.origin_std or view.samples)
    checks.require(not uncertain, name, "is a true pose: it has no standard deviations or samples")
