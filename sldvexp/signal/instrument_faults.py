"""Faults of the instrument, told by pixels most of which are not to be trusted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sldvexp.signal.complex_image import ComplexImage
from sldvexp.signal.pixel_quality import Flag
from sldvexp.typing import Array, BoolArray

#: Share of the pixels from which a fault is the instrument's, whatever the scene.
MOST = 0.5
#: An amplitude, in standard errors, that noise does not have among a thousand pixels.
CLEAR = 6.0
#: Ratio of large to small amplitudes in a channel that is the same everywhere, or is not.
ALIKE, UNLIKE = 1.2, 2.0
#: Lines that a sentence names at most.
NAMED = 3


def instrument_fault(image: ComplexImage, share: float = MOST) -> str:
    """Say what is wrong with the instrument, and what to look at; empty if nothing seems to be.

    Parameters
    ----------
    share : float
        Of the pixels, from which a flag counts.

    Examples
    --------
    Nothing but noise on both channels:

    >>> import numpy as np
    >>> from sldvexp.signal import demodulate, instrument_fault, sine_model
    >>> rng, times = np.random.default_rng(1), np.arange(256) / 2560.0
    >>> samples = 1e-3 * rng.standard_normal((50, 2, 256))
    >>> print(instrument_fault(demodulate(samples, sine_model(times, [100.0]))))
    the reference channel has no signal of 100 Hz (...), and nothing moves; the generator's output
    is off
    """
    flags = image.flags

    def many(flag: Flag) -> bool:
        return bool(np.mean(flags & flag != 0) > share)

    tones = _named(image.frequencies)
    if _exchanged(image):
        return (
            f"the channels look exchanged, and so every phase conjugated: {_volts(image)} of "
            f"{tones}, the same everywhere, come on the velocity channel, and what differs "
            "from pixel to pixel on the reference channel; exchange their cables, or the "
            "profile's data.channels"
        )
    if many(Flag.non_finite):
        return f"{_count(flags, Flag.non_finite)} have samples that are no numbers"
    if many(Flag.saturated):  # whatever else is wrong with them may come of it
        return (
            f"{_count(flags, Flag.saturated)} are saturated; choose a larger range of the "
            "vibrometer or the digitizer, or a smaller amplitude of the scan's sampling"
        )
    if many(Flag.poor_fit):
        return (
            f"the reference channel carries something else than {tones}: "
            f"{float(np.median(image.reference_fit.noise)):.3g} V rms of it are left; the "
            "generator plays other frequencies than the scan's sampling says, or no sine"
        )
    if many(Flag.reference_missing):
        return _no_reference(image, tones)
    lost = without_light(image)
    if lost.any():
        return (
            f"the light drops out in {int(lost.sum())} of {len(flags)} pixels; focus the beam, or "
            "make the surface reflect more"
        )
    if many(Flag.dropped_out):
        return (
            f"no light comes back from {_count(flags, Flag.dropped_out)}; the laser's shutter is "
            "closed, or the beam falls beside everything"
        )
    return ""


def without_light(image: ComplexImage) -> BoolArray:
    """Find pixels that are far noisier than the quietest ones, shape (pixel,)."""
    saturated = image.flags & Flag.saturated != 0
    noise = np.where(saturated, 0.0, image.velocity_fit.noise)
    if not noise.any() or not _ratio(noise[noise > 0]) > UNLIKE:
        return np.zeros(len(noise), bool)
    return np.asarray(noise > UNLIKE * np.percentile(noise[noise > 0], 10))


def moving(image: ComplexImage) -> BoolArray:
    """Find pixels that clearly move, flagged ones among them, shape (pixel,)."""
    return np.asarray((np.abs(image.velocity) > CLEAR * image.std).any(axis=1))


def _no_reference(image: ComplexImage, tones: str) -> str:
    """Say whether the generator or only its way to the reference channel is at fault."""
    volts = float(np.median(np.abs(image.reference_fit.phasor)))
    what = f"the reference channel has no signal of {tones} ({volts:.2g} V)"
    fit = image.velocity_fit
    if (np.abs(fit.phasor) > CLEAR * np.sqrt(fit.variance)).any():
        return f"{what}, though something moves; its cable from the generator is not plugged in"
    return f"{what}, and nothing moves; the generator's output is off"


def _exchanged(image: ComplexImage) -> bool:
    """Tell whether the velocity channel is alike everywhere and the reference is not."""
    velocity, reference = (
        np.abs(fit.phasor[:, 0]) for fit in (image.velocity_fit, image.reference_fit)
    )
    noise = np.sqrt(image.velocity_fit.variance[:, 0])
    there = float(np.percentile(velocity, 10)) > CLEAR * float(np.median(noise))
    return there and _ratio(velocity) < ALIKE and _ratio(reference) > UNLIKE


def _named(frequencies: Array) -> str:
    """Name lines, the first of many."""
    named = [f"{f:g}" for f in frequencies]
    if len(named) <= NAMED:
        return f"{' and '.join(named)} Hz"
    return f"{', '.join(named[:NAMED])} Hz and {len(named) - NAMED} others"


def _ratio(amplitude: Array) -> float:
    """Compute large over small amplitudes; a few that speckle spoilt do not count."""
    small, large = np.percentile(amplitude, [10, 90])
    return float(large / max(small, np.finfo(float).tiny))


def _volts(image: ComplexImage) -> str:
    amplitude = float(np.median(np.abs(image.velocity_fit.phasor[:, 0])))
    return f"{amplitude:.2g} m/s"


def _count(flags: NDArray[np.uint8], flag: Flag) -> str:
    return f"{int(np.sum(flags & flag != 0))} of {len(flags)} pixels"
