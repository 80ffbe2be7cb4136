"""Complex pixels: the velocity's phasor relative to the phase of the reference channel.

With phasors V and R of ``exp(+i w t)`` a pixel is ``V conj(R) / |R|`` (Eqs 3.11 to 3.17): it lags
the reference by its own phase, whenever the record began. The errors of V and R are taken to be
independent. The noise of the reference turns the pixel by ``Im(e conj(R)) / |R|^2`` and so adds
``|pixel|^2 var(phase)`` across the pixel's direction, nothing along it. A wrong frequency turns V
and R alike and cancels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.errors import UserError
from sldvexp.signal.channel import ChannelFit, fit_channel, squared
from sldvexp.signal.frequency import Refined
from sldvexp.signal.harmonics import fit_while_significant
from sldvexp.signal.pixel_quality import Flag, FlagRules, Intercept
from sldvexp.signal.projection import Projection, project
from sldvexp.signal.sine_model import SineModel
from sldvexp.typing import Array, BoolArray, ComplexArray

#: Variance of a phase that is not known at all: uniform over the circle.
UNKNOWN_PHASE = np.pi**2 / 3


@dataclass(frozen=True, repr=False)
class ComplexImage:
    """Pixels of one view, flagged ones included.

    Attributes
    ----------
    velocity : ndarray of complex, shape (pixel, frequency), m/s
        Peak amplitude, exp(+i w t), phase relative to the reference, positive towards the
        instrument.
    phase_variance : ndarray, shape (pixel, frequency), rad2
        Of the reference's phase.
    flags : ndarray of int, shape (pixel,)
        `sldvexp.signal.pixel_quality.Flag`, zero for a good pixel.
    frequencies : ndarray, shape (frequency,), Hz
    velocity_fit : ChannelFit, m/s
    reference_fit : ChannelFit, V
    refined : Refined, optional
        The frequencies with their standard errors, if they were estimated.
    """

    velocity: ComplexArray
    phase_variance: Array
    flags: NDArray[np.uint8]
    frequencies: Array
    velocity_fit: ChannelFit
    reference_fit: ChannelFit
    refined: Refined | None = None

    def __repr__(self) -> str:
        count, hertz = self.velocity.shape
        noise = float(np.median(self.std)) if self.velocity.size else float("nan")
        flagged = int((self.flags != 0).sum())
        return (
            f"{count} complex pixels at {hertz} frequencies: standard error {noise:.2g} m/s "
            f"(median), {flagged} flagged"
        )

    @property
    def variance(self) -> Array:
        """``E |e|^2`` of the pixel's error e, (pixel, frequency), m2/s2: that of both parts."""
        return self.velocity_fit.variance + squared(self.velocity) * self.phase_variance

    @property
    def pseudo_variance(self) -> ComplexArray:
        """``E e^2``, (pixel, frequency), m2/s2: how far the error prefers one direction."""
        turned = self.velocity_fit.pseudo_variance * against(self.reference_fit.phasor) ** 2
        return turned - self.velocity**2 * self.phase_variance

    @property
    def std(self) -> Array:
        """Standard error per real and imaginary part, shape (pixel, frequency), m/s.

        The root mean square of both parts', which differ where the noise of the reference counts
        or the record has no whole number of periods; `std_parts` gives each.
        """
        return np.sqrt(self.variance / 2)

    @property
    def std_parts(self) -> tuple[Array, Array]:
        """Standard errors of the real and of the imaginary part, (pixel, frequency), m/s."""
        both, shift = self.variance, self.pseudo_variance.real
        return np.sqrt(np.maximum(both + shift, 0) / 2), np.sqrt(np.maximum(both - shift, 0) / 2)

    @property
    def uncorrected(self) -> ComplexArray:
        """Pixels before the phase correction (Eq 3.9, Figures 3.4 and 3.6), m/s."""
        return self.velocity_fit.phasor


