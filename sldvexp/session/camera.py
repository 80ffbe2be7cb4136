"""An instrument at one view, seen as a camera: scan lines in, complex pixels out.

`ViewContext` has what is at hand while a session is in one view, also the `Operator`: the person
at the terminal, who is asked when something must be done by hand.
"""

from __future__ import annotations

import signal as signals
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from sldvexp.dataset import Finding
from sldvexp.geometry import KnownPose
from sldvexp.instrument import Acquisition, Foresees, Instrument, RawSamples
from sldvexp.instrument.bench import make_safe
from sldvexp.instrument.person import GuideMaker
from sldvexp.instrument.recording import line_name as line_name
from sldvexp.laser import TwoMirror
from sldvexp.scan import Sampling
from sldvexp.session.journal import Journal, Measured
from sldvexp.session.operator import Operator
from sldvexp.session.records import Averaging, acquisition_of, require_records
from sldvexp.session.watching import LineDone, Watcher, complex_pixels
from sldvexp.signal import ComplexImage, Response, ResponseSums, SignalEstimator
from sldvexp.stopping import Stopped, undisturbed
from sldvexp.targets import Target
from sldvexp.typing import IntArray

#: Number of the first line of pixels that are measured once more.
ONCE_MORE_FROM = 2**24
#: Sampling of a pixel that somebody aims by.
LOOK = Acquisition(rate=25600.0, samples=64, excitation=())


class ViewSkipped(Exception):  # noqa: N818, for it is no error
    """The rest of a view is left out, as a watcher wished."""


