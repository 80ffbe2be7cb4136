"""Who watches a session: told of every view and line as they come, asked between lines.

`Watcher` is the contract of all that show a session or steer it: the bar of a terminal, a page in
a browser. A session runs the same without one. What it tells costs it nothing: numbers that take
work, such as the velocity of a line, are computed when a watcher asks for them, in whose thread
they may be; what is told is never changed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from sldvexp import instrument
from sldvexp import signal as signals
from sldvexp.lazy import xarray as xr
from sldvexp.typing import IntArray

#: Beginning of the names of lines that search a circle around where a rough pose predicts it.
SEARCH = "search"


@dataclass(frozen=True)
class PartAhead:
    """What a part of a view takes, before it begins.

    Attributes
    ----------
    kind : str
        A key of `sldvexp.session.session.KINDS`.
    lines, pixels : int
    kept : int
        Pixels of these that the journal has already, so that they are not scanned.
    seconds : float, s
        Of samples, for all pixels.
    searches : bool
        Whether circles are searched first, which takes more pixels than these.
    """

    kind: str
    lines: int
    pixels: int
    kept: int
    seconds: float
    searches: bool = False


@dataclass(frozen=True)
class ViewAhead:
    """What a view takes, before it begins.

    Attributes
    ----------
    name : str
    number, count : int
        View `number` of `count`, from 1.
    parts : tuple of PartAhead
        In their order.
    """

    name: str
    number: int
    count: int
    parts: tuple[PartAhead, ...]

    @property
    def lines(self) -> int:
        """Number of scan lines of all parts."""
        return sum(part.lines for part in self.parts)

    @property
    def pixels(self) -> int:
        """Number of pixels of all parts."""
        return sum(part.pixels for part in self.parts)

    @property
    def kept(self) -> int:
        """Number of pixels that the journal has already."""
        return sum(part.kept for part in self.parts)


@dataclass(frozen=True, eq=False)
class LineDone:
    """A scan line that is in the journal.

    Attributes
    ----------
    view : str
    kind : str
        Of the part.
    lines : str
        Name of the lines that are scanned together: ``image``, ``2_coarse`` of a circle, or
        ``search_003`` of a ring of pixels around a predicted circle.
    number, count : int
        Line `number` of `count` such lines, from 1.
    dac : ndarray of int, shape (pixel, 2), steps
    samples : RawSamples or ResponseSums
        Of a broadband excitation, the sums of its records.
    kept : bool
        Whether it was in the journal before, and nothing was scanned.
    again : bool
        Whether it takes the place of the line of that number that was told before.
    acquisition : Acquisition
    signal : SignalEstimator
    """

    view: str
    kind: str
    lines: str
    number: int
    count: int
    dac: IntArray
    samples: instrument.RawSamples | signals.ResponseSums
    kept: bool
    again: bool
    acquisition: instrument.Acquisition
    signal: signals.SignalEstimator

    @cached_property
    def image(self) -> signals.ComplexImage | signals.ResponseImage:
        """Complex pixels of this line alone, with their flags.

        The session makes them of all lines together, which with `refine` gives other frequencies.
        """
        return pixels_of(self.signal, self.acquisition, [self.samples])

    @property
    def searches(self) -> bool:
        """True if it is one of a search, that nobody knew of before."""
        return self.lines.startswith(SEARCH)

    @property
    def level(self) -> tuple[float, float]:
        """Largest sample of velocity and of reference, V; of sums their r.m.s. at all lines."""
        if isinstance(self.samples, signals.ResponseSums):
            assert isinstance(self.signal, signals.Response)
            sums, records = self.samples, max(self.samples.count.sum(), 1)
            volts = np.sqrt([sums.syy.sum() / 2 / records, sums.sxx.sum() / 2 / records])
            return float(volts[0] / abs(self.signal.velocity_per_volt)), float(volts[1])
        most = np.abs(self.samples.counts.astype(np.int32)).max(axis=(0, 2))
        velocity, reference = most * self.samples.volts_per_count
        return float(velocity), float(reference)


@dataclass(frozen=True)
class Wish:
    """Wish for what comes next; as it is made, to go on.

    Attributes
    ----------
    again : tuple of int
        Numbers of the lines, of those that are scanned together and done, to scan once more.
        Nothing of the line that the journal has stays.
    skip : bool
        Whether the rest of the view is left out. Of an image the lines that are done stay, of a
        calibration object nothing does. The journal says so, and who resumes the run skips it too.
    stop : bool
        Whether the session ends, as by Ctrl-C: what is scanned is kept, and it can be resumed.
    """

    again: tuple[int, ...] = ()
    skip: bool = False
    stop: bool = False


GO_ON = Wish()


class Watcher:
    """Someone who watches; this one does nothing. Methods are called where the session runs.

    A context that is entered for the time of a run. What a method raises ends the session, as any
    fault does.
    """

    def __enter__(self) -> None:
        """Begin to watch."""

    def __exit__(self, *exception: object) -> None:
        """End; also after a fault or Ctrl-C, of which the arguments tell."""

    def run_begun(self, folder: Path) -> None:
        """Note the folder in which a run keeps what it has scanned."""

    def run_done(self, files: list[Path]) -> None:
        """Note that a run is done, and the files that it has left, the dataset first."""

    def step_begun(self, name: str, number: int, count: int) -> None:
        """Note that step `number` of `count` of a run begins."""

    def session_begun(self, views: tuple[ViewAhead, ...]) -> None:
        """Note what all views take, before the first; a run may have several sessions."""

    def view_begun(self, view: ViewAhead) -> None:
        """Note that a view begins; the instrument is not there yet."""

    def arrived(self, rest: Callable[[], None]) -> None:
        """Note that the instrument stands in the view.

        Parameters
        ----------
        rest : callable
            Sends the mirrors home and switches the generator off, for a pause in `between_lines`;
            the next line brings both back.
        """

    def between_lines(self, view: str, lines: str, done: int, count: int) -> Wish:
        """Say what comes next; who wants a pause waits here.

        Called before the first and after each line of some that are scanned together, after the
        last one too.

        Parameters
        ----------
        lines : str
            As `LineDone.lines`.
        done, count : int
            How many of these lines there are, and how many there will be.
        """
        return GO_ON

    def line_done(self, line: LineDone) -> None:
        """Note a line, also one that the journal had."""

    def view_done(self, view: ViewAhead, groups: Mapping[str, xr.Dataset]) -> None:
        """Note that a view is done; its groups of the dataset, by their names."""

    def session_done(self) -> None:
        """Note that all views are done."""

    def asking(self, request: str) -> AbstractContextManager[object]:
        """Make a context for the time in which a person at the terminal is asked for something."""
        return nullcontext()


def in_words(lines: str, number: int, count: int, circles: Sequence[int] = ()) -> str:
    """Say which line it is of those that are scanned together.

    Parameters
    ----------
    circles : sequence of int
        Numbers of the view's circles in the order in which they are scanned; without them their
        places in it.

    Examples
    --------
    >>> in_words("image", 3, 25), in_words("2_coarse", 1, 3), in_words("search_007", 1, 1)
    ('line 3 of 25', 'circle 2, coarse line 1 of 3', 'searching circles, ring 7')
    """
    first, _, stage = lines.partition("_")
    if first == SEARCH:
        return f"searching circles, ring {int(stage)}"
    if stage and circles:
        first = str(circles[int(first) - 1])
    named = f"circle {first}, {stage} line" if stage else "line"
    return f"{named} {number} of {count}"


def pixels_of(
    signal: signals.SignalEstimator,
    acquisition: instrument.Acquisition,
    lines: Sequence[instrument.RawSamples | signals.ResponseSums],
) -> signals.ComplexImage | signals.ResponseImage:
    """Turn samples of some lines, or sums of their records, into complex pixels."""
    if acquisition.drive is None:
        samples = [line for line in lines if isinstance(line, instrument.RawSamples)]
        return complex_pixels(signal, acquisition, samples)
    assert isinstance(signal, signals.Response)
    sums = [line for line in lines if isinstance(line, signals.ResponseSums)]
    return signal.image(signals.ResponseSums.concatenated(sums), acquisition.drive)


def complex_pixels(
    signal: signals.SignalEstimator,
    acquisition: instrument.Acquisition,
    lines: Sequence[instrument.RawSamples],
) -> signals.ComplexImage:
    """Turn the samples of some lines into complex pixels, with the instrument's own flags."""
    times = np.arange(acquisition.samples) / lines[0].rate
    status = np.concatenate([line.status for line in lines])
    image = signal.demodulate(
        np.concatenate([line.counts for line in lines]),
        times,
        acquisition.excitation,
        volts_per_count=lines[0].volts_per_count,
        quality=status & instrument.Status.dropped_out == 0,
    )
    over = status & instrument.Status.over_range
    saturated = np.where(over, signals.Flag.saturated, 0).astype(np.uint8)
    return replace(image, flags=image.flags | saturated)
