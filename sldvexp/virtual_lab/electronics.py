"""From velocity to counts: vibrometer, noise, drop-outs, hum, and the A/D converter.

Time dependence is exp(+i w t); amplitudes are peak values. The sampling of each pixel starts at a
random time, the same for everything that is sampled.

Random numbers that belong to a pixel, whatever was measured before it.

Every pixel owns a stretch of a counter-based generator (Philox), found by the seed and the view
(the key) and by the stream and the pixel's place in it (the counter). A scan line that is measured
again under its stream's number repeats its noise bit for bit, and how a list is split into calls
makes no difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sldvexp.instrument import Acquisition, Status
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, ComplexArray
from sldvexp.virtual_lab.scene import AnalogInput, Vibrometer

Array32 = NDArray[np.float32]

#: Counts of the converter on each side of zero.
HALF_COUNTS = 2**15

#: Frequency of the mains, Hz.
MAINS = 50.0

#: Products are made in pieces of this size (cosines and sines, samples), too small for BLAS to
#: share them out among threads: so the last bits do not depend on how many threads there are.
PART, SPAN = 8, 512

#: Sampling of a pixel starts anywhere within this time, s.
START = 1.0


class Electronics:
    """Two channels as one acquisition uses them.

    Parameters
    ----------
    vibrometer : Vibrometer
    digitizer : AnalogInput
    acquisition : Acquisition
    frequency : ndarray, shape (tone,), Hz
        That the generator truly plays.
    """

    def __init__(
        self,
        vibrometer: Vibrometer,
        digitizer: AnalogInput,
        acquisition: Acquisition,
        frequency: Array,
    ) -> None:
        self._vibrometer = vibrometer
        self._digitizer = digitizer
        self._acquisition = acquisition
        self._orders = np.arange(1, 2 + len(vibrometer.harmonics))
        harmonics = np.outer(self._orders, frequency).ravel()
        self._velocity_tones = np.append(harmonics, MAINS)
        self._reference_tones = frequency
        self._velocity_carrier = self._carrier(self._velocity_tones)
        self._reference_carrier = self._carrier(frequency)
        ranges = np.array([digitizer.velocity_range, digitizer.reference_range])
        self.volts_per_count: Array = ranges / HALF_COUNTS

    def record(
        self,
        velocity: ComplexArray,
        lit: BoolArray,
        uniform: Array,
        normal: Array32,
        noisier: Array | None = None,
    ) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
        """Sample some pixels; their counts.

        Parameters
        ----------
        velocity : ndarray of complex, shape (block, tone), m/s
            Along the line of sight, relative to the excitation. A block may be longer than the
            pixels it holds: products of matrices of one shape make results of the same last bits.
        lit : ndarray of bool, shape (block,)
            Whether light comes back.
        uniform : ndarray, shape (pixel, 4)
        normal : ndarray of float32, shape (pixel, channel, sample)
        noisier : ndarray, shape (pixel,), optional
            Factor of the laser's noise.

        Returns
        -------
        counts : ndarray of int16, shape (pixel, channel, sample)
        status : ndarray of uint8, shape (pixel,)
        """
        n = len(normal)
        start = np.zeros(len(velocity))
        start[:n] = START * uniform[:, 0]
        signal = _sum_of_tones(
            self._velocity_phasors(velocity), self._velocity_tones, start, self._velocity_carrier
        )
        played = complex(self._acquisition.amplitude * self._digitizer.reference_gain)
        amplitude = np.full(velocity.shape, played)
        reference = _sum_of_tones(amplitude, self._reference_tones, start, self._reference_carrier)
        return self._sampled(signal, reference, lit, (uniform, normal), noisier)

    def record_motion(
        self,
        velocity: Array32,
        played: Array32,
        power: float,
        lit: BoolArray,
        noise: tuple[Array, Array32],
        noisier: Array | None = None,
    ) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
        """Sample some records of one pixel that moves in any way; their counts.

        Parameters
        ----------
        velocity : ndarray of float32, shape (record, sample), m/s
        played : ndarray of float32, shape (record, sample), V
        power : float, m^2/s^2
            Mean square of the velocity, at all times.
        lit, noise, noisier
            As in `record`, with a record in the place of a pixel.
        """
        v = self._vibrometer
        signal = np.float32(v.sensitivity) * self._distorted(velocity, power)
        if v.hum:
            start = START * noise[0][:, :1]
            time = start + np.arange(velocity.shape[1]) / self._acquisition.rate
            signal += (v.hum * np.cos(2 * np.pi * MAINS * time)).astype(np.float32)
        reference = np.float32(self._digitizer.reference_gain) * played
        return self._sampled(signal, reference, lit, noise, noisier)

    def _distorted(self, velocity: Array32, power: float) -> Array32:
        """Add harmonics by a curved characteristic, ``v + a sum_n r_n T_n(v / a)``.

        With ``a^2 = 2 power`` a sine of that amplitude gets exactly the harmonics r_n; any other
        signal gets what the same characteristic makes of it.
        """
        ratios = self._vibrometer.harmonics
        size = np.float32(np.sqrt(2 * power))
        if not any(ratios) or size == 0:
            return velocity
        curve = np.polynomial.Chebyshev([0.0, 1.0, *ratios])
        return np.asarray(size * curve(velocity / size), np.float32)

    def _sampled(
        self,
        signal: Array32,
        reference: Array32,
        lit: BoolArray,
        drawn: tuple[Array, Array32],
        noisier: Array | None,
    ) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
        """Add the noise to voltages of a block, and convert those of its pixels."""
        (uniform, normal), n, v = drawn, len(drawn[1]), self._vibrometer
        noise = self._band_limited(normal[:, 0], len(signal))
        with_light = noise if noisier is None else noise * noisier[:, None].astype(np.float32)
        full_scale = v.sensitivity * v.full_scale
        volts = np.empty(normal.shape, np.float32)
        np.multiply(with_light, np.float32(v.noise * full_scale), out=volts[:, 0])
        np.multiply(normal[:, 1], np.float32(self._digitizer.reference_noise), out=volts[:, 1])
        volts[:, 0] += signal[:n]
        volts[:, 1] += reference[:n]
        lost = self._lost(lit[:n], uniform)
        if lost.any():
            np.copyto(volts[:, 0], np.float32(v.burst * full_scale) * noise, where=lost)
        over = _size(volts[:, 0]) > full_scale
        if over.any():
            np.clip(volts[:, 0], -full_scale, full_scale, out=volts[:, 0])
        if self._digitizer.exchanged:
            volts = volts[:, ::-1].copy()
        return self._converted(volts, np.any(lost, axis=1), over)

    def _carrier(self, frequency: Array) -> Array32:
        """Compute cosines and sines of the tones over one record, shape (2 tone, sample)."""
        a = self._acquisition
        angle = 2 * np.pi * np.outer(frequency, np.arange(a.samples) / a.rate)
        return np.concatenate([np.cos(angle), np.sin(angle)]).astype(np.float32)

    def _velocity_phasors(self, velocity: ComplexArray) -> ComplexArray:
        """Compute voltages of fundamentals, harmonics and hum, shape (pixel, tone), V.

        A distorted cosine cos(w t + phi) has the harmonics r_n cos(n (w t + phi)).
        """
        v = self._vibrometer
        size, phase = v.sensitivity * np.abs(velocity), np.angle(velocity)
        parts = [
            r * size * np.exp(1j * n * phase)
            for n, r in zip(self._orders, (1.0, *v.harmonics), strict=True)
        ]
        return np.concatenate([*parts, np.full((len(velocity), 1), complex(v.hum))], axis=1)

    def _lost(self, lit: BoolArray, uniform: Array) -> BoolArray:
        """Find samples without light: those of a speckle's burst, or all; shape (pixel, sample)."""
        samples = self._acquisition.samples
        lost = np.zeros((len(lit), samples), bool)
        lost[~lit] = True
        spoilt = np.flatnonzero(uniform[:, 1] < self._vibrometer.drop_out)
        ends = np.floor(np.sort(uniform[spoilt, 2:4], axis=1) * samples).astype(int)
        for pixel, (begin, end) in zip(spoilt, ends, strict=True):
            lost[pixel, begin : end + 1] = True
        return lost

    def _band_limited(self, noise: Array32, block: int) -> Array32:
        """Draw white noise, cut off at the bandwidth and as strong if sampling shows it."""
        a, bandwidth = self._acquisition, self._vibrometer.bandwidth
        if bandwidth >= a.rate / 2:
            return noise
        keep = np.fft.rfftfreq(a.samples, 1.0 / a.rate) <= bandwidth
        lines = np.where((np.arange(len(keep)) * 2) % a.samples == 0, 1, 2)
        gain = np.sqrt(a.samples / lines[keep].sum())
        filled = np.zeros((block, a.samples), np.float32)
        filled[: len(noise)] = noise
        limited = np.fft.irfft(np.fft.rfft(filled) * keep * gain, a.samples)
        return limited[: len(noise)].astype(np.float32)

    def _converted(
        self, volts: Array32, lost: BoolArray, over: BoolArray
    ) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
        """Convert voltages to counts and status.

        Beyond its range the converter stays at its last count.
        """
        volts /= self.volts_per_count.astype(np.float32)[:, None]
        np.rint(volts, out=volts)
        rails = (volts.min(axis=2) <= -HALF_COUNTS) | (volts.max(axis=2) >= HALF_COUNTS - 1)
        if rails.any():
            np.clip(volts, -HALF_COUNTS, HALF_COUNTS - 1, out=volts)
        counts = volts.astype(np.int16)
        over = over | rails.any(axis=1)
        status = np.where(over, Status.over_range, Status.good).astype(np.uint8)
        if self._vibrometer.drop_out_reported:
            status |= np.where(lost, Status.dropped_out, Status.good).astype(np.uint8)
        return counts, status


