"""`signal=sine_fit`: the least-squares sine of both channels, pixel by pixel (Section 3.2.3)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.signal.base import SignalEstimator
from sldvexp.signal.complex_image import ComplexImage, demodulate, records
from sldvexp.signal.frequency import refine_frequencies
from sldvexp.signal.pixel_quality import Flag, FlagRules, Intercept
from sldvexp.signal.sine_model import sine_model


@register("signal", "sine_fit")
@dataclass
class SineFit(SignalEstimator):
    """Sines at known frequencies, with what disturbs them.

    Parameters
    ----------
    velocity_per_volt : float, m/s/V
        Of the instrument's output; negative if a positive voltage means away from the instrument.
        The default is Ometron's medium range, 100 mV per mm/s.
    harmonics : int
        Harmonics of each frequency that are fitted besides, then discarded: 2 adds 2 f and 3 f.
    incremental : bool
        Fit harmonic after harmonic, up to `harmonics`, only while each channel's F-test says that
        it is significant (recommendation of Section 6.2). The first that is not ends it.
    hum : list of float, Hz
        Other disturbing frequencies that are fitted, then discarded.
    intercept : Intercept
        Whether the fit has the constant of Eq 3.2: as each channel's F-test says (recommendation
        of Section 6.2), always or never.
    confidence : float
        1 - alpha of these tests.
    refine : bool
        Find the frequencies from the reference records instead of trusting the set ones.
    search : float, Hz
        With `refine`: half-width of the interval that is searched first. With 0 the set
        frequencies must be right to half of 1 / (length of a record).
    flags : FlagRules
        When a pixel is not to be trusted.
    """

    velocity_per_volt: float = 0.01
    harmonics: int = 0
    incremental: bool = False
    hum: list[float] = field(default_factory=list)
    intercept: Intercept = Intercept.test
    confidence: float = 0.95
    refine: bool = False
    search: float = 0.0
    flags: FlagRules = field(default_factory=FlagRules)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.finite("velocity_per_volt", self.velocity_per_volt)
        ok = self.velocity_per_volt != 0
        checks.require(ok, "velocity_per_volt", "must not be zero: every velocity would vanish")
        checks.non_negative("harmonics", self.harmonics)
        useless = self.incremental and self.harmonics == 0
        checks.require(not useless, "incremental", "has no effect without harmonics")
        for hertz in self.hum:
            checks.positive("hum", hertz)
        checks.probability("confidence", self.confidence)
        checks.non_negative("search", self.search)
        useless = self.search > 0 and not self.refine
        checks.require(not useless, "search", "has no effect without refine: true")
        self.flags.check(checks, "flags")
        checks.done()

    def demodulate(
        self,
        samples: ArrayLike,
        times: ArrayLike,
        frequencies: ArrayLike,
        *,
        channel_axis: int = 1,
        volts_per_count: ArrayLike = 1.0,
        limits: ArrayLike | None = None,
        quality: ArrayLike | None = None,
    ) -> ComplexImage:
        """See `SignalEstimator`; the image has `refined` if `refine` is set."""

        def image_at(hertz: ArrayLike) -> ComplexImage:
            fewer = range(self.harmonics if self.incremental else 0)
            return demodulate(
                samples,
                sine_model(times, hertz, self.harmonics, self.hum),
                channel_axis=channel_axis,
                volts_per_count=volts_per_count,
                velocity_per_volt=self.velocity_per_volt,
                limits=limits,
                quality=quality,
                intercept=self.intercept,
                confidence=self.confidence,
                rules=self.flags,
                simpler=[sine_model(times, hertz, count, self.hum) for count in fewer],
            )

        image = image_at(frequencies)
        if not self.refine:
            return image
        spoilt = image.flags & (Flag.saturated | Flag.non_finite) != 0
        reference = records(np.asarray(samples), channel_axis)[1]
        refined = refine_frequencies(
            reference[~spoilt] if spoilt.any() else reference,
            times,
            frequencies,
            self.harmonics,
            self.hum,
            self.search,
        )
        return replace(image_at(refined.frequencies), refined=refined)
