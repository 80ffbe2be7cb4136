"""`signal=response`: response functions of broadband records, and sines where there is but one.

Each pixel has several records. Those without a fault go into `ResponseSums`, of which the pixel's
response H to the reference is made. The pixel's velocity is ``H`` times the nominal amplitude of
the reference at that line, so that all views have one scale, and its standard error comes from the
scatter of the records.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.signal.excitation import RecordDesign
from sldvexp.signal.pixel_quality import Flag
from sldvexp.signal.record_faults import (
    RecordFault,
    RecordLevels,
    at_limits,
    double_hit,
    find_record_faults,
    limits_of,
    noise_power,
)
from sldvexp.signal.response_findings import MAINS
from sldvexp.signal.response_function import (
    LEAST_RECORDS,
    Estimator,
    ResponseFunction,
    response_function,
)
from sldvexp.signal.response_sums import ResponseSums
from sldvexp.signal.sine_fit import SineFit
from sldvexp.signal.sums_settings import SumsSettings
from sldvexp.typing import Array, ComplexArray, IntArray

#: Samples that are transformed at once, for memory's sake.
CHUNK_SAMPLES = 2**18


@dataclass(frozen=True, repr=False)
class ResponseImage:
    """Pixels of one view from response functions, flagged ones included.

    Attributes
    ----------
    velocity : ndarray of complex, shape (pixel, line), m/s
        Peak amplitude, exp(+i w t), relative to the reference, positive towards the instrument:
        H times `reference_amplitude`.
    std : ndarray, shape (pixel, line), m/s
        Standard error of real and imaginary part each.
    flags : ndarray of int, shape (pixel,)
        `Flag`: why too few of a pixel's records are left, zero for a good pixel.
    frequencies : ndarray, shape (line,), Hz
    reference_amplitude : ndarray, shape (line,), V
    coherence : ndarray, shape (pixel, line)
    records : ndarray of int, shape (pixel,)
    left_out : ndarray of int, shape (pixel, fault)
        See `ResponseSums`.
    design : RecordDesign
    estimator : Estimator
    """

    velocity: ComplexArray
    std: Array
    flags: NDArray[np.uint8]
    frequencies: Array
    reference_amplitude: Array
    coherence: Array
    records: IntArray
    left_out: IntArray
    design: RecordDesign
    estimator: Estimator

    def __repr__(self) -> str:
        count, hertz = self.velocity.shape
        flagged = int((self.flags != 0).sum())
        return f"{count} complex pixels at {hertz} lines, {flagged} flagged"


@register("signal", "response")
@dataclass
class Response(SineFit):
    """Response functions by averages of records; its other settings are those of `sine_fit`.

    Where a pixel has one record of sines, as the circles of a calibration object have, they are
    fitted as `sine_fit` does.

    Parameters
    ----------
    estimator : Estimator
        h1 with noise in the response alone, h2 in the reference alone, hv in both.
    noise_ratio : float, ((m/s)/V)2
        Of hv: noise power of the response over that of the reference.
    mains : list of float, Hz
        Frequencies of mains whose hum is looked for in broadband records; empty for none.
    """

    estimator: Estimator = Estimator.h1
    noise_ratio: float = 1.0
    mains: list[float] = field(default_factory=lambda: list(MAINS))

    def __post_init__(self) -> None:
        super().__post_init__()
        checks = Checks()
        checks.positive("noise_ratio", self.noise_ratio)
        for hertz in self.mains:
            checks.positive("mains", hertz)
        useless = self.noise_ratio != 1.0 and self.estimator is not Estimator.hv
        checks.require(not useless, "noise_ratio", "has no effect without estimator: hv")
        checks.done()

    def sums(
        self,
        records: ArrayLike,
        design: RecordDesign,
        *,
        volts_per_count: ArrayLike = 1.0,
        limits: ArrayLike | None = None,
        good: ArrayLike | None = None,
    ) -> ResponseSums:
        """Sum records of some pixels, as of a scan line; more of the same can be merged with them.

        Parameters
        ----------
        records : array_like, shape (pixel, record, 2, sample)
            Counts; channels are velocity, reference. Lead records are cut off already.
        design : RecordDesign
        volts_per_count : array_like, shape () or (2,)
        limits : array_like, shape (2,) or (2, 2), optional
            Smallest and largest sample that the converter can give, for each channel.
        good : array_like of bool, shape (pixel, record), optional
            False where the instrument itself reported a lost signal.

        Raises
        ------
        UserError
            If the records do not have the design's samples.
        """
        counts = np.asarray(records)
        if counts.ndim != 4 or counts.shape[2:] != (2, design.samples):
            raise UserError(
                "signal: records must have the shape (pixel, record, 2, "
                f"{design.samples}) with the channels velocity and reference, not {counts.shape}"
            )
        volts = np.broadcast_to(np.asarray(volts_per_count, float), (2,))
        scale, bounds = volts * [self.velocity_per_volt, 1.0], limits_of(counts, limits)
        sums = ResponseSums.zeros(
            len(counts), design.hertz(design.read_lines), self.made_with(design)
        )
        chunk = max(1, CHUNK_SAMPLES // max(1, counts[:1].size))
        parts = [
            _transform(counts[first : first + chunk], design, scale, bounds)
            for first in range(0, len(counts), chunk)
        ]
        if parts:
            levels = RecordLevels.concatenated([part.levels for part in parts])
            faults = find_record_faults(levels, self.flags, good)
            phasors = np.concatenate([part.phasors for part in parts])
            sums.add(phasors[:, :, 1], phasors[:, :, 0], faults, levels.noise)
            if design.excitation.overlap:
                phasors = np.concatenate([part.between for part in parts])
                either = faults[:, :-1] | faults[:, 1:]
                sums.add(phasors[:, :, 1], phasors[:, :, 0], either, between=True)
        return sums

    def made_with(self, design: RecordDesign, again: int = 0) -> SumsSettings:
        """Say what sums of records are made with.

        Parameters
        ----------
        design : RecordDesign
        again : int
            Records of each pixel at most that are taken in the place of spoilt ones.
        """
        flags, played = self.flags, design.excitation
        of_signal = (self.velocity_per_volt, flags.dropout_factor, flags.reference_minimum)
        return SumsSettings(*of_signal, played.force, played.overlap, again)

    def response(self, sums: ResponseSums, design: RecordDesign) -> ResponseFunction:
        """Make response functions at the excited lines."""
        excited = np.isin(design.read_lines, design.lines)
        return response_function(sums.at(excited), self.estimator, self.noise_ratio)

    def image(self, sums: ResponseSums, design: RecordDesign) -> ResponseImage:
        """Make the pixels of a view; those with fewer than two good records are flagged."""
        found = self.response(sums, design)
        amplitude = design.reference_amplitude
        return ResponseImage(
            velocity=found.response * amplitude,
            std=found.std * amplitude,
            flags=_flags(sums),
            frequencies=found.frequency,
            reference_amplitude=amplitude,
            coherence=found.coherence,
            records=found.records,
            left_out=sums.left_out,
            design=design,
            estimator=self.estimator,
        )


def _flags(sums: ResponseSums) -> NDArray[np.uint8]:
    """Flag pixels with too few records, for the faults of those that are left out."""
    flags = np.zeros(len(sums.count), np.uint8)
    for k, fault in enumerate(RecordFault):
        # A pulse twice is no signal to refer to, and has no flag of its own.
        flag = Flag.reference_missing if fault is RecordFault.double_hit else Flag(fault)
        flags |= np.where(sums.left_out[:, k] > 0, np.uint8(flag), np.uint8(0))
    few = sums.count < LEAST_RECORDS
    flags[few & (flags == 0)] = np.uint8(Flag.dropped_out)
    return np.where(few, flags, np.uint8(0))


class _Transformed(NamedTuple):
    """Records of some pixels: what they are judged by, phasors (pixel, record, 2, read).

    With `Excitation.overlap` also the phasors of stretches between records, of one record less.
    """

    levels: RecordLevels
    phasors: ComplexArray
    between: ComplexArray


def _transform(counts: NDArray, design: RecordDesign, scale: Array, bounds: Array) -> _Transformed:
    """Transform records to phasors in m/s and V, and measure what they are judged by."""
    saturated, finite = at_limits(counts, bounds), np.isfinite(counts).all(axis=(2, 3))
    volts = np.where(finite[..., None, None], counts, 0.0) * scale[:, None]
    spectrum = np.fft.rfft(design.windowed(design.as_used(volts)), axis=-1)
    reference = volts[:, :, 1]
    levels = RecordLevels(
        saturated,
        ~finite,
        double_hit(reference, design),
        noise_power(spectrum[:, :, 0], design),
        np.sqrt(np.vecdot(reference, reference) / design.samples),
        np.abs(reference).max(axis=-1),
    )
    overlapping = volts[:, :0] if not design.excitation.overlap else design.between(volts)
    return _Transformed(levels, design.phasors(spectrum), design.spectra(overlapping))
