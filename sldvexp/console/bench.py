"""Aims and scans as the controller wishes, in the one thread that has the instrument.

The instrument is opened when something needs it, and left (mirrors home, generator off) when the
controller has gone, when another view is chosen, and when it fails. While nothing is wished, a
quick look that was begun goes on from coarse to fine, and then the level is told where the beam
stands.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from typing import Any

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.console.board import NoticeBoard
from sldvexp.console.drawing import drawn_layout
from sldvexp.console.marks import (
    CIRCLE,
    CORNER,
    CORNERS,
    FIDUCIAL,
    AimedMarks,
    Name,
    Steps,
    kind_of,
    parts_of,
    view_names,
    wanted,
)
from sldvexp.console.marks_told import UNMOVED, marks_told
from sldvexp.console.outlook import Foresight, Outlook
from sldvexp.console.spots import SpotsSeen
from sldvexp.console.wishes import Wish, pair_of, text_of
from sldvexp.errors import UserError
from sldvexp.instrument import Acquisition, Instrument, InstrumentError, RawSamples
from sldvexp.instrument import bench as aids
from sldvexp.instrument.person import mark_label
from sldvexp.instrument.protocol import CHANNELS
from sldvexp.scan import Sampling
from sldvexp.session.records import acquisition_of
from sldvexp.signal import Flag, SignalEstimator
from sldvexp.signal.sine_fit import SineFit
from sldvexp.stopping import undisturbed
from sldvexp.typing import Array, IntArray

#: Wishes that follow another one, which may have failed: the page's, not the person's.
FOLLOWS = ("release", "kind")

#: How often the level is told, s; and how often an instrument that has failed is tried again, s.
LEVEL, RETRY = 0.25, 2.0
#: How long the parts of a quick look take about, s, between which wishes are heard; and their most
#: pixels.
PART, MOST = 0.2, 256
#: How long the line of a broadband scan is looked for at which most moves, s, and at how many
#: places at most.
SPENT, MOST_PLACES = 4.0, 16
#: Amplitude over the largest in a coarse look, from which a place is on what moves.
MOVES = 0.1
#: Cells along a side of a quick look, from coarse to fine.
FINENESS = (8, 16, 32, 64, 128)
#: A mirror that is held moves on so often, s, and only while the page says so so often, s.
STRIDE, HELD = 0.05, 0.6
#: Pictures of the camera are not taken more often than this, s.
PICTURE = 0.2
MILLI = 1e3
#: How an instrument is left.
HOME = "the mirrors are home and the generator is off"
#: Place of the reference among the channels.
REFERENCE = CHANNELS.index("reference")
#: Numbers of spots at most.
MOST_SPOTS = 10_000


class AimingBench:
    """Aims, and scans.

    Parameters
    ----------
    experiment : Experiment
        With ready plugins; the instrument scans.
    board : NoticeBoard
        Where browsers see what happens.
    wishes : queue of dict
        Of the controller.
    further : dict of str to callable, optional
        What else can be wished, with the wish: a scan, a file.
    """

    def __init__(
        self,
        experiment: Experiment,
        board: NoticeBoard,
        wishes: queue.Queue[Wish],
    ) -> None:
        self.experiment, self.board, self.wishes = experiment, board, wishes
        self.marks = AimedMarks()
        self.views = view_names(experiment)
        self.view = self.views[0]
        self.wanted = wanted(experiment)
        self._signal: SignalEstimator = experiment.signal or SineFit()
        self.outlook = Outlook(experiment, self.wanted)
        self.spots: dict[str, SpotsSeen] = {}
        self.kind = next(iter(self.wanted), "")
        self.beam: Steps = (0, 0)
        self._led: tuple[Name, Steps] | None = None  # mark whose prediction has brought it there
        self.steered = self.used = False
        self.further: dict[str, Callable[[Wish], None]] = {}
        self.answered: Callable[[], None] = lambda: None
        self.changed: Callable[[], None] = lambda: None  # told of the marks
        self._opened = ExitStack()
        self._instrument: Instrument | None = None
        self._set: Acquisition | None = None
        self._look: Iterator[tuple[IntArray, int]] | None = None
        self._held: tuple[Steps, float] | None = None
        self._pace = PART
        self._tone: float | None = None  # of the last look at a broadband part, Hz
        self._seen: list[tuple[int, IntArray, Any, Any]] | None = None  # coarsely, to find it
        self._window: tuple[Steps, Steps] = ((0, 0), (0, 0))
        self._silent = False  # whether the instrument has failed
        self._photographed = (0.0, (0, 0), "")
        self._complaint = 0.0  # when the problem was said that stands, 0 if none does
        self._begin()

    def serve(self) -> None:
        """Do what is wished, until Ctrl-C.

        Raises
        ------
        UserError
            If the instrument cannot be left as it should be.
        """
        try:
            while True:
                self.turn()
        finally:
            try:
                self.leave()
            except InstrumentError as error:
                raise UserError(str(error)) from error

    def turn(self) -> None:
        """Hear the next wish, or go on with what there is to do without one."""
        busy = self._look is not None or self._held is not None
        rest = RETRY if self._silent else LEVEL
        patience = 0.0 if self._look else STRIDE if busy else rest
        try:
            wish = self.wishes.get(timeout=patience) if patience else self.wishes.get_nowait()
        except queue.Empty:
            self._safely(self._idle)
            return
        self._safely(lambda: self._do(wish))

    def say(self, text: str, problem: bool = False) -> None:
        """Tell the controller something in a sentence."""
        now = time.time()
        self._complaint = now if problem else 0.0
        self.board.tell("said", {"text": text, "problem": problem, "at": now})

    @property
    def left_as(self) -> str:
        """Say how the instrument is left at the end."""
        if self._silent:
            return "the instrument did not answer at last: see to its mirrors and its generator"
        return HOME if self.used else "no instrument was opened"

    def doubt(self) -> None:
        """Take it that the instrument has failed until it answers, which is said then."""
        self._silent = True

    def leave(self) -> None:
        """Leave the instrument, whose mirrors go home and whose generator is off then."""
        self._look, self._held, self._set = None, None, None
        opened, self._opened, self._instrument = self._opened, ExitStack(), None
        self.beam, self._led = (0, 0), None
        try:
            with undisturbed():
                opened.close()
        finally:  # an instrument that is lost shows nothing either
            self._photographed = (0.0, (0, 0), "")
            self.board.begin("camera")
            self.board.tell("level", None)
            self.board.tell("looking", False)
            self._tell_beam()

    def settings(self) -> dict[str, Any]:
        """Make the part ``scan`` of a configuration of what was aimed; empty if nothing was."""
        ahead = {view: self.foresight(view).predicted for view in self.views}
        return self.marks.settings(self.experiment, ahead)

    def foresight(self, view: str) -> Foresight:
        """Tell what the marks of a view tell, its rough pose, and what was seen there."""
        return self.outlook.of(self.marks.telling(view), view, self.spots.get(view))

    def contradictions(self) -> str:
        """Say which marks of the views contradict one another; empty if none do."""
        wrong = ((view, self.foresight(view).wrong) for view in self.views)
        return "; ".join(f"view {view}: {told}" for view, told in wrong if told)

    # ---- what is wished ----

    def _do(self, wish: Wish) -> None:
        name = wish["do"]
        known = {
            "taken": self._taken,
            "lost": self._lost,
            "move": self._move,
            "go": self._go_there,
            "nudge": self._nudge,
            "hold": self._hold,
            "release": self._release,
            "mark": self._mark,
            "forget": self._forget,
            "undo": self._undo,
            "redo": self._redo,
            "view": self._choose_view,
            "add_view": self._add_view,
            "kind": self._choose_kind,
            "look": self._begin_look,
            "stop_look": self._stop_look,
            **self.further,
        }
        if name not in known:
            raise UserError("that cannot be done now")
        before = self._complaint
        known[name](wish)
        if before and before == self._complaint and name not in FOLLOWS:
            self.say("")  # what was done since has overtaken it

    def _taken(self, wish: Wish) -> None:
        self.steered = True
        self.say("")

    def _lost(self, wish: Wish) -> None:
        self.steered = False
        self.leave()
        self.say(f"Nobody is steering: {HOME}.")

    def _move(self, wish: Wish) -> None:
        self._go(pair_of(wish.get("to")))

    def _go_there(self, wish: Wish) -> None:
        """Go to where a mark is, or is predicted; a pose is made of fiducials alone."""
        name = self._named(wish)
        self._go(pair_of(wish.get("to")))
        if name[0] == FIDUCIAL and name not in self.marks.telling(self.view):
            self._led = name, self.beam

    def _nudge(self, wish: Wish) -> None:
        by = pair_of(wish.get("by"))
        self._go((self.beam[0] + by[0], self.beam[1] + by[1]))

    def _hold(self, wish: Wish) -> None:
        """Move on and on, as long as the page says again and again that it is held."""
        self._held = (pair_of(wish.get("by")), time.monotonic() + HELD)

    def _release(self, wish: Wish) -> None:
        self._held = None

    def _mark(self, wish: Wish) -> None:
        """Take the beam's place for the mark that is meant."""
        name = self._named(wish)
        unmoved = self._led == (name, self.beam)
        self.marks.put(self.view, name, self.beam, unmoved)
        if unmoved:
            self.say(f"{mark_label(name[1]).capitalize()}: {UNMOVED}.")
        self._tell_marks()

    def _forget(self, wish: Wish) -> None:
        self.marks.put(self.view, self._named(wish), None)
        self._tell_marks()

    def _undo(self, wish: Wish) -> None:
        self._tell_change(self.marks.undo())

    def _redo(self, wish: Wish) -> None:
        self._tell_change(self.marks.redo())

    def _choose_view(self, wish: Wish) -> None:
        name = text_of(wish, "name")
        if name not in self.views:
            raise UserError("there is no such view")
        self.leave()
        self.view = name
        self.board.begin("raster", view=name)
        self._tell_marks()
        if not self.experiment.instrument.takes_views_itself:
            self.say(f"See that the instrument stands where the view {name} is measured from.")

    def _add_view(self, wish: Wish) -> None:
        """Add a view, named by the next number that is free."""
        taken = set(self.views)
        name = next(str(k) for k in range(1, len(taken) + 2) if str(k) not in taken)
        self.views.append(name)
        self._choose_view({"name": name})

    def _choose_kind(self, wish: Wish) -> None:
        """Sample as the part does whose marks come next."""
        kind = text_of(wish, "kind")
        if kind not in self.wanted:
            raise UserError("the scan has no such marks")
        if self._look is not None and kind != self.kind:
            self._stop_look({})  # its other half would show what moves in another part
        self.kind = kind
        self._tell_marks()

    def _begin_look(self, wish: Wish) -> None:
        low, high = pair_of(wish.get("low")), pair_of(wish.get("high"))
        board = self.experiment.laser.board.value
        low = (max(low[0], board[0]), max(low[1], board[0]))
        high = (min(high[0], board[1]), min(high[1], board[1]))
        if low[0] >= high[0] or low[1] >= high[1]:
            raise UserError("there is nothing to look at: the region is outside the board's range")
        self._begin_parts(low, high)
        if (full := self._full()).drive is not None:
            corners, count = self._corners(), places_within(full)
            if len(corners) == CORNERS:
                least, most = corners.min(axis=0), corners.max(axis=0)
                self._find_tone(least + (most - least) * aids.spread_out(count))
            else:
                self._seen = []

    def _begin_parts(self, low: Steps, high: Steps) -> None:
        """Begin a quick look."""
        self._look, self._window, self._seen = self._parts(low, high), (low, high), None
        self.spots.setdefault(self.view, SpotsSeen()).begin()
        self.board.begin("raster", view=self.view)
        self.board.tell("looking", True)

    def _find_tone(self, places: Array) -> bool:
        """Find the line of a broadband part at which most moves, to look at by a sine.

        One record is taken at some places. An instrument that cannot play it is looked at in the
        middle of the band.
        """
        self._set, before = None, self._tone
        with suppress(InstrumentError):
            instrument, dac = self._opened_in_view(), np.rint(places).astype(np.int64)
            self._tone = aids.strongest_line(instrument, self._full(), dac)
        return self._tone not in (None, before)

    def _seek(self, cell: int) -> bool:
        """Find that line all over what moves in the coarsest look, once this is over; true if so.

        Where most moves at one frequency would be a place of few modes only.
        """
        if self._seen is None or cell == self._seen[0][0]:
            return False
        _, dac, value, flags = zip(*self._seen, strict=True)
        self._seen = None
        moves = np.where(np.concatenate(flags) == 0, np.concatenate(value), 0.0)
        there = np.flatnonzero(moves >= MOVES * moves.max())
        chosen = np.linspace(0, len(there) - 1, places_within(self._full())).round().astype(int)
        return self._find_tone(np.concatenate(dac)[there[np.unique(chosen)]])

    def _corners(self) -> IntArray:
        """Give the corners of the region as marked or predicted, (corner, 2), as many as known."""
        marks = self.marks.of(self.view)
        every = {**self.foresight(self.view).predicted, **marks}
        return np.array([dac for (kind, _), dac in every.items() if kind == CORNER], np.int64)

    def _stop_look(self, wish: Wish) -> None:
        self._look = None
        self.board.tell("looking", False)
        if self._instrument is not None:
            self._instrument.move(self.beam)

    def _named(self, wish: Wish) -> tuple[str, int]:
        kind, number = text_of(wish, "kind"), wish.get("number")
        known = self.wanted.get(kind)
        if type(number) is not int or not 1 <= number <= MOST_SPOTS:
            raise UserError("there is no such mark")
        if known is None or (known and number not in known):
            raise UserError("there is no such mark")
        return kind, number

    # ---- without a wish ----

    def _idle(self) -> None:
        if not self.steered:
            return
        if self._held is not None:
            by, until = self._held
            if time.monotonic() > until:
                self._held = None
            else:
                self._go((self.beam[0] + by[0], self.beam[1] + by[1]))
        elif self._look is not None:
            self._look_on(self._look)
        else:
            self._tell_level()

    def _look_on(self, look: Iterator[tuple[IntArray, int]]) -> None:
        """Scan the next part of a quick look."""
        part = next(look, None)
        if part is None:
            if self.kind == CIRCLE and self.spots[self.view].end():
                self._tell_marks()
            self._stop_look({})
            return
        dac, cell = part
        if self._seen and self._seek(cell):
            self._begin_parts(*self._window)
            return
        began = time.monotonic()
        samples = self._ready().scan(dac)
        self._pace = max((time.monotonic() - began) / len(dac), 1e-6)
        value, flags, _ = self._amplitude(samples)
        reference = _peaks(samples)[:, REFERENCE].astype(np.float32)
        arrays = [dac.astype(np.int32).ravel(), value, flags, reference]
        assert self._set is not None
        drive = self._full().drive
        among = 1 if drive is None or self._tone is None else len(drive.lines)
        how = {"frequency": self._set.excitation[0], "among": among}
        self.board.add("raster", arrays, cell=cell, **how)
        if self.kind == CIRCLE and self.spots[self.view].add(cell, dac, value, flags):
            self._tell_marks()
        if self._seen is not None:
            self._seen.append((cell, dac, value, flags))

    def _parts(self, low: Steps, high: Steps) -> Iterator[tuple[IntArray, int]]:
        """Yield the pixels of a quick look, coarse to fine, with the size of their cells."""
        side = max(high[0] - low[0], high[1] - low[1])
        for count in FINENESS:
            cell = side / count
            if cell < 1:
                return
            axes = [np.arange(a + cell / 2, b, cell) for a, b in zip(low, high, strict=True)]
            grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
            pixels = np.rint(grid).astype(np.int64)
            at = 0
            while at < len(pixels):
                size = int(np.clip(PART / self._pace, 1, MOST))
                yield pixels[at : at + size], int(np.ceil(cell))
                at += size

    # ---- the instrument ----

    def _ready(self) -> Instrument:
        """Give the instrument in the view, sampling quickly, as the part that is aimed at does."""
        instrument = self._opened_in_view()
        wanted = self._sampling()
        if self._set != wanted:
            instrument.configure(wanted)
            self._set = wanted
        return instrument

    def _opened_in_view(self) -> Instrument:
        if not self.steered:
            raise UserError("nobody is steering")
        e = self.experiment
        if self._instrument is None:
            opened = e.instrument.open(e.scene, e.laser, e.target, seed=e.seed, view=self.view)
            self._instrument = self._opened.enter_context(opened)
            self.used = True
        return self._instrument

    def _full(self) -> Acquisition:
        """Say how the part that is aimed at is sampled when it is scanned."""
        parts = [p for p in parts_of(self.experiment).values() if hasattr(p, "sampling")]
        chosen = [p for p in parts if kind_of(p) == self.kind] or parts
        return acquisition_of(chosen[0].sampling if chosen else Sampling())

    def _sampling(self) -> Acquisition:
        return aids.quick(self._full(), self._tone)

    def _go(self, to: Steps) -> None:
        """Move the beam, to the nearest place that the board has."""
        low, high = self.experiment.laser.board.value
        up_down, left_right = (min(max(step, low), high) for step in to)
        self._ready().move((up_down, left_right))
        self.beam, self._led = (up_down, left_right), None
        self._tell_beam()

    def _amplitude(self, samples: RawSamples) -> tuple[Any, Any, Any]:
        """Compute amplitudes, mm/s, flags, and standard errors of real or imaginary parts, mm/s."""
        assert self._set is not None
        image = self._signal.demodulate(
            samples.counts,
            np.arange(self._set.samples) / samples.rate,
            self._set.excitation,
            volts_per_count=samples.volts_per_count,
        )
        value = MILLI * np.abs(image.velocity[:, 0])
        flags = image.flags.astype(np.uint8)
        noise = MILLI * image.std[:, 0]
        return np.where(np.isfinite(value), value, 0.0).astype(np.float32), flags, noise

    def _safely(self, work: Callable[[], None]) -> None:
        """Do something; what goes wrong is told, and the instrument left if it was its fault."""
        try:
            work()
        except InstrumentError as error:
            self._silent = True
            with suppress(InstrumentError):
                self.leave()
            told = f"The instrument: {error}. It is tried again every {RETRY:g} s."
            self.say(told, problem=True)
        except UserError as error:
            self._look = None
            self.board.tell("looking", False)
            self.say(str(error), problem=True)

    # ---- what browsers see ----

    def _begin(self) -> None:
        e = self.experiment
        low, high = e.laser.board.value
        ways = e.laser.ways.tolist()
        layout, seen = drawn_layout(e, self.outlook.places, self.outlook.rims)
        setup = {"low": low, "high": high, "ways": ways, "wanted": self.wanted}
        self.board.tell("setup", {**setup, "layout": layout, "layout_told": seen})
        self.board.begin("raster", view=self.view)
        self.board.tell("level", None)
        self.board.tell("looking", False)
        self._tell_beam()
        self._tell_marks()

    def _tell_beam(self) -> None:
        self.board.tell("beam", list(self.beam))

    def _tell_level(self) -> None:
        """Sample where the beam stands, and tell what comes back."""
        instrument = self._ready()
        samples = instrument.acquire()
        value, flags, noise = self._amplitude(samples)
        light = aids.light_level(instrument, samples)
        told = {
            "velocity": round(float(value[0]), 4),
            "noise": float(noise[0]) if np.isfinite(noise[0]) else None,
            "reference": round(float(_peaks(samples)[0, REFERENCE]), 4),
            "light": round(light, 3),
            "flags": [flag.name for flag in Flag if flags[0] & flag],
        }
        self.board.tell("level", told)
        if self._silent:
            self._silent = False
            self.say("The instrument answers again.")
            self.answered()
        place = aids.read_position(instrument, self.beam)
        if place != self.beam:
            self.beam = place
            self._tell_beam()
        self._tell_picture(instrument)

    def _tell_picture(self, instrument: Instrument) -> None:
        when, beam, view = self._photographed
        if (beam, view) == (self.beam, self.view) or time.monotonic() < when + PICTURE:
            return
        self._photographed = (time.monotonic(), self.beam, self.view)
        if (seen := aids.picture(instrument)) is not None:
            self.board.begin("camera", arrays=[seen], rows=seen.shape[0], columns=seen.shape[1])

    def _tell_marks(self) -> None:
        told = marks_told(self.marks, self.view, self.views, self.foresight(self.view))
        self.board.tell("marks", {**told, "kind": self.kind})
        self.changed()

    def _tell_change(self, change: Any) -> None:
        """Show what was taken back or repeated, in its view."""
        if change is None:
            raise UserError("there is nothing to take back or to repeat")
        if change.view != self.view:
            self._choose_view({"name": change.view})
        self._tell_marks()


def places_within(full: Acquisition) -> int:
    """Say at how many places a record of a broadband part is taken to find its strongest line."""
    return int(np.clip(SPENT // replace(full, records=1).seconds, 1, MOST_PLACES))


def _peaks(samples: RawSamples) -> Array:
    """Find the largest sample of every pixel and channel, V."""
    most = np.abs(samples.counts.astype(np.int32)).max(axis=2)
    return np.asarray(most * samples.volts_per_count)
