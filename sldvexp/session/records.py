"""Records of a broadband excitation: taken, summed up, and taken again where they were spoilt.

Of a scan line nothing stays but the sums of its records (`sldvexp.signal.ResponseSums`), 32 bytes a
pixel and line. A record that is over range, has lost its light or missed its trigger is left out
and taken again, up to a limit for each pixel, unless no record of the pixel is good. At the end of
a view those pixels are measured once more whose coherence is worst, as long as there is time: all
records of a pixel are alike, so that its error goes with one over the root of their number.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.instrument import Acquisition, Instrument, RawSamples, Status
from sldvexp.instrument.protocol import CHANNELS
from sldvexp.instrument.recording import TellsSums
from sldvexp.scan import Sampling
from sldvexp.signal import Response, ResponseSums, SumsSettings
from sldvexp.signal.response_sums import SUMS
from sldvexp.typing import IntArray

log = logging.getLogger(__name__)

#: Samples of all channels that are held at once, so that memory does not grow with the line.
HELD = 2**21
#: Between the numbers of scan lines and those of their records that are taken again.
AGAIN = 2**32
#: Largest relative difference of the rate that was set from the one that was asked for.
RATE = 1e-6
#: Coherence over that of noise, up to which nothing moves.
NOTHING = 2.0
#: Pixels of a line that is measured once more.
ONCE_MORE = 25


def acquisition_of(sampling: Sampling) -> Acquisition:
    """Say to an instrument how pixels are sampled.

    Raises
    ------
    UserError
        If the band has no line.
    """
    s = sampling
    if not s.broadband:
        return Acquisition(s.rate, s.samples, tuple(s.frequency), s.amplitude)
    design = s.played.design(s.rate, s.samples)
    how = (s.records, s.let_go, s.triggered)
    return Acquisition(s.rate, s.samples, (), s.amplitude, design, *how)


@dataclass(frozen=True)
class Averaging:
    """Averaging of records, as one acquisition asks for them.

    Parameters
    ----------
    signal : Response
    acquisition : Acquisition
        With a `drive`.
    again : int
        Records of each pixel at most that are taken in the place of spoilt ones.
    """

    signal: Response
    acquisition: Acquisition
    again: int
    _warned_of: set[Path] = field(default_factory=set, init=False, compare=False, repr=False)

    def measure(self, instrument: Instrument, dac: IntArray, stream: int) -> ResponseSums:
        """Measure a scan line on an instrument that is configured so.

        Parameters
        ----------
        dac : ndarray of int, shape (pixel, 2), steps
        stream : int
            Number of the line, so that a simulation draws the same noise for it.

        Raises
        ------
        UserError
            If the instrument samples at another rate, or gives other records.
        """
        if isinstance(instrument, TellsSums):
            return self.as_asked(instrument.sums(dac), instrument.folder)
        sums = self._taken(instrument, self.acquisition, dac, stream)
        wanted, left = self.acquisition.records, self.again
        for round_ in range(1, self.again + 1):
            missing = wanted - sums.count
            few = np.flatnonzero((missing > 0) & (sums.count > 0))  # others are beside everything
            if not len(few) or left <= 0:
                break
            records = int(min(missing[few].min(), left))
            fewer = replace(self.acquisition, records=records)
            instrument.configure(fewer)
            more = self._taken(instrument, fewer, dac[few], stream + round_ * AGAIN)
            sums, left = added(sums, more, few), left - records
        if left < self.again:
            instrument.configure(self.acquisition)
        return replace(sums, made=self._made)

    @property
    def _made(self) -> SumsSettings:
        """What sums are made with."""
        assert self.acquisition.drive is not None
        return self.signal.made_with(self.acquisition.drive, self.again)

    def as_asked(self, sums: ResponseSums, where: Path) -> ResponseSums:
        """Make kept sums those that are asked for.

        Parameters
        ----------
        sums : ResponseSums
            Of a journal or a recording.
        where : Path
            Their file or folder, for the sentence.

        Raises
        ------
        UserError
            If they are made with settings that sums alone cannot be freed of.
        """
        if sums.made is None:
            if where not in self._warned_of:
                self._warned_of.add(where)
                log.warning(
                    "%s: does not say which velocity_per_volt, flags, force, overlap and again its "
                    "sums of records were made with; those of this run are taken for them",
                    where,
                )
            return replace(sums, made=self._made)
        unlike = list(sums.made.unlike(self._made))
        if unlike:
            kept = " and ".join(f"{key}={value}" for key, value, _ in unlike)
            wanted = " and ".join(f"{key}={value}" for key, _, value in unlike)
            raise UserError(
                f"{where}: its sums of records were made with {kept}, not with {wanted}, and the "
                f"records themselves are not kept: set {kept} again, or scan anew"
            )
        return sums.in_velocity_per_volt(self.signal.velocity_per_volt)

    def _taken(
        self, instrument: Instrument, acquisition: Acquisition, dac: IntArray, stream: int
    ) -> ResponseSums:
        """Take records of some pixels and sum them up, piece by piece."""
        design = acquisition.drive
        assert design is not None
        at_once = max(1, HELD // (2 * acquisition.records * acquisition.samples))
        found = []
        for first in range(0, len(dac), at_once):
            piece = dac[first : first + at_once]
            samples = instrument.scan(piece, stream=stream if first == 0 else None)
            _require_as_asked(samples, acquisition, len(piece))
            shape = (len(piece), acquisition.records)
            counts = _as_told(samples).reshape(*shape, *samples.counts.shape[1:])
            lost = samples.status & Status.dropped_out
            good = (lost == 0).reshape(shape) if len(lost) else None
            volts = samples.volts_per_count
            found.append(self.signal.sums(counts, design, volts_per_count=volts, good=good))
        return ResponseSums.concatenated(found)


def _as_told(samples: RawSamples) -> NDArray[np.int16]:
    """Let samples show what the instrument says of their records: over range, or no trigger.

    Faults of records are then found, and named, in one way, whether it says so or not.
    """
    over, missed = (samples.status & s != 0 for s in (Status.over_range, Status.untriggered))
    if not (over.any() or missed.any()):
        return samples.counts
    counts = samples.counts.copy()
    counts[over] = np.iinfo(counts.dtype).max
    counts[missed, CHANNELS.index("reference")] = 0
    return counts


def _require_as_asked(samples: RawSamples, acquisition: Acquisition, pixels: int) -> None:
    """Refuse records of another number, length or rate than asked for."""
    a, counts = acquisition, samples.counts
    if len(counts) != pixels * a.records:
        raise UserError(
            f"scan: {pixels * a.records} records were asked for and {len(counts)} came: triggers "
            "were missed, or the instrument takes another number of records"
        )
    if counts.shape[2] != a.samples:
        raise UserError(
            f"scan: records of {a.samples} samples were asked for and have {counts.shape[2]}; all "
            "must have the same length"
        )
    if abs(samples.rate - a.rate) > RATE * a.rate:
        raise UserError(
            f"scan: the instrument samples at {samples.rate:.10g} Hz, not at {a.rate:.10g} Hz, so "
            "that no line of a record is where the generator plays it; choose a rate that it has"
        )


def added(sums: ResponseSums, more: ResponseSums, pixels: IntArray) -> ResponseSums:
    """Add further records of some of the pixels."""
    whole = ResponseSums.zeros(len(sums.count), sums.frequency)
    for name in SUMS:
        getattr(whole, name)[pixels] = getattr(more, name)
    return sums.merged(whole)


def worst_first(sums: ResponseSums) -> IntArray:
    """Order pixels by their coherence over all lines, the worst first, ties by their numbers.

    ``sum |Sxy|^2 / Sxx`` over ``sum Syy``: a line counts by how much moves at it, so that a node at
    one line does not make a good pixel a bad one. Of n records of noise alone that is 1 / n; pixels
    that have no more than `NOTHING` times this come last, for nothing moves there, or no light
    comes back, and more records would not help.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.signal import ResponseSums
    >>> sums = ResponseSums.zeros(3, [50.0])
    >>> still, rough = [[[-1.0], [1.0], [1.0], [-1.0]], [[1.0], [0.5], [1.5], [1.0]]]
    >>> sums.add(np.ones((3, 4, 1)), [np.ones((4, 1)), still, rough])
    >>> worst_first(sums).tolist()
    [2, 0, 1]
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        explained = np.nansum(np.abs(sums.sxy) ** 2 / sums.sxx, axis=1)
        coherence = np.nan_to_num(explained / sums.syy.sum(axis=1))
    moves = coherence * sums.averages > NOTHING
    return np.argsort(np.where(moves, coherence, np.inf), kind="stable")


def once_more(
    sums: ResponseSums, dac: IntArray, seconds: float, spare: float
) -> Iterator[tuple[IntArray, IntArray]]:
    """Choose pixels to measure once more in the time that is left.

    Parameters
    ----------
    dac : ndarray of int, shape (pixel, 2), steps
    seconds : float, s
        That a pixel takes.
    spare : float, s
        For all of them.

    Yields
    ------
    pixels : ndarray of int
        Numbers of some of them, in lines that a journal can keep.
    dac : ndarray of int, shape (pixel, 2)
        Theirs.
    """
    chosen = worst_first(sums)[: int(spare / seconds)]
    for first in range(0, len(chosen), ONCE_MORE):
        pixels = chosen[first : first + ONCE_MORE]
        yield pixels, dac[pixels]


def require_records(parts: Sequence[Sampling], signal: object) -> None:
    """Refuse a broadband excitation whose samples would be fitted by sines.

    Raises
    ------
    UserError
        That says which signal it needs.
    """
    played = {s.excitation.name for s in parts if s.broadband}
    if played and not isinstance(signal, Response):
        raise UserError(
            f"scan.sampling.excitation={min(played)} needs signal=response, which averages records"
        )