class Camera:
    """Takes complex images line by line, from the journal where it has the line already.

    A context manager: leaving it leaves the instrument, which goes home.

    Parameters
    ----------
    arrive : callable
        Opens the instrument in this view. Called when it is needed for the first time; a view
        that is in the journal as a whole needs none.
    signal : SignalEstimator
    journal : Journal
        Of this view.
    watcher : Watcher, optional
        Told of every line, and asked between them.
    view : str
        Its name, for the watcher.
    planned : int
        Number of scan lines of the view.
    left : tuple of str and int, optional
        Where the view was left when it was scanned before, see `Journal.left`.
    recorded : callable, optional
        Gives the pixels of lines by their name, if they were recorded before.
    """

    def __init__(
        self,
        arrive: Callable[[], AbstractContextManager[Instrument]],
        signal: SignalEstimator,
        journal: Journal,
        watcher: Watcher | None = None,
        view: str = "",
        planned: int = 0,
        left: tuple[str, int] | None = None,
        recorded: Callable[[str], list[IntArray]] | None = None,
    ) -> None:
        self.recorded = recorded or (lambda name: [])
        self.signal = signal
        self.journal = journal
        self.kind = ""  # of the part that is scanned
        self.skipped = False  # whether the rest of the view is left out
        self.lines_done = 0
        self._watcher = watcher or Watcher()
        self._view, self._left = view, left
        self._arrive = arrive
        self._opened = ExitStack()
        self._instrument: Instrument | None = None
        self._foresees = False  # whether it hears of lines that are going to be scanned
        self._wanted: Acquisition | None = None
        self._set: Acquisition | None = None
        self._averages: Averaging | None = None
        self._taken, self._repeated = 0, planned
        self._coming: list[tuple[IntArray, int]] = []  # lines and numbers that are asked for

    def __enter__(self) -> Camera:
        return self

    def __exit__(self, *exception: object) -> None:
        with undisturbed():
            self._opened.__exit__(*exception)  # type: ignore[arg-type]

    @property
    def instrument(self) -> Instrument:
        """Instrument, sampling as was said last."""
        if self._instrument is None:
            self._instrument = self._opened.enter_context(self._arrive())
            self._foresees = isinstance(self._instrument, Foresees)
            self._watcher.arrived(self.rest)
        if self._wanted is not None and self._set != self._wanted:
            self._instrument.configure(self._wanted)
            self._set = self._wanted
        return self._instrument

    def rest(self) -> None:
        """Send the mirrors home and switch the generator off until the next line is scanned."""
        if self._instrument is not None and self._set is not None:
            known, self._set = self._set, None
            make_safe(self._instrument, known)

    def sample(self, sampling: Sampling) -> None:
        """Say how all pixels that follow are sampled."""
        require_records([sampling], self.signal)
        self._wanted, self._averages = acquisition_of(sampling), None
        if isinstance(self.signal, Response) and sampling.broadband:
            self._averages = Averaging(self.signal, self._wanted, sampling.again)

    def look(self) -> RawSamples:
        """Sample a pixel where the beam stands: few samples, the generator off."""
        instrument = self._instrument or self.instrument
        if self._set != LOOK:
            self._set = None  # a scan that goes on must configure again, also after a fault
            instrument.configure(LOOK)
            self._set = LOOK
        return instrument.acquire()

    def image(self, name: str, lines: Sequence[IntArray], in_part: bool = False) -> ComplexImage:
        """Scan some lines and turn them into complex pixels.

        Parameters
        ----------
        name : str
            Of these lines, unique in the view.
        lines : sequence of ndarray of int, shape (pixel, 2)
        in_part : bool
            Whether the first of the lines are of use when the rest is skipped.

        Returns
        -------
        ComplexImage
            Of the pixels of all lines, in their order.

        Raises
        ------
        ViewSkipped
            If the watcher wishes it, and what is done is of no use.
        """
        done = self.scanned(name, lines, in_part)
        samples = [line for line in done if isinstance(line, RawSamples)]
        return complex_pixels(self.signal, self.acquisition, samples)

    def placed(
        self, name: str, lines: Sequence[IntArray], within: float, lost: int = 0
    ) -> Sequence[IntArray]:
        """Put lines that follow from estimates where a recording has them.

        Another estimator of signals places them some steps beside, where nothing was recorded.

        Parameters
        ----------
        within : float, steps
            By how much the box around them may differ.
        lost : int
            By how many lines the recording may have more or fewer.

        Returns
        -------
        sequence of ndarray of int
            Of the recording, and what it does not have any more; those given if there is none, or
            it has other ones.
        """
        kept = self.recorded(name)
        if kept and _alike(kept, lines, within, lost):
            return kept
        if kept and len(kept) < len(lines) and _alike(kept, lines[: len(kept)], within, 0):
            return [*kept, *lines[len(kept) :]]
        return lines

    def known(self, name: str, count: int) -> list[IntArray | None]:
        """Give the pixels of lines that are there already, None for each that must be measured."""
        if recorded := self.recorded(name):
            return [*recorded[:count], *[None] * (count - len(recorded))]
        return [self.journal.pixels(line_name(name, place)) for place in range(count)]

    @property
    def acquisition(self) -> Acquisition:
        """How pixels are sampled, as was said last."""
        assert self._wanted is not None, "call sample first"
        return self._wanted

    def scanned(
        self, name: str, lines: Sequence[IntArray], in_part: bool = False
    ) -> list[Measured]:
        """Scan some lines; samples of each, or the sums of its records. See `image`."""
        assert self._wanted is not None, "call sample first"
        first, self._taken = self._taken, self._taken + len(lines)
        self._coming = [(dac, first + place) for place, dac in enumerate(lines)]
        done: list[Measured] = []
        while not self._skips(name, lines, done, first) and len(done) < len(lines):
            done.append(self._line(name, lines, len(done), first))
        if len(done) < len(lines) and not (in_part and done):
            raise ViewSkipped
        return done

    def once_more(self, name: str, place: int, dac: IntArray) -> Measured:
        """Measure a line of pixels that were measured already, of which no watcher is told."""
        where = line_name(name, place)
        return self._kept(where, dac, lambda: self._measure(dac, ONCE_MORE_FROM + place))

    def _kept(self, where: str, dac: IntArray, measure: Callable[[], Measured]) -> Measured:
        """Take a line from the journal, sums as they are asked for, or measure it."""
        samples = self.journal.line(where, dac, self.acquisition, measure)
        if self._averages is None or not isinstance(samples, ResponseSums):
            return samples
        return self._averages.as_asked(samples, self.journal.folder)

    def _measure(self, dac: IntArray, number: int) -> Measured:
        """Measure a line, of which nothing is in the journal."""
        if self._averages is None:
            instrument = self.instrument
            if self._foresees:
                cast(Foresees, instrument).expect(self._coming)
            return instrument.scan(dac, stream=number)
        return self._averages.measure(self.instrument, dac, number)

    def _skips(
        self, name: str, lines: Sequence[IntArray], done: list[Measured], first: int
    ) -> bool:
        """Do what the watcher wishes before the next line; True if the rest is left out."""
        if self._left == (name, len(done)):
            self._leave(*self._left)
        while not self.skipped:
            wish = self._watcher.between_lines(self._view, name, len(done), len(lines))
            for number in wish.again:
                done[number - 1] = self._line(name, lines, number - 1, first, again=True)
            if wish.stop:
                raise Stopped(signals.SIGINT)
            if wish.skip:
                self._leave(name, len(done))
            if not wish.again:
                break
        return self.skipped

    def _leave(self, name: str, done: int) -> None:
        """Leave the rest of the view out, here and whenever it is resumed or played again."""
        self.journal.leave(name, done)
        self.skipped = True

    def _line(
        self, name: str, lines: Sequence[IntArray], place: int, first: int, again: bool = False
    ) -> Measured:
        """Scan one line; its number in the view makes a repeated one the same on a virtual lab.

        One that is scanned again on purpose gets a number of its own, and so another noise.
        """
        assert self._wanted is not None
        dac, number, scanned = lines[place], first + place, False
        if again:
            number, self._repeated = self._repeated, self._repeated + 1

        def measure() -> Measured:
            nonlocal scanned
            scanned = True
            return self._measure(dac, number)

        where = line_name(name, place)
        if again:
            samples = self.journal.replaced(where, dac, self._wanted, measure)
        else:
            samples = self._kept(where, dac, measure)
        self.lines_done += not again
        told = (name, place + 1, len(lines), dac, samples, not scanned, again)
        self._watcher.line_done(LineDone(self._view, self.kind, *told, self._wanted, self.signal))
        return samples


