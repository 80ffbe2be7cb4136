"""When the intercept stays in the fit, and which pixels are not to be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntFlag

from sldvexp.errors import Checks


class Intercept(Enum):
    """Presence of the constant C of Eq 3.2 in the fit: as its F-test decides, always or never."""

    test = "test"
    always = "always"
    never = "never"


class Flag(IntFlag):
    """Fault of a pixel; several may hold. A flagged pixel keeps its value.

    Attributes
    ----------
    saturated
        A sample of either channel lies at or beyond the limits of the converter, or the velocity
        is cut off: the largest one together with that of many other pixels.
    dropped_out
        The instrument said so, or the velocity channel's residual is `dropout_factor` times
        larger (a lost or clipped signal) or smaller (a dead channel) than the image's median.
    reference_missing
        The reference's amplitude, at any of the frequencies, is below `reference_minimum` or below
        `reference_snr` standard errors: the pixel's phase means nothing.
    non_finite
        A sample of either channel is not a finite number.
    poor_fit
        The reference carries something else than its sine: its residual (r.m.s.) exceeds both
        `poor_fit` times the sine (r.m.s.) and `reference_minimum`. The frequency is wrong or the
        generator does not give a sine. The velocity channel is not held to this, since at a node
        all of it is noise.
    unlike
        Neither its neighbours nor the other views confirm it: the signal dropped out unnoticed.
    resting
        Part of a patch that is at rest while what surrounds it moves, as a hole does.
    """

    saturated = 1
    dropped_out = 2
    reference_missing = 4
    non_finite = 8
    poor_fit = 16
    unlike = 32
    resting = 64


@dataclass
class FlagRules:
    """Thresholds of `Flag`; a flagged pixel keeps its value beside its flag.

    Parameters
    ----------
    dropout_factor : float
        Accepted ratio between a pixel's velocity residual and the image's median, either way.
    reference_minimum : float, V
        Smallest accepted peak amplitude of the reference, above the noise of an idle channel.
    reference_snr : float
        Smallest accepted amplitude of the reference in its own standard errors.
    poor_fit : float
        Largest accepted ratio of the reference's residual to its sine.
    """

    dropout_factor: float = 5.0
    reference_minimum: float = 0.1
    reference_snr: float = 10.0
    poor_fit: float = 0.2

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is wrong with the thresholds."""
        ok = self.dropout_factor > 1
        message = f"must exceed 1, the median pixel itself, not {self.dropout_factor}"
        checks.require(ok, f"{name}.dropout_factor", message)
        checks.non_negative(f"{name}.reference_minimum", self.reference_minimum)
        checks.non_negative(f"{name}.reference_snr", self.reference_snr)
        checks.positive(f"{name}.poor_fit", self.poor_fit)