def against(reference: ComplexArray) -> ComplexArray:
    """Compute ``conj(R) / |R|``, the turn that takes the reference's phase away.

    1 if there is none.
    """
    size = np.sqrt(squared(reference))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(size == 0, 1.0, np.conj(reference) / size)


def phase_variance(fit: ChannelFit, turn: ComplexArray) -> Array:
    """Compute variance of a channel's phase, shape (pixel, frequency), rad2.

    That of the error across the phasor over its squared length, ``Im(e conj(R))^2 / |R|^4``, and
    at most that of a phase uniform over the circle.

    Parameters
    ----------
    turn : ndarray of complex, shape (pixel, frequency)
        ``conj(R) / |R|``.
    """
    across = (fit.variance - (fit.pseudo_variance * turn**2).real) / 2
    size = squared(fit.phasor)
    known = across < UNKNOWN_PHASE * size
    spoilt = np.isnan(across)
    return np.where(known | spoilt, across / np.where(known, size, 1.0), UNKNOWN_PHASE)


def demodulate(
    samples: ArrayLike,
    model: SineModel,
    *,
    channel_axis: int = 1,
    volts_per_count: ArrayLike = 1.0,
    velocity_per_volt: float = 0.01,
    limits: ArrayLike | None = None,
    quality: ArrayLike | None = None,
    intercept: Intercept = Intercept.test,
    confidence: float = 0.95,
    rules: FlagRules | None = None,
    threads: int | None = None,
    simpler: Sequence[SineModel] = (),
) -> ComplexImage:
    """Turn the samples of a whole image into complex pixels with standard errors and flags.

    Parameters
    ----------
    samples : array_like, shape (pixel, channel, sample) or (channel, pixel, sample)
        Channels are velocity, reference. Integers are counts of the converter.
    model : SineModel
        See `sldvexp.signal.sine_model.sine_model`.
    channel_axis : int
        1 or 0: which of the two shapes.
    volts_per_count : array_like, shape () or (2,), V
        Of one unit of the samples, for each channel.
    velocity_per_volt : float, m/s/V
        Negative if a positive voltage means away from the instrument. Ometron's medium range has
        100 mV per mm/s: 0.01.
    limits : array_like, shape (2,) or (2, 2), optional
        Smallest and largest sample that the converter can give, for each channel. Integers have
        the limits of their type unless given; floats have none.
    quality : array_like of bool, shape (pixel,), optional
        False where the instrument itself reported a lost signal.
    confidence : float
        Of the F-tests of intercept and harmonics.
    simpler : sequence of SineModel
        The model without harmonics, with the second, and so on up to `model`: a pixel has the
        first whose next harmonic is not significant.

    Raises
    ------
    UserError
        If the samples do not have two channels or do not fit the model's times.

    Examples
    --------
    A velocity of 3 V that leads its reference by 0.5 rad, at 0.01 m/s a volt:

    >>> import numpy as np
    >>> from sldvexp.signal import demodulate, sine_model
    >>> turn = 2 * np.pi * 200.0 * (times := np.arange(512) / 5120.0)
    >>> image = demodulate([[3 * np.cos(turn + 0.5), np.cos(turn)]], sine_model(times, [200.0]))
    >>> np.abs(image.velocity).round(6), np.angle(image.velocity).round(6)
    (array([[0.03]]), array([[0.5]]))
    """
    channels = records(np.asarray(samples), channel_axis)
    counts = channels.dtype.kind in "iu"
    if limits is None and counts:
        kind = np.iinfo(channels.dtype)
        limits = (kind.min, kind.max)
    sums = project(channels, model.columns, limits, threads)
    volts = np.broadcast_to(np.asarray(volts_per_count, float), (2,))
    fits = [
        fit_while_significant(
            c, square, [*simpler, model], intercept, confidence, scale, float(counts)
        )
        if simpler
        else fit_channel(c, square, model, intercept, confidence, scale, float(counts))
        for c, square, scale in zip(
            sums.coefficients, sums.square, (volts[0] * velocity_per_volt, volts[1]), strict=True
        )
    ]
    velocity, reference = fits
    turn = against(reference.phasor)
    return ComplexImage(
        velocity=velocity.phasor * turn,
        phase_variance=phase_variance(reference, turn),
        flags=find_flags(velocity, reference, sums, quality, rules or FlagRules()),
        frequencies=model.frequencies,
        velocity_fit=velocity,
        reference_fit=reference,
    )


