"""Faults of single records, which cost a record and not its pixel.

A record is left out if a sample lies at the converter's limit, is no number, or if the instrument
said that its light was lost; if its noise outside of the band, where nothing is excited, is
`FlagRules.dropout_factor` times that of the median record or less than its inverse, as a lost
signal's is; if the reference has no pulse or signal, as where a trigger was missed; or if a hammer
hit twice.
"""

from __future__ import annotations

from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.signal.excitation import BEFORE_PULSE, ExcitationKind, RecordDesign
from sldvexp.signal.pixel_quality import FlagRules
from sldvexp.typing import Array, BoolArray

#: Height of a second pulse over the first, from which a hammer hit twice.
SECOND_HIT = 0.1
#: Pulses' lengths after the first in which its own ringing is no second hit.
RINGING = 3.0
#: Share of the band above it, from which a line is outside of it: windows spread what is inside.
BESIDE_BAND = 1.1
#: Reference's r.m.s. over the pixels' median below which there is none.
NO_REFERENCE = 0.1


class RecordFault(IntFlag):
    """Fault of a record; the first four have the bits of `Flag`.

    Attributes
    ----------
    saturated
        A sample of either channel lies at or beyond the limits of the converter.
    dropped_out
        The instrument said so, or the velocity's noise differs from the median record's.
    reference_missing
        The reference has no signal: the trigger was missed, or the generator was off.
    non_finite
        A sample of either channel is not a finite number.
    double_hit
        The hammer hit twice.
    """

    saturated = 1
    dropped_out = 2
    reference_missing = 4
    non_finite = 8
    double_hit = 16


def find_record_faults(
    records: ArrayLike,
    design: RecordDesign,
    *,
    volts_per_count: ArrayLike = 1.0,
    limits: ArrayLike | None = None,
    good: ArrayLike | None = None,
    rules: FlagRules | None = None,
) -> NDArray[np.uint8]:
    """Find what is wrong with each record.

    Parameters
    ----------
    records : array_like, shape (pixel, record, 2, sample)
        Counts; channels are velocity, reference.
    volts_per_count : array_like, shape () or (2,)
    limits : array_like, shape (2,) or (2, 2), optional
        Smallest and largest sample that the converter can give, for each channel; those of
        integers' type unless given.
    good : array_like of bool, shape (pixel, record), optional
        False where the instrument itself reported a lost signal.

    Returns
    -------
    ndarray of int, shape (pixel, record)
        Bits of `RecordFault`, zero for a good record.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.signal import Excitation, find_record_faults
    >>> design = Excitation(band=[100.0, 300.0]).design(rate=1000.0, samples=200)
    >>> records = np.tile(design.waveform(), (1, 3, 2, 1))
    >>> records[0, 1, 0, 7] = np.nan
    >>> find_record_faults(records, design).tolist()
    [[0, 8, 0]]
    """
    samples, rules = np.asarray(records), rules or FlagRules()
    non_finite = ~np.isfinite(samples).all(axis=(2, 3))
    saturated = _saturated(samples, limits)
    usable = ~(non_finite | saturated)
    clean = np.where(usable[..., None, None], samples, 0.0)
    reference = clean[:, :, 1] * np.broadcast_to(np.asarray(volts_per_count, float), (2,))[1]
    found = {
        RecordFault.saturated: saturated,
        RecordFault.non_finite: non_finite,
        RecordFault.dropped_out: _dropped_out(noise_power(clean[:, :, 0], design), usable, rules),
        RecordFault.reference_missing: usable & _no_reference(reference, usable, rules),
        RecordFault.double_hit: usable & double_hit(reference, design),
    }
    if good is not None:
        found[RecordFault.dropped_out] |= ~np.asarray(good, bool)
    faults = np.zeros(usable.shape, np.uint8)
    for fault, where in found.items():
        faults |= np.where(where, np.uint8(fault), np.uint8(0))
    return faults


def noise_power(velocity: Array, design: RecordDesign) -> Array:
    """Estimate the mean square of white noise from lines above the band, shape (pixel, record).

    Parameters
    ----------
    velocity : ndarray, shape (pixel, record, sample)

    Returns
    -------
    ndarray
        NaN if there is no line above the band.
    """
    first = int(np.ceil(BESIDE_BAND * design.read_lines[-1])) + 1
    above = np.arange(first, (design.samples - 1) // 2)
    if len(above) == 0:
        return np.full(velocity.shape[:2], np.nan)
    spectrum = np.fft.rfft(velocity, axis=-1)[..., above]
    power = spectrum.real**2 + spectrum.imag**2
    # The median of an exponential distribution is ln 2 of its mean; tones of hum do not count.
    return np.asarray(np.median(power, axis=-1) / np.log(2) / design.samples, float)


def double_hit(reference: Array, design: RecordDesign) -> BoolArray:
    """Tell where a hammer's record has a second pulse, shape (pixel, record).

    Parameters
    ----------
    reference : ndarray, shape (pixel, record, sample)
    """
    if design.excitation.kind is not ExcitationKind.hammer:
        return np.zeros(reference.shape[:2], bool)
    quiet = max(1, int(BEFORE_PULSE * design.samples / 2))
    pulse = np.abs(reference - reference[..., :quiet].mean(axis=-1, keepdims=True))
    apart = int(np.ceil(RINGING * design.rate / design.excitation.band[1]))
    first = pulse.argmax(axis=-1)[..., None]
    n = np.arange(design.samples)
    rest = np.where(np.abs(n - first) > apart, pulse, 0.0).max(axis=-1)
    return np.asarray(rest > SECOND_HIT * pulse.max(axis=-1))


def _saturated(samples: NDArray, limits: ArrayLike | None) -> BoolArray:
    """Find records that touch the converter's limits."""
    if limits is None and samples.dtype.kind in "iu":
        kind = np.iinfo(samples.dtype)
        limits = (kind.min, kind.max)
    if limits is None:
        return np.zeros(samples.shape[:2], bool)
    low, high = np.broadcast_to(np.asarray(limits, float), (2, 2)).T[..., None]
    return np.asarray(((samples <= low) | (samples >= high)).any(axis=(2, 3)))


def _dropped_out(noise: Array, usable: BoolArray, rules: FlagRules) -> BoolArray:
    """Find usable records whose noise stands out from the median, either way."""
    if not usable.any() or np.isnan(noise).all():
        return np.zeros(usable.shape, bool)
    typical, most = np.median(noise[usable]), rules.dropout_factor**2
    return np.asarray(usable & ((noise > most * typical) | (noise * most < typical)))


def _no_reference(reference: Array, usable: BoolArray, rules: FlagRules) -> BoolArray:
    """Find records whose reference is silent."""
    rms = np.sqrt(np.mean(reference**2, axis=-1))
    typical = np.median(rms[usable]) if usable.any() else 0.0
    return np.asarray(rms < NO_REFERENCE * typical) | (
        np.abs(reference).max(axis=-1) < rules.reference_minimum
    )
