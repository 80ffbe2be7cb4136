"""Faults of single records, which cost a record and not its pixel.

A record is left out if a sample lies at the converter's limit, is no number, or if the instrument
said that its light was lost; if its noise outside of the band, where nothing is excited, is
`FlagRules.dropout_factor` times that of the median record or less than its inverse, as a lost
signal's is; if the reference has no pulse or signal, as where a trigger was missed; or if a hammer
hit twice. Medians are over the records that are given together, as those of a scan line.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.signal.excitation import ExcitationKind, RecordDesign
from sldvexp.signal.pixel_quality import FlagRules
from sldvexp.typing import Array, BoolArray, ComplexArray

#: Height of a second pulse over the first, from which a hammer hit twice.
SECOND_HIT = 0.1
#: Lengths of the pulse in which the hammer's own ringing is no second hit.
RINGING = 3.0
#: Frequency over the highest of the band, from which there is noise alone: windows spread lines.
BESIDE_BAND = 1.1
#: Most lines that the noise is estimated from: its standard error is then 9 %.
NOISE_LINES = 256
#: Reference's r.m.s. over that of the median record, below which there is none.
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


@dataclass(frozen=True, eq=False)
class RecordLevels:
    """Numbers by which records are judged, each of shape (pixel, record).

    Attributes
    ----------
    saturated, non_finite, double_hit : ndarray of bool
    noise : ndarray, (m/s)2
        Mean square of the velocity's noise; NaN if there is no line above the band.
    reference_rms, reference_peak : ndarray, V
    """

    saturated: BoolArray
    non_finite: BoolArray
    double_hit: BoolArray
    noise: Array
    reference_rms: Array
    reference_peak: Array

    @staticmethod
    def concatenated(parts: list[RecordLevels]) -> RecordLevels:
        """Join pixels."""
        names = [f.name for f in fields(RecordLevels)]
        return RecordLevels(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))


def find_record_faults(
    levels: RecordLevels, rules: FlagRules, good: ArrayLike | None = None
) -> NDArray[np.uint8]:
    """Find what is wrong with each record.

    Parameters
    ----------
    good : array_like of bool, shape (pixel, record), optional
        False where the instrument itself reported a lost signal.

    Returns
    -------
    ndarray of int, shape (pixel, record)
        Bits of `RecordFault`, zero for a good record.
    """
    usable = ~(levels.non_finite | levels.saturated)
    lost = np.zeros(usable.shape, bool) if good is None else ~np.asarray(good, bool)
    found = {
        RecordFault.saturated: levels.saturated,
        RecordFault.non_finite: levels.non_finite,
        RecordFault.dropped_out: lost | _dropped_out(levels.noise, usable & ~lost, rules),
        RecordFault.reference_missing: usable & _no_reference(levels, usable, rules),
        RecordFault.double_hit: usable & levels.double_hit,
    }
    faults = np.zeros(usable.shape, np.uint8)
    for fault, where in found.items():
        faults |= np.where(where, np.uint8(fault), np.uint8(0))
    return faults


def limits_of(samples: NDArray, limits: ArrayLike | None) -> Array:
    """Give lowest and highest count of each channel, (2, channel); infinite for floats."""
    if limits is None and samples.dtype.kind in "iu":
        kind = np.iinfo(samples.dtype)
        limits = (kind.min, kind.max)
    given = (-np.inf, np.inf) if limits is None else limits
    return np.broadcast_to(np.asarray(given, float), (2, 2)).T


def at_limits(samples: NDArray, limits: Array) -> BoolArray:
    """Find records of (pixel, record, 2, sample) that touch the converter's limits."""
    low, high = limits[..., None]
    if np.isinf(limits).all():
        return np.zeros(samples.shape[:2], bool)
    return np.asarray(((samples <= low) | (samples >= high)).any(axis=(2, 3)))


def noise_power(spectrum: ComplexArray, design: RecordDesign) -> Array:
    """Estimate the mean square of white noise from lines above the band, shape (pixel, record).

    Parameters
    ----------
    spectrum : ndarray of complex, shape (pixel, record, samples // 2 + 1)
        Of the windowed records, as `numpy.fft.rfft` gives it.
    """
    first = int(np.ceil(BESIDE_BAND * design.read_lines[-1])) + 1
    last = (design.samples - 1) // 2
    above = np.arange(first, last, max(1, (last - first) // NOISE_LINES))
    if len(above) == 0:
        return np.full(spectrum.shape[:2], np.nan)
    lines = spectrum[..., above]
    power = np.median(lines.real**2 + lines.imag**2, axis=-1)
    # The median of an exponential distribution is ln 2 of its mean; tones of hum do not count.
    return np.asarray(power / np.log(2) / (design.window**2).sum(), float)


def double_hit(reference: Array, design: RecordDesign) -> BoolArray:
    """Tell where a hammer's record has a second pulse, shape (pixel, record).

    Parameters
    ----------
    reference : ndarray, shape (pixel, record, sample)
    """
    if design.excitation.kind is not ExcitationKind.hammer:
        return np.zeros(reference.shape[:2], bool)
    pulse = np.abs(reference - design.offset(reference))
    apart = int(np.ceil(RINGING * design.rate / design.excitation.band[1]))
    first = pulse.argmax(axis=-1)[..., None]
    rest = np.where(np.abs(np.arange(design.samples) - first) > apart, pulse, 0.0).max(axis=-1)
    return np.asarray(rest > SECOND_HIT * pulse.max(axis=-1))


def _dropped_out(noise: Array, usable: BoolArray, rules: FlagRules) -> BoolArray:
    """Find usable records whose noise stands out from the median, either way."""
    if not usable.any() or np.isnan(noise).all():
        return np.zeros(usable.shape, bool)
    typical, most = np.median(noise[usable]), rules.dropout_factor**2
    return np.asarray(usable & ((noise > most * typical) | (noise * most < typical)))


def _no_reference(levels: RecordLevels, usable: BoolArray, rules: FlagRules) -> BoolArray:
    """Find records whose reference is silent."""
    typical = np.median(levels.reference_rms[usable]) if usable.any() else 0.0
    return np.asarray(
        (levels.reference_rms < NO_REFERENCE * typical)
        | (levels.reference_peak < rules.reference_minimum)
    )
