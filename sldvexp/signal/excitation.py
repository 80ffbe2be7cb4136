r"""Excitation of a record: its waveform, the lines that it has, and the window that follows it.

A record of N samples at the rate f_s has the lines ``f_k = k f_s / N``. An excitation that repeats
with the record has energy at lines only, so that whole records need no window and leak nothing once
the structure has gone through one record in advance. All others are cut off by the record's ends:

=============  ========================================================  =========================
kind           waveform of a record                                      window
=============  ========================================================  =========================
sine           tones, in phase                                           none; first record dropped
multisine      equal lines of Schroeder's phases ``-pi k (k - 1) / n``   none; first record dropped
chirp          linear sweep through the band                             none; first record dropped
pseudo_random  equal lines of random phases, the same in every record    none; first record dropped
burst_random   noise, then silence in which the response dies            none
random         noise without end                                         Hann
hammer         one half-sine pulse                                       ``exp(-t / tau)``, or none
=============  ========================================================  =========================

An exponential window adds ``1 / (tau omega_n)`` to the damping ratio of a mode, which
`added_damping` tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.errors import Checks, UserError
from sldvexp.typing import Array, ComplexArray, IndexArray

#: Share of a hammer's record before its pulse, from which a trigger is known to be complete.
BEFORE_PULSE = 0.02
#: Length of a force window in periods of the band's end, and the share of it that fades out.
LEAST_FORCE, FADE = 2.0, 0.25
#: How far a tone may be from a line, in line spacings: the phase then turns by less than 1e-5.
ON_LINE = 1e-6


class ExcitationKind(Enum):
    """Waveforms that a generator, or a hammer, excites a structure with."""

    sine = "sine"
    multisine = "multisine"
    chirp = "chirp"
    pseudo_random = "pseudo_random"
    burst_random = "burst_random"
    random = "random"
    hammer = "hammer"


class LineChoice(Enum):
    """Lines of the band that a multisine or a pseudo-random signal excites.

    Attributes
    ----------
    every
        All of them; distortion falls on excited lines and is not seen.
    odd
        Odd multiples of the spacing: distortion of even order shows on the even ones.
    sparse
        Three of four odd ones, one of each four left out by chance: also distortion of odd order
        shows.
    """

    every = "every"
    odd = "odd"
    sparse = "sparse"


#: Kinds that repeat with the record.
PERIODIC = (
    ExcitationKind.sine,
    ExcitationKind.multisine,
    ExcitationKind.chirp,
    ExcitationKind.pseudo_random,
)
#: Kinds whose lines can be chosen.
OF_CHOSEN_LINES = (ExcitationKind.multisine, ExcitationKind.pseudo_random)
#: Odd lines of which one is left out where they are sparse.
GROUP = 4


@dataclass
class Excitation:
    """Settings of an excitation, whatever the record is.

    Parameters
    ----------
    kind : ExcitationKind
    band : list of 2 float, Hz
        Lowest and highest frequency that is excited; tones of a `sine` are given otherwise.
    amplitude : float, V
        Of the reference: r.m.s. while the signal plays; of `sine` the peak of each tone, and of
        `hammer` the pulse's peak (in the unit of the hammer's channel).
    lines : LineChoice
        Of a multisine or a pseudo-random signal.
    seed : int
        Of what is random about the waveform.
    burst : float
        Share of the record that a `burst_random` plays for.
    decay : float, s
        Time constant tau of a hammer's exponential window; 0 for none.
    force : float, s
        Length of a hammer's force window, beyond which its channel is taken for zero; 0 for none.
    overlap : bool
        Whether `random` also uses stretches halfway between records, which must follow one another
        without a gap.
    """

    kind: ExcitationKind = ExcitationKind.multisine
    band: list[float] = field(default_factory=lambda: [50.0, 1340.0])
    amplitude: float = 1.0
    lines: LineChoice = LineChoice.every
    seed: int = 0
    burst: float = 0.5
    decay: float = 0.0
    force: float = 0.0
    overlap: bool = False

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is wrong."""
        checks.positive(f"{name}.amplitude", self.amplitude)
        rising = len(self.band) == 2 and 0 < self.band[0] < self.band[1] < np.inf
        message = f"must be two increasing positive frequencies, not {list(self.band)}"
        checks.require(rising, f"{name}.band", message)
        checks.non_negative(f"{name}.seed", self.seed)
        checks.probability(f"{name}.burst", self.burst)
        checks.non_negative(f"{name}.decay", self.decay)
        chosen = self.lines is LineChoice.every or self.kind in OF_CHOSEN_LINES
        message = f"can be chosen of multisine and pseudo_random, not of {self.kind.name}"
        checks.require(chosen, f"{name}.lines", message)
        damped = self.decay == 0 or self.kind is ExcitationKind.hammer
        message = f"is the window of a hammer, not of {self.kind.name}"
        checks.require(damped, f"{name}.decay", message)
        checks.non_negative(f"{name}.force", self.force)
        hit = self.force == 0 or self.kind is ExcitationKind.hammer
        message = f"is the window of a hammer, not of {self.kind.name}"
        checks.require(hit, f"{name}.force", message)
        short = self.force > 0 and rising and self.force * self.band[1] < LEAST_FORCE
        message = f"must hold the pulse, {LEAST_FORCE / self.band[-1]:.3g} s or more"
        checks.require(not short, f"{name}.force", message)
        endless = not self.overlap or self.kind is ExcitationKind.random
        message = f"is of random, whose records are windowed, not of {self.kind.name}"
        checks.require(endless, f"{name}.overlap", message)

    @property
    def periodic(self) -> bool:
        """True if the waveform repeats with the record."""
        return self.kind in PERIODIC

    @property
    def lead(self) -> int:
        """Records to throw away before the first that counts, after every move of the beam."""
        return int(self.periodic)

    def design(
        self, rate: float, samples: int, tones: Sequence[float] | Array = ()
    ) -> RecordDesign:
        """Lay the excitation out in records of `samples` at `rate` Hz.

        Parameters
        ----------
        tones : sequence of float, Hz
            Of a `sine`; each must be a line of the record.

        Raises
        ------
        UserError
            If the band has no line, reaches half the rate, or a tone is no line.

        Examples
        --------
        >>> from sldvexp.signal import Excitation
        >>> design = Excitation(band=[100.0, 300.0]).design(rate=1000.0, samples=200)
        >>> design.frequency[:3].tolist(), design.waveform().shape
        ([100.0, 105.0, 110.0], (200,))
        """
        if self.kind is ExcitationKind.sine:
            return RecordDesign(self, rate, samples, _lines_of_tones(rate, samples, tones))
        # The band's ends are lines also where rounding puts them beside one.
        low, high = np.array(self.band) * samples / rate
        every = np.arange(max(1, int(np.ceil(low - ON_LINE))), int(np.floor(high + ON_LINE)) + 1)
        if len(every) == 0:
            raise UserError(
                f"excitation: no line of a record of {samples / rate:g} s lies between "
                f"{self.band[0]:g} and {self.band[1]:g} Hz; lines are {rate / samples:g} Hz apart"
            )
        if 2 * every[-1] >= samples:
            raise UserError(
                f"excitation: a band up to {self.band[1]:g} Hz needs a rate above "
                f"{2 * self.band[1]:g} Hz, not {rate:g}"
            )
        if self.lines is LineChoice.every:
            return RecordDesign(self, rate, samples, every)
        excited = every[every % 2 == 1]
        if self.lines is LineChoice.sparse:
            whole = excited[: len(excited) // GROUP * GROUP].reshape(-1, GROUP)
            out = np.random.default_rng([self.seed, 1]).integers(GROUP, size=len(whole))
            excited = np.setdiff1d(excited, whole[np.arange(len(whole)), out])
        if len(excited) == 0:
            raise UserError("excitation: the band has no odd line; make the record longer")
        return RecordDesign(self, rate, samples, excited, np.setdiff1d(every, excited))


@dataclass(frozen=True, eq=False)
class RecordDesign:
    """Excitation in records of a given length: what the generator plays and what is read.

    Attributes
    ----------
    excitation : Excitation
    rate : float, Hz
    samples : int
        Of a record.
    lines : ndarray of int, shape (line,)
        Excited lines, as multiples of the spacing.
    unexcited : ndarray of int, shape (other,)
        Lines of the band that are left out, so that distortion shows there.
    """

    excitation: Excitation
    rate: float
    samples: int
    lines: IndexArray
    unexcited: IndexArray = field(default_factory=lambda: np.zeros(0, np.intp))

    @property
    def read_lines(self) -> IndexArray:
        """Lines that sums are kept of, excited or not, in ascending order, shape (read,)."""
        return np.union1d(self.lines, self.unexcited)

    @property
    def record_seconds(self) -> float:
        """Length of a record, s."""
        return self.samples / self.rate

    @property
    def frequency(self) -> Array:
        """Frequencies of the excited lines, shape (line,), Hz."""
        return self.hertz(self.lines)

    def hertz(self, lines: IndexArray) -> Array:
        """Convert lines to frequencies, Hz."""
        return lines * self.rate / self.samples

    @property
    def reference_amplitude(self) -> Array:
        """Nominal amplitude of each line, shape (line,), V: of the sine of the line's power.

        It is the same in all views, whatever noise made of a record.
        """
        kind, lines = self.excitation.kind, len(self.lines)
        if kind in (ExcitationKind.random, ExcitationKind.burst_random):
            share = 1.0 if kind is ExcitationKind.random else self.excitation.burst
            return np.full(lines, self.excitation.amplitude * np.sqrt(2 * share / lines))
        phasors = 2 / self.samples * np.fft.rfft(self.waveform())
        return np.asarray(np.abs(phasors[self.lines]), float)

    @property
    def window(self) -> Array:
        """Factor of each sample, shape (sample,)."""
        n = np.arange(self.samples)
        if self.excitation.kind is ExcitationKind.random:
            return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi * n / self.samples), float)
        if self.excitation.decay > 0:
            return np.exp(-n / (self.rate * self.excitation.decay))
        return np.ones(self.samples)

    @property
    def force_window(self) -> Array:
        """Factor of each sample of a hammer's channel, 1 over the pulse, shape (sample,)."""
        seconds, force = np.arange(self.samples) / self.rate, self.excitation.force
        if force == 0:
            return np.ones(self.samples)
        end = BEFORE_PULSE * self.record_seconds + force
        left = np.clip((end - seconds) / (FADE * force), 0, 1)
        return np.asarray(0.5 - 0.5 * np.cos(np.pi * left), float)

    def added_damping(self, frequency: ArrayLike) -> Array:
        """Compute by how much the window raises damping ratios, ``1 / (tau omega_n)``.

        Parameters
        ----------
        frequency : array_like, Hz
            Natural frequencies.
        """
        hertz = np.asarray(frequency, float)
        if self.excitation.decay == 0:
            return np.zeros(hertz.shape)
        return 1 / (self.excitation.decay * 2 * np.pi * hertz)

    def waveform(self, records: int = 1) -> Array:
        """Make what is played in some records, one after the other, without `lead`.

        Parameters
        ----------
        records : int
            How many; `random` is one stretch of noise that goes on from one to the next and from
            the last to the first, all others begin anew in each.

        Returns
        -------
        ndarray, shape (records * sample,), V
        """
        e, n = self.excitation, self.samples
        rng = np.random.default_rng([e.seed, 0])
        match e.kind:
            case ExcitationKind.sine:
                one = self._tones(np.full(len(self.lines), e.amplitude))
            case ExcitationKind.multisine | ExcitationKind.pseudo_random:
                one = self._tones(self._phases(rng) * e.amplitude * np.sqrt(2 / len(self.lines)))
            case ExcitationKind.chirp:
                one = self._sweep()
            case ExcitationKind.hammer:
                one = self._pulse()
            case ExcitationKind.random:
                return self._noise(rng, records * n, e.amplitude)
            case ExcitationKind.burst_random:
                plays = np.arange(n) < e.burst * n
                return np.concatenate(
                    [self._noise(rng, n, e.amplitude) * plays for _ in range(records)]
                )
        return np.tile(one, records)

    def spectra(self, records: ArrayLike) -> ComplexArray:
        """Transform records to phasors at `read_lines`, in the unit of the records.

        Parameters
        ----------
        records : array_like, shape (..., sample)

        Returns
        -------
        ndarray of complex, shape (..., read)
            Peak amplitudes of ``exp(+i omega t)``, with the window's mean divided out.
        """
        return self.phasors(np.fft.rfft(self.windowed(np.asarray(records, float)), axis=-1))

    def windowed(self, records: Array) -> Array:
        """Apply the window, without the records' offset, which it would spread over lines."""
        if self.excitation.kind in (ExcitationKind.random, ExcitationKind.hammer):
            return (records - self.offset(records)) * self.window
        return records

    def as_used(self, records: Array) -> Array:
        """Apply the force window to the reference of records, shape (..., 2, sample)."""
        if self.excitation.force == 0:
            return records
        reference = records[..., 1, :]
        hit = (reference - self.offset(reference)) * self.force_window
        return np.stack([records[..., 0, :], hit], axis=-2)

    def between(self, records: NDArray) -> NDArray:
        """Cut the stretches halfway between records, (pixel, record - 1, 2, sample)."""
        half = self.samples // 2
        parts = records[:, :-1, :, half:], records[:, 1:, :, : self.samples - half]
        whole = np.concatenate(parts, axis=-1)
        return np.asarray(whole[..., : self.samples])

    def offset(self, records: Array) -> Array:
        """Estimate the channel's offset, shape (..., 1): of a hammer from before its pulse."""
        quiet = self.samples
        if self.excitation.kind is ExcitationKind.hammer:
            quiet = max(1, int(BEFORE_PULSE * quiet / 2))  # half of it, as triggers jitter
        return np.asarray(records[..., :quiet].mean(axis=-1, keepdims=True))

    def phasors(self, spectrum: ComplexArray) -> ComplexArray:
        """Take those phasors of the whole spectrum of windowed records."""
        return np.asarray(spectrum[..., self.read_lines] * (2 / self.window.sum()), complex)

    def _phases(self, rng: np.random.Generator) -> ComplexArray:
        """Choose ``exp(i phase)`` of the lines: Schroeder's, or random ones."""
        count = len(self.lines)
        k = np.arange(1, count + 1)
        schroeder = -np.pi * k * (k - 1) / count
        multisine = self.excitation.kind is ExcitationKind.multisine
        return np.exp(1j * (schroeder if multisine else rng.uniform(0, 2 * np.pi, count)))

    def _tones(self, phasors: NDArray) -> Array:
        """Add up sines of the lines."""
        whole = np.zeros(self.samples // 2 + 1, complex)
        whole[self.lines] = phasors
        return np.asarray(np.fft.irfft(whole, self.samples) * self.samples / 2, float)

    def _noise(self, rng: np.random.Generator, samples: int, rms: float) -> Array:
        """Make normal noise between the lowest and the highest line, which repeats after all."""
        low, high = self.lines[[0, -1]] * samples // self.samples
        whole = np.zeros(samples // 2 + 1, complex)
        count = high - low + 1
        whole[low : high + 1] = rng.standard_normal((count, 2)) @ [1, 1j]
        return np.asarray(np.fft.irfft(whole, samples) * samples / 2 * rms / np.sqrt(count), float)

    def _sweep(self) -> Array:
        """Sweep from the lowest line to the highest, ending at the phase that it begins with."""
        low, high = int(self.lines[0]), int(self.lines[-1])
        high -= (high - low) % 2  # so that the mean of both, the turns of a record, is whole
        t = np.arange(self.samples) / self.samples
        turns = low * t + (high - low) * t**2 / 2
        return np.asarray(self.excitation.amplitude * np.sqrt(2) * np.cos(2 * np.pi * turns), float)

    def _pulse(self) -> Array:
        """Make a half-sine whose spectrum is a third (-9.5 dB) at the highest frequency."""
        t = np.arange(self.samples) / self.rate - BEFORE_PULSE * self.record_seconds
        turn = np.pi * t * self.excitation.band[1]
        return self.excitation.amplitude * np.where((turn > 0) & (turn < np.pi), np.sin(turn), 0.0)


def _lines_of_tones(rate: float, samples: int, tones: Sequence[float] | Array) -> IndexArray:
    """Find the lines of tones; refuse what is none."""
    wanted = np.atleast_1d(np.asarray(tones, float)) * samples / rate
    lines = np.rint(wanted).astype(np.intp)
    if len(lines) == 0:
        raise UserError("excitation: a sine needs its frequencies")
    off = np.abs(wanted - lines) > ON_LINE
    if off.any():
        raise UserError(
            f"excitation: {wanted[off][0] * rate / samples:g} Hz is no line of a record of "
            f"{samples / rate:g} s; lines are {rate / samples:g} Hz apart"
        )
    if (lines < 1).any() or (2 * lines >= samples).any() or len(np.unique(lines)) != len(lines):
        raise UserError(f"excitation: tones must differ and lie between 0 and {rate / 2:g} Hz")
    return lines
