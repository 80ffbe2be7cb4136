"""Five modes whose records are made with the vibrometer's and the reference's noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from sldvexp.signal import ExcitationKind, ResponseSums

#: Natural frequencies of a plate's bending modes, Hz, each with 1 % of damping.
NATURAL = np.array([197.0, 439.0, 545.0, 842.0, 1100.0])
DAMPING = 0.01


@dataclass(frozen=True)
class FiveModes:
    """Structure in m/s per V, seen at pixels by a sensor of 0.01 m/s per V.

    Attributes
    ----------
    gain : float, (m/s)/V
        Of each mode's residue.
    noise : tuple of float, V
        R.m.s. of velocity and reference.
    """

    gain: float = 0.001
    noise: tuple[float, float] = (0.05, 0.001)
    cubic: float = 0.0  # share of the velocity's cube, in units of its r.m.s.

    def response(self, frequency):
        """True response functions, (m/s)/V."""
        turn = np.asarray(frequency, float)[:, None] / NATURAL
        return self.gain * (1j * turn / (1 - turn**2 + 2j * DAMPING * turn)).sum(axis=1)

    def _steady(self, x, rate):
        """Response in V to a waveform that goes on repeating."""
        filtered = np.fft.rfft(x) * self.response(np.fft.rfftfreq(x.shape[-1], 1 / rate)) / 0.01
        return np.fft.irfft(filtered, x.shape[-1])

    def records(self, design, count, rng, pixels):
        """Records of pixels that all move alike, shape (pixel, record, 2, sample), V."""
        n = design.samples
        made = np.empty((pixels, count, 2, n))
        for one in made:
            # Noise of a generator is another one at every pixel.
            again = replace(design.excitation, seed=int(rng.integers(2**31)))
            x = replace(design, excitation=again).waveform(count)
            if design.excitation.kind in (ExcitationKind.burst_random, ExcitationKind.hammer):
                padded = np.pad(x.reshape(count, n), [(0, 0), (0, int(2 * design.rate))])
                y = self._steady(padded, design.rate)[:, :n]
            else:
                y = self._steady(x, design.rate).reshape(count, n)
            one[:, 0] = y + self.cubic * y**3 / np.mean(y**2)
            one[:, 1] = x.reshape(count, n)
        return made + np.array(self.noise)[:, None] * rng.standard_normal(made.shape)

    def sums(self, estimator, design, count, rng, pixels, at_once=20):
        """Sums of as many records, a few pixels at a time."""
        pieces = [min(at_once, pixels - k) for k in range(0, pixels, at_once)]
        return ResponseSums.concatenated(
            [estimator.sums(self.records(design, count, rng, p), design) for p in pieces]
        )

    def peaks(self, frequency):
        """Places of the lines nearest to the modes."""
        return np.abs(frequency[:, None] - NATURAL).argmin(axis=0)


@pytest.fixture
def five_modes():
    return FiveModes()