def records(samples: NDArray, channel_axis: int) -> NDArray:
    """View the samples as (channel, pixel, sample); refuse what is not two channels."""
    if samples.ndim != 3 or channel_axis not in (0, 1) or samples.shape[channel_axis] != 2:
        names = ("channel", "pixel") if channel_axis == 0 else ("pixel", "channel")
        raise UserError(
            f"signal: the samples must have the shape ({names[0]}, {names[1]}, sample) with the "
            f"two channels velocity and reference, not {samples.shape}"
        )
    return np.moveaxis(samples, channel_axis, 0)


#: A residual below this share of the image's largest sine is arithmetic, not a dead channel.
NOISE_FLOOR = 1e-6


def find_flags(
    velocity: ChannelFit,
    reference: ChannelFit,
    sums: Projection,
    quality: ArrayLike | None,
    rules: FlagRules,
) -> NDArray[np.uint8]:
    """Flag the pixels that are not to be trusted.

    Parameters
    ----------
    velocity, reference : ChannelFit
        The reference in V.
    sums : Projection
        Of both channels.
    quality : array_like of bool, shape (pixel,), optional
        False where the instrument reported a lost signal.

    Returns
    -------
    ndarray of int, shape (pixel,)

    Raises
    ------
    UserError
        If `quality` does not have one entry a pixel.
    """
    non_finite = np.any(~np.isfinite(sums.square), axis=0)
    saturated = np.any(sums.at_limit, axis=0)
    least = np.maximum(rules.poor_fit * _sine_rms(reference), rules.reference_minimum)
    found = {
        Flag.saturated: saturated,
        Flag.dropped_out: _dropped_out(velocity, ~(non_finite | saturated), rules),
        Flag.reference_missing: _reference_missing(reference, rules) & ~non_finite,
        Flag.non_finite: non_finite,
        Flag.poor_fit: reference.noise > least,
    }
    if quality is not None:
        good = np.asarray(quality, bool)
        if good.shape != non_finite.shape:
            raise UserError(
                f"signal: the instrument's quality has the shape {good.shape}, but there are "
                f"{non_finite.size} pixels; give one value for each"
            )
        found[Flag.dropped_out] |= ~good
    flags = np.zeros(non_finite.shape, np.uint8)
    for flag, where in found.items():
        flags |= np.where(where, np.uint8(flag), np.uint8(0))
    return flags


def _dropped_out(velocity: ChannelFit, usable: BoolArray, rules: FlagRules) -> BoolArray:
    """Find pixels whose residual stands out from the usable ones' median, either way."""
    if not usable.any():
        return np.zeros(usable.shape, bool)
    floor = NOISE_FLOOR * _sine_rms(velocity)[usable].max()
    noise = np.maximum(velocity.noise, floor)
    typical = np.median(noise[usable])
    return (noise > rules.dropout_factor * typical) | (noise * rules.dropout_factor < typical)


def _reference_missing(reference: ChannelFit, rules: FlagRules) -> BoolArray:
    """Find pixels whose reference is too small or too noisy to give a phase at every frequency."""
    least = np.maximum(rules.reference_minimum**2, rules.reference_snr**2 * reference.variance / 2)
    return np.any(~(squared(reference.phasor) >= least), axis=1)


def _sine_rms(fit: ChannelFit) -> Array:
    """Compute root mean square of the fitted sines, shape (pixel,)."""
    return np.sqrt(squared(fit.phasor).sum(axis=1) / 2)