def _size(signal: Array32) -> Array32:
    """Give the largest size of each row."""
    return np.maximum(signal.max(axis=1), -signal.min(axis=1))


def _sum_of_tones(
    phasors: ComplexArray, frequency: Array, start: Array, carrier: Array32
) -> Array32:
    """Sum the tones ``Re sum_k phasor_k exp(i w_k (start + t))``, shape (pixel, sample)."""
    turned = phasors * np.exp(2j * np.pi * frequency * start[:, None])
    parts = np.concatenate([turned.real, -turned.imag], axis=1).astype(np.float32)
    total = np.zeros((len(parts), carrier.shape[1]), np.float32)
    for k in range(0, len(carrier), PART):
        for n in range(0, carrier.shape[1], SPAN):
            total[:, n : n + SPAN] += parts[:, k : k + PART] @ carrier[k : k + PART, n : n + SPAN]
    return total


#: Uniform numbers a pixel; a multiple of what the generator makes at once.
UNIFORMS = 4

#: 64-bit words that Philox makes for one count.
BLOCK = 4

#: Equally probable levels of the normal numbers, so that one 16-bit number draws one.
LEVELS = 2**16


class PixelNoise:
    """Random numbers of one view.

    Parameters
    ----------
    seed : sequence of int
    view : str
    """

    def __init__(self, seed: Sequence[int], view: str) -> None:
        entropy = [len(seed), *seed, *view.encode()]
        self._key = np.random.SeedSequence(entropy).generate_state(2, np.uint64)

    def draw(
        self, stream: int, first: int, pixels: int, samples: int
    ) -> tuple[Array, NDArray[np.float32]]:
        """Draw random numbers of successive pixels.

        Parameters
        ----------
        stream : int
            From 0 to 2^64 - 1, for example a scan line's number.
        first : int
            Place of the first pixel in the stream.
        samples : int
            Samples per channel; other numbers of samples are other streams.

        Returns
        -------
        uniform : ndarray, shape (pixel, UNIFORMS)
            In [0, 1).
        normal : ndarray of float32, shape (pixel, 2, sample)
            Of zero mean and unit variance on 65536 levels, the largest 4.3.
        """
        uniform = np.empty((pixels, UNIFORMS))
        normal = np.empty((pixels, 2, samples), np.float32)
        self.fill(stream, first, uniform, normal)
        return uniform, normal

    def fill(self, stream: int, first: int, uniform: Array, normal: Array32) -> None:
        """Draw them into arrays of these shapes."""
        pixels, _, samples = normal.shape
        counts = -(-2 * samples // (4 * BLOCK))
        words = UNIFORMS + BLOCK * counts
        counter = np.array([first * words // BLOCK, samples, stream, 0], np.uint64)
        generator = np.random.Philox(key=self._key, counter=counter)
        raw = generator.random_raw(pixels * words).reshape(pixels, words)
        np.multiply(raw[:, :UNIFORMS] >> np.uint64(11), 2.0**-53, out=uniform)
        level = raw[:, UNIFORMS:].view(np.uint16)[:, : 2 * samples]
        # All levels are there; not to be asked for each saves half of the time.
        _normal_levels().take(level, mode="wrap", out=normal.reshape(pixels, -1))


@cache
def _normal_levels() -> NDArray[np.float32]:
    """Compute middle quantiles of the normal distribution, scaled to unit variance."""
    levels = scipy.special.ndtri((np.arange(LEVELS) + 0.5) / LEVELS)
    return (levels / levels.std()).astype(np.float32)