def _alike(kept: Sequence[IntArray], lines: Sequence[IntArray], within: float, lost: int) -> bool:
    """Tell whether recorded lines are those that are asked for, placed by other estimates.

    There are as many of them but for those lost, of as many pixels but for one, and the boxes
    around both end at the same steps within some.
    """
    if abs(len(kept) - len(lines)) > lost or abs(len(kept[0]) - len(lines[0])) > min(lost, 1):
        return False
    ends = [
        np.concatenate([every.min(axis=0), every.max(axis=0)])
        for every in (np.concatenate(kept), np.concatenate(lines))
    ]
    return bool(np.abs(ends[0] - ends[1]).max() <= within)


@dataclass(frozen=True)
class ViewContext:
    """One view, from the first pixel to the last.

    Attributes
    ----------
    view : str
    camera : Camera
        Its `instrument` is opened when something asks for it.
    laser : TwoMirror
    target : Target or None
    operator : Operator
    poses : dict of str to KnownPose
        The view's rough pose once its circles have corrected it, for what is scanned after them.
    guide : callable, optional
        Makes who tells a person where marks lie.
    findings : list of Finding
        What is wrong with what was scanned.
    """

    view: str
    camera: Camera
    laser: TwoMirror
    target: Target | None
    operator: Operator
    poses: dict[str, KnownPose] = field(default_factory=dict)
    guide: GuideMaker | None = None
    findings: list[Finding] = field(default_factory=list)
